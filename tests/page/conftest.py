"""The paper's drive in files, its map, and its film, made once."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from starlette.applications import Starlette

from whichroad import Places, read_drive, read_vehicle
from whichroad.evidence.sensed import columns_of
from whichroad.live.web_server import listen, web_server
from whichroad.replay.open_replay import Remaking
from whichroad.replay.recorded_messages import RecordedMessages
from whichroad.roadmap import RoadMap
from whichroad.sensors import Compass, Height, Sky
from whichroad.simulate import write_demo


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("demo")
    write_demo(made, force=True)
    return made


@pytest.fixture(scope="session")
def roads(folder: Path) -> RoadMap:
    return RoadMap.from_osm(folder / "map.osm")


@pytest.fixture(scope="session")
def remaking(folder: Path, roads: RoadMap) -> Remaking:
    car = read_vehicle(folder / "vehicle.toml")
    (drive,) = read_drive(
        folder / "drive.nmea", vehicle=car, can=folder / "can.log", dbc=folder / "vehicle.dbc"
    )
    return Remaking(drive, roads, car)


@pytest.fixture(scope="session")
def recorded(remaking: Remaking) -> RecordedMessages:
    return remaking([])


@pytest.fixture(scope="session")
def crowded(folder: Path, roads: RoadMap, recorded: RecordedMessages) -> Remaking:
    """The drive with places along it, some roads in tunnels, and further sensors."""
    text = (folder / "map.osm").read_text("utf-8")
    driven = {
        way for edge in (400, 2000) for way in [roads.source(int(recorded.edge[edge]), 0.0)[0]]
    }
    for way, kind in zip(sorted(driven), ("tunnel", "bridge"), strict=False):
        end = text.index("</way>", text.index(f'<way id="{way}"'))
        text = f'{text[:end]}<tag k="{kind}" v="yes"/>{text[end:]}'
    (folder / "stacked.osm").write_text(text, "utf-8")
    stacked = RoadMap.from_osm(folder / "stacked.osm")
    lat, lon = recorded.track()
    places = Places(
        {"id": [f"Sign of a long name {k}" for k in range(0, len(lat), 150)],
         "lat": lat[::150] + 3e-5, "lon": lon[::150]}, stacked,
    )  # fmt: skip
    car, sensors = read_vehicle(folder / "vehicle.toml"), [Height(), Sky(), Compass()]
    (drive,) = read_drive(
        folder / "drive.nmea", vehicle=car, can=folder / "can.log", dbc=folder / "vehicle.dbc",
        columns=columns_of(sensors),
    )  # fmt: skip
    return Remaking(drive, stacked, car, places=places, sensors=sensors)


@contextmanager
def served(app: Starlette) -> Iterator[str]:
    """An application on a free port of this machine; gives its address."""
    door = listen("127.0.0.1", 0)
    server = web_server(app, lifespan=True)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [door]}, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{door.getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join(10)
        door.close()
