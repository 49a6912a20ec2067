"""J1939: messages are found by their group, whoever sends them."""

from types import SimpleNamespace

import numpy as np
import pytest

from readers.truck import DBC
from whichroad.errors import ReadError
from whichroad.observations import Odometer, SpeedYawRate
from whichroad.readers import read_drive
from whichroad.readers.can_frames import EXTENDED
from whichroad.readers.j1939 import Senders, bare, group_of, mask_of
from whichroad.settings import Vehicle

T0 = 1_780_315_200.0
BOTH = {"speed": "WheelSpeed", "yaw_rate": "YawRate"}
SPEED, TURN = 2566844926 - 2**31, 2565868030 - 2**31


def line(k, identifier, at, value):
    """A frame with one value of 16 bits at a byte."""
    data = bytearray(b"\xff" * 8)
    data[at : at + 2] = int(value).to_bytes(2, "little")
    return f"({T0 + 0.1 * k:.6f}) can0 {identifier:08X}#{data.hex().upper()}\n"


def speeds(identifier, kmh=36, count=20):
    return [line(k, identifier, 1, 256 * kmh) for k in range(count)]


def turns(identifier):
    return [line(k, identifier, 3, round((0.1 + 3.92) * 8192)) for k in range(20)]


@pytest.fixture
def read(put):
    def drive_of(lines, signals=BOTH, dbc=DBC):
        log = put("can.log", "".join(sorted(lines, key=lambda one: float(one[1:18]))))
        car = Vehicle(signals=signals)
        return read_drive([], can=log, dbc=put("car.dbc", dbc), vehicle=car)[0]

    return drive_of


@pytest.mark.parametrize(
    ("frame", "group", "mask"),
    [(0x18FEF1FE, 65265, 0x3FFFF00), (0x0CFEF100, 65265, 0x3FFFF00),
     (0x19FEF100, 130801, 0x3FFFF00), (0x0CF00400, 61444, 0x3FFFF00),
     (0x0C000B03, 0, 0x3FF0000), (0x18EF1234, 61184, 0x3FF0000)],
)  # fmt: skip
def test_a_destination_is_no_part_of_a_group(frame, group, mask):
    assert group_of(frame) == group_of(frame | EXTENDED) == group
    assert mask_of(frame) == mask
    assert bare(frame) & mask == frame & mask
    assert bare(frame) & 0xFF == frame & 0xFF
    assert bare(bare(frame)) == bare(frame)


def test_messages_are_read_whoever_sends_them_and_that_is_noted(read):
    drive = read(speeds(0x18FEF100) + turns(0x0CF0090B))
    assert isinstance(drive.odometry, SpeedYawRate)
    assert drive.odometry.speed == pytest.approx(10.0)
    assert drive.odometry.yaw_rate == pytest.approx(0.1, abs=1e-4)
    assert drive.notes == (
        "frame CCVS1: read from source address 00, as FE of the .dbc does not send PGN 65265",
        "frame VDC2: read from source address 0B, as FE of the .dbc does not send PGN 61449",
    )


def test_of_several_senders_the_first_is_read_and_the_others_are_noted(read):
    late = speeds(0x18FEF121, 72)[1:]
    drive = read(speeds(0x18FEF100) + late + speeds(0x18FEF103, 90)[5:] + turns(TURN))
    assert drive.odometry.speed == pytest.approx(10.0)
    [note] = drive.notes
    assert "from source address 00" in note
    assert "; 21, 03 sends it too and is not read: write the address that is meant" in note
    assert "(id 18FEF121 for 21)" in note


def without(identifier, value=0xFFFF, count=20):
    return [line(k - 0.5, identifier, 1, value) for k in range(count)]


@pytest.mark.parametrize("value", [0xFFFF, 0xFE00])
def test_the_first_that_gives_a_value_is_read_and_who_gives_none_is_noted(read, value):
    """Many units send CCVS1; those that do not know the speed say so in it."""
    drive = read(without(0x18FEF100, value) + speeds(0x18FEF121), {"speed": "WheelSpeed"})
    assert len(drive.odometry.time) == 20
    assert drive.notes == (
        "frame CCVS1: read from source address 21, as FE of the .dbc does not send PGN 65265; "
        "00 sends it without a value",
    )
    assert not drive.skipped  # frames of who is not read


