"""CAN logs: signals as cantools decodes them, frames as python-can reads them."""

import can
import cantools
import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from whichroad.errors import ReadError
from whichroad.observations import Odometer, SpeedYawRate, WheelCounts, WheelSpeeds, WithGyro
from whichroad.readers import read_drive
from whichroad.readers.can import decode
from whichroad.readers.can_absent import is_no_value
from whichroad.settings import Vehicle

T0 = 1_780_315_200.0
DBC = """VERSION ""
BU_: Car
BO_ 928 Ticks: 8 Car
 SG_ Left : 0|16@1+ (1,0) [0|65535] "" Car
 SG_ Right : 16|16@1+ (1,0) [0|65535] "" Car
BO_ 929 Speeds: 8 Car
 SG_ SpeedLeft : 7|16@0- (0.01,0) [0|0] "km/h" Car
 SG_ SpeedRight : 23|16@0- (0.01,0) [0|0] "km/h" Car
BO_ 930 Gears: 1 Car
 SG_ Gear : 0|4@1+ (1,0) [0|15] "" Car
BO_ 931 Motion: 8 Car
 SG_ Speed : 0|16@1+ (0.01,0) [0|0] "km/h" Car
 SG_ YawRate : 16|16@1- (0.01,0) [0|0] "deg/s" Car
 SG_ Odometer : 32|32@1+ (0.001,0) [0|0] "km" Car
BO_ 932 Pages: 8 Car
 SG_ Page M : 0|8@1+ (1,0) [0|0] "" Car
 SG_ Hidden m1 : 8|16@1+ (1,0) [0|0] "" Car
BO_ 2566834709 Long: 8 Car
 SG_ LongSpeed : 0|16@1+ (0.01,0) [0|0] "furlong" Car
VAL_ 930 Gear 0 "N" 2 "R" 4 "D" ;
"""
TICKS = {"wheel_rl_ticks": "Left", "wheel_rr_ticks": "Right"}


def vehicle(signals=TICKS, **kwargs):
    """A car of 4 cm per tick."""
    ratio = {"metres_per_tick_left": 0.04, "metres_per_tick_right": 0.04}
    return Vehicle(signals=signals, **ratio, **kwargs)


def ticks(left, right=None):
    """Payload of a frame of counters."""
    right = left if right is None else right
    return b"".join(int(v % 65_536).to_bytes(2, "little") for v in (left, right)) + bytes(4)


def line(time, identifier, data, spaced=False):
    """A frame as candump writes it."""
    name = f"{identifier:03X}" if identifier < 2048 else f"{identifier:08X}"
    if spaced:
        return f" ({time:.6f})  can0  {name}   [{len(data)}]  {data.hex(' ').upper()}\n"
    return f"({time:.6f}) can0 {name}#{data.hex().upper()}\n"


def counters(counts, step=0.1):
    """A log of one count for both wheels, ten times a second."""
    return "".join(line(T0 + step * k, 928, ticks(n)) for k, n in enumerate(counts))


@pytest.fixture
def read(put):
    """A function from a log to its drive."""

    def drive_of(log, car=None, dbc=DBC, name="can.log"):
        dbc = put("car.dbc", dbc)
        return read_drive([], can=put(name, log), dbc=dbc, vehicle=car or vehicle())[0]

    return drive_of


@given(
    length=st.integers(1, 64),
    start=st.integers(0, 63),
    big=st.booleans(),
    signed=st.booleans(),
    scale=st.floats(-1e3, 1e3).filter(lambda s: abs(s) > 1e-6),
    offset=st.floats(-1e6, 1e6),
    payload=st.binary(min_size=8, max_size=8),
)
def test_signals_are_decoded_as_by_cantools(length, start, big, signed, scale, offset, payload):
    assume(length > 1 or not signed)
    check(length, start, big, signed, False, scale, offset, payload)


