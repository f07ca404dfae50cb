"""Python examples of README.md and docs/ run as they stand; links of the pages lead somewhere."""

import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from textwrap import dedent
from types import SimpleNamespace

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.drives import WAVEFORMS

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "validation" / "README.md"]
PAGES += [ROOT / "validation" / "benchmarks" / "README.md", *sorted(DOCS.glob("*.md"))]
PAGES += [
    page for room in ("terms", "howto", "methods") for page in sorted((DOCS / room).glob("*.md"))
]

FENCE = re.compile(r"^ *```(\w*|\{\w+\}[^\n]*)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
ELSEWHERE = re.compile(r"\]\((https?:[^)\s]+)\)")
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
ANCHOR = re.compile(r"\]\(([\w./-]*\.md)?#([\w-]+)\)")


def slugs(text):
    """Return the anchors of a page's headings."""
    headings = HEADING.findall(text)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


def python_blocks(text):
    """Yield the line on which a block begins, and the block."""
    for match in FENCE.finditer(text):
        if match.group(1) == "python":
            yield text.count("\n", 0, match.start(2)), dedent(match.group(2))


def marks(page):
    """Return the mark of a page that the site's build runs too."""
    return pytest.mark.built if page.is_relative_to(DOCS) else ()


EXAMPLES = [
    pytest.param(page, marks=marks(page))
    for page in PAGES
    if any(python_blocks(page.read_text(encoding="utf-8")))
]


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.name)
def test_python_examples_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    namespace = {"__name__": "__main__"}
    for line, block in python_blocks(page.read_text(encoding="utf-8")):
        # Line numbers of the page, so that a failure points into it.
        code = compile("\n" * line + block, str(page), "exec")
        exec(code, namespace)


@pytest.mark.slow
def test_python_examples_pass_pyright(tmp_path):
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["basedpyright"]
    settings |= {"include": ["."], "extraPaths": [str(ROOT)]}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    for page in PAGES:
        lines = []
        for line, block in python_blocks(page.read_text(encoding="utf-8")):
            lines += [""] * (line - len(lines)) + block.splitlines()
        name = "_".join(page.relative_to(ROOT).with_suffix("").parts)
        (tmp_path / f"{name}_page.py").write_text("\n".join([*lines, ""]), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "basedpyright", "--pythonpath", sys.executable],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1].startswith("0 errors"), done.stdout + done.stderr


def dead_links(page, text):
    """Yield links of a page to files that are not there."""
    return (link for link in LINK.findall(text) if not (page.parent / link).exists())


def dead_anchors(page, text):
    """Yield links to headings that are not there."""
    for link, anchor in ANCHOR.findall(text):
        target = (page.parent / link).read_text(encoding="utf-8") if link else text
        if anchor not in slugs(target):
            yield f"{link}#{anchor}"


def malformed_addresses(page, text):
    """Yield links to other sites that are no address."""
    for link in ELSEWHERE.findall(text):
        if not re.fullmatch(r"https://[\w.-]+\.\w+(/[^\s<>]*)?", link):
            yield link


def missing_modules(page, text):
    """Yield names of modules that are not there."""
    roots = (ROOT, ROOT / "mems_impact", page.parent)
    for path in re.findall(r"`([\w.-]+/[\w./-]*?\.pyi?)`", text):
        if path.islower() and not any((root / path).exists() for root in roots):
            yield path


def unnamed_blocks(page, text):
    """Yield lines of blocks without a language."""
    for match in FENCE.finditer(text):
        if not match.group(1):
            yield f"line {text.count(chr(10), 0, match.start()) + 1}"


@pytest.mark.parametrize(
    "fault", [dead_links, dead_anchors, malformed_addresses, missing_modules, unnamed_blocks]
)
def test_pages_have_no(fault):
    found = [
        f"{page.relative_to(ROOT)}: {each}"
        for page in PAGES
        for each in fault(page, page.read_text(encoding="utf-8"))
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (dead_links, "[there](nowhere.md)"),
        (dead_anchors, "# A heading\n[there](#another)"),
        (malformed_addresses, "[there](http://example)"),
        (missing_modules, "`mems_impact/nowhere.py`"),
        (unnamed_blocks, "```\nx\n```\n"),
    ],
)
def test_a_fault_of_a_page_is_found(fault, text):
    assert len(list(fault(ROOT / "README.md", text))) == 1


