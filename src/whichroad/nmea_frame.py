"""The frame of NMEA 0183 sentences: `$`, the body, `*`, a checksum, the end of the line."""

from functools import reduce
from operator import xor


def checksum(body: bytes) -> int:
    """Of what stands between the $ and the *: all bytes by exclusive or."""
    return reduce(xor, body, 0)


def sealed(body: str) -> bytes:
    """A sentence with its frame and checksum.

    Args:
        body: What stands between the $ and the *.
    """
    data = body.encode()
    return b"$%s*%02X\r\n" % (data, checksum(data))