@given(
    length=st.sampled_from([16, 32, 64]),
    start=st.integers(0, 63),
    big=st.booleans(),
    payload=st.binary(min_size=8, max_size=8),
)
@example(length=32, start=10, big=False, payload=b"\x00\x00\x00\x01\xfe\x01\x00\x00")  # such a NaN
def test_floats_are_decoded_as_by_cantools(length, start, big, payload):
    check(length, start, big, True, True, 1.0, 0.0, payload)


def check(length, start, big, signed, is_float, scale, offset, payload):
    """One signal in one frame, by both."""
    first = 8 * (start // 8) + 7 - start % 8 if big else start
    assume(first + length <= 64)
    signal = cantools.database.can.Signal(
        "S",
        start,
        length,
        byte_order="big_endian" if big else "little_endian",
        is_signed=signed,
        conversion=cantools.database.conversion.BaseConversion.factory(
            scale=scale, offset=offset, is_float=is_float
        ),
    )
    message = cantools.database.can.Message(1, "M", 8, [signal])
    expected = message.decode(payload)["S"]
    data = np.frombuffer(payload, np.uint8).reshape(1, 8)
    assert decode(signal, data) == pytest.approx([expected], rel=1e-12, nan_ok=True)


@pytest.mark.parametrize("spaced", [False, True])
def test_counters_that_wrap_are_unwrapped(read, sound, spaced):
    counts = 65_000 + 30 * np.arange(100)
    log = "".join(line(T0 + 0.1 * k, 928, ticks(n, 2 * n), spaced) for k, n in enumerate(counts))
    drive = read(log)
    sound(drive)
    assert isinstance(drive.odometry, WheelCounts)
    assert drive.odometry.time == pytest.approx(T0 + 0.1 * np.arange(100))
    assert drive.odometry.left == pytest.approx(counts)
    assert np.diff(drive.odometry.right) == pytest.approx(60.0)
    assert drive.skipped == {}


def test_a_counter_that_counts_down_is_driven_backwards(read):
    counts = 20 - 5 * np.arange(20)
    assert np.diff(read(counters(counts)).odometry.left) == pytest.approx(-5.0)


@pytest.mark.parametrize("value", ["R", "2", None])
def test_the_reverse_gear_turns_counters_that_only_rise(read, sound, value):
    frames = []
    for k in range(30):
        gear = 2 if 10 <= k < 20 else (0 if value is None else 4)
        frames.append(line(T0 + 0.1 * k, 930, bytes([gear])))
        frames.append(line(T0 + 0.1 * k + 0.05, 928, ticks(20 * k)))
    signals = TICKS | {"reverse": "Gear"} | ({"reverse_value": value} if value else {})
    drive = read("".join(frames), vehicle(signals))
    sound(drive)
    expected = np.where((np.arange(1, 30) >= 10) & (np.arange(1, 30) < 20), -20.0, 20.0)
    assert np.diff(drive.odometry.left) == pytest.approx(expected)
    assert drive.geared


def test_an_unknown_reverse_value_offers_the_known_ones(read):
    car = vehicle(TICKS | {"reverse": "Gear", "reverse_value": "Back"})
    log = counters(range(5)) + line(T0, 930, b"\x02")
    with pytest.raises(ReadError, match=r"'Back'.*\(D, N, R\)"):
        read(log, car)


def test_counters_that_began_anew_in_a_gap_do_not_run_back(read, sound):
    late = [line(T0 + 5.5 + 0.1 * k, 928, ticks(60 * k)) for k in range(25)]
    drive = read(counters(60 * np.arange(25)) + "".join(late))
    sound(drive)
    assert (np.diff(drive.odometry.left) > 0.0).all()
    assert drive.skipped == {"wheel counter jumped (bridged)": 2}


def test_a_jump_is_bridged_and_counted(read, sound):
    counts = np.cumsum(np.full(50, 20))
    counts[25:] += 30_000
    drive = read(counters(counts))
    sound(drive)
    assert np.diff(drive.odometry.left) == pytest.approx(20.0)
    assert drive.skipped == {"wheel counter jumped (bridged)": 2}  # both wheels


def test_missing_frames_lose_no_distance(read, sound):
    counts = 20 * np.arange(60)
    lines = counters(counts).splitlines(keepends=True)
    drive = read("".join(lines[:20] + lines[35:]))
    sound(drive)
    assert drive.odometry.left[-1] - drive.odometry.left[0] == 20 * 59
    assert drive.skipped == {}


def test_a_long_gap_takes_the_wrap_that_fits_the_speed(read):
    speed = 600  # counts a second: 24 m/s
    at = np.concatenate([np.arange(0, 20, 0.1), np.arange(100, 120, 0.1)])
    log = "".join(line(T0 + t, 928, ticks(round(speed * t))) for t in at)
    odometry = read(log).odometry
    assert odometry.left[-1] - odometry.left[0] == pytest.approx(round(speed * at[-1]))


def test_short_odd_remote_and_error_frames_are_counted(read, sound):
    log = counters(20 * np.arange(10)) + "".join(
        (
            line(T0 + 2, 928, b"\x01\x02"),
            f"({T0 + 3:.6f}) can0 3A0#123\n",
            f"({T0 + 4:.6f}) can0 3A0#R\n",
            f"({T0 + 5:.6f}) can0 20000004#0000000000000000\n",
            "not a frame at all\n\n",
        )
    )
    drive = read(log)
    sound(drive)
    assert len(drive.odometry.time) == 10
    assert drive.skipped == {
        "frame cut short": 2,  # it has the left wheel's counter, not the right one's
        "remote frame": 1,
        "error frame": 1,
        "not a CAN frame": 1,
    }


def test_a_frame_whose_time_is_none_is_counted(read, sound):
    late = line(T0, 928, ticks(0)).replace(f"{T0:.6f}", "9" * 400 + ".0")
    drive = read(counters(20 * np.arange(10)) + late)
    sound(drive)
    assert len(drive.odometry.time) == 10
    assert drive.skipped == {"no time": 2}  # for each wheel's signal


def test_wheel_speeds_come_in_metres_per_second(read, sound):
    def payload(v):
        return b"".join(round(x * 360).to_bytes(2, "big", signed=True) for x in (v, -v)) + bytes(4)

    log = "".join(line(T0 + 0.1 * k, 929, payload(1.0 * k)) for k in range(10))
    drive = read(log, vehicle({"wheel_rl": "SpeedLeft", "wheel_rr": "Speeds.SpeedRight"}))
    sound(drive)
    assert isinstance(drive.odometry, WheelSpeeds)
    assert drive.odometry.left == pytest.approx(np.arange(10.0))
    assert drive.odometry.right == pytest.approx(-np.arange(10.0))


def motion(k):
    """36 km/h, 9 degrees a second, one metre a frame."""
    words = (3600).to_bytes(2, "little") + (900).to_bytes(2, "little") + k.to_bytes(4, "little")
    return line(T0 + 0.1 * k, 931, words)


@pytest.mark.parametrize(
    ("signals", "kind"),
    [
        ({"speed": "Speed", "yaw_rate": "YawRate"}, SpeedYawRate),
        ({"odometer": "Odometer", "speed": "Speed"}, Odometer),
        ({"speed": "Speed"}, Odometer),
    ],
)
def test_without_wheels_speed_yaw_rate_or_an_odometer_will_do(read, sound, signals, kind):
    drive = read("".join(motion(k) for k in range(20)), vehicle(signals))
    sound(drive)
    assert isinstance(drive.odometry, kind)
    if kind is Odometer:
        # times near 2^31 s are kept to a quarter of a microsecond
        assert np.diff(drive.odometry.distance) == pytest.approx(1.0, abs=1e-5)
    else:
        assert drive.odometry.speed == pytest.approx(10.0)
        assert drive.odometry.yaw_rate == pytest.approx(np.radians(9.0))


def test_a_yaw_rate_in_another_frame_turns_an_odometer(read, sound):
    signals = {"odometer": "Odometer", "yaw_rate": "YawRate"}
    log = "".join(motion(k) for k in range(20))
    drive = read(log, vehicle(signals))
    sound(drive)
    assert isinstance(drive.odometry, WithGyro)
    assert np.diff(drive.odometry.distance.distance) == pytest.approx(1.0, abs=1e-5)
    assert drive.odometry.gyro.rate == pytest.approx(np.radians(9.0))
    assert not any("not used" in note for note in drive.notes)
    also = read(log, vehicle(signals | {"speed": "Speed"}))  # a finer step than most odometers'
    assert isinstance(also.odometry, SpeedYawRate)


def test_long_identifiers_are_theirs_alone_and_strange_units_are_noted(read):
    log = "".join(
        line(T0 + k, 2566834709 - 2**31, (3600).to_bytes(2, "little") + bytes(6)) for k in range(5)
    )
    drive = read(log, vehicle({"speed": "LongSpeed"}))
    assert np.diff(drive.odometry.distance) == pytest.approx(36.0)
    assert any("furlong" in note for note in drive.notes)


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".csv", ".trc", ".mf4"])  # asammdf writes MF4
def test_other_logs_are_read_by_python_can(tmp_path, put, suffix, sound):
    log = tmp_path / f"log{suffix}"
    counts = 65_400 + 20 * np.arange(50)
    with can.Logger(str(log)) as writer:
        for k, n in enumerate(counts):
            writer(can.Message(T0 + 0.1 * k, 928, is_extended_id=False, data=ticks(n), channel=1))
    (drive,) = read_drive([], can=log, dbc=put("car.dbc", DBC), vehicle=vehicle())
    sound(drive)
    assert np.diff(drive.odometry.time) == pytest.approx(0.1, abs=2e-3)
    assert np.diff(drive.odometry.left) == pytest.approx(20.0)