def test_every_waveform_is_described():
    page = (ROOT / "docs" / "drives.md").read_text(encoding="utf-8")
    assert [name for name in WAVEFORMS.values() if f"| `{name}(" not in page] == []


def test_the_map_of_the_house_names_what_is_there():
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    paths = set(re.findall(r"`((?:mems_impact|tests|validation|docs)/[^`]*)`", page))
    # KIND and NAME are to come, as is what is built.
    paths = {path for path in paths if not re.search("[A-Z]{2}|_build", path)}
    assert len(paths) > 15
    assert [path for path in sorted(paths) if not (ROOT / path).exists()] == []
    for name, path in re.findall(r"`([A-Z_]+)` of `([^`]+)`", page):
        assert re.search(rf"^ *{name}\b", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE)


def test_the_page_of_validation_says_how_to_run_each_folder():
    page = (ROOT / "validation" / "README.md").read_text(encoding="utf-8")
    folders = {path.parent.name for path in (ROOT / "validation").glob("*/__init__.py")}
    assert set(re.findall(r"^\| `(\w+)/`", page, re.MULTILINE)) == folders
    for module in set(re.findall(r"`python -m ([\w.]+)", page)):
        path = ROOT / module.replace(".", "/")
        assert (path / "__main__.py").exists() or path.with_suffix(".py").exists(), module


def docs_module(name):
    """Return a module of the documentation, which is no package."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("statement", "shown"),
    [
        ("assert np.isclose(x, 1 / 3)", "x  # 0.333333"),
        ("assert abs(3 * x - 1) < 1e-9", "3 * x  # 1"),
        ("assert 0 < x < 1", "x  # 0.333333"),
        ("assert [x, 2] == [1 / 3, 2]", "[x, 2]  # 0.333333, 2"),
        ("assert (x > 0\n    and x < 1)  # both", "x > 0 and x < 1  # True"),
        ('assert "a" in "ab"', ""),
        ("assert np.ones((9, 9)).shape", "np.ones((9, 9)).shape  # 9, 9"),
        ("assert np.zeros(40).tolist() == 40 * [0]", ""),
        ("for i in (1, 2):\n    assert i", "for i in (1, 2):\n    assert i"),
    ],
)
def test_pages_show_assertions_as_quantities_with_values(statement, shown):
    run_block = docs_module("executing").run_block
    code, printed = run_block(f"{statement}\nprint(x)", "page.md", 5, {"x": 1 / 3, "np": np})
    assert code == f"{shown}\nprint(x)".lstrip()
    assert printed.startswith("0.333")


def test_a_wrong_assertion_of_a_page_fails_at_its_line():
    with pytest.raises(AssertionError) as caught:
        docs_module("executing").run_block("x = 1\nassert x == 2", "page.md", 5, {})
    assert caught.traceback[-1].lineno + 1 == 7


def test_pages_show_the_pictures_that_their_blocks_write(tmp_path, monkeypatch):
    executing = docs_module("executing")
    monkeypatch.setattr(executing, "MADE", tmp_path / "made")
    block = (
        '```python\nfrom pathlib import Path\nPath("{}.png").write_bytes(b"")  # savefig(\n```\n'
    )
    text = block.format("first") + "\n![shown](../figures/first.png)\n\n" + block.format("second")
    app = SimpleNamespace(
        env=SimpleNamespace(doc2path=lambda page: tmp_path / f"{page}.md"),
        config=SimpleNamespace(sphinx_gallery_conf={}),
    )
    content = [text]
    executing.run(app, "howto/page", content)
    assert "![shown](../made/howto_page_first.png" in content[0]
    assert content[0].endswith("```\n\n![second](../made/howto_page_second.png)\n\n")
    made = {path.name for path in (tmp_path / "made").iterdir()}
    assert made == {"howto_page_first.png", "howto_page_second.png"}


def test_signatures_show_what_a_verb_takes_and_no_defaults_of_options():
    module = docs_module("signatures")
    of_system, of_device = module.signatures(mi.operating_map)
    assert of_system.startswith("(system, *, x, y, initial=None, recurrence=RecurrenceOptions(), ")
    assert of_device.startswith("(actuator, drive, *, x, y, ")
    assert "options=Options(method='auto')," in of_system
    assert module.signatures(mi.continue_solution) == [
        "(solution, parameter, stop, *, back=None, steps=None, through_grazing=True, "
        "events=None, stop_at=(), progress=False)"
    ]
