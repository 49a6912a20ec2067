"""Roads above each other: heights against levels, the sky against tunnels; what receivers tell."""

import numpy as np
import pytest
import typer

import whichroad
from whichroad import Localizer
from whichroad.cli.arguments import read_sensors
from whichroad.errors import SettingError
from whichroad.live.decode import NmeaStream
from whichroad.observations import SensorReading, SpeedYaw, WheelTicks
from whichroad.readers.nmea import read_nmea
from whichroad.readers.nmea_told import NmeaTold
from whichroad.roadmap.levels import LEVEL_M, RAMP_M, UNIT_M, ZERO, profile
from whichroad.sensors import Compass, Height, Sky
from whichroad.simulate import GOOD, MapBuilder, simulate_drive

BAROMETER = Height(drift_m=1.5, drift_s=300.0)


@pytest.fixture(scope="module")
def roads():
    """A road splits, and one branch runs on a bridge above the other."""
    builder = MapBuilder()
    for name, x, y in (("begin", -300, 0), ("fork", 0, 0), ("up", 150, 0.2), ("over", 450, 0.2),
                       ("end", 700, 60), ("low", 150, -0.2), ("on", 450, -0.2),
                       ("low end", 700, -60)):  # fmt: skip
        builder.node(name, float(x), float(y))
    builder.way(["begin", "fork"], "secondary", name="Approach")
    builder.way(["fork", "up"], "secondary", name="Above")
    builder.way(["up", "over"], "secondary", name="Above", bridge="yes", layer="1")
    builder.way(["over", "end"], "secondary", name="Above")
    builder.way(["fork", "low", "on", "low end"], "secondary", name="Below")
    return builder.compiled()


def edge_of(roads, name: str) -> int:
    named = np.flatnonzero(np.array(roads.column("name")) == name)
    return int(next(e for e in named if abs(roads.at(int(e), 0.0)[2]) < 1.5))


@pytest.fixture(scope="module", params=["Above", "Below"])
def ride(request, roads):
    """A drive, which road it takes, and heights once a second that climb with it."""
    route = [edge_of(roads, "Approach"), edge_of(roads, request.param)]
    drive = simulate_drive(roads, seed=5, route=route, scenario=GOOD)
    t = drive.truth
    at = np.where(t.edge == route[1], t.along, -1.0)
    over = np.interp(at, [40.0, 150.0, 450.0, 560.0], [0.0, 6.0, 6.0, 0.0])
    over *= request.param == "Above"
    k = np.arange(0, len(t), 10)
    told = [
        SensorReading(float(time), {"height_m": 200.0 + float(z)})
        for time, z in zip(t.time[k], over[k], strict=True)
    ]
    until = float(t.time[np.searchsorted(at, 440.0)])
    return drive, request.param, told, until


def observations_of(drive, told, until):
    f, o = drive.drive.fixes, drive.drive.odometry
    made = [WheelTicks(*map(float, row)) for row in zip(o.time, o.left, o.right, strict=True)]
    made += [
        whichroad.GeoFix(float(t), float(a), float(b), float(c), 0.0, float(c))
        for t, a, b, c in zip(f.time, f.lat_deg, f.lon_deg, f.cov_ee, strict=True)
    ]
    return sorted((one for one in [*made, *told] if one.time <= until), key=lambda one: one.time)


def test_a_height_knows_the_road_that_gnss_does_not(roads, ride):
    drive, name, told, until = ride
    p = {}
    for case, readings in (("without", []), ("with", told)):
        localizer = Localizer(roads, vehicle=drive.vehicle, sensors=[BAROMETER])
        for one in observations_of(drive, readings, until):
            estimate = localizer.update(one)
        p[case] = dict(estimate.attribute("name")).get(name, 0.0)
    assert p["without"] < 0.8
    assert p["with"] > 0.93
    level = 1 if name == "Above" else 0
    assert dict(estimate.attribute("level"))[level] == pytest.approx(p["with"], abs=1e-6)
    result = whichroad.match(
        observations_of(drive, told, until), roads, vehicle=drive.vehicle, sensors=[BAROMETER]
    )
    assert result.summary["sensors"]["height"]["heard"] > 50
    last = result.to_arrow().slice(len(result.points) - 1).to_pylist()[0]
    assert last["p_road"] == pytest.approx(estimate.p_road, abs=0.03)


def test_a_localizer_goes_on_with_the_heights_that_it_has_heard(roads, ride):
    drive, _, told, until = ride
    observations = observations_of(drive, told, until)
    sensors = [Sky(), Height()]
    first = Localizer(roads, vehicle=drive.vehicle, sensors=sensors)
    half = len(observations) // 2
    for one in observations[:half]:
        first.update(one)
    again = Localizer.from_bytes(first.to_bytes(), roads, sensors=sensors)
    for one in observations[half:]:
        assert again.update(one).p_road == first.update(one).p_road


