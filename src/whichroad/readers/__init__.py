"""Logs and tables in, records out: one file per format, none knows another."""

from .drives import read_drive
from .nmea import NmeaParser
from .observed import drive_of_observations
from .table import drive_from_table
from .vehicle import read_vehicle

__all__ = [
    "NmeaParser", "drive_from_table", "drive_of_observations", "read_drive", "read_vehicle"
]  # fmt: skip
