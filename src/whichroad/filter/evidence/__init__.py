"""Rows of further sensors."""
