"""Drivers who break a rule are found, and the rule is named."""

import numpy as np
import pytest

import whichroad
from demands.town import corners, fixes
from whichroad.simulate import MapBuilder

BLOCK = 150.0
RULES = {"against_one_way": {"oneway": "yes"}, "turn_banned": {}, "no_access": {"access": "no"}}


def map_with(rule: str) -> whichroad.RoadMap:
    """Five by five crossings; from `22` northwards a rule is broken by who comes from the west."""
    builder = MapBuilder()
    for r in range(5):
        for c in range(5):
            builder.node(f"{r}{c}", c * BLOCK, r * BLOCK)
    for k in (0, 1, 3, 4):
        builder.way([f"{k}{c}" for c in range(5)], "residential", name=f"Row {k}")
        builder.way([f"{r}{k}" for r in range(5)], "residential", name=f"Column {k}")
    west = builder.way(["20", "21", "22"], "residential", name="Row 2")
    builder.way(["22", "23", "24"], "residential", name="Row 2")
    builder.way(["02", "12", "22"], "residential", name="Column 2")
    north = builder.way(["42", "32", "22"], "residential", name="North", **RULES[rule])
    if rule == "turn_banned":
        builder.restrict("no_left_turn", west, "22", north)
    return builder.compiled()


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("seed", range(3))
def test_a_rule_that_is_broken_is_seen_and_named(rule, seed):
    roads = map_with(rule)
    line = corners("20", "22", "42")
    line[-1] -= [0.0, 30.0]
    result = whichroad.match(fixes(line, sigma=3.0, seed=seed), roads)
    names = [roads.attributes(int(e))["name"] for e in result.path.edge_id]
    assert names[-1] == "North"
    assert "Column 2" not in names
    broken = result.path.broken_rule[np.array(names) == "North"]
    assert any(rule in str(text) for text in broken)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("seed", range(3))
def test_who_keeps_the_rules_is_not_accused(rule, seed):
    line = corners("20", "22", "02")
    line[-1] += [0.0, 30.0]
    result = whichroad.match(fixes(line, sigma=3.0, seed=seed), map_with(rule))
    assert result.path.broken_rule.isna().all()
