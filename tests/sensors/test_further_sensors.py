"""Further sensors as plug-ins: in tables, lists, many trips and on line; errors that last."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

import whichroad
from whichroad import GeoFix, Localizer, WheelTicks, sensors, simulate_drive
from whichroad.epochs import build_timeline
from whichroad.errors import ReadError, SettingError
from whichroad.evidence.sensed import Sensed
from whichroad.geodesy.angles import bearing_of
from whichroad.sensors import Attribute, Compass, Heading, Range, SensorReading
from whichroad.sensors.lasting import Lasting

RANGE_M = 30.0


@pytest.fixture(scope="module")
def ride(town):
    return simulate_drive(town, seed=3, length_m=1500.0)


@pytest.fixture(scope="module")
def told(town, ride):
    """A compass without an error once a second, as columns beside the drive's own."""
    t = ride.truth
    k = np.arange(5, len(t), 10)
    bearing = bearing_of(t.heading[k], town.plane.convergence(t.x[k], t.y[k]))
    return [
        SensorReading(float(a), {"compass_deg": float(b)}, "compass")
        for a, b in zip(t.time[k], bearing, strict=True)
    ]


def table_of(ride, told) -> pa.Table:
    """A row for each reading of any sensor, its other cells empty."""
    f, o = ride.drive.fixes, ride.drive.odometry
    rows = [
        {"time": t, "lat": a, "lon": b, "sigma_m": s}
        for t, a, b, s in zip(f.time, f.lat_deg, f.lon_deg, np.sqrt(f.cov_ee), strict=True)
    ]
    rows += [
        {"time": t, "wheel_rl_ticks": a, "wheel_rr_ticks": b}
        for t, a, b in zip(o.time, o.left, o.right, strict=True)
    ]
    rows += [{"time": one.time, **one.values} for one in told]
    names = ("time", "lat", "lon", "sigma_m", "wheel_rl_ticks", "wheel_rr_ticks", "compass_deg")
    rows.sort(key=lambda row: row["time"])
    return pa.table({name: [row.get(name) for row in rows] for name in names})


def with_names(table: pa.Table) -> pa.Table:
    """All of its rows as one trip."""
    return table.append_column("drive_id", pa.array(["a"] * len(table)))


def observations_of(ride, told) -> list:
    f, o = ride.drive.fixes, ride.drive.odometry
    cov, none = f.cov_ee, 0.0 * f.cov_ee
    made = [WheelTicks(*map(float, row)) for row in zip(o.time, o.left, o.right, strict=True)]
    fixes = zip(f.time, f.lat_deg, f.lon_deg, cov, none, cov, strict=True)
    made += [GeoFix(*map(float, row)) for row in fixes]
    return sorted([*made, *told], key=lambda one: one.time)


EXACT = Compass(sigma_deg=1.0, lasts_m=0.0)


def sigma(result) -> float:
    return float(np.median(result.to_arrow()["sigma_bearing_deg"].to_numpy()))


def test_a_compass_in_a_table_in_a_list_and_among_many_trips_says_the_same(town, ride, told):
    table = table_of(ride, told)
    alone = whichroad.match(table, town, vehicle=ride.vehicle)
    points = whichroad.match(table, town, vehicle=ride.vehicle, sensors=[EXACT])
    assert sigma(points) < 0.8 * sigma(alone)
    listed = whichroad.match(
        observations_of(ride, told), town, vehicle=ride.vehicle, sensors=[EXACT]
    )
    assert listed.to_arrow()["lat"].equals(points.to_arrow()["lat"])
    trips = with_names(table)
    many = whichroad.match_many(trips, town, vehicle=ride.vehicle, sensors=[EXACT])
    assert many.points["lat"].equals(points.to_arrow()["lat"])


