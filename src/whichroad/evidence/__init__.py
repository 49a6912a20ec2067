"""What further sensors say, as the filter takes it."""
