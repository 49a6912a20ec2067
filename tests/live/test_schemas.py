"""The JSON Schemas that are published describe what the service really says."""

import asyncio
import json
from itertools import pairwise
from pathlib import Path

import httpx
import pytest
from jsonschema import Draft202012Validator, ValidationError

from whichroad import GeoFix, Localizer
from whichroad.live.app import Service, application
from whichroad.live.broadcaster import Broadcaster
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.recent import History
from whichroad.live.schemas import schemas
from whichroad.page.compressed import takes_gzip
from whichroad.tables.schema import POINTS

FOLDER = Path(__file__).parents[2] / "docs" / "schemas"


class Client:
    """Asks an application in this process."""

    def __init__(self, app):
        self._app = app

    def get(self, path, **more):
        """The answer to a GET."""

        async def ask():
            transport = httpx.ASGITransport(self._app)
            async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as one:
                return await one.get(path, **more)

        return asyncio.run(ask())


@pytest.fixture(scope="module")
def client(town, observations):
    """A service that has heard a minute of fixes and wheels."""
    loop = FilterLoop(Localizer(town, lag=5.0), window=0.0)
    app = application(Service(loop, Broadcaster()))
    for one in observations[:600]:
        kind = "gnss" if isinstance(one, GeoFix) else "wheels"
        loop.observe([one])
        loop.sensor(kind, kind).heard(1, one.time, 0.0, one.time)
        if isinstance(one, GeoFix):
            loop.publish()
    return Client(app)


def valid(schema, value):
    Draft202012Validator.check_schema(schema)
    Draft202012Validator(schema, format_checker=Draft202012Validator.FORMAT_CHECKER).validate(value)


def test_the_published_schemas_are_those_of_the_code():
    assert {path.stem for path in FOLDER.glob("*.json")} == schemas().keys()
    for name, schema in schemas().items():
        text = (FOLDER / f"{name}.json").read_text("utf-8")
        assert json.loads(text) == schema, (
            "run whichroad.live.schemas.write_schemas('docs/schemas')"
        )


def test_what_the_service_says_follows_the_schemas_that_it_serves(client):
    known = {name: client.get(f"/schema/{name}").json() for name in schemas()}
    assert client.get("/schema").json() == [f"/schema/{name}" for name in known]
    valid(known["error"], client.get("/schema/nothing").json())
    said = client.get("/estimate").json()
    valid(known["estimate"], said)
    assert said["lagged"] is not None
    valid(known["health"], client.get("/health").json())
    valid(known["vehicles"], client.get("/vehicles").json())
    history = client.get("/history").json()
    valid(known["history"], history)
    assert len(history["estimates"]) > 30


def test_a_message_of_another_type_is_seen(client):
    said = client.get("/estimate").json()
    for change in (
        {"p_road": "0.9"},
        {"time": "yesterday"},
        {"road": {**said["road"], "source_id": 7}},
    ):
        with pytest.raises(ValidationError):
            valid(schemas()["estimate"], {**said, **change})


def test_ids_and_probabilities_have_the_types_of_the_tables(client, town):
    said = client.get("/estimate").json()
    estimate, row = (schemas()[name]["properties"] for name in ("estimate", "match"))
    row = row["points"]["items"]["properties"]
    road = estimate["road"]["properties"]
    assert road["source_id"] == row["source_id"] == {"type": ["string", "null"]}
    assert set(road["edge_id"]["type"]) == set(row["edge_id"]["type"])
    assert isinstance(said["road"]["source_id"], str)
    assert isinstance(said["road"]["edge_id"], int)
    shared = set(POINTS.names) & (set(estimate) | set(road))
    assert {"time", "edge_id", "source_id", "p_road", "p_way", "protection_level_m"} <= shared


def test_the_last_minutes_are_given_whole_or_in_part_and_compressed(client):
    whole = client.get("/history").json()["estimates"]
    times = [one["epoch_s"] for one in whole]
    assert times == sorted(times)
    some = client.get("/history?seconds=20&every=2").json()["estimates"]
    kept = [one["epoch_s"] for one in some]
    assert kept[-1] >= times[-1] - 2.0
    assert times[-1] - kept[0] <= 20.0
    assert all(b - a >= 2.0 - 1e-6 for a, b in pairwise(kept))
    plain = client.get("/history", headers={"accept-encoding": "identity"})
    packed = client.get("/history", headers={"accept-encoding": "gzip"})
    assert (plain.headers.get("content-encoding"), plain.json()["estimates"]) == (None, whole)
    assert packed.headers["content-encoding"] == "gzip"
    assert int(packed.headers["content-length"]) < len(plain.content) / 4
    assert client.get("/history?seconds=never").status_code == 400


def test_the_history_does_not_grow(client, town, observations):
    history, message = History(kept=10.0, spacing=0.5), client.get("/estimate").json()
    for number in range(2000):
        history.send(b"{}", {**message, "epoch_s": 0.1 * number})
    assert len(history) == 21
    history.send(b"{}", {**message, "epoch_s": 3.0})  # a recording was sought back
    assert len(history) == 1


@pytest.mark.parametrize(
    ("header", "taken"),
    [
        ("gzip", True), ("br, gzip;q=0.5", True), ("*", True), ("", False), ("identity", False),
        ("gzip;q=0", False), ("gzip;q=no", False), ("*;q=0, gzip", True),
    ],
)  # fmt: skip
def test_gzip_is_given_to_who_takes_it(header, taken):
    assert takes_gzip(header) == taken
