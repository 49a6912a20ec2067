"""How hypotheses begin, branch, merge and end."""
