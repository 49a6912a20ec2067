"""Turn restrictions of OpenStreetMap: what they ban, and which are counted instead."""

import numpy as np
import pytest

from whichroad.graph.network import TURN_BANNED, U_TURN

CROSS = {1: (0, 0), 2: (100, 0), 3: (0, 100), 4: (-100, 0), 5: (0, -100)}
ARMS = [(10, [1, 2], {}), (20, [1, 3], {}), (30, [1, 4], {}), (40, [1, 5], {})]


def restriction(kind, origin, via, target, **tags):
    members = (("way", origin, "from"), ("node", via, "via"), ("way", target, "to"))
    return {"type": "restriction", "restriction": kind, **tags}, members


@pytest.mark.parametrize(
    ("rule", "banned"),
    [
        (restriction("no_left_turn", 30, 1, 20), {(4, 3)}),
        (restriction("no_straight_on", 30, 1, 10), {(4, 2)}),
        (restriction("only_straight_on", 30, 1, 10), {(4, 3), (4, 5), (4, 4)}),
        (restriction("no_u_turn", 30, 1, 30), {(4, 4)}),
        (restriction("no_left_turn", 30, 1, 20, **{"except": "psv"}), {(4, 3)}),
        (restriction("no_left_turn", 30, 1, 20, **{"except": "psv;motorcar"}), set()),
    ],
)
def test_turn_restrictions_ban_what_they_say(osm, check, rule, banned, turn):
    roads = osm(CROSS, ARMS, [rule])
    check(roads)
    seen = {
        (start, end)
        for start in (2, 3, 4, 5)
        for end in (2, 3, 4, 5)
        if turn(roads, start, 1, end)[2] & TURN_BANNED
    }
    assert seen == banned


def test_a_restriction_for_cars_is_heard_and_one_for_lorries_is_not(osm, turn):
    members = restriction("", 30, 1, 20)[1]
    cars = {"type": "restriction", "restriction:motorcar": "no_left_turn"}
    lorries = {"type": "restriction", "restriction:hgv": "no_left_turn"}
    hours = {"type": "restriction", "restriction:conditional": "no_left_turn @ (07:00-09:00)"}
    assert turn(osm(CROSS, ARMS, [(cars, members)]), 4, 1, 3)[2] == TURN_BANNED
    for tags in (lorries, hours):
        roads = osm(CROSS, ARMS, [(tags, members)])
        assert turn(roads, 4, 1, 3)[2] == 0
        assert sum(roads.info()["skipped"].values()) == 1


def test_restrictions_that_cannot_be_kept_are_counted(osm):
    via_way = ("way", 30, "from"), ("way", 10, "via"), ("way", 20, "to")
    no_target = ("way", 30, "from"), ("node", 1, "via")
    elsewhere = ("way", 77, "from"), ("node", 99, "via"), ("way", 78, "to")
    tags = {"type": "restriction", "restriction": "no_left_turn"}
    mixed = ("way", 30, "from"), ("node", 1, "via"), ("way", 10, "via"), ("way", 20, "to")
    all_of_them = (via_way, no_target, elsewhere, mixed)
    roads = osm(CROSS, ARMS, [(tags, members) for members in all_of_them])
    assert roads.info()["skipped"] == {
        "restrictions via neither one node nor ways": 1,
        "restrictions without from or to": 1,
        "restrictions that touch no turn of this map": 2,  # from 10 no turn leads to 20
    }


def test_an_only_restriction_into_a_missing_street_bans_nothing(osm):
    roads = osm(CROSS, ARMS, [restriction("only_left_turn", 30, 1, 77)])
    assert not np.any(roads.arrays.turns.rule & TURN_BANNED)


def test_the_node_of_a_restriction_is_a_junction_even_on_one_street(osm, check, turn):
    nodes = {1: (0, 0), 2: (50, 0), 3: (100, 0)}
    roads = osm(nodes, [(10, [1, 2, 3], {})], [restriction("no_u_turn", 10, 2, 10)])
    check(roads)
    assert len(roads) == 4
    assert turn(roads, 1, 2, 1)[2] == TURN_BANNED | U_TURN
    assert turn(roads, 1, 2, 3)[2] == 0


