"""Places that scatter from row to row as no vehicle moves are named, and their size is used."""

import math

import numpy as np
import pandas as pd
import pytest

from readers.driving import town
from whichroad.observations import SCATTERED, Fixes
from whichroad.readers.drive_tables import drive_from_table
from whichroad.readers.scattered_places import _median, scatter


def table(sigma: float, every: float, seed: int = 0, **columns: float) -> pd.DataFrame:
    return town(seed, 120, every, sigma)[["time", "lat", "lon"]].assign(**columns)


def read(frame: pd.DataFrame) -> tuple[Fixes, list[str]]:
    (drive,) = drive_from_table(frame)
    assert drive.fixes is not None
    assert len(drive.fixes) == len(frame)
    return drive.fixes, list(drive.notes)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("every", [3.0, 5.0, 10.0])
@pytest.mark.parametrize("sigma", [50.0, 100.0, 300.0])
def test_the_size_of_the_scatter_is_taken_where_no_error_is_told(sigma, every, seed):
    fixes, notes = read(table(sigma, every, seed))
    (note,) = [one for one in notes if "two vehicles" not in one]
    assert ((fixes.flags & SCATTERED) > 0).all()
    for covariance in (fixes.cov_ee, fixes.cov_nn):
        assert np.sqrt(covariance) == pytest.approx(sigma, rel=0.35)
    assert note.startswith("places scatter by ")
    assert "no errors are told, so that size is taken: give it as sigma_m" in note


@pytest.mark.parametrize("every", [1.0, 2.0])
def test_dense_rows_are_named_and_keep_their_error(every):
    fixes, (note,) = read(table(100.0, every))
    assert (fixes.cov_nn == 25.0).all()
    assert "give the places without that noise, or one row in 10 s" in note


def test_errors_that_are_told_stay_and_are_named_where_they_are_too_small():
    fixes, (note,) = read(table(100.0, 10.0, sigma_m=4.0))
    assert (fixes.cov_nn == 16.0).all()
    assert "and errors of 4 m are told; tell errors of that size" in note
    fixes, notes = read(table(100.0, 10.0, sigma_m=90.0))
    assert not fixes.flags.any()
    assert notes == []


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("every", [1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 60.0])
@pytest.mark.parametrize("sigma", [0.0, 3.0, 10.0])
def test_of_drives_as_vehicles_make_them_nothing_is_said(sigma, every, seed):
    fixes, notes = read(table(sigma, every, seed))
    assert not (fixes.flags & SCATTERED).any()
    assert notes == []


def test_neither_of_uneven_times_nor_of_two_places_in_turn_nor_of_rounding():
    frame = table(3.0, 1.0)
    fast = frame.assign(lat=49.4 + 3e-4 * np.arange(120), lon=8.7)
    uneven = fast[np.isin(np.arange(120) % 10, (0, 9))]
    in_turn = frame.lat.to_numpy() + 0.003 * (np.arange(120) % 2)
    assert scatter(frame.time.to_numpy(), in_turn, frame.lon.to_numpy(), np.zeros(1, int)) is None
    coarse = table(3.0, 10.0).round({"lat": 3, "lon": 3})
    for one in (uneven, coarse):
        fixes, notes = read(one)
        assert not (fixes.flags & SCATTERED).any()
        assert not [note for note in notes if "scatter" in note]


@pytest.mark.parametrize("values", [[3.0], [4.0, 1.0], [5.0, 1.0, 2.0], [2.0, math.nan, 1.0]])
def test_the_median_of_few_numbers_is_that_of_numpy(values: list[float]):
    assert _median(np.array(values)) == pytest.approx(np.median(values), abs=0.0, nan_ok=True)
