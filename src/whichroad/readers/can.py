"""CAN logs."""
from ..errors import ReadError
from ..records import Drive
def read_can(path, dbc, vehicle) -> Drive:
    raise ReadError("x")
