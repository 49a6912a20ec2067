"""Fixes that another map would hold are told as such, on line and where a file is played."""

from dataclasses import replace

import pytest

from whichroad import GeoFix, Localizer, cli
from whichroad.live.filter_loop import FilterLoop
from whichroad.live.troubles import Troubles


@pytest.fixture
def said():
    return []


@pytest.fixture
def loop(town, said):
    return FilterLoop(Localizer(town), troubles=Troubles(said.append, "van"))


def fixes(observations, **changes):
    """Fixes of the drive, one a second."""
    every = [one for one in observations if isinstance(one, GeoFix)]
    return [replace(one, **{k: v(one) for k, v in changes.items()}) for one in every]


def test_fixes_off_the_map_are_told_once_with_their_distance_and_over_when_one_is_on_it(
    loop, said, observations
):
    away = fixes(observations, lat_deg=lambda one: one.lat_deg + 3.0)
    loop.observe(away[:4])
    assert said == []
    loop.observe(away[4:30])
    (line,) = said
    assert line.startswith("van: map: none of the last 5 fixes is within 1 km of a road; ")
    assert "km from the map; a map that holds the drive was expected" in line
    assert line.endswith("is this the right extract?")
    assert loop.health()["problems"] == [line.removeprefix("van: ")]
    loop.observe(fixes(observations)[30:32])
    assert said[1:] == ["van: the fixes are on the map again"]
    assert loop.health()["problems"] == []


def test_swapped_coordinates_are_recognised(loop, said, observations):
    loop.observe(fixes(observations, lat_deg=lambda o: o.lon_deg, lon_deg=lambda o: o.lat_deg)[:10])
    assert said[0].endswith("were latitude and longitude swapped?")


def test_fixes_on_the_map_are_no_problem(loop, said, observations):
    loop.observe(observations)
    assert said == []


def test_a_file_that_is_off_the_map_is_refused_as_match_does(files, tmp_path, capsys, monkeypatch):
    table = tmp_path / "away.csv"
    rows = [f"{1.6e9 + k},52.{k:04d},8.7" for k in range(20)]
    table.write_text("time,lat,lon\n" + "\n".join(rows) + "\n")
    said = []
    for command in (["live", "--play", str(table), "--once", "--port", "0"], ["match", str(table)]):
        monkeypatch.setattr("sys.argv", ["whichroad", *command, "--map", str(files / "town.map")])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 1
        said.append(capsys.readouterr().err)
    assert said[0] == said[1]
    assert "none of its 20 fixes is within 1 km of a road" in said[0]
