"""Logs written for the tests: a sentence writer of their own, and what holds for all records."""

from types import SimpleNamespace

import numpy as np
import pytest

from whichroad.observations import WithGyro


def sealed(body: str) -> bytes:
    """An NMEA sentence with its frame and checksum."""
    check = 0
    for byte in body.encode():
        check ^= byte
    return f"${body}*{check:02X}\r\n".encode()


def angle(degrees: float, digits: int, letters: str) -> str:
    """`ddmm.mmmmmm,N`."""
    micro = round(abs(degrees) * 60e6)
    minutes = f"{micro // 60_000_000:0{digits}d}{micro % 60_000_000 / 1e6:09.6f}"
    return f"{minutes},{letters[degrees < 0]}"


def burst(
    clock="080000.00",
    lat=49.4,
    lon=8.7,
    knots=20.0,
    course="90.0",
    date="010626",
    gst="2.6,1.3,30.0,2.0,1.5",
    talker="GP",
    quality=1,
    hdop="0.9",
) -> bytes:
    """GGA, GST and RMC of one epoch; None leaves a sentence or a date out."""
    place = f"{angle(lat, 2, 'NS')},{angle(lon, 3, 'EW')}"
    lines = [f"{talker}GGA,{clock},{place},{quality},09,{hdop},52.0,M,45.0,M,,"]
    if gst is not None:
        lines.append(f"{talker}GST,{clock},1.2,{gst},3.0")
    if knots is not None:
        lines.append(f"{talker}RMC,{clock},A,{place},{knots},{course},{date or ''},,,A")
    return b"".join(map(sealed, lines))


def check_records(drive) -> None:
    """What observations.py promises: times that increase, nothing but finite numbers."""
    odometry = drive.odometry
    beside = (odometry.distance, odometry.gyro) if isinstance(odometry, WithGyro) else (odometry,)
    for log in (drive.fixes, *beside):
        if log is None:
            continue
        assert (np.diff(log.time) > 0).all()
        for name in log.__dataclass_fields__:
            values = getattr(log, name)
            assert not np.isnan(values).any(), name
            assert name.startswith("sigma_") or np.isfinite(values).all(), name
    assert all(count > 0 for count in drive.skipped.values())


@pytest.fixture(scope="session")
def nmea():
    """The sentence writer."""
    return SimpleNamespace(sealed=sealed, angle=angle, burst=burst)


@pytest.fixture
def sound():
    """`check_records`."""
    return check_records


@pytest.fixture
def put(tmp_path):
    """A function that writes a file and gives its path."""

    def write(name: str, content: bytes | str):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write