def test_roads_climb_to_bridges_and_are_flat_elsewhere(roads):
    found = profile(roads)

    def height(edge: int, s: float) -> float:
        first, end = found.first[edge], found.first[edge + 1]
        piece = first + int(np.searchsorted(found.start[first:end], s, side="right")) - 1
        return UNIT_M * (float(found.height[piece]) - ZERO)

    above, below = edge_of(roads, "Above"), edge_of(roads, "Below")
    assert height(above, 300.0) == pytest.approx(LEVEL_M)
    assert height(above, 1.0) == 0.0
    assert height(above, 450.0 + RAMP_M + 10.0) == 0.0
    assert 0.0 < height(above, 90.0) < height(above, 130.0) < LEVEL_M
    assert height(above, 470.0) == pytest.approx(height(above, 130.0), abs=0.5)
    assert {height(below, s) for s in range(0, 600, 10)} == {0.0}
    lengths = roads.arrays.edges.length
    back = int(roads.arrays.edges.opposite[above])
    assert height(back, lengths[back] - 300.0) == pytest.approx(LEVEL_M)
    assert np.all(np.diff(found.first) > 0)
    assert roads.attribute("level", above, 300.0) == 1
    assert roads.attribute("level", above, 10.0) == 0


def sentence(body: str) -> bytes:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\r\n".encode()


def gga(second: int, quality: int, satellites: int, height: str = "112.5") -> bytes:
    place = "4924.0000,N,00842.0000,E" if quality else ",,,"
    time = f"1200{second:02}.00"
    return sentence(f"GNGGA,{time},{place},{quality},{satellites:02},1.0,{height},M,47.0,M,,")


def log() -> bytes:
    data = sentence("GNRMC,115959.00,A,4924.0000,N,00842.0000,E,20.0,90.0,010626,,,A")
    for second in range(4):
        data += sentence("GPGSV,1,1,03,01,40,083,46,02,17,308,41,03,07,344,39")
        data += gga(second, 0 if second == 2 else 1, 9)
    return data


def test_a_log_tells_satellites_heights_and_their_strength_where_sensors_ask(tmp_path):
    path = tmp_path / "drive.nmea"
    path.write_bytes(log())
    assert read_nmea(path).sensed == ()
    told = read_nmea(path, columns=["+satellites", "+height_m", "+cn0_dbhz", "+compass_deg"]).sensed
    fixes = read_nmea(path).fixes.time
    assert [one.values.get("satellites") for one in told] == [9.0, 9.0, 0.0, 9.0]
    assert told[0].values == {"satellites": 9.0, "height_m": 112.5, "cn0_dbhz": 42.0}
    assert told[2].values == {"satellites": 0.0, "cn0_dbhz": 42.0}
    assert told[0].time == fixes[1]
    (only,) = {tuple(one.values) for one in read_nmea(path, columns=["+height_m"]).sensed}
    assert only == ("height_m",)


def test_a_stream_tells_the_same_in_pieces_of_any_size():
    stream, found = NmeaStream(told=["satellites"]), []
    data = log()
    for k in range(0, len(data), 7):
        stream.feed(data[k : k + 7])
        found += stream.readings()
    assert [one.values["satellites"] for one in found] == [9.0, 9.0, 0.0, 9.0]
    whole = NmeaTold(found[0].time).feed(data)
    assert [one.time for one in whole] == [one.time for one in found]


@pytest.mark.parametrize(
    ("reading", "lost"),
    [({"satellites": 9.0}, False), ({"satellites": 0.0}, True), ({"cn0_dbhz": 20.0}, True)],
)
def test_weak_satellites_speak_for_a_tunnel(reading, lost):
    (one,) = Sky().rows(reading)
    assert (one.likelihoods[True] > one.otherwise) is lost


def test_sensors_are_named_on_the_command_line():
    assert read_sensors(["Compass", "whichroad.sensors:Height"]) == [Compass(), Height()]
    for text in ("Compas", "whichroad.sensors:Nothing", "nowhere:Sensor", "Sensor"):
        with pytest.raises(typer.BadParameter, match="was expected"):
            read_sensors([text])


def test_a_speed_with_a_gyro_beside_wheels_changes_nothing_and_is_counted(roads, ride):
    drive, _, _, until = ride
    wheels = observations_of(drive, [], until)
    alone = Localizer(roads, vehicle=drive.vehicle)
    both = Localizer(roads, vehicle=drive.vehicle)
    count = 0
    for one in wheels:
        expected, found = alone.update(one), both.update(one)
        if isinstance(one, WheelTicks):
            both.take(SpeedYaw(one.time + 0.01, 12.0, 0.2))
            count += 1
        assert found.p_road == expected.p_road
        assert np.array_equal(found.cov, expected.cov)
    assert both.skipped == {"odometry beside another one (not used)": count}
    assert both.take(SpeedYaw(until + 10.0, 12.0, 0.0))


def test_a_height_that_cannot_be_is_skipped_and_a_level_needs_a_map(roads):
    with pytest.raises(SettingError, match="levels"):
        roads.attribute("levels", 0)
    localizer = Localizer(roads, sensors=[Height(sigma_m=0.0)])
    localizer.update(whichroad.GeoFix(0.0, 49.41, 2.82))
    assert not localizer.take(SensorReading(1.0, {"height_m": 1.0}))
    assert localizer.skipped == {"height: impossible value or sigma": 1}
