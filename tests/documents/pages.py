"""The pages of the documentation, and the code blocks that stand in them."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += [ROOT / "benchmarks" / "README.md"]
NOTEBOOKS = sorted((ROOT / "docs").rglob("*.ipynb"))

_BLOCK = re.compile(
    r"^(?:<!-- (?P<mark>not run|file|ci): *(?P<text>[^\n]*?) -->\n\n?)?"
    r"```(?P<kind>[a-z{][^\n]*|)\n(?P<code>.*?)^```$",
    re.M | re.S,
)


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its code, and what the comment above it says."""

    kind: str
    code: str
    line: int
    mark: str  # "not run" (with the reason), "file" (with the name), "ci" (that step), or ""
    text: str


def title(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def blocks(path: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = path.read_text("utf-8")
    return [
        Block(
            m["kind"], m["code"], text.count("\n", 0, m.start("code")) + 1,
            m["mark"] or "", m["text"] or "",
        )
        for m in _BLOCK.finditer(text)
    ]  # fmt: skip
