"""The drives of the experiments as files, for other programs to answer."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import WriteError, refused
from ..observations import Fixes, OdometryLog, WheelCounts
from ..simulate import SimulatedDrive, truth_table, vehicle_text
from ..tables.schema import times
from .scenes import Scene

if TYPE_CHECKING:
    import pyarrow as pa

FOLDER = "drives"
"""Where drives are kept, in the folder of the experiments."""


def folder_of(out: Path, scene: str, seed: int) -> Path:
    """The folder of one drive."""
    return out / FOLDER / scene / str(seed)


def keep_map(scene: Scene, out: Path) -> None:
    """Write a scene's map, compiled and as a table of edges whose `edge_id` the truth names.

    Raises:
        WriteError: The system refuses.
    """
    folder = out / FOLDER / scene.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        scene.roads.save(folder / "roads.map")
        scene.roads.edges_table().to_file(folder / "roads.geojson", driver="GeoJSON")
    except OSError as error:
        raise _refusal(folder, error) from error


def keep_drive(scene: Scene, drive: SimulatedDrive, out: Path) -> None:
    """Write what a drive's sensors said, the car as it is believed to be, and the truth.

    Raises:
        WriteError: The system refuses.
    """
    import pyarrow.parquet as pq

    folder = folder_of(out, scene.name, drive.seed)
    fixes, odometry = drive.drive.fixes, drive.drive.odometry
    assert fixes is not None
    assert odometry is not None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        pq.write_table(_fixes(fixes), folder / "fixes.parquet")
        pq.write_table(_wheels(odometry), folder / "odometry.parquet")
        pq.write_table(truth_table(drive, scene.roads), folder / "truth.parquet")
        text = vehicle_text(drive.vehicle, counter_bits=0)
        (folder / "vehicle.toml").write_text(text, encoding="utf-8")
    except OSError as error:
        raise _refusal(folder, error) from error


def _refusal(folder: Path, error: OSError) -> WriteError:
    else_ = "a folder that may be written to was expected; choose another with --out"
    return refused(folder, error, else_)


def _fixes(fixes: Fixes) -> "pa.Table":
    import pyarrow as pa

    course = np.isfinite(fixes.sigma_bearing_deg)
    return pa.table(
        {
            "time": times(fixes.time),
            "lat": fixes.lat_deg,
            "lon": fixes.lon_deg,
            "cov_ee_m2": fixes.cov_ee,
            "cov_en_m2": fixes.cov_en,
            "cov_nn_m2": fixes.cov_nn,
            "speed_mps": pa.array(fixes.speed, mask=~np.isfinite(fixes.sigma_speed)),
            "bearing_deg": pa.array(fixes.bearing_deg, mask=~course),
        }
    )


def _wheels(log: OdometryLog) -> "pa.Table":
    import pyarrow as pa

    assert isinstance(log, WheelCounts)
    return pa.table(
        {"time": times(log.time), "wheel_rl_ticks": log.left, "wheel_rr_ticks": log.right}
    )
