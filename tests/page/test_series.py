"""The page's columns of estimates and its list of sensors, run by Node where it is installed."""

import json
import shutil
import subprocess
from typing import Any

import pytest

from whichroad.page.static_files import STATIC

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(NODE is None, reason="Node is not installed")


def run(script: str, name: str = "Series", module: str = "series.js") -> Any:
    """What a script that imports a name of a module prints, as JSON."""
    code = f"import {{ {name} }} from {json.dumps((STATIC / module).as_uri())};\n{script}"
    command = [str(NODE), "--input-type=module", "-e", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.parametrize("rows", [3, 10, 25])
def test_a_clock_that_is_set_back_leaves_the_track_and_its_order(rows: int):
    times, lats, found = run(
        f"""
        const series = new Series(10);
        for (let i = 0; i < {rows}; i += 1) series.push({{ t: 1000 + i, lat: i }}, []);
        series.endBefore(500);
        series.push({{ t: 500.5, lat: -1 }}, []);
        series.endBefore(900); // ahead of all rows: nothing is to be done
        const column = (name) => [...Array(series.length).keys()].map((i) => series.get(name, i));
        console.log(JSON.stringify([column("t"), column("lat"), series.find(500.2)]));
        """
    )
    kept = min(rows, 9)
    assert lats == [*range(rows - kept, rows), -1]
    assert times == [*range(501 - kept, 501), 500.5]
    assert found == kept


@pytest.mark.parametrize(
    ("rate", "age", "state", "word"),
    [
        (0.0, None, "waiting", "not heard"), (0.0, 0.1, "ok", "heard"), (1.0, 0.4, "ok", "1.0 Hz"),
        (0.0, 7.0, "silent", "silent 0:07"),
    ],
)  # fmt: skip
def test_a_sensor_that_has_just_begun_is_not_silent(
    rate: float, age: float | None, state: str, word: str
):
    one = {"name": "gnss", "rate_hz": rate, "age_s": age, "learnt": []}
    (row,) = run(f"console.log(JSON.stringify(sensorRows([], [{json.dumps(one)}])));",
                 "sensorRows", "beside.js")  # fmt: skip
    assert (row["name"], row["state"], row["rate"]) == ("GNSS", state, word)
