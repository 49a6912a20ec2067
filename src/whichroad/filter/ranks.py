"""The record of an epoch's ranked edges; it holds for as long as no weight changes."""

import numpy as np

ALTERNATIVES = 6  # ranked edges

RANKING = np.dtype(
    [
        ("known", "u1"),  # 1: it is that of the weights as they are
        ("unknown", "f8"),  # P of what no hypothesis knows, by which it was made
        ("edge", "i4", (ALTERNATIVES,)),  # the most probable edges, in order
        ("p", "f4", (ALTERNATIVES,)),
        ("row", "i4", (ALTERNATIVES,)),  # the hypothesis of the largest weight on each
        ("chosen", "i4"),  # the edge that is told: the most probable one
        ("best", "i4"),  # the heaviest hypothesis on it, -1: none
        ("p_chosen", "f8"),  # of all hypotheses on it, where all of P is known
        ("facing", "f8"),  # P of its opposite direction
        ("chain", "i8"),  # ranked edges of its way, as bits; 0: it is alone
        ("p_chain", "f8"),  # of these
    ],
    align=True,
)
