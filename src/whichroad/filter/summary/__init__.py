"""What is told of an epoch."""
