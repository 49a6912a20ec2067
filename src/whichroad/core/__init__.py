"""The compiled floor: floats and arrays, no files, no degrees, raises nothing."""
