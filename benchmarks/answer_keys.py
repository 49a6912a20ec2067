"""Keys and types of OSRM's and Valhalla's own answers, beside ours on the same requests.

Needs `pip install pyvalhalla osrm-bindings` (Python 3.12 or newer), which bring the programs that
make their maps.  A key counts as given where it is anywhere in the twenty answers, by its place:
`matchings[].legs[].steps[].ref`.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import whichroad
from whichroad.answers import osrm_match, trace_attributes, trace_route

from . import Figure, Options, Skipped
from .serving import Rows, traces_of

Keys = dict[str, set[str]]  # place of a value -> types
_PROFILE = "share/profiles/car.lua"


def keys_of(answer: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """Each value of an answer: its place and type; integers are numbers."""
    if isinstance(answer, dict):
        for name, value in answer.items():
            yield from keys_of(value, f"{place}.{name}".lstrip("."))
    elif isinstance(answer, (list, tuple)):
        yield place, "list"
        for value in answer:
            yield from keys_of(value, f"{place}[]")
    else:
        if answer is None and place.endswith("[]"):
            return  # an element that is absent has no keys; ours are absent elsewhere
        kinds = {bool: "boolean", int: "number", float: "number", str: "text"}
        yield place, kinds.get(type(answer), "null")


def collect(answers: list[Any]) -> Keys:
    """Places and types of several answers."""
    found: Keys = {}
    for answer in answers:
        for place, kind in keys_of(answer):
            found.setdefault(place, set()).add(kind)
    return found


def _package(name: str) -> Path:
    spec = find_spec(name)
    if spec is None or spec.origin is None:
        raise Skipped(f"{name} is not installed; pip install pyvalhalla osrm-bindings")
    return Path(spec.origin).parent


def _do(*command: str | Path) -> None:
    subprocess.run([str(part) for part in command], check=True, capture_output=True)


def osrm_answers(extract: Path, folder: Path, traces: list[Rows]) -> list[Any]:
    """OSRM's answers to `match` with all that it can add."""
    home = _package("osrm")
    import osrm

    data = folder / "map.osm.pbf"
    data.symlink_to(extract)
    _do(home / "bin" / "osrm-extract", "-p", home / _PROFILE, data)
    base = folder / "map.osrm"
    _do(home / "bin" / "osrm-partition", base)
    _do(home / "bin" / "osrm-customize", base)
    engine = osrm.OSRM(
        algorithm="MLD", storage_config=str(base), use_shared_memory=False,
        max_locations_map_matching=-1,
    )  # fmt: skip
    found = []
    for rows in traces:
        asked = osrm.MatchParameters(
            coordinates=[(lon, lat) for _, lat, lon in rows],
            timestamps=[round(t) for t, _, _ in rows],
            radiuses=[5.0] * len(rows),
            steps=True,
            annotations=["all"],
            geometries="geojson",
            overview="full",
        )
        found.append(plain(engine.Match(asked)))
    return found


def plain(value: Any) -> Any:
    """Objects of osrm as dicts, lists and numbers."""
    import osrm

    if isinstance(value, osrm.Object):
        return {name: plain(value[name]) for name in value}
    if isinstance(value, osrm.Array):
        return [plain(one) for one in value]
    return None if type(value).__name__ == "NoneType" else value


def valhalla_answers(extract: Path, folder: Path, bodies: list[Any]) -> dict[str, list[Any]]:
    """Valhalla's answers of `trace_attributes` and `trace_route`, that also as OSRM's."""
    home = _package("valhalla")
    from valhalla import Actor, get_config

    (folder / "tiles").mkdir()
    config = get_config(tile_extract="", tile_dir=str(folder / "tiles"), verbose=False)
    config["mjolnir"].pop("tile_extract", None)
    (folder / "valhalla.json").write_text(json.dumps(config))
    _do(home / "bin" / "valhalla_build_tiles", "-c", folder / "valhalla.json", extract)
    actor = Actor(str(folder / "valhalla.json"))

    def ask(call: Any, body: Any) -> Any:
        return json.loads(call(json.dumps(body)))

    return {
        "trace_attributes": [ask(actor.trace_attributes, body) for body in bodies],
        "trace_route": [ask(actor.trace_route, body) for body in bodies],
        "trace_route, format osrm": [
            ask(actor.trace_route, body | {"format": "osrm"}) for body in bodies
        ],
    }


def run(options: Options) -> list[Figure]:
    """Keys that they give and we do not, and keys of another type."""
    extract = options.need("maps", "heidelberg.osm.pbf")
    roads = whichroad.RoadMap.from_osm(extract)
    traces = traces_of(roads)
    bodies = [
        {"shape": [{"time": t, "lat": lat, "lon": lon} for t, lat, lon in rows],
         "costing": "auto", "shape_match": "map_snap", "use_timestamps": False}
        for rows in traces
    ]  # fmt: skip
    places = [
        (";".join(f"{lon:.6f},{lat:.6f}" for _, lat, lon in rows), {
            "timestamps": ";".join(f"{t:.0f}" for t, _, _ in rows),
            "radiuses": ";".join(["5"] * len(rows)), "steps": "true", "annotations": "true",
            "geometries": "geojson", "overview": "full",
        }) for rows in traces
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        theirs = {"match of OSRM": osrm_answers(extract, Path(name), traces)}
    with tempfile.TemporaryDirectory() as name:
        theirs |= valhalla_answers(extract, Path(name), bodies)
    ours = {
        "match of OSRM": [osrm_match(roads, *asked) for asked in places],
        "trace_attributes": [trace_attributes(roads, body) for body in bodies],
        "trace_route": [trace_route(roads, body) for body in bodies],
        "trace_route, format osrm": [
            trace_route(roads, body | {"format": "osrm"}) for body in bodies
        ],
    }
    figures = []
    for kind, answers in theirs.items():
        given, made = collect(answers), collect(json.loads(json.dumps(ours[kind])))
        absent = sorted(set(given) - set(made))
        other = sorted(k for k in set(given) & set(made) if not made[k] <= given[k] | {"null"})
        for key in absent:
            options.say(f"{kind}: {key} ({', '.join(sorted(given[key]))}) is absent")
        for key in other:
            options.say(f"{kind}: {key} is {made[key]}, with them {given[key]}")
        n = len(given)
        figures.append(Figure(f"{kind}: keys absent", len(absent), "<= 0", "", n))
        figures.append(Figure(f"{kind}: keys of another type", len(other), "<= 0", "", n))
    print(f"Python {sys.version.split()[0]}, {len(traces)} traces", file=sys.stderr)
    return figures
