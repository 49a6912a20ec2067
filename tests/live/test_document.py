"""docs/live.md speaks of every key of a message, every address, and every option that matters."""

import re
from pathlib import Path
from typing import get_args, get_type_hints

from typer.main import get_command

from whichroad.cli import app
from whichroad.live.messages import EstimateMessage

TEXT = (Path(__file__).parents[2] / "docs" / "live.md").read_text("utf-8")


def keys(kind):
    """All keys of a message, inner ones too."""
    for one in (kind, *get_args(kind)):
        if hasattr(one, "__total__"):
            for name, hint in get_type_hints(one).items():
                yield name
                yield from keys(hint)


def test_every_key_of_a_message_is_told():
    assert {name for name in keys(EstimateMessage) if f"`{name}`" not in TEXT} == set()


def test_every_option_in_the_text_exists_and_most_are_told():
    options = {o for p in get_command(app).commands["live"].params for o in p.opts if o[:2] == "--"}
    told = set(re.findall(r"--[a-z][a-z-]+", TEXT))
    assert told <= options | {"--truth"}
    assert options - told <= {"--start", "--tiles", "--page", "--laps", "--map", "--dbc"}
