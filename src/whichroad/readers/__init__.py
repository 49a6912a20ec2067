"""Logs and tables in, records out: one file per format, none knows another."""

from .drive_tables import drive_from_table
from .drives import read_drive
from .folders import vehicle_beside
from .from_observations import drive_of_observations
from .nmea import NmeaParser
from .source import is_file
from .vehicle import read_vehicle

__all__ = [
    "NmeaParser", "drive_from_table", "drive_of_observations", "is_file", "read_drive",
    "read_vehicle", "vehicle_beside",
]  # fmt: skip
