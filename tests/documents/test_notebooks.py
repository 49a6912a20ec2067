"""The notebooks run from their first cell to their last, offline, on data that they make."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from .pages import NOTEBOOKS, title

if TYPE_CHECKING:  # slow to import: only the worker that runs notebooks does
    from nbformat import NotebookNode


def run(path: Path, folder: Path) -> "NotebookNode":
    """A notebook with its outputs, run in a folder of its own."""
    import nbclient
    import nbformat

    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()
    return notebook


def printed(notebook: "NotebookNode") -> str:
    """What its cells printed, and their values as text and as HTML."""
    texts = []
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            texts += [output.get("text", ""), data.get("text/plain", ""), data.get("text/html", "")]
    return "\n".join(texts)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # those of the client and its sockets are not ours
@pytest.mark.parametrize("path", NOTEBOOKS, ids=title)
def test_a_notebook_runs(path: Path, tmp_path: Path):
    out = printed(run(path, tmp_path))
    assert "<svg" in out or "P(road)" in path.read_text("utf-8")
    if "Valhalla is left out" in out:
        pytest.skip(next(line for line in out.splitlines() if "left out" in line))


def test_there_are_three():
    assert [path.stem for path in NOTEBOOKS] == ["beside-valhalla", "outage-live", "own-drive"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=title)
def test_a_notebook_is_kept_without_outputs(path: Path):
    cells = json.loads(path.read_text("utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell for cell in code if cell["outputs"] or cell["execution_count"]] == []
