"""Pages use plain technical English, and the terms of the glossary (see CONTRIBUTING.md)."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PHRASES = tomllib.loads((ROOT / "tests" / "prose.toml").read_text("utf-8"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]
PAGES += [
    page
    for folder in ("howto", "methods", "terms", "tutorials", "ideas", "examples")
    for ending in ("*.md", "*.py", "*.rst")
    for page in sorted((DOCS / folder).glob(ending))
]

QUOTED = re.compile(r"^\| do not write .*?\n\n", re.MULTILINE | re.DOTALL)


def relapses(text, phrases):
    """Return the lines of a text in which a phrase occurs, each with its replacement."""
    text = QUOTED.sub(lambda table: "\n" * table.group().count("\n"), text)
    # A phrase may run over the end of a line, and of a comment's.
    joined = re.sub(r"\n *(?:#: |# )?", lambda end: " " * len(end.group()), text)
    return [
        f"line {text.count(chr(10), 0, match.start()) + 1}: {match.group()!r}, rather: {better}"
        for phrase, better in phrases.items()
        for match in re.finditer(phrase.replace(" ", r"\s+"), joined)
    ]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_is_in_plain_english(page):
    assert relapses(page.read_text("utf-8"), PHRASES) == []


def test_relapses_are_found_over_the_ends_of_lines():
    text = "The table has one\nrow a point.\n# What is\n# told here.\n"
    assert len(relapses(text, {r"\bone row a (?!time)": "", r"\bis told\b": ""})) == 2
    assert relapses("| do not write | write |\n|---|---|\n| anew | again |\n\n", {"anew": ""}) == []


def test_the_glossary_defines_the_terms():
    glossary = (DOCS / "glossary.md").read_text("utf-8")
    defined = {
        term.strip().lower()
        for entry in re.findall(r"^\*\*(.+?)\*\*", glossary, re.MULTILINE)
        for term in entry.split(",")
    }
    page = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    table = page.partition("| term | rather than |")[2]
    terms = {
        re.sub(r" \(.*\)", "", term).strip()
        for row in re.findall(r"^\| ([a-z].*?) \|", table, re.MULTILINE)
        for term in re.split("[,;]", row)
    }
    assert len(terms) > 30
    assert terms - defined == set()
    entries = re.findall(r"^\*\*(.+?)\*\*", glossary, re.MULTILINE)
    assert entries == sorted(entries, key=lambda entry: entry.lower().replace("é", "e"))
