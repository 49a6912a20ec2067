"""What the on-line filter remembers: as a value, as bytes, in copies and from other threads."""

import copy
import math
import pickle
import threading
from dataclasses import replace

import numpy as np
import pytest

from online.avenue import (
    CAR,
    PLANE,
    STRAIGHT,
    TOWN,
    avenue,
    driven_to,
    fixes,
    records,
    said,
    seen,
    wheels,
)
from scenes import Town, network
from whichroad.errors import MapError, ReadError, SettingError
from whichroad.filter.lookback.history import new_history
from whichroad.filter.state import new_path
from whichroad.lookback import smoothing
from whichroad.observations import (
    GeoFix,
    StartPose,
    WheelTicks,
)
from whichroad.online import Estimate, Localizer, State, localizer, localizer_state
from whichroad.sensors import Compass, Height, Sensor
from whichroad.settings import Settings


def test_predicting_changes_nothing():
    online = driven_to(205)
    before = online.predict(float(STRAIGHT.time[205]))
    ahead = online.predict(float(STRAIGHT.time[205]) + 4.0)
    again = online.predict(float(STRAIGHT.time[205]))
    np.testing.assert_array_equal(said({0.0: again}), said({0.0: before}))
    assert ahead.pose.x - before.pose.x == pytest.approx(40.0, rel=0.05)
    assert ahead.cov[0, 0] > before.cov[0, 0]


@pytest.mark.parametrize("lag", [None, 5.0])
def test_a_localizer_out_of_a_pickle_goes_on_as_if_nothing_had_been(lag: float | None):
    online = Localizer(TOWN, vehicle=CAR, lag=lag)
    at = np.arange(0, 600, 10)
    seen = list(records(wheels(STRAIGHT), fixes(STRAIGHT, at)))
    for one in seen[:300]:
        online.take(one)
    again = pickle.loads(pickle.dumps(online))
    for one in seen[300:600]:
        online.take(one)
        again.take(one)
    np.testing.assert_array_equal(said({0.0: online.estimate()}), said({0.0: again.estimate()}))
    if lag is not None:
        pair = online.lagged(), again.lagged()
        np.testing.assert_array_equal(*[said({0.0: estimate}) for estimate in pair])


def test_a_copy_goes_on_alone():
    online = Localizer(TOWN, vehicle=CAR, lag=5.0)
    for one in seen(0, 300):
        online.take(one)
    before, double = repr(online.estimate()), copy.deepcopy(online)
    for one in seen(300):
        double.take(one)
    assert repr(online.estimate()) == before
    for one in seen(300):
        online.take(one)
    assert repr(online.estimate()) == repr(double.estimate())
    assert repr(online.lagged()) == repr(double.lagged())


@pytest.mark.parametrize("lag", [None, 5.0])
@pytest.mark.parametrize("until", [0, 1, 2, 3, 300])
def test_a_localizer_out_of_its_bytes_goes_on_to_the_bit(until: int, lag: float | None):
    settings, start = Settings(gnss_time=50.0), StartPose(*PLANE.to_geodetic(20.0, 0.0), 90.0)
    online = Localizer(TOWN, vehicle=CAR, settings=settings, start=start, lag=lag)
    online.update(WheelTicks(math.nan, 0.0, 0.0))
    for one in seen(0, until):
        online.take(one)
    again = Localizer.from_bytes(online.to_bytes(), TOWN)
    assert (again.vehicle, again.settings, again.lag) == (CAR, settings, lag)
    assert again.skipped == {"no time": 1}
    assert again.answered == online.answered == (until > 0)
    assert repr(again.estimate()) == repr(online.estimate())
    for one in seen(until):
        assert repr(again.update(one)) == repr(online.update(one))
    assert again.to_bytes() == online.to_bytes() or lag is not None  # its past began anew
    assert repr(again.lagged() if lag else None) == repr(online.lagged() if lag else None)


def test_a_localizer_of_fixes_alone_goes_on_to_the_bit():
    course = fixes(STRAIGHT, np.arange(0, 600, 10))
    told = [one for one in records(wheels(STRAIGHT), course) if isinstance(one, GeoFix)]
    online = Localizer(TOWN)
    for one in told[:30]:
        online.take(one)
    again = Localizer.from_bytes(online.to_bytes(), TOWN)
    assert repr(again.predict(told[30].time)) == repr(online.predict(told[30].time))
    for one in told[30:]:
        assert repr(again.update(one)) == repr(online.update(one))


def test_damaged_bytes_are_refused():
    data = driven_to(20).to_bytes()
    cut = [data[:n] for n in (0, 7, 25, len(data) - 1)]
    turned = [
        data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
        for place in range(25, len(data), 97)
    ]
    for damaged in [*cut, *turned, data + b" "]:
        with pytest.raises(ReadError, match="damaged"):
            Localizer.from_bytes(damaged, TOWN)


@pytest.mark.parametrize("given", ["text", None, 5])
def test_what_is_no_bytes_is_refused_as_a_state(given):
    with pytest.raises(ReadError, match="the bytes that Localizer"):
        Localizer.from_bytes(given, TOWN)


def test_bytes_of_another_map_are_refused():
    other = Town(network(avenue()[:-1], curvature=PLANE.curvature), PLANE)
    with pytest.raises(MapError, match="it belongs to the map"):
        Localizer.from_bytes(driven_to(20).to_bytes(), other)