@pytest.mark.parametrize("compression", [0, 9])
def test_a_blf_log_with_an_object_of_no_size_does_not_hang(tmp_path, read, compression):
    import struct
    import zlib

    log = tmp_path / "log.blf"
    with can.BLFWriter(str(log), compression_level=compression) as writer:
        for k in range(5):
            writer(can.Message(T0 + k, 928, is_extended_id=False, data=ticks(20 * k), channel=1))
    content = log.read_bytes()
    container = content.index(b"LOBJ")
    size = struct.unpack_from("<I", content, container + 8)[0]
    inner = content[container + 32 : container + size]
    inner = bytearray(zlib.decompress(inner) if compression else inner)
    struct.pack_into("<I", inner, inner.index(b"LOBJ", 10) + 8, 0)
    packed = zlib.compress(inner) if compression else bytes(inner)
    head = bytearray(content[: container + 32])
    struct.pack_into("<I", head, container + 8, 32 + len(packed))
    with pytest.raises(ReadError, match=r"x\.blf: an object of 0 bytes"):
        read(bytes(head) + packed, name="x.blf")


def test_a_log_is_known_by_its_lines(put):
    log = put("drive.txt", counters(20 * np.arange(10)))
    (drive,) = read_drive(log, dbc=put("car.dbc", DBC), vehicle=vehicle())
    assert len(drive.odometry.time) == 10


