"""Fixes: their rows, noise and faults."""
