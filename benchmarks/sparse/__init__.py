"""Fixes one to sixty seconds apart, beside the peers (`python -m benchmarks sparse`)."""
