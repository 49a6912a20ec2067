"""What users of map matchers ask for, as drives through a small town."""
