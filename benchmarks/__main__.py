"""`python -m benchmarks NAME`: measure, print a table, write rows as JSON."""

import argparse
import importlib
import json
import platform
import sys
from dataclasses import asdict
from pathlib import Path

from . import Figure, Options, Skipped, data_folder

# name: module and function, what is measured
BENCHMARKS = {
    "kubicka": ("kubicka.run", "real GNSS drives world-wide, 1 Hz: route mismatch"),
    "town": ("town.run", "simulated drives in Heidelberg: right road, honesty of the pose"),
    "outage": ("town.outage", "the same with 1.5 km without GNSS"),
    "consistency": ("scenes.consistency.run", "ellipses over many short drives, both frames"),
    "lookback": ("lookback.run", "the same drives filtered, with a lag of 10 s, and in full"),
    "fork": ("scenes.fork.run", "a Y-junction of 5 degrees in an outage"),
    "pulled": ("scenes.parallel.pulled", "parallel roads, GNSS pulled to the wrong one"),
    "coldstart": ("scenes.parallel.coldstart", "starting on one of two parallel roads"),
    "lanes": ("scenes.lanes.run", "parallel roads with different numbers of lanes"),
    "rates": ("scenes.rates.run", "fixes at 1 to 20 Hz, alone, with an odometer or wheels"),
    "rules": ("scenes.rules.run", "against one-ways, banned turns, closed streets"),
    "turns": ("scenes.dark.turns", "1.5 km without GNSS, a turn in every 500 m"),
    "long": ("scenes.dark.long", "10 km without GNSS"),
    "nostart": ("search.run", "wheels and the map alone: until the road is known"),
    "unmapped": ("scenes.unmapped.run", "an unmapped road beside a mapped one: P(off-road)"),
    "missing": ("scenes.missing.run", "streets that the map lacks: P(off-road)"),
    "jump": ("scenes.jump.run", "a receiver that jumps 200 m; a car that is carried away"),
    "diagnosis": ("scenes.diagnosis.run", "three-hour drives: are wrong settings noticed?"),
    "comma": ("comma.run", "real wheels and a map, GNSS masked: drift"),
    "nagoya": ("nagoya.run", "city GNSS: do the adapted ellipses hold the fixes?"),
    "hsl": ("hsl.run", "bus odometers and a map, GNSS hidden for a minute"),
    "speed": ("speed.run", "epochs a second on recorded drives"),
    "online": ("speed.online", "time of one Localizer.update"),
    "map": ("speed.map_files", "compiling and opening a road map"),
    "readers": ("readers.run", "sentences and frames a second"),
    "sparse": ("sparse.run", "fixes 1 to 60 s apart, beside the peers: accuracy, speed, costs"),
    "honesty": ("honesty.run", "is P(road) true?  Ten thousands of short simulated drives"),
    "worlds": ("worlds.run", "a second simulator: SUMO's drivers, real errors, faults at rates"),
    "pauses": ("worlds.pauses.run", "nothing heard for 1 min to 10 h, and the car is elsewhere"),
    "learnt": ("worlds.learnt.run", "receivers and maps whose errors nobody told: true ellipses?"),
    "manoeuvres": (
        "manoeuvres.run",
        "what maps do not draw: U-turns, yards, backing up, odd clocks",
    ),
    "places": ("places.run", "point objects ahead and near: P, sigma, time of a question"),
    "sensors": ("sensors.run", "a gyro beside an odometer or a speed, 1.5 km without GNSS"),
    "stacked": ("scenes.stacked.run", "roads above each other: GNSS alone, heights, the sky"),
    "evidence": ("evidence.run", "further sensors: ranges, a compass, each removed, each faulty"),
    "stand": ("stand.run", "ten minutes at a stop beside a biased gyro, then no GNSS"),
    "first": ("first_heard.run", "on line, a fix or the wheels first, then 5 km without GNSS"),
    "takeover": ("takeover.run", "wheels and a gyro together, one of them wrong or silent"),
    "calibrate": ("calibration.run", "cars from their own drives: errors, coverage"),
    "outages": ("calibration.outages", "1.5 km without GNSS of cars that were calibrated"),
    "exact": ("exact.run", "exact inference against oracles; the reduction against it"),
    "build": ("building.run", "memory of building a map of 10 million edges, by the slope"),
    "fleet": ("fleet.run", "fleets: cost beside the filter, order, memory, kill -9, poison"),
    "live": (
        "live.run",
        "the service: latency, throughput, clients, kill -9, rubbish, /match, memory",
    ),
    "serve": ("serving.run", "whichroad serve: rate and time among callers, bad, huge requests"),
    "keys": ("answer_keys.run", "keys and types of OSRM's and Valhalla's own answers, beside ours"),
    "overture": ("overture.run", "a city as Overture's segments, beside OpenStreetMap's ways"),
    "openlr": ("openlr_paths.run", "OpenLR references, followed by another decoder"),
    "page": ("page.run", "the page in Chromium: first road drawn, long tasks, memory"),
    "day": ("day.run", "a day at 10 Hz, time compressed: memory of the service and of its page"),
    "routes": ("routes.run", "points against path, sure edges between fixes, turning round"),
    "doubt": ("doubt.run", "how long P says ambiguous where no road competes"),
    "fuzz": ("fuzz.run", "random and mutated input to every reader"),
}


def seeds(text: str) -> range:
    """`A:B` as a range."""
    first, _, last = text.partition(":")
    return range(int(first), int(last))


def setting(text: str) -> tuple[str, float]:
    """`NAME=VALUE` of one of the model's settings."""
    name, _, value = text.partition("=")
    return name, float(value)


