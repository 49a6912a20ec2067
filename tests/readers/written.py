"""What writers of drives share: the kinds of files, and the drive in usual objects."""

import warnings
from datetime import UTC, datetime

import geopandas as gpd
import gpxpy
import gpxpy.gpx
import numpy as np
import pandas as pd
import pytest

N = 90
KNOT, KMH = 1852 / 3600, 1 / 3.6


def frame_of(d, at=True):
    """A GeoDataFrame of the drive's points."""
    more = {"time": d.iso} if at else {}
    return gpd.GeoDataFrame(more, geometry=gpd.points_from_xy(d.lon, d.lat), crs=4326)


def line_of(d):
    from shapely import LineString

    return gpd.GeoDataFrame(
        {"name": ["a"]}, geometry=[LineString(np.column_stack([d.lon, d.lat]))], crs=4326
    )


def gpx_of(d, timed=True):
    """The drive as gpxpy's object."""
    points = [
        gpxpy.gpx.GPXTrackPoint(
            lat, lon, time=datetime.fromtimestamp(round(t), UTC) if timed else None
        )
        for t, lat, lon in zip(d.time, d.lat, d.lon, strict=True)
    ]
    gpx, track = gpxpy.gpx.GPX(), gpxpy.gpx.GPXTrack(name="a")
    gpx.tracks.append(track)
    track.segments.append(gpxpy.gpx.GPXTrackSegment(points))
    return gpx


def trajectory(d):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mpd = pytest.importorskip("movingpandas", reason="movingpandas is not installed")
        frame = frame_of(d).assign(t=d.at.dt.tz_localize(None), who=1).drop(columns="time")
        return mpd.Trajectory(frame, traj_id="who", t="t")


def installed(name):
    return pytest.importorskip(name, reason=f"{name} is not installed")


def csv(path, columns, **options):
    pd.DataFrame(columns).to_csv(path, index=False, **options)
    return path


def text(path, content):
    path.write_text(content, encoding="utf-8")
    return path


def lines(rows, head=""):
    return head + "".join(f"{row}\n" for row in rows)


def degrees(d, letters=False):
    return {"lat": d.lat, "lon": d.lon}


# Kinds that must be read: each writes the drive and gives what is to be read, and with which
# options where the file alone does not say it.

READ = {}


def kind(name, **about):
    def keep(write):
        READ[name] = write, about
        return write

    return keep
