"""Sources of the live service as they are named on the command line."""

import re
from dataclasses import dataclass

from ..errors import SettingError
from ..readers.source import STDIN

_ADDRESS = re.compile(r"(tcp|udp|listen)://(\[[^\]]*\]|[^:/]*):(\d{1,5})/?")
_SERIAL = re.compile(r"(?:serial:)?((?:/dev/|COM|\\\\\.\\)[^@]+)(?:@(\d+))?")


@dataclass(frozen=True, slots=True)
class Address:
    """A source as it was named.

    Attributes:
        kind: serial, tcp, udp, listen, standard (input), can.
        place: Device, host, or channel.
        number: Baud rate or port.
        interface: python-can's name of the CAN interface.
    """

    kind: str
    place: str
    number: int = 0
    interface: str = ""


def nmea_address(text: str, option: str = "--nmea") -> Address:
    """`/dev/ttyUSB0@9600`, `tcp://host:port`, `udp://:port`, `listen://host:port`, or `-`.

    Args:
        text: As it was given.
        option: By which.

    Raises:
        SettingError: It is none of them.
    """
    if (found := _ADDRESS.fullmatch(text)) and int(found[3]) < 65_536:
        return Address(found[1], found[2].strip("[]") or "127.0.0.1", int(found[3]))
    if text == STDIN:
        return Address("standard", "input")
    if scheme := re.match(r"(tcp|udp|listen)://", text):
        raise SettingError(
            f"{option} is {text!r}, without a port from 0 to 65535; {scheme[0]}HOST:PORT was "
            "expected; add the port"
        )
    if found := _SERIAL.fullmatch(text):
        return Address("serial", found[1], int(found[2] or 9600))
    raise SettingError(
        f"{option} is {text!r}, and the file does not exist; a serial port (/dev/ttyUSB0@9600), "
        "tcp://HOST:PORT, udp://HOST:PORT, listen://HOST:PORT, - (standard input)"
        + (", or a recorded file" if option == "--nmea" else "")
        + " was expected; check the name"
    )


def can_address(text: str) -> Address:
    """`can0` of socketcan, or `INTERFACE:CHANNEL` as python-can knows them.

    Raises:
        SettingError: It is empty.
    """
    interface, colon, channel = text.partition(":")
    if not text or (colon and not (interface and channel)):
        raise SettingError(
            f"--can is {text!r}; a socketcan interface (can0), INTERFACE:CHANNEL (virtual:bus), or "
            "a recorded file was expected"
        )
    return Address("can", channel, 0, interface) if colon else Address("can", text, 0, "socketcan")
