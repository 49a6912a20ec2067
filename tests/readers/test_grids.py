"""Places in whole parts of minutes or seconds, or in the middle of cells, have a coarse error."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from whichroad.geodesy.units import METRES_PER_DEGREE
from whichroad.observations import ROUNDED
from whichroad.readers import drive_from_table
from whichroad.readers.many_trips import trip_batches
from whichroad.readers.reading import Reading
from whichroad.readers.regular_trips import batched_fixes
from whichroad.readers.trip_units import with_units
from whichroad.settings import Settings

LAT, LON = 180.0 / 2**20, 360.0 / 2**20  # degrees of a cell of a geohash of 8 letters
GRIDS = {
    "minutes of 2 decimals": (lambda x, _: np.round(60.0 * x, 2) / 60.0, 1 / 6000, 1 / 6000),
    "seconds": (lambda x, _: np.round(3600.0 * x) / 3600.0, 1 / 3600, 1 / 3600),
    "geohash": (lambda x, cell: (np.floor(x / cell) + 0.5) * cell, LAT, LON),
}
WRITTEN = {
    "all digits": lambda x: x,
    "6 decimals": lambda x: x.round(6),
    "5 decimals": lambda x: x.round(5),
    "single precision": lambda x: x.astype(np.float32).astype(float),
}


def driven(seed: int, rows: int = 400, seconds: float = 1.0) -> pd.DataFrame:
    """A drive of bends and changing speeds."""
    rng = np.random.default_rng(seed)
    heading = 1.0 + np.cumsum(rng.normal(0.0, 0.15, rows))
    moved = seconds * np.clip(12.0 + np.cumsum(rng.normal(0.0, 1.0, rows)), 0.0, 25.0)
    lat = 42.51 + np.cumsum(moved * np.cos(heading)) / METRES_PER_DEGREE
    lon = 1.52 + np.cumsum(moved * np.sin(heading)) / METRES_PER_DEGREE / np.cos(np.radians(lat))
    time = 1_780_315_200.0 + seconds * np.arange(rows)
    return pd.DataFrame({"time": time, "lat": lat, "lon": lon, "sigma_m": 3.0})


@pytest.mark.parametrize("seconds", [1.0, 10.0])
@pytest.mark.parametrize("written", WRITTEN)
@pytest.mark.parametrize("grid", GRIDS)
def test_the_error_of_a_grid_is_added_and_said(grid, written, seconds, sound):
    to_lines, north, east = GRIDS[grid]
    frame = driven(1, seconds=seconds)
    for name, cell in (("lat", LAT), ("lon", LON)):
        frame[name] = WRITTEN[written](to_lines(frame[name].to_numpy(), cell))
    (drive,) = drive_from_table(frame)
    sound(drive)
    assert (drive.fixes.flags & ROUNDED).all()
    north *= METRES_PER_DEGREE
    east *= METRES_PER_DEGREE * np.cos(np.radians(frame.lat[0]))
    assert drive.fixes.cov_nn == pytest.approx(9.0 + north**2 / 12.0, rel=0.01)
    assert drive.fixes.cov_ee == pytest.approx(9.0 + east**2 / 12.0, rel=0.03)
    moved = np.abs(np.diff(drive.fixes.lat_deg)) + np.abs(np.diff(drive.fixes.lon_deg))
    assert (moved > 1e-8).all()  # so that none is said to repeat the one before
    (note,) = (note for note in drive.notes if "coordinates are" in note)
    assert f"on a grid, {north:.3g} m from south to north and {east:.3g} m from west" in note


@pytest.mark.parametrize("decimals", [3, 4])
def test_decimals_are_seen_in_single_precision_too(decimals):
    frame = driven(2, 2000)
    frame[["lat", "lon"]] = frame[["lat", "lon"]].round(decimals)
    (double,) = drive_from_table(frame)
    (single,) = drive_from_table(frame.astype({"lat": np.float32, "lon": np.float32}))
    assert single.notes == double.notes
    assert f"rounded to {decimals} decimals" in single.notes[0]
    assert single.fixes.cov_nn == pytest.approx(double.fixes.cov_nn)


@pytest.mark.parametrize("seconds", [1.0, 10.0, 60.0])
@pytest.mark.parametrize("written", WRITTEN)
def test_places_that_are_on_no_grid_are_left_as_they_are(written, seconds):
    for seed in range(30):
        frame = driven(seed, int(600 / seconds) + 10, seconds)
        frame[["lat", "lon"]] = WRITTEN[written](frame[["lat", "lon"]].to_numpy())
        (drive,) = drive_from_table(frame)
        assert not (drive.fixes.flags & ROUNDED).any()
        assert drive.fixes.lat_deg.tolist() == frame.lat.tolist()


@pytest.mark.parametrize("turned", [0, 200])
def test_who_drives_straight_on_at_one_speed_is_on_no_grid(turned):
    """His places are as far from each other as if they were."""
    frame = driven(3)
    k = np.arange(400.0)
    frame["lat"] = 42.51 + 1.1e-4 * k
    frame["lon"] = 1.52 + 0.7e-4 * (k - 2.0 * np.maximum(k - 200.0, 0.0) * (turned > 0))
    frame["lat"] += 3e-8 * np.sin(k)
    (drive,) = drive_from_table(frame)
    assert not (drive.fixes.flags & ROUNDED).any()


FEW = {
    "geohash of 6": (lambda x, k: (np.floor(x / (k * 45 / 2**13)) + 0.5) * (k * 45 / 2**13), 610.8),
    "2 decimals": (lambda x, _: x.round(2), 1112.0),
    "3 decimals": (lambda x, _: x.round(3), 111.2),
    "tenths of minutes": (lambda x, _: np.round(600.0 * x) / 600.0, 185.3),
}


@pytest.mark.parametrize("kind", FEW)
def test_six_places_tell_decimals_and_grids_that_are_known(kind, sound):
    to_lines, step = FEW[kind]
    frame = driven(4, 3000)[::500].reset_index(drop=True)
    for name, cells in (("lat", 1), ("lon", 2)):
        frame[name] = to_lines(frame[name].to_numpy(), cells)
    assert len(frame[["lat", "lon"]].drop_duplicates()) in range(4, 7)
    (drive,) = drive_from_table(frame)
    sound(drive)
    assert (drive.fixes.flags & ROUNDED).all()
    assert drive.fixes.cov_nn == pytest.approx(9.0 + step**2 / 12.0, rel=0.01)
    assert any(f"{step:.3g} m" in note for note in drive.notes)


@pytest.mark.parametrize("kind", [*FEW, "steps of 0.0017171 degrees"])
def test_the_first_trips_of_a_table_tell_the_grid_of_a_parked_one(kind):
    to_lines, step = FEW.get(kind, (lambda x, _: 0.0017171 * np.round(x / 0.0017171) + 4e-7, 190.9))
    frame = driven(5, 20_000)
    frame["trip_id"] = [f"t{k // 200}" for k in range(len(frame))]
    for name, cells in (("lat", 1), ("lon", 2)):
        frame[name] = to_lines(frame[name].to_numpy(), cells)
    parked = frame.iloc[[-1] * 40].assign(trip_id="parked", time=1.79e9 + np.arange(40))
    full = driven(6, 200).assign(trip_id="full")
    table = pd.concat([frame, parked, full], ignore_index=True)
    for batches in (table, [pa.Table.from_pandas(table)]):
        read = {}
        for batch in with_units(trip_batches(batches, "trip_id"), Reading()):
            first = np.array(batch.first[:-1])
            found = batched_fixes(batch.table, first, Settings(), units=batch.units)
            begin = np.cumsum([0, *np.where(found.regular, np.diff(batch.first), 0)])
            for k in np.flatnonzero(found.regular).tolist():
                notes = [n for n in found.notes.get(k, ()) if "coordinates are" in n]
                read[batch.names[k]] = (found.fixes.cov_nn[begin[k]], notes)
        assert read["parked"][0] == pytest.approx(9.0 + step**2 / 12.0, rel=0.01)
        assert len(read["parked"][1]) == 1
        assert read["full"] == (9.0, [])
    drives = {drive.drive_id: drive for drive in drive_from_table(table)}
    assert drives["parked"].fixes.cov_nn[0] == read["parked"][0]
    assert drives["full"].fixes.cov_nn[0] == 9.0
