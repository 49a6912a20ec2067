"""Laws: what must not change the answer, or may change it only one way."""
