"""A drive in hindsight: its path, its rivals, smoothing with a lag."""
