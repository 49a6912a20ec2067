"""Further sensors on line: lines of JSON, a bus, what receivers say, what is recorded."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage
from typer.testing import CliRunner

import whichroad
from readers.test_can import DBC, line, ticks, vehicle
from readers.test_ubx import ITOW, NOON, pvt
from whichroad import GeoFix, Localizer, read_drive
from whichroad.cli import app
from whichroad.evidence.sensed import columns_of
from whichroad.geodesy.angles import bearing_of
from whichroad.live.dead_reckoning import DeadReckoning
from whichroad.live.decode import CanStream, NmeaStream
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.heard_sensors import HeardSensors
from whichroad.live.playback import RecordedObservations
from whichroad.live.reading_lines import ReadingLines
from whichroad.live.recording import Recorder
from whichroad.live.troubles import Troubles
from whichroad.readers.can_frames import read_frames
from whichroad.readers.nmea_told import NmeaTold
from whichroad.sensors import Compass, DualAntenna, SensorReading, Sky
from whichroad.writers.nmea_text import sealed

SENSORS = [Compass(), DualAntenna()]
COLUMNS = columns_of(SENSORS)
WAY = """BO_ 935 Way: 8 Car
 SG_ North : 0|16@1+ (0.001,0) [0|0] "rad" Car
 SG_ Sure : 16|16@1+ (0.01,0) [0|0] "deg" Car