def test_a_file_with_the_columns_of_a_sensor_is_read_and_smoothed(town, ride, told, tmp_path):
    import pyarrow.csv

    path = tmp_path / "drive.csv"
    pyarrow.csv.write_csv(table_of(ride, told), path)
    alone = whichroad.match(path, town, vehicle=ride.vehicle, lag="full")
    smoothed = whichroad.match(path, town, vehicle=ride.vehicle, lag="full", sensors=[EXACT])
    assert sigma(smoothed) < 0.9 * sigma(alone)
    assert smoothed.diagnosis == alone.diagnosis
    assert smoothed.summary["sensors"] == {
        "compass": {"heard": len(told), "misfits": 0, "withheld": 0}
    }
    assert "sensors" not in alone.summary
    own = tmp_path / "compass.csv"
    pyarrow.csv.write_csv(pa.table({"time": [one.time for one in told], "compass_deg": [
        one.values["compass_deg"] for one in told]}), own)  # fmt: skip
    pyarrow.csv.write_csv(table_of(ride, []).drop_columns("compass_deg"), path)
    apart = whichroad.match([path, own], town, vehicle=ride.vehicle, lag="full", sensors=[EXACT])
    assert apart.to_arrow()["lat"].equals(smoothed.to_arrow()["lat"])


def test_on_line_it_is_as_in_a_recording(town, ride, told):
    """Readings between odometry move the vehicle by what was, where a recording knows what came."""
    localizer = Localizer(town, vehicle=ride.vehicle, sensors=[EXACT])
    without = Localizer(town, vehicle=ride.vehicle)
    for one in observations_of(ride, told):
        estimate = localizer.update(one)
        if not isinstance(one, SensorReading):
            other = without.update(one)
    points = whichroad.match(
        observations_of(ride, told), town, vehicle=ride.vehicle, sensors=[EXACT]
    ).to_arrow()
    last = points.slice(len(points) - 1).to_pylist()[0]
    assert estimate.cov[2, 2] < 0.8 * other.cov[2, 2]
    assert math.degrees(math.sqrt(estimate.cov[2, 2])) == pytest.approx(
        last["sigma_bearing_deg"], rel=0.05
    )
    assert localizer.skipped == {}
    again = Localizer.from_bytes(localizer.to_bytes(), town, sensors=[EXACT])
    late = SensorReading(estimate.time + 0.1, told[-1].values, "compass")
    assert np.array_equal(again.update(late).cov, localizer.update(late).cov)


def test_the_sky_on_line_is_as_in_a_recording(town, ride):
    sky = sensors.Sky()
    told = [
        SensorReading(one.time, {"satellites": float(3 + k % 7)}, "sky")
        for k, one in enumerate(observations_of(ride, []))
        if isinstance(one, WheelTicks)
    ]
    localizer = Localizer(town, vehicle=ride.vehicle, sensors=[sky])
    for one in observations_of(ride, told):
        estimate = localizer.update(one)
    points = whichroad.match(observations_of(ride, told), town, vehicle=ride.vehicle, sensors=[sky])
    last = points.to_arrow().slice(len(points.points) - 1).to_pylist()[0]
    assert points.summary["sensors"]["sky"]["heard"] > 0.9 * len(told)
    assert estimate.edge == last["edge_id"]
    assert estimate.p_road == pytest.approx(last["p_road"], abs=0.02)


def test_without_its_sensor_a_drive_is_what_it_was(town, ride, told):
    drive = ride.drive
    one = build_timeline(drive, town.plane, ride.vehicle)
    other = build_timeline(replace(drive, sensed=tuple(told)), town.plane, ride.vehicle)
    assert one.epochs.tobytes() == other.epochs.tobytes()
    assert len(other.evidence.rows) == 0


def test_a_sensor_that_no_table_has_is_said_to_be_not_heard(town, ride):
    result = whichroad.match(table_of(ride, []), town, vehicle=ride.vehicle, sensors=[EXACT])
    assert "sensor compass: not heard" in " ".join(result.summary["notes"])
    trips = with_names(table_of(ride, []))
    many = whichroad.match_many(trips, town, vehicle=ride.vehicle, sensors=[EXACT])
    assert "sensor compass: not heard" in " ".join(many.drives["notes"].to_pylist()[0])