def test_bytes_of_another_version_are_refused(monkeypatch):
    data = driven_to(20).to_bytes()
    with pytest.raises(ReadError, match="another version"):
        Localizer.from_bytes(data.replace(b"localizer 1", b"localizer 0"), TOWN)
    monkeypatch.setattr(localizer_state, "_RECORDS", "records with other fields")
    with pytest.raises(ReadError, match="another version"):
        Localizer.from_bytes(data, TOWN)


def test_a_state_kept_with_another_lag_is_refused():
    state = driven_to(20).state()
    assert isinstance(state, State)
    with pytest.raises(SettingError, match="stored with lag=None"):
        Localizer(TOWN, vehicle=CAR, lag=5.0).restore(state)


def test_a_state_of_another_vehicle_is_refused():
    online, other = driven_to(20), replace(CAR, metres_per_tick_left=0.005)
    one = Localizer(TOWN, vehicle=other)
    before = one.to_bytes()
    with pytest.raises(SettingError, match=r"metres_per_tick_left=0\.01; 0\.005 was"):
        one.restore(online.state())
    assert one.to_bytes() == before
    assert Localizer.from_bytes(online.to_bytes(), TOWN, vehicle=other).vehicle == other


@pytest.mark.parametrize(
    ("sensors", "here"), [([], "none"), ([Height()], "height"), ([Height(), Compass()], "height, ")]
)
def test_a_state_of_other_sensors_is_refused(sensors: list[Sensor], here: str):
    online = Localizer(TOWN, vehicle=CAR, sensors=[Compass()])
    for one in seen(0, 50):
        online.update(one)
    with pytest.raises(SettingError, match=f"the further sensors compass; {here}"):
        Localizer.from_bytes(online.to_bytes(), TOWN, sensors=sensors)
    with pytest.raises(SettingError, match="the further sensors none; compass was expected"):
        Localizer.from_bytes(driven_to(20).to_bytes(), TOWN, sensors=[Compass()])
    again = Localizer.from_bytes(online.to_bytes(), TOWN, sensors=[Compass()])
    assert again.to_bytes() == online.to_bytes()


@pytest.mark.parametrize(
    "ask", ["predict", "estimate", "to_bytes", "diagnosis", "sensor_states", "last_rows", "lagged"]
)
def test_who_asks_from_another_thread_disturbs_nothing(ask: str):
    """Kernels let other threads run: what they share must wait for them."""
    alone, online = (Localizer(TOWN, vehicle=CAR, lag=5.0) for _ in range(2))
    done, asked = threading.Event(), 0
    answers = {"predict": lambda: online.predict(online.estimate().time + 0.05)}

    def feed() -> None:
        for one in seen():
            online.take(one)
        done.set()

    thread = threading.Thread(target=feed)
    thread.start()
    while not done.is_set():
        found = answers.get(ask, lambda: getattr(online, ask))()
        asked += 1
        if callable(found):
            found = found()
        if isinstance(found, Estimate) and found.answered:
            assert np.linalg.eigvalsh(found.cov).min() > 0.0
    thread.join()
    assert asked
    for one in seen():
        alone.take(one)
    assert repr(online.estimate()) == repr(alone.estimate())
    assert repr(online.lagged()) == repr(alone.lagged())


def test_a_call_waits_for_the_call_of_another_thread():
    online, entered = driven_to(100), threading.Event()
    before = online.estimate().time

    def feed() -> None:
        entered.set()
        online.update(WheelTicks(before + 0.1, 2000.0, 2000.0))

    with online._lock:
        thread = threading.Thread(target=feed)
        thread.start()
        assert entered.wait(60.0)
        assert online.estimate().time == before
    thread.join(60.0)
    assert online.estimate().time == before + 0.1


def test_predicting_leaves_the_estimate_as_it_was():
    online = driven_to(205)
    before = repr(online.estimate())
    online.predict(30.0)
    assert repr(online.estimate()) == before


def test_an_estimate_stays_as_it_was_when_the_filter_goes_on():
    """Nothing of it was asked for before."""
    online, other = driven_to(205), driven_to(205)
    kept, now = online.estimate(), other.estimate()
    expected = repr(now), now.hypotheses, now.reason, now.map_pose, now.matched, now.speed
    for one in seen(400):
        online.take(one)
    online.predict(100.0)
    found = repr(kept), kept.hypotheses, kept.reason, kept.map_pose, kept.matched, kept.speed
    assert repr(found) == repr(expected)
    with pytest.raises(AttributeError):
        kept.time = 0.0


@pytest.mark.parametrize("steps", [1, 1 << 12])
def test_tables_of_the_past_that_grow_change_no_estimate(monkeypatch, steps: int):
    """The kernel is bound to its tables: it must go on with those that take their place."""
    monkeypatch.setattr(smoothing, "new_history", lambda _: new_history(steps))
    monkeypatch.setattr(localizer, "new_path", lambda _: new_path(2050))  # 2 entries are free
    online, alone = Localizer(TOWN, vehicle=CAR, lag=5.0), Localizer(TOWN, vehicle=CAR)
    history, tree = online._past.history, online._filter.path
    for one in seen():
        assert repr(online.update(one)) == repr(alone.update(one))
    assert online._filter.path is not tree
    assert (online._past.history is not history) == (steps == 1)
    assert online._filter.history is online._past.history
    monkeypatch.undo()
    roomy = Localizer(TOWN, vehicle=CAR, lag=5.0)
    for one in seen():
        roomy.take(one)
    assert repr(online.lagged()) == repr(roomy.lagged())
    assert online.decided_until == roomy.decided_until
