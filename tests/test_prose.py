"""The prose of the documents: short sentences, the field's words, and true numbers.

How sentences are counted:

- Left out: fenced and indented code (equations), tables, headings, HTML comments, images.
- A paragraph and a list item are each read on their own.  A sentence ends at the end of its
  paragraph or list item, and at a full stop, a question mark or an exclamation mark that a
  space and the beginning of a new sentence follow.  Colons and semicolons end nothing.
- A full stop inside a number, a file name or an abbreviation ("e.g.", "i.e.", "cf.") ends
  nothing.
- A word is whatever stands between spaces and holds a letter or a digit.  A code span and
  the text of a link count with the words that a reader sees; the address of a link counts
  nothing.
"""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from whichroad.settings import Settings

ROOT = Path(__file__).parents[1]
MODEL_PAGES = [
    "docs/model.md", "docs/sensors-that-fail.md",
    *(f"docs/model/{path.name}" for path in sorted((ROOT / "docs" / "model").iterdir())),
]  # fmt: skip
PAGES = ["README.md", "docs/model.md", "docs/sensors-that-fail.md", "docs/architecture.md"]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]

LONGEST = 25  # words
SHARE = 0.05  # of the sentences of a page may be longer

_COMMENT = re.compile(r"<!--.*?-->", re.S)
_FENCE = re.compile(r"^(```|~~~).*?^\1\s*$", re.M | re.S)
_IMAGE = re.compile(r"!\[[^\]]*\]\([^)]*\)")
_LINK = re.compile(r"\[([^\]]*)\]\([^)]*\)")
_ITEM = re.compile(r"^\s*(?:[-*+]|\d+\.)\s+")
_END = re.compile(r"(?<!e\.g)(?<!i\.e)(?<!cf)[.!?][)\]\"'*_`]*\s+(?=`|[\"'(\[*_]*[A-ZÀ-ÞΑ-Ω0-9$])")

_BUILDING = re.compile(
    r"\b(?:houses?|rooms?|doors?|floors?|upstairs|downstairs|cellars?|attics?)\b", re.IGNORECASE
)
# Words of ours for which the field has its own: along-track position, smooth, branch, ...
_HOMEMADE = re.compile(
    r"\b(?:abscissae?|astray|athwart|hand(?:s|ed|ing)?[ -]over|look(?:s|ed|ing)?[ -]back|"
    r"la(?:y|ys|id)[ -]out|parcels?|retraced?|swarm|wander(?:s|ed|ing)?)\b",
    re.IGNORECASE,
)


def blocks(text: str) -> list[str]:
    """The paragraphs and list items of a Markdown text, each on one line."""
    text = _IMAGE.sub("", _COMMENT.sub("", _FENCE.sub("", text)))
    found: list[list[str]] = []
    fresh, in_item = True, False
    for line in text.splitlines():
        bare = line.strip()
        is_item = bool(_ITEM.match(line))
        if not bare:
            fresh = True
            continue
        indented = line.startswith("    ") and not is_item
        if bare.startswith(("#", "|")) or (indented and fresh and not in_item):
            fresh = True
            continue
        if indented and fresh and in_item and line.startswith("      "):
            continue  # an equation inside a list item
        if is_item or fresh:
            found.append([])
            in_item = is_item or (in_item and line.startswith(" "))
        found[-1].append(_ITEM.sub("", line) if is_item else bare)
        fresh = False
    return [" ".join(lines).strip() for lines in found]


def sentences(text: str) -> list[str]:
    """The sentences of a Markdown text, see the module's rules."""
    return [s for block in blocks(text) for s in _END.split(_LINK.sub(r"\1", block)) if words(s)]


def words(sentence: str) -> int:
    """How many words a sentence has."""
    return sum(any(c.isalnum() for c in token) for token in sentence.split())