def test_a_compass_with_the_other_sign_is_named(town, ride, told):
    wrong = [replace(one, values={"compass_deg": -one.values["compass_deg"]}) for one in told]
    observations = observations_of(ride, wrong)
    result = whichroad.match(observations, town, vehicle=ride.vehicle, sensors=[EXACT])
    assert "sensor compass" in [finding.what for finding in result.diagnosis]
    localizer = Localizer(town, vehicle=ride.vehicle, sensors=[EXACT])
    for one in observations:
        localizer.take(one)
    assert "sensor compass" in [finding.what for finding in localizer.diagnosis]
    assert localizer.sensor_states[-1].doubted == ("readings",)
    trips = with_names(table_of(ride, wrong))
    many = whichroad.match_many(trips, town, vehicle=ride.vehicle, sensors=[EXACT])
    (notes,) = many.drives["notes"].to_pylist()
    assert "sensor compass" in " ".join(notes)
    assert "left out" in " ".join(notes)


@pytest.mark.parametrize("age", [0.01, 0.3, 2.0])
def test_readings_are_worth_what_errors_that_last_leave_of_them(age: float):
    """Σ shares is 1ᵀ R⁻¹ 1 of the errors' joint covariance; headings' last half as long again."""
    lasting, n = Lasting(), 30
    key, lasts = (0, "Position", 0.0, 0.0), (10.0, 0.0)
    shares = [lasting.share(key, 10.0 * age * k, 0.0, lasts) for k in range(n)]
    heading = (0, "Heading", 0.0, 0.0)
    headings = [lasting.share(heading, 15.0 * age * k, 0.0, lasts) for k in range(n)]
    assert headings == pytest.approx(shares)
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    joint = np.linalg.solve(np.exp(-age * apart), np.ones(n)).sum()
    assert sum(shares) == pytest.approx(joint)


def test_standing_teaches_nothing_where_an_error_lasts_for_metres():
    lasting, key = Lasting(), (0, "Lateral", 0.0, 0.0)
    assert lasting.share(key, 0.0, 0.0, (0.0, 100.0)) == 1.0
    assert lasting.share(key, 60.0, 0.0, (0.0, 100.0)) == 0.0
    assert lasting.share(key, 61.0, 100.0, (0.0, 100.0)) == pytest.approx(math.tanh(0.5))


READINGS = {"second_lat": 49.4, "second_lon": 8.7, "compass_deg": 350.0, "antennas_deg": 80.0,
            "range_to": 7.0, "range_m": RANGE_M, "lane_offset_m": 1.5,
            "satellites": 2.0}  # fmt: skip
GIVEN = {
    "second receiver": (sensors.SecondReceiver(sigma_m=3.0),
                        sensors.Position(49.4, 8.7, 3.0, lasts_s=80.0)),
    "compass": (Compass(declination_deg=15.0), Heading(5.0, 5.0, lasts_m=300.0)),
    "dual antenna": (sensors.DualAntenna(mounted_deg=90.0),
                     Heading(350.0, 0.5, lasts_s=5.0, bias_sigma=2.0)),
    "ranging": (sensors.Ranging({7: (49.41, 8.71)}),
                Range(49.41, 8.71, RANGE_M, 1.0, bias_sigma=0.3)),
    "camera": (sensors.LaneCamera(), sensors.Lateral(1.5, 0.5, lasts_m=50.0)),
    "sky": (sensors.Sky(), Attribute("tunnel", {True: 0.95}, 0.03, lasts_s=20.0)),
}  # fmt: skip


@pytest.mark.parametrize(("sensor", "evidence"), GIVEN.values(), ids=GIVEN)
def test_what_a_sensor_makes_of_its_columns(sensor, evidence):
    reading = {"time": 0.0, **{n: READINGS[n] for n in sensor.columns if n in READINGS}}
    assert list(sensor.rows(reading)) == [evidence]


