"""Every column of every table, worked out again from independent ingredients."""
