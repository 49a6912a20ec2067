"""Which sensors are believed."""