@pytest.mark.parametrize(
    ("signals", "said"),
    [
        (
            {"wheel_rl_ticks": "Lefd", "wheel_rr_ticks": "Right"},
            "^car.dbc: .signals. wheel_rl_ticks of the vehicle is 'Lefd'.*did you mean Left.*Odome",
        ),
        ({"speed": "Hidden"}, "'Hidden', a multiplexed signal"),
        ({}, r"names no \[signals\].*Left, LongSpeed"),
        ({"speed": "Speed"}, "none of Speed .frame Motion. moves the vehicle"),
    ],
)
def test_signals_that_will_not_do_are_refused(read, signals, said):
    with pytest.raises(ReadError, match=said):
        read(counters(range(5)), vehicle(signals))


ABSENT = """VERSION ""
BU_: Car
BO_ 928 Wheels: 8 Car
 SG_ Left : 0|16@1+ (0.00390625,0) [0|250.996] "km/h" Car
 SG_ Right : 16|16@1+ (0.00390625,0) [0|250.996] "km/h" Car
 SG_ Turn : 32|16@1- (0.01,0) [-300|300] "deg/s" Car
 SG_ Gear : 48|4@1+ (1,0) [0|8] "" Car
 SG_ Pulses : 56|8@1+ (1,0) [0|200] "" Car
VAL_ 928 Right 65535 "Signal_nicht_verf\u00fcgbar" 60000 "Bremse_ungueltig" ;
VAL_ 928 Pulses 255 "SNA" ;
"""


