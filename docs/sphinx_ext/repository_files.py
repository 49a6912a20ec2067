"""Files of the repository outside of docs/ as pages of the site, and links between them.

A link in Markdown is written so that it works where the repository is shown.  Here it is
turned into one that works on the site.
"""

import posixpath
import re
from pathlib import Path

from sphinx.application import Sphinx

ROOT = Path(__file__).parents[2]
SHOWN = {  # page of the site: the file that it shows
    "results/changes": "CHANGELOG.md",
    "results/counting": "benchmarks/README.md",
    "explanation/contributing": "CONTRIBUTING.md",
}
_PAGES = {file: f"docs/{page}.md" for page, file in SHOWN.items()} | {
    "README.md": "docs/index.md",
    "docs/decisions": "docs/decisions/README.md",
}
_LINK = re.compile(r"(?<!!)\[([^\]]*)\]\((?![a-z]+:)([^)#\s]*)(#[^)\s]*)?\)")


def on_the_site(text: str, file: str, page: str) -> str:
    """A file's text with links that work on the site.

    Args:
        text: Markdown.
        file: The file, from the root of the repository.
        page: The page that shows it, from docs/ and without a suffix.
    """

    def one(found: re.Match[str]) -> str:
        words, target, anchor = found[1], found[2], found[3] or ""
        if not target:
            return found[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(file), target))
        if path in _PAGES:
            path, anchor = _PAGES[path], ""
        if not path.startswith("docs/"):
            return words  # a file that is not shown, such as the licence
        inside = posixpath.relpath(path, posixpath.dirname(f"docs/{page}"))
        return f"[{words}]({inside}{anchor})"

    return _LINK.sub(one, text)


def _read(site: Sphinx, page: str, source: list[str]) -> None:
    """Replace the text of a page before it is parsed."""
    if str(site.env.doc2path(page)).endswith(".ipynb"):
        return
    file = SHOWN.get(page, f"docs/{page}.md")
    text = (ROOT / file).read_text("utf-8") if page in SHOWN else source[0]
    source[0] = on_the_site(text, file, page)


def setup(site: Sphinx) -> dict[str, bool]:
    """Have the pages read so."""
    site.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
