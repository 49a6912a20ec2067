"""Options of `whichroad live` that may name a vehicle: `NAME=VALUE`."""

import re
from dataclasses import dataclass
from pathlib import Path

import typer

_NAMED = re.compile(r"([A-Za-z][A-Za-z0-9_-]{0,31})=(.+)")

Named = dict[str | None, list[str]]


@dataclass(frozen=True, slots=True)
class Fittings:
    """What the options give each vehicle; the name None: the only one, or all of them."""

    nmea: Named
    can: Named
    dbc: Named
    vehicle: Named
    nmea_out: Named
    readings: Named

    @property
    def names(self) -> list[str | None]:
        """The vehicles in the order in which their inputs were named.

        Raises:
            BadParameter: Some inputs have a name and some have none, an option names a
                vehicle without input, or two inputs are standard input.
        """
        names = list(dict.fromkeys([*self.nmea, *self.can]))
        if None in names and len(names) > 1:
            raise typer.BadParameter(
                "some of --nmea and --can name a vehicle (NAME=SOURCE) and some do not; a name "
                "for each was expected"
            )
        options = {"--dbc": self.dbc, "--vehicle": self.vehicle, "--nmea-out": self.nmea_out}
        options["--readings"] = self.readings
        for option, given in options.items():
            for name in given:
                if name is not None and name not in names:
                    raise typer.BadParameter(
                        f"{option} {name}=...: no --nmea and no --can is of {name!r}; the name of "
                        "a vehicle with an input was expected"
                    )
        inputs = [*self.nmea.values(), *self.readings.values()]
        if sum(given.count("-") for given in inputs) > 1:
            raise typer.BadParameter("- (standard input) was given twice; once was expected")
        if len(names) > 1 and None in self.nmea_out:
            raise typer.BadParameter("--nmea-out without a vehicle; NAME=SINK was expected")
        if len(names) > 1 and None in self.readings:
            raise typer.BadParameter("--readings without a vehicle; NAME=SOURCE was expected")
        return names or [None]

    def one(self, option: str, name: str | None) -> str | None:
        """The value of an option that each vehicle has once: its own, else that of all.

        Raises:
            BadParameter: It was given twice.
        """
        given: Named = getattr(self, option)
        values = given.get(name) or given.get(None) or [None]  # type: ignore[list-item]
        if len(values) > 1:
            raise typer.BadParameter(f"--{option} was given twice; once was expected")
        return values[0]


def named(texts: list[str] | None) -> Named:
    """Values by the vehicle that they name; a file that exists is never taken for a name."""
    found: Named = {}
    for text in texts or ():
        match = None if Path(text).exists() else _NAMED.fullmatch(text)
        name, value = match.groups() if match else (None, text)
        found.setdefault(name, []).append(value)
    return found


def own_file(path: Path | None, name: str | None) -> Path | None:
    """A file of one vehicle: `drive.state` of van is `drive-van.state`."""
    if path is None or name is None:
        return path
    return path.with_name(f"{path.stem}-{name}{path.suffix}")