def speeds(k, left=0x2000, right=0x2000, gear=3, turn=100, pulses=7):
    """A frame of `ABSENT`: 32 km/h unless told."""
    data = b"".join(int(v % 65_536).to_bytes(2, "little") for v in (left, right, turn))
    return line(T0 + 0.1 * k, 928, data + bytes([gear, pulses]))


@pytest.mark.parametrize(
    "odd",
    [
        {"left": 0xFFFF},  # all ones, beyond the declared range
        {"left": 0xFE13},  # an error by J1939
        {"right": 0xFFFF},  # so named
        {"right": 60_000},  # so named, inside the range of speeds
        {"left": 0xFFFF, "right": 0xFFFF},
    ],
)
def test_a_signal_that_is_not_available_is_no_speed(read, sound, odd):
    log = "".join(speeds(k, **(odd if k in (0, 1, 20) else {})) for k in range(40))
    drive = read(log, Vehicle(signals={"wheel_rl": "Left", "wheel_rr": "Right"}), ABSENT)
    sound(drive)
    assert drive.odometry.left == pytest.approx(32.0 / 3.6)
    assert drive.odometry.right == pytest.approx(32.0 / 3.6)
    assert drive.skipped == {"signal not available": 3 * len(odd)}


def test_a_yaw_rate_and_a_gear_that_are_not_available_say_nothing(read, sound):
    odd = {3: {"turn": 0x7FFF}, 4: {"turn": -0x8000}, 5: {"gear": 15}, 6: {"gear": 14}}
    log = "".join(speeds(k, **odd.get(k, {})) for k in range(20))
    signals = {"speed": "Left", "yaw_rate": "Turn", "reverse": "Gear", "reverse_value": "15"}
    drive = read(log, Vehicle(signals=signals), ABSENT)
    sound(drive)
    assert (drive.odometry.speed > 0.0).all()
    assert drive.odometry.yaw_rate == pytest.approx(np.radians(1.0))
    assert drive.skipped == {"signal not available": 4}


@pytest.mark.parametrize("told", ["Backwards_err", "9"])
def test_the_value_of_reverse_is_one_whatever_its_name_says(read, told):
    signals = {"speed": "Left", "yaw_rate": "Turn", "reverse": "Gear", "reverse_value": told}
    dbc = ABSENT + 'VAL_ 928 Gear 9 "Backwards_err" 5 "Gear_err" ;\n'
    log = "".join(speeds(k, gear={5: 5, 6: 9}.get(k, 3)) for k in range(20))
    drive = read(log, Vehicle(signals=signals), dbc)
    assert (drive.odometry.speed < 0.0).tolist() == [k == 6 for k in range(20)]
    assert drive.skipped == {"signal not available": 1}


def test_only_its_name_takes_a_number_from_a_counter_that_wraps(read):
    car = vehicle({"wheel_rl_ticks": "Pulses", "wheel_rr_ticks": "Pulses"}, counter_bits=8)
    log = "".join(speeds(k, pulses=3 * k % 256) for k in range(300))
    named = read(log, car, ABSENT)
    plain = read(log, car, ABSENT.replace('VAL_ 928 Pulses 255 "SNA" ;', ""))
    assert np.diff(plain.odometry.left) == pytest.approx(3.0)
    assert "signal not available" not in plain.skipped
    assert named.skipped == {"signal not available": 2}
    assert np.diff(named.odometry.left).sum() == pytest.approx(3.0 * 299)


