"""What each sensor observes: one file each, from readings to what the filter takes."""
