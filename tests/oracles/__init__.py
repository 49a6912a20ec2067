"""Slow and obviously right versions of what the kernels do."""
