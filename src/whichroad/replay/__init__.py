"""A recorded drive or its answer, shown again: on the page, or as one file to mail."""