def title(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_sentences_are_counted_as_the_rules_say():
    text = (
        "# A heading of no account.\n\nOne two. Three `a.b` [four](five.md) five 1.5, e.g. six!\n"
        "- An item: one;\n  still one\n- `code` is two\n\nWhere:\n\n    x = y. Z\n\n"
        "```\ncode. Code.\n```\n| a. B |\n"
    )
    assert [(s, words(s)) for s in sentences(text)] == [
        ("One two", 2),
        ("Three `a.b` four five 1.5, e.g. six!", 7),
        ("An item: one; still one", 5),
        ("`code` is two", 3),
        ("Where:", 1),
    ]


@pytest.mark.parametrize("page", PAGES)
def test_few_sentences_are_long(page: str):
    said = sentences((ROOT / page).read_text("utf-8"))
    long = [s for s in said if words(s) > LONGEST]
    assert len(long) <= SHARE * len(said), long


@pytest.mark.parametrize("path", DOCUMENTS, ids=title)
def test_no_document_speaks_of_buildings(path: Path):
    text = _FENCE.sub("", path.read_text("utf-8"))
    assert [line for line in text.splitlines() if _BUILDING.search(line)] == []


@pytest.mark.parametrize("path", DOCUMENTS, ids=title)
def test_documents_use_the_words_of_the_field(path: Path):
    text = _FENCE.sub("", path.read_text("utf-8"))
    assert [line for line in text.splitlines() if _HOMEMADE.search(line)] == []


# The numbers of the model's pages

SETTING = re.compile(r"`([a-z][a-z_0-9]*)` \(([-+.\de]+)(?: ([^()]+))?\)")
MODEL = " ".join(word for page in MODEL_PAGES for word in (ROOT / page).read_text("utf-8").split())
FIELDS = {f.name: f for f in fields(Settings)}


@pytest.mark.parametrize(
    ("name", "value", "unit"), sorted(set(SETTING.findall(MODEL))), ids=lambda v: v or "-"
)
def test_a_number_on_the_models_pages_is_the_default(name: str, value: str, unit: str):
    field = FIELDS[name]
    assert float(value) == field.default
    assert unit == field.metadata["unit"]


def test_the_models_pages_name_every_setting():
    assert set(FIELDS) - {name for name, _, _ in SETTING.findall(MODEL)} == set()


# Modules are named by their path below src/whichroad

MODULE = re.compile(r"`((?:[a-z_]+/)*[a-z_]+\.py)`")
LISTED = re.compile(r"\b[a-z_]+\.py\b")
PACKAGE = ROOT / "src" / "whichroad"
renamed = pytest.mark.skipif(
    not (PACKAGE / "filter").is_dir(), reason="the modules do not have their new names yet"
)


@renamed
@pytest.mark.parametrize("path", DOCUMENTS, ids=title)
def test_the_modules_that_a_page_names_exist(path: Path):
    named = set(MODULE.findall(path.read_text("utf-8")))
    assert {m for m in named if not ((PACKAGE / m).is_file() or (ROOT / m).is_file())} == set()


@renamed
def test_the_tree_of_the_architecture_page_lists_the_modules():
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    tree = _FENCE.search(page)
    assert tree is not None
    core = [m for f in ("filter", "graph") for m in (PACKAGE / f).rglob("*.py")]
    modules = {m.name for m in [*PACKAGE.glob("*.py"), *core]}
    assert set(LISTED.findall(tree[0])) == modules - {"__init__.py", "__main__.py"}


def test_the_tree_of_the_architecture_page_lists_the_folders():
    tree = _FENCE.search((ROOT / "docs" / "architecture.md").read_text("utf-8"))
    assert tree is not None
    named = set(re.findall(r"(?:^|  )([a-z_]+(?:/[a-z_]+)?)/(?= )", tree[0], re.M))
    tops = {p for p in PACKAGE.iterdir() if (p / "__init__.py").is_file()}
    core = {p.parent for p in (PACKAGE / "filter").rglob("__init__.py")}
    assert named == {p.relative_to(PACKAGE).as_posix() for p in tops | core}
