"""Pages and modules use plain technical English, and the glossary's terms (CONTRIBUTING.md)."""

import ast
import re
import tomllib
from pathlib import Path

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
STRING_OR_COMMENT = re.compile(
    r"""\"{3}.*?\"{3}|'{3}.*?'{3}|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|(?P<comment>#[^\n]*)""",
    re.DOTALL,
)
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
    code = STRING_OR_COMMENT.sub(lambda each: each["comment"] or "\n" * each[0].count("\n"), source)
    for block in re.finditer(r"(?:^ *#.*\n)+|#.*", code, re.MULTILINE):
        line = code.count("\n", 0, block.start()) + 1
        yield line, re.sub(r"^ *[#: ]+", "", block.group(), flags=re.MULTILINE)


def test_pages_are_in_plain_english():
    found = [
        f"{page.relative_to(ROOT)}: {relapse}"
        for page in PAGES
        for relapse in relapses(page.read_text("utf-8"), PHRASES)
    ]
    assert not found, "\n".join(found)


def test_modules_are_in_plain_english():
    found = [
        f"{module.relative_to(ROOT)}: text at line {line}, {relapse}"
        for module in MODULES
        for line, text in passages(module.read_text("utf-8"))
        if " " in text  # not a name
        for relapse in relapses(text, PHRASES)
    ]
    assert not found, "\n".join(found)


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
    assert len(entries) > 50
    assert entries == sorted(entries, key=lambda entry: entry.lower().replace("é", "e"))
