"""Pages and modules use plain technical English, and the glossary's terms (CONTRIBUTING.md)."""

import ast
import io
import re
import tokenize
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

MODULES = sorted((ROOT / "mems_impact").rglob("*.py"))

# The table of phrases to avoid, in CONTRIBUTING.md.
QUOTED = re.compile(r"^\| do not write .*?\n(?:\n|\Z)", re.MULTILINE | re.DOTALL)
EXAMPLE = re.compile(r"^ *(?:>>>|\.\.\.) .*$", re.MULTILINE)


def relapses(text, phrases):
    """Return the lines of a text in which a phrase occurs, each with its replacement."""
    text = QUOTED.sub(lambda table: "\n" * table.group().count("\n"), text)
    # A phrase may run over the end of a line, and of a comment's.
    joined = re.sub(r"\n *(?:#: |# )?", lambda end: " " * len(end.group()), text)
    if not re.search("|".join(phrases).replace(" ", r"\s+"), joined):
        return []
    return [
        f"line {text.count(chr(10), 0, match.start()) + 1}: {match.group()!r}, rather: {better}"
        for phrase, better in phrases.items()
        for match in re.finditer(phrase.replace(" ", r"\s+"), joined)
    ]


def passages(source):
    """Yield the docstrings, messages and comments of a module, each after its first line number."""
    nodes = list(ast.walk(ast.parse(source)))
    formatted = [node for node in nodes if isinstance(node, ast.JoinedStr)]
    parts = {id(part) for node in formatted for part in ast.walk(node) if part is not node}
    for node in formatted:
        texts = (part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
        yield node.lineno, "".join(texts)
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            yield node.lineno, EXAMPLE.sub("", node.value)
    yield from comments(source)


def comments(source):
    """Yield the comments of a module, successive lines as one, after the first line number."""
    first, block = 0, []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            line, trailing = token.start[0], bool(token.line[: token.start[1]].strip())
            if trailing or line != first + len(block):
                yield first, "\n".join(block)
                first, block = line, []
            block.append(token.string.lstrip("#: "))
            if trailing:
                yield first, block.pop()
                first = 0
    yield first, "\n".join(block)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_is_in_plain_english(page):
    assert relapses(page.read_text("utf-8"), PHRASES) == []


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_module_is_in_plain_english(module):
    source = module.read_text("utf-8")
    found = [
        f"text at line {line}, {relapse}"
        for line, text in passages(source)
        if " " in text  # not a name
        for relapse in relapses(text, PHRASES)
    ]
    assert found == []


def test_the_passages_of_a_module_are_its_texts():
    source = """\'\'\'Add.

    >>> told = 1
    \'\'\'
told = 1  # told
# two
# lines
raise ValueError(
    f"{told} is "
    "a message"
)
"""
    texts = [" ".join(text.split()) for _, text in passages(source)]
    assert [text for text in texts if text] == ["{} is a message", "Add.", "told", "two lines"]


def test_relapses_are_found_over_the_ends_of_lines():
    text = "The table has one\nrow a point.\n# What is\n# told here.\n"
    assert len(relapses(text, {r"\bone row a (?!time)": "", r"\bis told\b": ""})) == 2
    assert relapses("| do not write | write |\n|---|---|\n| anew | again |\n\n", {"anew": ""}) == []


def test_the_glossary_is_sorted():
    glossary = (DOCS / "glossary.md").read_text("utf-8")
    entries = re.findall(r"^\*\*(.+?)\*\*", glossary, re.MULTILINE)
    assert len(entries) > 60
    assert entries == sorted(entries, key=lambda entry: entry.lower().replace("é", "e"))
