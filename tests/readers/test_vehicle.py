"""`vehicle.toml`: one car, and what is said of its mistakes."""

import inspect
import pickle
from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from whichroad.errors import ReadError, SettingError
from whichroad.readers import read_vehicle
from whichroad.readers.vehicle import ROLES
from whichroad.settings import Settings, Vehicle, to_toml

NUMBERS = st.floats(-1e6, 1e6)
POSITIVE = st.floats(1e-6, 1e6)
NAMES = st.text(min_size=1, max_size=12).filter(lambda s: s.isprintable())
FILES = st.text("abcäß漢 ._-'\"\\0189", min_size=1, max_size=12)


@given(
    st.builds(
        Vehicle,
        track_width=st.floats(1e-6, 5.0),
        metres_per_tick_left=POSITIVE,
        metres_per_tick_right=POSITIVE,
        counter_bits=st.integers(0, 64),
        least_speed=st.floats(0.0, 3.0),
        antenna_forward=st.floats(-30.0, 30.0),
        antenna_left=st.floats(-30.0, 30.0),
        clock_offset=st.dictionaries(FILES, NUMBERS, max_size=3),
        signals=st.dictionaries(st.sampled_from(sorted(ROLES)), NAMES, max_size=4),
        noise=st.dictionaries(st.just("heading_noise"), st.floats(0, 0.1), max_size=1),
        driving_side=st.sampled_from(["left", "right"]),
    )
)
def test_a_vehicle_written_is_the_vehicle_read(tmp_path_factory, vehicle):
    path = tmp_path_factory.mktemp("car") / "vehicle.toml"
    path.write_bytes(to_toml(vehicle).encode())
    assert read_vehicle(path) == vehicle


def test_an_empty_file_is_the_usual_car(put):
    assert read_vehicle(put("vehicle.toml", "")) == Vehicle()


def test_one_number_may_stand_for_both_wheels(put):
    vehicle = read_vehicle(put("vehicle.toml", "[wheels]\nmetres_per_tick = 0.05\n"))
    assert vehicle.metres_per_tick_left == vehicle.metres_per_tick_right == 0.05


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[wheel]\n", "unknown key 'wheel'.*did you mean wheels"),
        ("[wheels]\ntrack_width = 1.5\n", "unknown key 'track_width'.*did you mean track_width_m"),
        ("[signals]\nwheel_rl_tick = 'A'\n", "did you mean wheel_rl_ticks"),
        ("[noise]\nheading_nois = 1\n", "did you mean heading_noise"),
        ("[noise]\nheading_noise = 5\n", "heading_noise is 5"),
        ("[wheels]\ntrack_width_m = 'wide'\n", "'wide'; a finite number"),
        ("[wheels]\ntrack_width_m = nan\n", "nan; a finite number"),
        ("[wheels]\ntrack_width_m = -1.5\n", "track_width is -1.5 m"),
        ("[wheels]\ntrack_width_m = 1500\n", "track_width is 1500.0 m.*in millimetres"),
        ("[antenna]\nforward_m = 1200\n", "antenna_forward is 1200.0 m.*in millimetres"),
        ("[wheels]\nmetres_per_tick = 0\n", "metres_per_tick_left is 0"),
        ("[wheels]\ncounter_bits = 16.5\n", "counter_bits is 16.5"),
        ("[clock]\ngnss = true\n", "True; a finite number"),
        ("[signals]\nspeed = ['a']\n", "the name of a signal"),
        ("driving_side = 'middle'\n", "'middle'; 'right' or 'left'"),
        ("wheels = 4\n", r"a section \[wheels\]"),
        ("wheels\n", "not TOML"),
    ],
)
def test_mistakes_are_named(put, text, said):
    with pytest.raises(ReadError, match=rf"vehicle\.toml: .*{said}"):
        read_vehicle(put("vehicle.toml", text))


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200).map(str.encode)))
def test_any_bytes_give_a_vehicle_or_a_read_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("car") / "vehicle.toml"
    path.write_bytes(content)
    try:
        vehicle = read_vehicle(path)
    except ReadError:
        return
    assert isinstance(vehicle, Vehicle)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Settings(protection_rsk=1e-4), "Settings: protection_rsk .* mean protection_risk"),
        (lambda: Settings(moon=1.0), "Settings: moon is no field of it.*; remove it"),
        (lambda: Settings(map_sigma="wide"), "Settings: map_sigma='wide' was given"),
        (lambda: Settings(4.0), "Settings: 4.0 was given"),
        (lambda: Vehicle(trackwidth=1.5), "Vehicle: trackwidth .* mean track_width"),
        (lambda: Vehicle(track_width="1.5 m"), "Vehicle: track_width='1.5 m' was given"),
    ],
)
def test_a_number_in_python_that_is_none_or_has_a_wrong_name_is_refused(make, message: str):
    with pytest.raises(SettingError, match=message):
        make()


def test_settings_show_their_fields_to_who_asks():
    names = list(inspect.signature(Settings).parameters)
    assert names == [f.name for f in fields(Settings)]
    assert pickle.loads(pickle.dumps(Settings(map_sigma=3.0))) == Settings(map_sigma=3.0)
