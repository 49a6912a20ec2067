"""What files hold, as they would be understood by `match`: drives, maps, cars, answers."""

from .files import Inspected, inspect_files
from .section import Section

__all__ = ["Inspected", "Section", "inspect_files"]
