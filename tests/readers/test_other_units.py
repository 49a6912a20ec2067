"""Speeds in another unit than their column says are not used, drive by drive."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from demands.town import corners, fixes, roads
from readers.test_resampled import PLANE, driven
from whichroad import match, match_many
from whichroad.observations import OTHER_UNIT
from whichroad.readers import drive_from_table

MPH, KNOTS, KMH = 2.2369, 1.9438, 3.6  # times m/s


def cruising(every: float) -> pd.DataFrame:
    """A vehicle that goes faster and slower for 20 minutes."""
    frame = driven(round(1200.0 / every), every)
    time = every * np.arange(len(frame))
    speed = 11.0 + 4.0 * np.sin(time / 40.0)
    far = 11.0 * time + 160.0 * (1.0 - np.cos(time / 40.0))
    lat, lon = PLANE.to_geodetic(0.3 * far, far)
    return frame.assign(lat=lat, lon=lon, speed_mps=speed * np.hypot(0.3, 1.0), bearing_deg=16.7)


def notes_of(
    frame: pd.DataFrame, factor: float, column: str = "speed_kmh"
) -> tuple[list[str], np.ndarray]:
    """What is said of speeds with a factor to m/s, and which of them are used."""
    renamed = frame.assign(**{column: frame.speed_mps * factor}).drop(columns="speed_mps")
    (drive,) = drive_from_table(renamed)
    assert drive.fixes is not None
    flagged = (drive.fixes.flags & OTHER_UNIT) > 0
    assert not (flagged & np.isfinite(drive.fixes.sigma_speed)).any()
    return [note for note in drive.notes if "speeds of the fixes" in note], flagged


@pytest.mark.parametrize("every", [1.0, 5.0, 10.0])
@pytest.mark.parametrize(
    ("factor", "column", "said"),
    [(MPH, "speed_kmh", "mph named km/h"), (KNOTS, "speed_kmh", "knots named km/h"),
     (1.0, "speed_kmh", "m/s named km/h"), (KMH, "speed_mph", "km/h named mph")],
)  # fmt: skip
def test_speeds_in_another_unit_are_not_used_and_the_unit_is_named(every, factor, column, said):
    (note,), flagged = notes_of(cruising(every), factor, column)
    assert said in note
    assert flagged.all()


@pytest.mark.parametrize("every", [1.0, 5.0, 10.0, 30.0, 60.0])
@pytest.mark.parametrize("sigma", [1.0, 4.0])
@pytest.mark.parametrize("step", [0.01, 5.0])
def test_sound_speeds_are_used(every, sigma, step):
    for seed in range(4):
        frame = driven(400, every, sigma, seed)
        kmh = np.floor(frame.speed_mps * 3.6 / step) * step
        notes, flagged = notes_of(frame.assign(speed_mps=kmh / 3.6), 3.6)
        assert not notes
        assert not flagged.any()


def test_courses_beside_such_speeds_are_used():
    frame = cruising(1.0)
    wrong = frame.assign(speed_kmh=frame.speed_mps * MPH).drop(columns="speed_mps")
    (drive,) = drive_from_table(wrong)
    assert np.isfinite(drive.fixes.sigma_bearing_deg).mean() > 0.5


@pytest.mark.parametrize("lag", [None, "full"])
def test_each_trip_of_a_table_is_judged_by_its_own_rows(lag):
    table = {k: np.asarray(v) for k, v in fixes(corners("00", "04", "24"), speed=11.0).items()}
    n = len(table["lat"])
    trips = [
        pa.table({**table, "speed_kmh": np.full(n, 11.0 * factor), "drive_id": [name] * n})
        for name, factor in (("a", KMH), ("b", MPH), ("c", KMH))
    ]
    many = match_many(pa.concat_tables(trips), roads(), lag=lag)
    notes = many.drives["notes"].to_pylist()
    assert [["named km/h" in note for note in one] for one in notes] == [[], [True], []]
    alone = match(trips[1].drop_columns("drive_id"), roads(), lag=lag)
    assert list(alone.summary["notes"]) == notes[1]
    without = match(table, roads(), lag=lag).points
    np.testing.assert_allclose(many.points["lat"].to_numpy()[n : 2 * n], without.lat)