def test_the_needles_declination_is_the_magnetic_models():
    pytest.importorskip("pygeomag")
    assert sensors.declination(49.4, 8.7, 1_782_864_000.0) == pytest.approx(3.72, abs=0.05)
    with pytest.raises(SettingError, match="upgrade pygeomag"):
        sensors.declination(49.4, 8.7, 4e9)


@dataclass
class Odd:
    """A sensor that gives whatever it was made with."""

    name: str = "odd"
    columns: tuple[str, ...] = ("odd",)
    given: object = 5

    def rows(self, reading):
        """What it was made with."""
        return [self.given]


def test_what_is_no_sensor_or_no_evidence_is_refused_by_name(town):
    for wrong in ([5], [Compass], [Compass(), Compass()], [Odd(columns="odd")]):
        with pytest.raises(SettingError, match="sensors: "):
            Sensed(wrong, town)
    told = SensorReading(1.0, {"odd": 2.0}, "odd")
    with pytest.raises(ReadError, match="sensor odd: rows gave '5'"):
        Sensed([Odd()], town).rows(told, 0.0, (0.0, 0.0))
    with pytest.raises(ReadError, match="'odd'; one of compass was expected"):
        Sensed([Compass()], town).rows(told, 0.0, (0.0, 0.0))
    sensed = Sensed([Odd(given=Heading(math.nan, 1.0)), Compass(sigma_deg=0.0)], town)
    assert sensed.rows(replace(told, sensor=""), 0.0, (0.0, 0.0)) == []
    assert sensed.rows(SensorReading(1.0, {"compass_deg": 2.0}), 0.0, (0.0, 0.0)) == []
    assert sensed.skipped == {
        "odd: impossible value or sigma": 1, "compass: impossible value or sigma": 1,
    }  # fmt: skip
    for values in ({"compass_deg": "north"}, {"compass_deg": None}, 5):
        with pytest.raises(ReadError, match=r"reading: its values are .*; numbers by the names"):
            sensed.rows(SensorReading(1.0, values), 0.0, (0.0, 0.0))
    with pytest.raises(SettingError, match="attribute: 'moon' is none of this map"):
        Sensed([Odd(given=Attribute("moon", {True: 0.5}, 0.5))], town).rows(told, 0.0, (0.0, 0.0))


def test_the_paper_takes_no_further_sensors(town, ride):
    with pytest.raises(SettingError, match="paper's method"):
        whichroad.match(ride.drive, town, model="paper", sensors=[EXACT])


def test_classes_of_an_attribute_are_those_of_the_pieces_of_roads(town):
    sensed = Sensed([], town)
    at, number = sensed.class_of("highway", "residential")
    evidence = sensed.evidence([])
    named = np.array([value == "residential" for value in town.at_pieces("highway")])
    assert named.any()
    np.testing.assert_array_equal(evidence.classes[at] == number, named)


def test_between_sparse_fixes_a_reading_is_counted_and_changes_nothing(town, ride, told):
    fixes = [one for one in observations_of(ride, []) if isinstance(one, GeoFix)][::15]
    every = sorted([*fixes, *told], key=lambda one: one.time)
    alone = whichroad.match(fixes, town)
    points = whichroad.match(every, town, sensors=[EXACT])
    assert len(points.points) == len(alone.points)
    why = "reading of a sensor between sparse fixes"
    assert points.summary["skipped"][why] > 0.8 * len(told)
    localizer = Localizer(town, sensors=[EXACT])
    for one in every:
        localizer.take(one)
    assert localizer.skipped[why] > 0.7 * len(told)


def test_the_tutorials_sensor_has_at_most_thirty_lines():
    """What it does is run with the page, and with the package as it is."""
    page = Path(__file__).parents[2] / "docs" / "tutorials" / "add-a-sensor.md"
    block = page.read_text("utf-8").partition("```python\n")[2].partition("```")[0]
    assert "class TagReader" in block
    assert len([line for line in block.splitlines() if line.strip()]) <= 30
