"""JSON Schemas of what the service sends and takes, made from the classes of the messages.

They are served at `/schema/NAME` and lie in `docs/schemas`.  Both are these.
"""

import json
import types
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints, is_typeddict

from .message_types import VERSION, EstimateMessage, LatencyMessage, PlayMessage, SensorMessage

_DRAFT = "https://json-schema.org/draft/2020-12/schema"
_PLAIN = {
    str: "string", int: "integer", float: "number", bool: "boolean", types.NoneType: "null",
}  # fmt: skip
_TIME = {"type": "string", "format": "date-time", "pattern": "Z$"}
_TEXT = {"type": ["string", "null"]}
_NUMBER = {"type": ["number", "null"]}
_WHOLE = {"type": ["integer", "null"]}
_EITHER = {"type": ["boolean", "null"]}


def schema_of(kind: Any) -> dict[str, Any]:
    """The schema of a class of messages, or of a part of one.

    Args:
        kind: A TypedDict, a list, a union or a plain type.
    """
    if is_typeddict(kind):
        hints = get_type_hints(kind)
        properties = {name: schema_of(hint) for name, hint in hints.items()}
        if "time" in properties:
            properties["time"] = _TIME
        about = {"description": (kind.__doc__ or "").partition("\n")[0]}
        return {
            "type": "object", **about, "properties": properties, "required": list(properties),
        }  # fmt: skip
    if get_origin(kind) is list:
        return {"type": "array", "items": schema_of(get_args(kind)[0])}
    if get_origin(kind) in (Union, types.UnionType):
        options = [schema_of(one) for one in get_args(kind)]
        if all(set(one) == {"type"} for one in options):
            return {"type": [one["type"] for one in options]}
        return {"anyOf": options}
    return {"type": _PLAIN[kind]}


def schemas() -> dict[str, dict[str, Any]]:
    """All of them, by name."""
    estimate = schema_of(EstimateMessage)
    estimate["properties"]["version"] = {"const": VERSION}
    estimate["properties"]["type"] = {"const": "estimate"}
    return {
        "estimate": _named("estimate", "A message of /ws, /events and /estimate", estimate),
        "history": _named("history", "The answer of /history", {
            "type": "object", "required": ["version", "type", "estimates"],
            "properties": {
                "version": {"const": VERSION}, "type": {"const": "history"},
                "estimates": {"type": "array", "items": estimate},
            },
        }),
        "match": _named("match", "The answer of /match", _match()),
        "health": _named("health", "The answer of /health", _health()),
        "vehicles": _named("vehicles", "The answer of /vehicles", {
            "type": "array", "items": {
                "type": "object", "required": ["vehicle", "answered", "status", "epoch_s"],
                "properties": {
                    "vehicle": _TEXT, "answered": {"type": "boolean"},
                    "status": {"enum": ["ok", "degraded"]}, "epoch_s": _NUMBER,
                },
            },
        }),
        "error": _named("error", "Any refusal", {
            "type": "object", "required": ["error"], "properties": {"error": {"type": "string"}},
        }),
    }  # fmt: skip


def write_schemas(folder: str | Path) -> None:
    """Write each into a folder, as it lies in `docs/schemas`."""
    for name, schema in schemas().items():
        text = json.dumps(schema, indent=1) + "\n"
        Path(folder, f"{name}.json").write_text(text, encoding="utf-8")


def _named(name: str, title: str, schema: dict[str, Any]) -> dict[str, Any]:
    return {"$schema": _DRAFT, "$id": f"/schema/{name}", "title": title, **schema}


def _match() -> dict[str, Any]:
    """Of the tables: every column, as JSON."""
    from ..tables.schema import PATH, POINTS

    path = _columns(PATH)
    feature = {
        "type": "object", "required": ["type", "geometry", "properties"],
        "properties": {
            "type": {"const": "Feature"}, "properties": path,
            "geometry": {
                "type": "object", "required": ["type", "coordinates"],
                "properties": {"type": {"const": "LineString"}, "coordinates": {"type": "array"}},
            },
        },
    }  # fmt: skip
    collection = {
        "type": "object", "required": ["type", "features"],
        "properties": {
            "type": {"const": "FeatureCollection"}, "features": {"type": "array", "items": feature},
        },
    }  # fmt: skip
    return {
        "type": "object", "required": ["version", "summary"],
        "properties": {
            "version": {"const": VERSION},
            "points": {"type": "array", "items": _columns(POINTS)},
            "path": {"anyOf": [collection, {"type": "null"}]},
            "summary": {"type": "object"},
        },
    }  # fmt: skip


def _columns(table: Any) -> dict[str, Any]:
    """A row of a table as a JSON object."""
    properties = {
        field.name: _column(field.type) for field in table if field.name != "geometry"
    }  # fmt: skip
    return {"type": "object", "properties": properties, "required": list(properties)}


def _column(kind: Any) -> dict[str, Any]:
    import pyarrow.types as pt

    if pt.is_timestamp(kind):
        return {"anyOf": [_TIME, {"type": "null"}]}
    if pt.is_list(kind):
        inner = {one.name: _column(one.type) for one in kind.value_type}
        row = {"type": "object", "properties": inner, "required": list(inner)}
        return {"anyOf": [{"type": "array", "items": row}, {"type": "null"}]}
    if pt.is_boolean(kind):
        return _EITHER
    if pt.is_integer(kind):
        return _WHOLE
    return _NUMBER if pt.is_floating(kind) else _TEXT


def _health() -> dict[str, Any]:
    return {
        "type": "object",
        "required": ["status", "problems", "answered", "seq", "sensors", "gnss_masked", "play",
                     "latency_ms", "skipped", "rewinds", "listeners", "dropped"],
        "properties": {
            "status": {"enum": ["ok", "degraded"]}, "answered": {"type": "boolean"},
            "problems": {"type": "array", "items": {"type": "string"}},
            "vehicle": _TEXT, "seq": {"type": "integer"},
            "sensors": {"type": "array", "items": schema_of(SensorMessage)},
            "gnss_masked": {"type": "boolean"}, "play": schema_of(PlayMessage),
            "latency_ms": schema_of(LatencyMessage),
            "skipped": {"type": "object", "additionalProperties": {"type": "integer"}},
            "rewinds": {"type": "integer"}, "listeners": {"type": "integer"},
            "dropped": {"type": "integer"},
        },
    }  # fmt: skip