def test_a_name_or_the_lack_of_a_range_keeps_a_number(read):
    signals = {"wheel_rl": "Left", "wheel_rr": "Right"}
    log = "".join(speeds(k, left=0xFFFF if k == 20 else 0x2000) for k in range(40))
    for dbc in (
        ABSENT.replace("[0|250.996]", "[0|0]"),
        ABSENT + 'VAL_ 928 Left 65535 "Fastest" ;\n',
    ):
        drive = read(log, Vehicle(signals=signals), dbc)
        assert drive.odometry.left.max() == pytest.approx(0xFFFF / 256.0 / 3.6)
        assert not drive.skipped


def test_a_log_without_any_value_says_so(read):
    log = "".join(speeds(k, left=0xFFFF) for k in range(40))
    with pytest.raises(ReadError, match=r"moves the vehicle in it .signal not available: 40"):
        read(log, Vehicle(signals={"speed": "Left"}), ABSENT)


@pytest.mark.parametrize(
    "name",
    [
        *("SNA", "NotAvailable", "not available", "NOT_AVAILABLE", "N/A", "NA", "Unavailable"),
        *("Invalid", "SignalInvalid", "signal not valid", "Error", "Err", "Wheel_fault", "Failure"),
        *(
            "Signal_ungueltig",
            "ung\u00fcltig",
            "nicht verfuegbar",
            "Nicht_verf\u00fcgbar",
            "Fehler",
        ),
        *("Init", "Initialisierung", "Unterspannung", "unknown", "Reserved", "defekt", "Timeout"),
        *(
            "Error not available",
            "Fault, no signal",
            "No signal error",
            "Init failed",
            "fehlerhaft",
        ),
        *("Not initialized", "Uninitialized", "not defined", "No data", "keine Daten"),
    ],
)
def test_names_of_no_value_are_known(name):
    assert is_no_value(name)


@pytest.mark.parametrize(
    "name",
    [
        *("No error", "NoFault", "kein Fehler", "fehlerfrei", "ErrorFree", "R", "Reverse", "N"),
        *("Valid", "Standstill", "Stillstand", "Not reverse", "NotActive", "Off", "gueltig"),
        *("Snail", "Natural", "Initiated", "Terror"),
        *("Fault_not_present", "Fehler nicht vorhanden", "Err_none", "Not_Invalid", "NotInvalid"),
        *("Invalid_False", "No_Timeout", "Timeout_inactive", "Not missing", "defekt_nein"),
        *("Init_OK", "Initialised", "Initialized", "Initialisiert", "Initialization finished"),
        *("Failsafe_inactive", "Without_fault", "keine St\u00f6rung", "not reserved"),
    ],
)
def test_names_of_values_are_not_taken_for_them(name):
    assert not is_no_value(name)


def test_a_log_without_its_dbc_is_refused(put):
    with pytest.raises(ReadError, match=r"can\.log: .*--dbc"):
        read_drive([], can=put("can.log", counters(range(5))), vehicle=vehicle())


@pytest.mark.parametrize("content", [b"", b"lat,lon\n1,2\n", b"\0\1\2", b"(12.5) can0"])
@pytest.mark.parametrize("name", ["x.log", "x.asc", "x.blf", "x.csv", "x.trc"])
def test_what_is_no_log_is_refused_by_name(read, name, content):
    with pytest.raises(ReadError, match=r"x\."):
        read(content, name=name)


@pytest.mark.parametrize("content", ["", "BO_ nonsense", "\0\1", "<xml/>", "{}"])
def test_what_is_no_dbc_is_refused_by_name(read, content):
    with pytest.raises(ReadError, match=r"car\.dbc"):
        read(counters(range(5)), dbc=content)


