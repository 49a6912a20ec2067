"""The documents: their code runs, their words are short, the reference is complete."""
