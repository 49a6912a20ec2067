"""What later observations tell of before: history, smoothing, the path driven."""