def parser() -> argparse.ArgumentParser:
    """The command line."""
    listing = "\n".join(f"  {name:11} {what}" for name, (_, what) in BENCHMARKS.items())
    command = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description=__doc__,
        epilog=f"names:\n{listing}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("name", metavar="NAME", choices=BENCHMARKS)
    command.add_argument("--seeds", type=seeds, metavar="A:B", help="seeds A to B - 1")
    command.add_argument("--data", type=Path, metavar="DIR", help="the folder of real data")
    command.add_argument("--json", metavar="FILE", help="write the rows here (-: print them)")
    command.add_argument("--tracks", metavar="0-9", help="kubicka, sparse, routes: only these")
    command.add_argument("--every", type=float, metavar="S", help="kubicka: seconds between fixes")
    command.add_argument("--preset", metavar="NAME", help="the simulator's preset")
    command.add_argument("--seconds", type=float, metavar="S", help="fuzz, readers, live: how long")
    command.add_argument("--metres", type=float, metavar="M", help="town, outage: per drive")
    command.add_argument(
        "--model", choices=("default", "paper"), help="kubicka, town, outage, comma: which filter"
    )
    command.add_argument(
        "--set", type=setting, action="append", default=[], metavar="NAME=VALUE",
        help="town, outage, kubicka, comma, worlds, manoeuvres: another value for one of the "
        "model's settings",
    )  # fmt: skip
    command.add_argument("--progress", action="store_true", help="scenes: a line per drive")
    command.add_argument("--processes", type=int, metavar="N", help="drives side by side")
    command.add_argument(
        "--classes", metavar="A,B*", help="honesty, nostart, live, diagnosis: only these"
    )
    command.add_argument("--noise", metavar="A,B", help="honesty: good, urban, misspecified")
    command.add_argument(
        "--drives",
        type=int,
        metavar="N",
        help="honesty: per class, with --seeds those of noises other than good; live: kills; "
        "worlds: at most",
    )
    command.add_argument("--scenes", metavar="A,B", help="manoeuvres: only these")
    command.add_argument("--resume", metavar="FILE", help="honesty: remember what is done here")
    command.add_argument("--write", metavar="FILE", help="honesty, sparse: write the page of docs")
    command.add_argument(
        "--parts", metavar="A,B", help="sparse, fleet, routes, places, learnt: only these"
    )
    command.add_argument(
        "--intervals", metavar="1,10", help="sparse, routes: seconds between fixes"
    )
    command.add_argument("--conditions", metavar="A,B", help="sparse: such as 10s/5m/gm")
    command.add_argument("--peers", metavar="DIR", help="sparse: the peers' environments")
    command.add_argument("--cache", metavar="DIR", help="sparse, worlds: kept between runs")
    command.add_argument(
        "--faults", metavar="A,B", help="worlds: none, all, each, or names (A+B: together)"
    )
    command.add_argument(
        "--told", action="store_true", help="worlds: without the readings of what fails"
    )
    command.add_argument("--sensors", metavar="NAME", help="worlds: all drives have these")
    command.add_argument(
        "--lag", metavar="LAG",
        help="worlds, manoeuvres: smoothed, as `match(lag=...)` is; online: as `Localizer` answers",
    )  # fmt: skip
    command.add_argument("--copies", metavar="4,16", help="build: towns in each extract")
    command.add_argument("--out", metavar="DIR", help="worlds, places: tables and pictures go here")
    return command


def table(figures: list[Figure]) -> str:
    """The figures as aligned text."""
    head = ("figure", "value", "goal", "", "unit", "n", "95 % interval", "seeds")
    mark = {True: "met", False: "MISSED", None: ""}
    rows = [
        (
            f.figure,
            "-"
            if f.value is None
            else f"{f.value:,.4g}"
            if abs(f.value) < 1e4
            else f"{f.value:,.0f}",
            f.goal,
            mark[f.met],
            f.unit,
            str(f.n),
            f"{f.ci95[0]:.4g} .. {f.ci95[1]:.4g}" if f.ci95 else "",
            f.seeds,
        )
        for f in figures
    ]
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    lines = ["  ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)) for r in [head, *rows]]
    return "\n".join(line.rstrip() for line in lines)


def main() -> int:
    """Run one benchmark; 0 also where its data is absent."""
    given = vars(parser().parse_args())
    more = {
        k: given[k]
        for k in (
            *("tracks", "every", "preset", "seconds", "metres", "model", "processes"),
            *("progress", "classes", "noise", "drives", "resume", "write"),
            *("parts", "intervals", "conditions", "peers", "cache", "faults", "told", "sensors"),
            *("lag", "out", "scenes", "copies"),
        )
    }
    if given["set"]:
        more["settings"] = dict(given["set"])
    options = Options(
        data=given["data"] or data_folder(),
        seeds=given["seeds"],
        more={k: v for k, v in more.items() if v is not None},
    )
    module, _, function = BENCHMARKS[given["name"]][0].rpartition(".")
    try:
        figures = getattr(importlib.import_module(f"benchmarks.{module}"), function)(options)
    except Skipped as reason:
        print(f"{given['name']}: skipped: {reason}")
        figures = []
    if figures:
        print(f"\n{given['name']}, Python {platform.python_version()}, {platform.machine()}\n")
        print(table(figures))
    if given["json"]:
        text = json.dumps([asdict(f) for f in figures], indent=1)
        if given["json"] == "-":
            print(text)
        else:
            Path(given["json"]).write_text(text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
