"""Value oracles: every column of every table computed again from independent ingredients."""
