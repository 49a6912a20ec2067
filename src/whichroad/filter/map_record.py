"""The record of what a drive has shown of the map's error, see `filter.map_error`."""

import numpy as np

MAP_ERROR = np.dtype(
    [
        ("factor", "f8"),  # variance of the map's error about its mean, over map_sigma²
        ("local", "f8"),  # of it, what is not the uncertainty of that mean
        ("prior", "f8"),  # of the hypotheses' own, before any road was seen
        ("whole", "f8", (2,)),  # mean of the map's error: how far the map is off as a whole, m
        ("energy", "f8", (2,)),  # what roads have told of its size: seen, and known
        ("information", "f8", (3,)),  # what they have told of its mean: xx, xy, yy, 1/m²,
        ("towards", "f8", (2,)),  # and that times the mean, 1/m
        ("moments", "f8", (3,)),  # over the way: lengths, and lengths times the error, m
        ("offset", "f8", (4,)),  # how far fixes are off from roads: lengths, square, and mean
    ],
    align=True,
)
