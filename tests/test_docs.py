"""The Python examples of README.md and docs/ run as they stand, page by page."""

import importlib.util
import re
from pathlib import Path
from textwrap import dedent
from types import SimpleNamespace

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


def python_blocks(text):
    """Yield the line on which a block begins, and the block."""
    for match in FENCE.finditer(text):
        if match.group(1) == "python":
            yield text.count("\n", 0, match.start(2)), dedent(match.group(2))


SLOW = ("designer.md", "device.md", "hybrid.md", "orbits.md", "parts.md")
SLOW += ("basins.md", "lyapunov.md", "studies.md", "tolerances.md", "sensitivity.md", "terms.md")
SLOW += ("drives.md", "figures.md", "guide.md", "howto.md", "index.md")
SLOW += tuple(page.name for room in ("terms", "howto") for page in (DOCS / room).glob("*.md"))


def marks(page):
    """Return how the examples of a page are marked: slow, and whether the site's build runs it."""
    if page.name not in SLOW:
        return ()
    built = page.is_relative_to(DOCS) and "savefig(" in page.read_text(encoding="utf-8")
    return (pytest.mark.slow, pytest.mark.built) if built else pytest.mark.slow


EXAMPLES = [pytest.param(page, marks=marks(page)) for page in PAGES]


@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.name)
def test_python_examples_run(page, tmp_path, monkeypatch):
    blocks = list(python_blocks(page.read_text(encoding="utf-8")))
    if not blocks:
        pytest.skip("no Python example on this page")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    namespace = {"__name__": "__main__"}
    for line, block in blocks:
        # Line numbers of the page, so that a failure points into it.
        code = compile("\n" * line + block, str(page), "exec")
        exec(code, namespace)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_within_the_project_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    missing = [link for link in LINK.findall(text) if not (page.parent / link).exists()]
    assert missing == []


HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
ANCHOR = re.compile(r"\]\(([\w./-]*\.md)?#([\w-]+)\)")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_headings(page):
    text = page.read_text(encoding="utf-8")
    missing = []
    for link, anchor in ANCHOR.findall(text):
        target = (page.parent / link).read_text(encoding="utf-8") if link else text
        slugs = {
            re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
            for heading in HEADING.findall(target)
        }
        if anchor not in slugs:
            missing.append(f"{link}#{anchor}")
    assert missing == []


def test_every_block_says_its_language():
    unnamed = [
        f"{page.name}:{page.read_text(encoding='utf-8')[: match.start()].count(chr(10)) + 1}"
        for page in PAGES
        for match in FENCE.finditer(page.read_text(encoding="utf-8"))
        if not match.group(1)
    ]
    assert unnamed == []


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


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pages_name_files_that_are_there(page):
    text = page.read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w.-]+/[\w./-]*?)`", text))
    named = {path for path in named if path.endswith((".py", ".pyi")) and path.islower()}
    roots = (ROOT, ROOT / "mems_impact", page.parent)
    missing = [path for path in named if not any((root / path).exists() for root in roots)]
    assert missing == []


def test_pages_show_the_pictures_that_their_blocks_write(tmp_path, monkeypatch):
    spec = importlib.util.spec_from_file_location("executing", DOCS / "executing.py")
    executing = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(executing)
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


def test_links_to_elsewhere_are_whole():
    links = [link for page in PAGES for link in ELSEWHERE.findall(page.read_text("utf-8"))]
    assert len(links) > 10
    assert [
        link for link in links if not re.fullmatch(r"https://[\w.-]+\.\w+(/[^\s<>]*)?", link)
    ] == []


def test_signatures_show_what_a_verb_takes_and_no_defaults_of_options():
    spec = importlib.util.spec_from_file_location("signatures", DOCS / "signatures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    of_system, of_device = module.signatures(mi.operating_map)
    assert of_system.startswith("(system, *, x, y, initial=None, recurrence=RecurrenceOptions(), ")
    assert of_device.startswith("(actuator, drive, *, x, y, ")
    assert "options=Options(method='auto')," in of_system
    assert module.signatures(mi.continue_orbit) == [
        "(orbit, parameter, stop, *, back=None, steps=StepControl(max_step=0.02), "
        "through_grazing=True, events=None, stop_at=(), progress=False)"
    ]
