"""Whether the settings fit the data: running statistics of a drive, and what they say."""
