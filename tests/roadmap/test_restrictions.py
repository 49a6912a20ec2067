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
    roads = osm(CROSS, ARMS, [(tags, members) for members in (via_way, no_target, elsewhere)])
    assert roads.info()["skipped"] == {
        "restrictions via ways": 1,
        "restrictions without from or to": 1,
        "restrictions that touch no turn of this map": 1,
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
