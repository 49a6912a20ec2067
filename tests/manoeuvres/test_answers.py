"""Single drives of the manoeuvres, answered: all sensors silent, coarse fixes from the start."""

import pytest
from benchmarks.manoeuvres import How, one
from benchmarks.manoeuvres.cases import SCENES
from benchmarks.manoeuvres.counting import Counted


def counted(scene: str, what: str, suite: str, seed: int) -> Counted:
    """What is said of one drive."""
    case = next(c for c in SCENES[scene] if c.what == what)
    return one(scene, case, suite, seed, How())


@pytest.mark.parametrize(
    ("what", "seed"),
    [("10 s", 1001), ("10 s", 1005), ("30 s, then dark", 1000), ("30 s, then dark", 1003)],
)
def test_after_a_silence_of_all_sensors_nothing_is_claimed_of_the_way_meanwhile(
    what: str, seed: int
):
    found = counted("silence", what, "yaw", seed)
    assert found.declared > 500
    assert found.wrong == found.pose.exceeded == 0


@pytest.mark.parametrize(("what", "seed"), [("60 m", 1103), ("200 m", 1001)])
def test_wheels_beside_coarse_fixes_find_their_road_by_the_map(what: str, seed: int):
    found = counted("coarse", what, "wheels", seed)
    assert found.declared > 2000
    assert found.wrong == found.pose.exceeded == 0
