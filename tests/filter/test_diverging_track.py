"""Fixes as fast as the odometer, on another track than the belief: it is looked for there."""

import numpy as np
import pytest

from laws.drives import said
from scenes import columns, drive_along, epochs_of, gnss, network
from whichroad.filter.gnss.diverging_track import follow_track, has_diverged, may_have_turned
from whichroad.filter.motion import arc_chord
from whichroad.filter.state import H, new_belief

CROSS = [
    [[0.0, 0.0], [600.0, 0.0]], [[600.0, 0.0], [1600.0, 0.0]],
    [[600.0, 0.0], [600.0, 1000.0]], [[600.0, 0.0], [600.0, -1000.0]],
]  # fmt: skip


def found(off: float, turned: float, unsure: float = 0.1) -> int:
    """After how many seconds another track of its fixes is seen; 0: never."""
    belief = new_belief()
    state = belief.state[0]
    state.count = 1
    vetting = state.vetting
    vetting.track, vetting.track_sigma = 0.0, 0.1
    follow_track(belief, 1.0)
    belief.hyp[0].mu[H] = 2.0 * np.pi - off
    vetting.windows.now.turn, vetting.track_sigma = turned, unsure
    for second in range(1, 10):
        follow_track(belief, 1.0)
        if has_diverged(belief):
            assert not has_diverged(belief)  # once
            return second
    return 0


@pytest.mark.parametrize(
    ("off", "turned", "seconds"),
    [(0.7, 0.7, 3), (-0.7, -0.4, 3), (0.7, 0.1, 0), (1.5, 0.0, 3), (0.4, 0.4, 0)],
)
def test_odometry_must_have_turned_or_directions_differ_by_far(off, turned, seconds):
    assert found(off, turned) == seconds


@pytest.mark.parametrize("unsure", [0.5, np.inf])
def test_a_direction_that_is_not_sure_says_nothing(unsure: float):
    assert found(0.7, 0.7, unsure) == 0


def test_turns_that_fixes_do_not_show_may_have_been_wrong_by_as_much():
    belief = new_belief()
    belief.state[0].count = 1
    belief.state[0].vetting.track_sigma = 0.1
    belief.hyp[0].mu[H] = 1.0
    assert may_have_turned(belief) == pytest.approx(1.2)
    belief.hyp[0].mu[H] = 0.3
    assert may_have_turned(belief) == 0.0


@pytest.mark.parametrize("by", [-1.57, 0.8])
@pytest.mark.parametrize("speed", [6.0, 12.0])
def test_a_turn_that_was_none_leads_nowhere(speed: float, by: float):
    """It fits the road to the right, and the vehicle drives straight on."""
    truth = drive_along([[0.0, -1.75], [1500.0, -1.75]], speed=speed)
    fix = gnss(truth, sigma=2.0, seed=1)
    epochs = epochs_of(truth, fix, np.arange(0, len(truth.time), 10), course=0.1)
    at = int(10.0 * 595.0 / speed)
    for epoch in epochs[at : at + 20]:
        epoch.turn = by / 20.0
        epoch.forward, epoch.left = arc_chord(epoch.arc, epoch.turn)
    told = said(network(CROSS), epochs, [[2]])
    error = np.hypot(*(columns(told.output, "x y") - np.column_stack([truth.x, truth.y])).T)
    assert error[at + 100 :].max() < 15.0
    assert told.p[at + 100 :].min() > 0.9


@pytest.mark.parametrize("seed", range(3))
def test_a_vehicle_that_is_on_another_track_at_its_speed_is_looked_for_there(seed: int):
    """Its odometry turned right, and fixes followed; then they are on the road straight on."""
    right = drive_along([[0.0, -1.75], [598.25, -1.75], [598.25, -900.0]])
    straight = drive_along([[0.0, -1.75], [1500.0, -1.75]])
    n, at = len(right.time), 700
    fix = gnss(right, sigma=2.0, seed=seed)
    fix[at:] = gnss(straight, sigma=2.0, seed=seed)[at:n]
    told = said(network(CROSS), epochs_of(right, fix, np.arange(0, n, 10), course=0.1), [[2], [6]])
    assert told.p[at - 10, 1] > 0.99
    assert told.p[at + 80, 1] < 0.6
    assert told.p[at + 150 :, 0].min() > 0.9