def test_a_sender_of_the_dbc_without_values_is_left_for_one_with_them(read):
    dbc = DBC.replace(str(SPEED | EXTENDED), str(0x18FEF121 | EXTENDED))
    some = speeds(0x18FEF100) + turns(TURN)
    drive = read(without(0x18FEF121) + some, dbc=dbc)
    assert drive.odometry.speed == pytest.approx(10.0)
    assert drive.notes == (
        "frame CCVS1: read from source address 00, as 21 of the .dbc gives no value in PGN 65265",
    )
    drive = read(without(0x18FEF121, count=3) + speeds(0x18FEF121, 72)[8:] + some, dbc=dbc)
    assert drive.odometry.speed == pytest.approx(20.0)
    assert not drive.notes


def test_senders_are_named_where_none_gives_a_value(read):
    lines = without(0x18FEF100) + without(0x18FEF121)[1:] + turns(TURN)
    with pytest.raises(ReadError) as told:
        read(lines)
    assert (
        "CCVS1 (PGN 65265) comes from source address 00 without a value, 21 without a value and "
        "VDC2 (PGN 61449) comes from source address FE; is it the right .dbc?"
    ) in str(told.value)


def test_the_sender_of_the_dbc_is_read_wherever_it_begins(read):
    dbc = DBC.replace(str(SPEED | EXTENDED), str(0x18FEF121 | EXTENDED))
    drive = read(speeds(0x18FEF100) + speeds(0x0CFEF121, 72)[8:] + turns(TURN), dbc=dbc)
    assert drive.odometry.speed == pytest.approx(20.0)  # another priority is the same message
    assert not drive.notes


def test_frames_to_any_destination_are_those_of_their_sender(read):
    lines = [line(k, 0x0CEF0003 + (k % 2 << 8), 0, 256 * 36) for k in range(20)]
    drive = read([*lines, line(3.5, 0x0CEE0003, 0, 0)], {"speed": "ToSpeed"})
    assert isinstance(drive.odometry, Odometer)
    assert len(drive.odometry.time) == 20
    assert np.diff(drive.odometry.distance) == pytest.approx(1.0, rel=1e-5)


def test_what_a_dbc_does_not_mark_is_refused_with_its_senders(read):
    dbc = DBC.split("BA_DEF_ ")[0]
    with pytest.raises(ReadError) as told:
        read(speeds(0x18FEF100) + speeds(0x18FEF121), dbc=dbc)
    text = str(told.value)
    assert (
        "no frame CCVS1 (18FEF1FE), VDC2 (18F009FE) came; by J1939 it has CCVS1 from 00, 21; "
        in text
    )
    assert "VFrameFormat (J1939PG)" in text


def test_a_message_that_does_not_come_is_told(read):
    drive = read(speeds(0x18FEF100))
    assert "signal YawRate: no frame VDC2 (18F009FE, PGN 61449) is in the log" in drive.notes
    with pytest.raises(
        ReadError, match=r"no frame CCVS1 \(18FEF1FE, PGN 65265\).* came; is it the"
    ):
        read(speeds(0x18FEF200))


def test_on_line_the_first_is_read_until_that_of_the_dbc_is_heard():
    message = SimpleNamespace(name="CCVS1", frame_id=0x18FEF121)
    senders = Senders([message])
    ours = bare(0x18FEF121)
    assert senders.take(0x18FEF100 | EXTENDED) == [ours]
    assert senders.take(0x18FEF103 | EXTENDED) == []
    assert senders.take(0x18FEF200 | EXTENDED) == []
    assert [one.others for one in senders.told()] == [True]
    assert senders.take(0x18FEF121 | EXTENDED) == [ours]
    assert senders.take(0x18FEF100 | EXTENDED) == []
    assert senders.told() == []


def test_on_line_the_first_that_gives_a_value_is_read_until_that_of_the_dbc_gives_one():
    senders = Senders([SimpleNamespace(name="CCVS1", frame_id=0x18FEF121)])
    ours, first, second = bare(0x18FEF121), 0x18FEF100 | EXTENDED, 0x18FEF103 | EXTENDED
    exact = 0x18FEF121 | EXTENDED

    def take(frame, gives):
        before = senders.news
        return senders.take(frame, lambda _: gives) == [ours], senders.news - before

    assert take(first, False) == (True, 1)
    assert take(second, False) == (False, 1)
    assert take(exact, False) == (True, 1)
    assert take(first, False) == (False, 0)
    assert take(second, True) == (True, 1)
    assert take(first, True) == (False, 1)
    assert take(exact, False) == (False, 0)
    [one] = senders.told()
    assert one.others
    assert "as 21 of the .dbc gives no value in PGN 65265; 00 sends it too" in one.text
    assert take(exact, True) == (True, 1)
    assert take(second, True) == (False, 0)
    assert take(exact, False) == (True, 0)
    assert senders.told() == []
