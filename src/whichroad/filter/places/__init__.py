"""Point objects, as hypotheses see them."""