def test_counters_of_the_wrong_scale_are_refused(read):
    with pytest.raises(ReadError, match="metres_per_tick"):
        read(
            counters(20 * np.arange(50)),
            Vehicle(signals=TICKS, metres_per_tick_left=40.0, metres_per_tick_right=40.0),
        )


def test_the_simulated_car_is_read_back_as_it_was(tmp_path):
    from whichroad.readers import read_vehicle
    from whichroad.roadmap import RoadMap
    from whichroad.simulate import draw_town, simulate_drive, write_drive

    town = tmp_path / "town.osm"
    town.write_text(draw_town())
    roads = RoadMap.from_osm(town)
    simulated = simulate_drive(roads, seed=3, length_m=2000.0)
    files = {path.name: path for path in write_drive(simulated, roads, tmp_path / "drive")}
    (drive,) = read_drive(
        files["drive.nmea"],
        can=files["can.log"],
        dbc=files["vehicle.dbc"],
        vehicle=read_vehicle(files["vehicle.toml"]),
    )
    wheels, fixes = simulated.drive.odometry, simulated.drive.fixes
    assert drive.odometry.time == pytest.approx(wheels.time, abs=1e-6)
    for side in ("left", "right"):
        read, true = getattr(drive.odometry, side), getattr(wheels, side)
        assert np.array_equal(read - read[0], true - true[0])
    assert drive.fixes.time == pytest.approx(fixes.time, abs=5e-3)
    assert np.abs(drive.fixes.lat_deg - fixes.lat_deg).max() < 1e-8
    assert np.abs(drive.fixes.lon_deg - fixes.lon_deg).max() < 1e-8
    assert drive.fixes.cov_ee == pytest.approx(fixes.cov_ee, rel=0.02, abs=0.02)
    assert drive.fixes.speed == pytest.approx(fixes.speed, abs=1e-3)


def test_a_damaged_mf4_file_is_refused_in_one_sentence_and_nothing_is_printed(tmp_path, put, capfd):
    log = tmp_path / "log.mf4"
    with can.Logger(str(log)) as writer:
        for k in range(20):
            writer(can.Message(T0 + 0.1 * k, 928, is_extended_id=False, data=ticks(k), channel=1))
    whole = log.read_bytes()
    for cut in (70, 200, len(whole) // 2):
        log.write_bytes(whole[:cut])
        with pytest.raises(ReadError, match=r"log\.mf4"):
            read_drive([], can=log, dbc=put("car.dbc", DBC), vehicle=vehicle())
    assert capfd.readouterr() == ("", "")


def test_an_mf4_file_that_leads_its_reader_in_a_circle_is_refused_in_time(tmp_path, monkeypatch):
    import struct
    from collections import Counter

    from whichroad.readers import mf4

    log = tmp_path / "log.mf4"
    with can.Logger(str(log)) as writer:
        for k in range(20):
            writer(can.Message(T0 + 0.1 * k, 928, is_extended_id=False, data=ticks(k), channel=1))
    assert len(list(mf4.messages(log, Counter()))) == 20
    content = bytearray(log.read_bytes())
    group = content.index(b"##DG")
    struct.pack_into("<Q", content, group + 24, group)  # the next group of data is this one
    log.write_bytes(content)
    monkeypatch.setattr(mf4, "LEAST_TIME", 3.0)
    with pytest.raises(ReadError, match=r"log\.mf4: asammdf came to no end within 3 s"):
        list(mf4.messages(log, Counter()))


def test_without_asammdf_the_remedy_is_named(tmp_path, monkeypatch):
    from collections import Counter

    from whichroad.readers import mf4

    monkeypatch.setitem(__import__("sys").modules, "asammdf", None)
    with pytest.raises(ReadError, match=r'asammdf is needed.*pip install "whichroad\[mf4\]"'):
        list(mf4.messages(tmp_path / "log.mf4", Counter()))