#       5       6
#       |       |
#   1 - 2 - 3 - 4 - 7      20 and 30 lead from 2 to 4
#       |
#       8
LADDER = {1: (0, 0), 2: (100, 0), 3: (150, 0), 4: (200, 0), 5: (100, 90), 6: (200, 90),
          7: (300, 0), 8: (100, -90)}  # fmt: skip
ONE_WAY = {"oneway": "yes"}
WEST, SOUTH, OVER = (10, [1, 2], {}), (15, [8, 2], {}), [(20, [2, 3], {}), (30, [3, 4], ONE_WAY)]
EAST, NORTH, UP = (40, [4, 7], {}), (50, [4, 6], {}), (60, [2, 5], {})


def over(kind, origin, *ways):
    """A restriction from a way over others to the last one."""
    *between, target = ways
    members = ("way", origin, "from"), *(("way", w, "via") for w in between), ("way", target, "to")
    return {"type": "restriction", "restriction": kind}, members


def forbidden(roads):
    """Ends of the turns that are banned."""
    turns, edges, found = roads.arrays.turns, roads.arrays.edges, set()
    for e in range(len(roads)):
        for k in range(edges.first_turn[e], edges.end_turn[e]):
            if turns.rule[k] & TURN_BANNED:
                nodes = edges.from_node[e], edges.to_node[e], edges.to_node[turns.edge[k]]
                found.add(tuple(roads.node_ids(np.array(nodes))))
    return found


@pytest.mark.parametrize(
    ("ways", "rule", "banned"),
    [
        # nobody else comes to 4 over the one-way 30 but from 1
        ([WEST, *OVER, EAST, NORTH], over("no_left_turn", 10, 20, 30, 50), {(3, 4, 6)}),
        ([WEST, *OVER, EAST, NORTH], over("only_straight_on", 10, 20, 30, 40),
         {(3, 4, 6), (2, 3, 2), (3, 4, 3)}),
        # who turns into 20 can go to 40 only
        ([WEST, (15, [8, 2], ONE_WAY), *OVER, EAST], over("no_left_turn", 10, 20, 30, 40),
         {(1, 2, 3)}),
        # those from 8 may do what those from 1 may not: a turn has no memory
        ([WEST, SOUTH, *OVER, EAST, NORTH], over("no_left_turn", 10, 20, 30, 50), set()),
        ([WEST, SOUTH, *OVER, EAST, NORTH], over("only_straight_on", 10, 20, 30, 40), set()),
    ],
)  # fmt: skip
def test_a_restriction_over_ways_is_kept_where_a_turn_without_memory_can(osm, ways, rule, banned):
    roads = osm(LADDER, ways, [rule])
    assert forbidden(roads) == banned
    counted = {"restrictions via ways that bind only who came by one street": 1}
    assert roads.info()["skipped"] == ({} if banned else counted)


def test_what_is_banned_over_ways_is_what_the_restriction_bans_and_no_more(osm):
    """Of all legal routes of four edges those go that the restriction names, and no other."""
    ways = [WEST, (15, [2, 8], ONE_WAY), *OVER, EAST, NORTH]
    free, bound = osm(LADDER, ways), osm(LADDER, ways, [over("no_left_turn", 10, 20, 30, 50)])
    assert routes(free) - routes(bound) == {r for r in routes(free) if r[-5:] == (1, 2, 3, 4, 6)}


def routes(roads, most=4):
    """Nodes of every legal route of so many edges."""
    turns, edges = roads.arrays.turns, roads.arrays.edges
    ways = [(e,) for e in range(len(roads)) if not edges.rule[e]]
    for _ in range(most - 1):
        ways = [
            (*way, int(turns.edge[k]))
            for way in ways
            for k in range(edges.first_turn[way[-1]], edges.end_turn[way[-1]])
            if not turns.rule[k]
        ]
    names = roads.node_ids
    return {(*names(edges.from_node[list(way)]), *names(edges.to_node[[way[-1]]])) for way in ways}
