"""`python -m whichroad.native`: libraries for some machines, and the C header.

python -m whichroad.native build --target linux-x86_64 --target macos-arm64
python -m whichroad.native header > whichroad.h
"""

import argparse
import importlib
import sys
import time

from .. import _compile
from ..errors import WhichroadError
from . import build, cache, linking
from .header import header

ON_LINE = ("run", "to_plane", "to_geodetic", "convergence")  # for the header


def main() -> int:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(prog="python -m whichroad.native", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("build", help="build libraries and print their paths")
    one.add_argument("--target", action="append", choices=sorted(linking.TARGETS))
    one.add_argument("--portable", action="store_true", help="for old systems, by zig")
    commands.add_parser("header", help="print the C header of the on-line entries")
    given = parser.parse_args()
    if given.command == "header":
        for module in cache.kernel_modules():
            importlib.import_module(module)
        chosen = [_compile.entries()[name] for name in ON_LINE]
        print(header([e.layout for e in chosen], [e.__doc__ for e in chosen]), end="")
        return 0
    targets = given.target or [cache.own_target()]
    portable = given.portable or targets != [cache.own_target()]
    begin = time.monotonic()
    try:
        made = build.build(targets, portable=portable, report=lambda share: None)
    except WhichroadError as error:
        print(error, file=sys.stderr)
        return 1
    for target, path in made.items():
        print(target, path)
    print(f"{time.monotonic() - begin:.1f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