"""


def test_lines_of_json_are_readings_and_the_rest_is_counted():
    lines, found = ReadingLines(SENSORS, offset=0.5), []
    good = [
        {"time": 1780300800.5, "compass_deg": 91.5, "more": "x"},
        {"time": "2026-06-01T08:00:01Z", "sensor": "compass", "compass_deg": 92},
        {"antennas_deg": 1.0, "antennas_sigma_deg": 0.2},
    ]
    bad = [b"rubbish", b"[1]", b"{}", b'{"compass_deg": NaN}', b'{"compass_deg": true}',
           b'{"compass_deg": 1, "time": "never"}', b'{"compass_deg": 1, "sensor": "other"}',
           b'{"compass_deg": 1' + b" " * 9000 + b"}", b"[" * 3000]  # fmt: skip
    data = b"\n".join([*(json.dumps(one).encode() for one in good), *bad]) + b"\n\n"
    for k in range(0, len(data), 100):
        assert lines.feed(data[k : k + 100]) == lines.flush() == []
        found += lines.readings()
    assert found[:2] == [
        SensorReading(1780300801.0, {"compass_deg": 91.5}),
        SensorReading(1780300801.5, {"compass_deg": 92.0}, "compass"),
    ]
    assert found[2].values == {"antennas_deg": 1.0, "antennas_sigma_deg": 0.2}
    assert found[2].time > 1.7e9
    assert (len(found), lines.skipped) == (3, len(bad))


def test_signals_of_a_bus_are_readings_live_as_in_a_log(tmp_path):
    (tmp_path / "car.dbc").write_text(DBC.replace("BO_ 932", f"{WAY}BO_ 932"))
    car = vehicle(sensors={"antennas_deg": "North", "antennas_sigma_deg": "Sure", "tag": "Gear"})
    rows = [(1_780_315_200.0 + 0.1 * k, 928, ticks(10 * k)) for k in range(40)]
    way = [(t + 0.05, 935, (1000 + k).to_bytes(2, "little") + b"\x32\0" + bytes(4))
           for k, (t, *_) in enumerate(rows)]  # fmt: skip
    log = tmp_path / "car.log"
    log.write_text("".join(line(*row) for row in sorted(rows + way)))
    (drive,) = read_drive(can=log, dbc=tmp_path / "car.dbc", vehicle=car, paths=[], columns=COLUMNS)
    assert len(drive.sensed) == 40
    assert drive.sensed[3].values == pytest.approx(
        {"antennas_deg": np.degrees(1.003), "antennas_sigma_deg": 0.5}
    )
    stream, found = CanStream(tmp_path / "car.dbc", car, columns=COLUMNS), []
    for key, frames in read_frames(log, stream.frames, Counter()).items():
        for when, data in zip(frames.time, frames.data, strict=True):
            found += stream.feed(key, float(when), bytes(data))
    told = [one for one in found if isinstance(one, SensorReading)]
    assert [one.time for one in told] == [one.time for one in drive.sensed]
    assert told[3].values == pytest.approx(drive.sensed[3].values)
    assert len(found) > len(told)
    plain = read_drive(can=log, dbc=tmp_path / "car.dbc", vehicle=car, paths=[])[0]
    assert plain.sensed == ()
    wrong = vehicle(sensors={"antennas_deg": "Nort"})
    said = r"\[sensors\] antennas_deg of the vehicle is 'Nort'.*North"
    with pytest.raises(whichroad.ReadError, match=said):
        CanStream(tmp_path / "car.dbc", wrong, columns=COLUMNS)


def relposned(k, heading, valid=1):
    """A NAV-RELPOSNED half a second after the k-th epoch, by pyubx2."""
    return UBXMessage(
        "NAV", "NAV-RELPOSNED", GET, version=1, iTOW=ITOW + 1000 * k + 500,
        relPosHeading=heading, accHeading=0.3, gnssFixOK=1, relPosValid=1,
        relPosHeadingValid=valid,
    ).serialize()  # fmt: skip


def test_a_receiver_in_ubx_tells_the_same_live_as_in_its_log(tmp_path):
    content = b"".join(pvt(k) + relposned(k, 10.0 + k, valid=k != 4) for k in range(8))
    (tmp_path / "two.ubx").write_bytes(content)
    asked = columns_of([*SENSORS, Sky()])
    (drive,) = read_drive(tmp_path / "two.ubx", columns=asked)
    stream, found = NmeaStream(told=[name.removeprefix("+") for name in asked]), []
    for k in range(0, len(content), 50):
        stream.feed(content[k : k + 50])
        found += stream.readings()
    assert sorted(found, key=lambda one: one.time) == list(drive.sensed)
    turned = [one for one in found if "antennas_deg" in one.values]
    assert [one.time - NOON for one in turned] == [0.5, 1.5, 2.5, 3.5, 5.5, 6.5, 7.5]
    assert turned[2].values == pytest.approx(
        {"antennas_deg": 12.0, "antennas_sigma_deg": 0.3}, rel=1e-4
    )
    assert sum("satellites" in one.values for one in found) == 8


def test_headings_of_nmea_have_the_time_of_the_sentence_before_them():
    gga = "GPGGA,0800{:02d}.00,4924.5,N,00242.1,E,1,09,0.9,52.0,M,45.0,M,,"
    said = [gga.format(0), "GPTHS,90.5,A", "GPTHS,91.5,A", "HCHDG,85.0,1.5,W,2.0,E",
            gga.format(1), "GPHDT,91.0,T", gga.format(2), "GPTHS,92.0,V"]  # fmt: skip
    told = NmeaTold(1_780_300_800.0, ("antennas_deg", "compass_deg"))
    found = told.feed(b"".join(sealed(one) for one in said))
    assert [(one.time - 1_780_300_800.0, one.values) for one in found] == [
        (0.0, {"antennas_deg": 90.5}), (0.0, {"compass_deg": 83.5}), (1.0, {"antennas_deg": 91.0}),
    ]  # fmt: skip


@pytest.fixture(scope="module")
def heard_too(town, ride, observations):
    """The drive with a compass beside it, a reading a second."""
    t = ride.truth
    k = np.arange(5, len(t), 10)
    bearing = bearing_of(t.heading[k], town.plane.convergence(t.x[k], t.y[k]))
    said = [
        SensorReading(float(when), {"compass_deg": float(value)})
        for when, value in zip(t.time[k], bearing, strict=True)
    ]
    return sorted([*observations, *said], key=lambda one: one.time)


def test_readings_are_recorded_read_back_and_played(town, ride, heard_too, tmp_path):
    recorder = Recorder(tmp_path / "rec", town, {}, ["compass_deg"])
    for one in heard_too:
        recorder.observe(one)
    recorder.close()
    readings = [one for one in heard_too if isinstance(one, SensorReading)]
    (drive,) = read_drive(tmp_path / "rec", vehicle=ride.vehicle, columns=COLUMNS)
    assert [one.values for one in drive.sensed] == [one.values for one in readings]
    assert read_drive(tmp_path / "rec", vehicle=ride.vehicle)[0].sensed == ()
    played = RecordedObservations(drive, laps=2)
    found = [played[k] for k in range(len(played)) if isinstance(played[k], SensorReading)]
    assert [one.values for one in found] == 2 * [one.values for one in readings]
    assert found[0].time == pytest.approx(readings[0].time, abs=1e-6)


@pytest.mark.parametrize("wrong", [False, True])
def test_a_message_tells_how_sensors_were_heard_and_which_is_withheld(
    town, ride, heard_too, wrong
):  # fmt: skip
    loop = FilterLoop(
        Localizer(town, vehicle=ride.vehicle, sensors=[Compass(sigma_deg=2.0, lasts_m=0.0), Sky()]),
        window=0.0,
    )
    for one in heard_too:
        if wrong and isinstance(one, SensorReading):
            one = SensorReading(one.time, {"compass_deg": -one.values["compass_deg"]})
        loop.observe([one])
    loop.publish()
    heard = {one["name"]: one for one in loop.message["heard"]}
    assert list(heard) == ["gnss", "wheels", "compass", "sky"]
    assert heard["compass"]["doubted"] == (["readings"] if wrong else [])
    assert (heard["compass"]["withheld"] > 5) is wrong
    assert heard["compass"]["rate_hz"] == pytest.approx(1.0, rel=0.05)
    assert heard["wheels"]["rate_hz"] == pytest.approx(10.0, rel=0.05)
    assert (heard["sky"]["count"], heard["sky"]["age_s"]) == (0, None)
    scale, drift = heard["wheels"]["learnt"]
    assert (scale["what"], drift["what"]) == ("scale", "drift")
    assert abs(scale["value"] - 1.0) < 5.0 * scale["sigma"] < 0.06
    assert loop.message["ahead"] is None


def test_who_is_silent_has_no_rate():
    heard = HeardSensors([Compass()])
    for k in range(100):
        heard.take(GeoFix(0.5 * k, 49.4, 8.7))
    (fixes, compass) = heard.messages(49.5, ())
    assert (fixes["rate_hz"], fixes["age_s"], fixes["doubted"]) == (2.0, 0.0, None)
    assert compass["count"] == 0
    assert heard.messages(60.0, ())[0]["rate_hz"] == 0.0
    heard.forget_after(10.0)
    assert heard.messages(20.0, ())[0]["age_s"] is None


def test_wheels_alone_go_on_beside_a_compass(town, ride, heard_too):
    alone, beside = (DeadReckoning(town.plane, ride.vehicle) for _ in range(2))
    localizer = Localizer(town, vehicle=ride.vehicle)
    estimate = next(e for e in map(localizer.update, filter(_is_fix, heard_too)) if e.answered)
    alone.reset(estimate)
    beside.reset(estimate)
    for one in heard_too:
        beside.take(one)
        if not isinstance(one, SensorReading):
            alone.take(one)
    assert beside.message() == alone.message()
    assert alone.message()["travelled_m"] > 100.0


def _is_fix(one):
    return isinstance(one, GeoFix)


def test_readings_without_a_sensor_are_refused_before_anything_is_opened(tmp_path):
    given = ["live", "--map", str(tmp_path / "no.map"), "--nmea", "udp://:1", "--readings"]
    done = CliRunner().invoke(app, [*given, "udp://:2"])
    assert "--readings goes with --sensor" in done.output
    assert done.exit_code == 2


class Broken:
    """A plug-in that fails at every other reading."""

    name, columns = "broken", ("count",)

    def rows(self, reading):
        """None, or an error."""
        if reading["count"] % 2:
            raise RuntimeError(f"no {reading['count']:g}")
        return []


def test_a_plug_in_that_raises_is_named_once_and_its_readings_are_counted(town, observations):
    said, sensors = [], [Broken(), Compass()]
    loop = FilterLoop(Localizer(town, sensors=sensors), troubles=Troubles(said.append))
    port = loop.sensor("readings", "readings")
    for k, one in enumerate(observations[:200]):
        loop.observe([one])
        reading = SensorReading(one.time + 0.001, {"count": float(k)})
        loop.take(port, [reading], 0.0, recorded=True)
    late = [one for one in observations[200:240] if isinstance(one, GeoFix)]
    loop.observe([replace(late[0], time=observations[199].time - 0.45)])
    assert loop.buffer.rewinds
    health = loop.health()
    assert health["skipped"]["sensor broken: reading that it failed at"] == 100
    assert health["sensors"][0]["count"] == 200
    reason = "sensor broken: rows raised RuntimeError (no 1); a list of evidence was expected"
    assert said == [f"{reason}; correct its class; its readings are skipped"]
    assert health["problems"] == [f"{reason}; correct its class"]
    assert loop.localizer.answered
