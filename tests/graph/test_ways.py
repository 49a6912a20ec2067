"""Routes by rivals of the cheapest one: their labels."""

import numpy as np

from whichroad.graph.labels import Reach, add_way, new_search, note_rival, write_way


def labelled(parents: list[int]):
    """A search whose labels are a chain, 100 m and one nat from each to the next."""
    search = new_search()
    for k, parent in enumerate(parents):
        label = search.label[k]
        label.cost, label.length, label.time, label.edge = k + 1.0, 100.0 * (k + 1), 10.0, k
        label.parent, label.rival, label.twin, label.same = parent, -1, -1, -1
    search.run[0].labels = len(parents)
    search.way[0].before = search.way[0].join = -1
    search.way[0].label = len(parents) - 1
    return search


def test_a_way_by_a_rival_avoids_the_label_before():
    """0, 1, 2, 3 is the cheapest; label 3 was reached from 1 as well, half a nat dearer."""
    search = labelled([-1, 0, 1, 2])
    note_rival(search, 3, 1, Reach(4.5, 450.0, 12.0, 0.0))
    add_way(search, 1, 0, 3, 0)
    assert (search.way[1].cost, search.way[1].length) == (0.5, 50.0)
    last = write_way(search, 3, 1)
    label = search.label[last]
    assert (label.edge, label.parent, label.same) == (3, 1, 3)
    assert (label.cost, label.length) == (4.5, 450.0)
    assert search.rival[label.rival].parent == 2  # the cheapest way is now the rival


def test_two_rivals_of_one_way_add_up():
    search = labelled([-1, 0, 1, 2, 3])
    note_rival(search, 4, 3, Reach(5.25, 510.0, 10.0, 0.0))
    note_rival(search, 2, 0, Reach(3.5, 360.0, 10.0, 0.0))
    add_way(search, 1, 0, 4, 0)
    add_way(search, 2, 1, 2, 1)
    last = write_way(search, 4, 2)
    chain, at = [], last
    while at >= 0:
        chain.append((int(search.label[at].edge), float(search.label[at].length)))
        at = int(search.label[at].parent)
    assert chain == [(4, 570.0), (3, 460.0), (2, 360.0), (0, 100.0)]
    np.testing.assert_allclose(search.label[last].cost, 5.75)
