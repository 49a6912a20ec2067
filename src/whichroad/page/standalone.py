"""One HTML file with everything in it: style, scripts, data; it opens without a network."""

import json
import re
from typing import Any

from .static_files import STATIC

MODULES = (
    "look", "series", "beside", "scene", "chart", "links", "numbers", "panel", "papermap", "report",
)  # fmt: skip

_IMPORT = re.compile(r"^import\b[^;]*;\n", re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const|let)\b)", re.MULTILINE)


def standalone(title: str, data: dict[str, Any]) -> str:
    """The report's page as one text.

    Args:
        title: Of the page.
        data: What `report.js` draws.
    """
    style = "".join(_read(f"{name}.css") for name in ("look", "report"))
    scripts = "".join(_EXPORT.sub("", _IMPORT.sub("", _read(f"{name}.js"))) for name in MODULES)
    encoded = json.dumps(data, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    parts = {
        "title": title.replace("&", "&amp;").replace("<", "&lt;"),
        "style": style,
        "theme": _read("theme.js"),
        "script": scripts,
        "data": encoded.replace("<", "\\u003c"),
    }
    page = re.split(r"\{\{(\w+)\}\}", _read("report.html"))
    return "".join(parts[part] if i % 2 else part for i, part in enumerate(page))


def _read(name: str) -> str:
    return (STATIC / name).read_text("utf-8")
