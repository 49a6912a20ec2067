"""Google's timeline: what a phone measured, and the paths of days of which that is gone."""

import json

import numpy as np
import pandas as pd
import pytest

from whichroad.readers import read_drive

T0 = 1_780_315_200.0  # 2026-06-01 12:00 UTC
DAY = 86_400.0
LAT, LON = 49.4, 8.7


def stamps(times, zone="Europe/Berlin"):
    moments = pd.to_datetime(np.asarray(times), unit="s", utc=True).tz_convert(zone)
    return [moment.isoformat(timespec="milliseconds") for moment in moments]


def placed(k):
    return round(LAT + 1e-3 * k, 7), LON


def path(times):
    """Segments of six places each."""
    points = [{"point": f"{placed(k)[0]}°, {LON}°", "time": t}
              for k, t in enumerate(stamps(times))]  # fmt: skip
    return [{"startTime": points[k]["time"], "endTime": points[min(k + 5, len(points) - 1)]["time"],
             "timelinePath": points[k : k + 6]} for k in range(0, len(points), 6)]  # fmt: skip


def measured(times):
    position = [{"LatLng": f"{placed(k)[0]}°, {LON}°", "accuracyMeters": 8, "timestamp": t}
                for k, t in enumerate(stamps(times))]  # fmt: skip
    return [{"wifiScan": {}}, *({"position": one} for one in position)]


VISIT = {"startTime": stamps([T0])[0], "endTime": stamps([T0])[0],
         "visit": {"topCandidate": {"placeLocation": {"latLng": "49.5°, 8.7°"}}}}  # fmt: skip


@pytest.fixture
def read(tmp_path):
    def read_content(content):
        (tmp_path / "a.json").write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
        return read_drive(tmp_path / "a.json")

    return read_content


def test_days_without_measured_places_are_those_of_the_paths(read):
    minutes = 120.0 * np.arange(20)
    days = [path(T0 + day * DAY + minutes) for day in range(3)]
    raw = measured(T0 + DAY + minutes)  # of the second day: the others lie on both sides
    (got,) = read({"semanticSegments": [s for day in days for s in day], "rawSignals": raw})
    expected = np.concatenate([T0 + day * DAY + minutes for day in range(3)])
    assert got.fixes.time == pytest.approx(expected)
    sigma = np.sqrt(got.fixes.cov_nn)
    assert (sigma[:20] == sigma[0]).all()
    assert (sigma[20:40] != sigma[0]).all()
    assert got.skipped == {"place of a path within 15 minutes of a measured one (not used)": 20}


def test_a_path_between_measured_places_hours_apart_is_read(read):
    (got,) = read({"semanticSegments": path(T0 + 1800.0 * np.arange(1, 4)),
                   "rawSignals": measured([T0, T0 + 7200.0])})  # fmt: skip
    assert got.fixes.time == pytest.approx(T0 + 1800.0 * np.arange(5))
    assert not got.skipped


def test_measured_places_alone_are_read(read):
    (got,) = read({"rawSignals": measured(T0 + 10.0 * np.arange(12))})
    assert got.fixes.time == pytest.approx(T0 + 10.0 * np.arange(12))
    assert got.fixes.lat_deg == pytest.approx([placed(k)[0] for k in range(12)], abs=1e-9)
    assert not got.skipped


def test_visits_are_counted(read):
    (got,) = read({"semanticSegments": [*path(T0 + 60.0 * np.arange(12)), VISIT]})
    assert len(got.fixes) == 12
    assert got.skipped == {"visit or activity of the timeline (no measured place)": 1}


def test_the_export_of_ios_is_read(read):
    begins = T0 + 3600.0 * np.arange(2)
    segments = [
        {"startTime": start, "endTime": start, "timelinePath": [
            {"point": f"geo:{placed(k)[0]:.6f},{LON:.6f}",
             "durationMinutesOffsetFromStartTime": str(2 * k)} for k in range(10)]}
        for start in stamps(begins)
    ]  # fmt: skip
    visit = {**VISIT, "visit": {"topCandidate": {"placeLocation": "geo:49.5,8.7"}}}
    broken = {
        "startTime": "?",
        "timelinePath": [
            {"point": "geo:49.4,8.7", "durationMinutesOffsetFromStartTime": "1"},
            {"point": "geo:?"},
        ],
    }
    (got,) = read([visit, *segments[::-1], broken])
    assert got.fixes.time == pytest.approx((begins[:, None] + 120.0 * np.arange(10)).ravel())
    assert got.fixes.lat_deg[:10] == pytest.approx([placed(k)[0] for k in range(10)], abs=1e-6)
    assert got.skipped == {"no time": 1, "visit or activity of the timeline (no measured place)": 1}
    assert "times of the path are told in whole minutes" in got.notes
