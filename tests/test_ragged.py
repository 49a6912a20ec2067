"""Lists of unequal length, laid end to end."""

import numpy as np

from whichroad.ragged import row_and_place


def test_each_item_has_its_list_and_its_place_in_it():
    row, place = row_and_place(np.array([2, 0, 3, 1], np.int32))
    assert row.tolist() == [0, 0, 2, 2, 2, 3]
    assert place.tolist() == [0, 1, 0, 1, 2, 0]


def test_without_items_there_are_none():
    for count in (np.zeros(0, int), np.zeros(3, int)):
        row, place = row_and_place(count)
        assert len(row) == len(place) == 0
