"""A town, a drive through it, and its observations."""

import pytest

from whichroad import GeoFix, WheelTicks, simulate_drive
from whichroad.simulate.drive_files import write_drive


@pytest.fixture(scope="session")
def ride(town):
    """Two minutes of driving, simulated."""
    return simulate_drive(town, seed=3, length_m=1500.0)


@pytest.fixture(scope="session")
def observations(ride):
    """Its fixes and wheel counts by time; where both have one time, the wheels first."""
    f, o = ride.drive.fixes, ride.drive.odometry
    columns = (f.time, f.lat_deg, f.lon_deg, f.cov_ee, f.cov_en, f.cov_nn)
    fixes = [GeoFix(*map(float, row)) for row in zip(*columns, strict=True)]
    wheels = [WheelTicks(*map(float, row)) for row in zip(o.time, o.left, o.right, strict=True)]
    return sorted(wheels + fixes, key=lambda one: one.time)


@pytest.fixture(scope="session")
def files(town, ride, tmp_path_factory):
    """The drive as files, and the compiled map."""
    folder = tmp_path_factory.mktemp("files")
    write_drive(ride, town, folder / "drive")
    town.save(folder / "town.map")
    return folder
