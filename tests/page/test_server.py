"""The replay's addresses."""

import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from websockets.sync.client import connect

from whichroad.errors import SettingError
from whichroad.live.web_server import listen
from whichroad.page import static_files
from whichroad.page.http_routes import page_routes
from whichroad.page.static_files import STATIC, maplibre_folder
from whichroad.replay.player import Player
from whichroad.replay.recorded_messages import RecordedMessages
from whichroad.replay.replay_server import replay_app
from whichroad.roadmap import RoadMap

from .conftest import served


@pytest.fixture(scope="module")
def client(recorded: RecordedMessages, roads: RoadMap) -> Iterator[httpx.Client]:
    with (
        served(replay_app(Player(recorded), roads)) as address,
        httpx.Client(base_url=address) as one,
    ):
        yield one


def test_the_page_and_all_that_it_names_are_there(client: httpx.Client):
    page = client.get("/")
    assert page.status_code == 200
    names = [
        part.split('"')[0] for part in page.text.replace('src="', 'href="').split('href="')[1:]
    ]
    assert len(names) > 10
    for name in names:
        assert client.get(f"/{name}").status_code == 200, name
    for script in STATIC.glob("*.js"):
        assert client.get(f"/static/{script.name}").headers["content-type"].startswith("text/java")


def test_nothing_is_loaded_from_elsewhere(client: httpx.Client):
    policy = client.get("/").headers["content-security-policy"]
    assert "http" not in policy
    assert "default-src 'none'" in policy
    for file in STATIC.iterdir():
        text = file.read_text("utf-8").replace("http://www.w3.org/2000/svg", "")
        assert "http://" not in text.replace("https://", "http://"), file.name


def test_a_users_own_tiles_are_let_in_and_no_others(roads: RoadMap):
    routes = page_routes(roads, tiles_url="https://tile.example/{z}/{x}/{y}.png")
    assert routes
    for wrong in ("tile.example/{z}/{x}/{y}", "file:///{z}/{x}/{y}", "https://tile.example/a.png"):
        with pytest.raises(SettingError, match="not an address of map tiles"):
            page_routes(roads, tiles_url=wrong)


def test_maplibre_is_found_without_being_imported():
    import sys

    assert (maplibre_folder() / "maplibre-gl.js").is_file()
    assert "maplibre" not in sys.modules


def test_maplibre_of_the_wheel_comes_before_the_cache_and_the_newest_before_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    packed, kept = tmp_path / "packed", tmp_path / "kept"
    monkeypatch.setattr(static_files, "PACKED", packed)
    monkeypatch.setattr(static_files, "kept_folder", lambda: kept)
    monkeypatch.setattr(static_files.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SettingError, match=r'pip install "whichroad\[maplibre\]"'):
        maplibre_folder()
    for folder in (kept / "maplibre-gl-5.9.1", kept / "maplibre-gl-5.24.0", packed):
        folder.mkdir(parents=True)
        (folder / "maplibre-gl.js").touch()
        assert maplibre_folder() == folder


def test_lookers_on_get_messages_and_can_turn_the_clock(client: httpx.Client):
    with connect(str(client.base_url.copy_with(scheme="ws", path="/ws"))) as socket:
        assert json.loads(socket.recv(10))["type"] == "estimate"
        client.post("/control", json={"action": "pause"})
        client.post("/control", json={"action": "seek", "value": 77.0})
        while (said := json.loads(socket.recv(10)))["play"]["position_s"] != 77.0:
            pass
        assert said["play"]["paused"]


@pytest.mark.parametrize(
    ("body", "code"),
    [
        (b"", 400), (b"{", 400), (b"[]", 400), (b'{"action": 3}', 409), (b"\xff\xfe", 400),
        (b'{"action": "seek"}', 409), (b"[" * 9000, 400), (b"x" * 50_000, 413),
    ],
)  # fmt: skip
def test_rubbish_gets_a_4xx_and_the_replay_goes_on(client: httpx.Client, body: bytes, code: int):
    assert client.post("/control", content=body).status_code == code
    assert client.get("/timeline").status_code == 200


@pytest.mark.parametrize(
    "path",
    [
        "/static/../routes.py", "/static/routes.py", "/maplibre/__init__.py", "/roads/edges",
        "/roads/edges?ids=x", "/roads/edges?ids=-1", f"/roads/edges?ids={'1,' * 200}1",
        "/roads/other/3/1/1.mvt", "/roads/other/3/1/x.mvt", "/etc/passwd",
    ],
)  # fmt: skip
def test_what_is_not_there_is_a_4xx_without_a_path_or_a_stack(client: httpx.Client, path: str):
    answer = client.get(path)
    assert 400 <= answer.status_code < 500
    assert str(Path.cwd()) not in answer.text
    assert "Traceback" not in answer.text


def test_other_sites_and_other_names_are_not_served(client: httpx.Client):
    assert client.get("/", headers={"Host": "evil.example"}).status_code == 403
    assert client.get("/timeline", headers={"Origin": "http://evil.example"}).status_code == 403
    refused = client.post(
        "/control", json={"action": "pause"}, headers={"Origin": "http://evil.example"}
    )
    assert refused.status_code == 403


def test_a_port_that_is_taken_is_told_in_one_sentence():
    door = listen("127.0.0.1", 0)
    with door, pytest.raises(SettingError, match="a free port of this machine was expected"):
        listen("127.0.0.1", door.getsockname()[1])
