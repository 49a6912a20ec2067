"""Arguments in, exit codes out: 0 done, 1 nothing could be answered, 2 wrong usage.

Modules are imported inside the commands, so that asking for help costs nothing.
Answers go to the standard output; progress, warnings and errors to the other.
"""

import os
import sys
from typing import Annotated, NoReturn

import typer

from .. import __version__
from ..errors import WhichroadError
from .calibrate import calibrate
from .fleet import fleet
from .inspect import inspect
from .live import live
from .maps import map_app
from .match import match
from .serve import serve
from .show import replay, report
from .trials import demo, evaluate, experiments, simulate, warmup

app = typer.Typer(
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(map_app, name="map", help="Compile a road map, or print what one holds.")
# as help lists them
for command in (
    demo, match, fleet, calibrate, inspect, replay, report, live, serve, simulate, evaluate,
    experiments, warmup,
):  # fmt: skip
    app.command()(command)


_EXTRAS = {
    "matplotlib": "plot", "geopandas": "geo", "pandas": "geo", "pyogrio": "geo",
    "cantools": "can", "can": "can",
}  # fmt: skip


def main() -> NoReturn:
    """Run the command line; every end is an exit code and no traceback."""
    try:
        app()
    except WhichroadError as error:
        _fail(f"error: {error}")
    except KeyboardInterrupt:
        _fail("interrupted", code=130)
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get(str(error.name).partition(".")[0])
        if extra is None or os.environ.get("WHICHROAD_TRACEBACK"):
            raise
        _fail(
            f"error: this command needs the package {error.name}, which is missing; install it by "
            f'pip install "whichroad[{extra}]", or ".[{extra}]" in the source folder'
        )
    except Exception as error:
        if os.environ.get("WHICHROAD_TRACEBACK"):
            raise
        kind = type(error).__name__
        _fail(
            f"error: this is a bug in whichroad ({kind}: {error}); please report it, with the "
            "traceback that WHICHROAD_TRACEBACK=1 prints"
        )
    sys.exit(0)


def _fail(message: str, code: int = 1) -> NoReturn:
    typer.echo(" ".join(message.split()), err=True)
    sys.exit(code)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"whichroad {__version__}")
        raise typer.Exit


@app.callback()
def whichroad(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Match recorded or live drives to a road network, with probabilities."""
