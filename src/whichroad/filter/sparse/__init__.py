"""Fixes far apart: routes between them."""
