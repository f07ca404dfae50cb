"""The pages of gallery, tutorials and ideas run as they stand; each has checks of its own.

Their pictures look as they did.
"""

import importlib.util
import re
import runpy
from pathlib import Path
from types import SimpleNamespace

import pytest
from matplotlib.figure import Figure
from PIL import Image

import mems_impact as mi

DOCS = Path(__file__).resolve().parents[1] / "docs"
GALLERY = sorted((DOCS / "examples").glob("*.py"))
LESSONS = [*sorted((DOCS / "tutorials").glob("*.py")), *sorted((DOCS / "ideas").glob("*.py"))]
PICTURES = {  # where they are not run, orbit, branch
    "bifurcation_diagram": {"branch"},
    "basin_boundary": {"basins"},
    "contact_switch": {"landing"},
    "electrodes": {"pull_in"},
    "friction_from_a_record": {"fit", "ellipses"},
    "gap_closing_actuator": {"times"},
    "impact_damper": {"integral", "run"},
    "operating_map": {"motions", "speed"},
    "optimal_drive": {"branch", "front", "tornado"},
    "real_device": {"chart", "step"},
    "relief_valve": {"run", "orbit", "branch", "curves"},
    "resonant_grazing": {"curves"},
    "tolerances": {"spread"},
}


def docs_module(name):
    """Return a module of the documentation, which is no package."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


comparing = docs_module("comparing")


def test_there_are_pages():
    assert len(GALLERY) >= 9
    assert len(LESSONS) >= 9


def looked_at(folder):
    """Return the names of the pictures there; PictureError if one does not look as it did."""
    found = sorted(folder.glob("*.png"))
    for path in found:
        comparing.check(path)
    return {path.stem for path in found}


@pytest.mark.built
@pytest.mark.slow
@pytest.mark.parametrize("page", GALLERY, ids=lambda page: page.stem)
def test_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    runpy.run_path(str(page), run_name="__main__")
    # What the gallery shows of it, under names that no other page takes.
    pictures = looked_at(tmp_path)
    kinds = PICTURES.get(page.stem, {"run", "orbit", "branch"})
    assert pictures == {f"{page.stem}_{kind}" for kind in kinds}


@pytest.mark.built
@pytest.mark.slow
@pytest.mark.parametrize("page", LESSONS, ids=lambda page: page.stem)
def test_lesson_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    runpy.run_path(str(page), run_name="__main__")
    assert "assert " in page.read_text(encoding="utf-8")
    # A build runs them all in one folder.
    pictures = looked_at(tmp_path)
    assert all(name.startswith(page.stem.lstrip("0123456789_")) for name in pictures)


def drawn(path, width=1.2, marker="o", color="tab:blue", grid=False, words="speed", far=0.0):
    """Save a picture, and return it as it is compared."""
    with mi.style():
        figure = Figure(layout="constrained")
        ax = figure.subplots()
        ax.plot([0, 1, 2], [0 + far, 1 + far, 0.5 + far], color=color, linewidth=width)
        ax.plot([1], [0.5], marker=marker, color="black")
        ax.set(xlabel="time", ylabel=words, ylim=(-0.1, 1.2))
        ax.grid(grid)
        figure.savefig(path, dpi=150)
    return comparing.small(path)


CHANGES = (
    {"width": 0}, {"width": 3.0}, {"marker": ""}, {"color": "tab:green"}, {"grid": True},
    {"words": "step"}, {"far": 0.03},
)  # fmt: skip


@pytest.mark.slow
def test_what_looks_otherwise_is_found(tmp_path):
    path = tmp_path / "drawn.png"
    before = drawn(path)
    found = {str(change): comparing.difference(before, drawn(path, **change)) for change in CHANGES}
    assert {change: by for change, (by, _) in found.items() if by <= comparing.MOST} == {}


def test_what_cannot_be_seen_is_none(tmp_path):
    path = tmp_path / "drawn.png"
    before = drawn(path)
    moved = Image.new("RGB", before.size, "white")
    moved.paste(before, (1, 1))
    assert comparing.difference(before, moved)[0] < 0.3 * comparing.MOST


def test_a_picture_is_compared_with_its_reference(tmp_path, monkeypatch):
    monkeypatch.setattr(comparing, "matplotlib", SimpleNamespace(__version_info__=(3, 11)))
    monkeypatch.setattr(comparing, "REFERENCES", tmp_path)
    (tmp_path / "made").mkdir()
    path = tmp_path / "made" / "drawn.png"
    drawn(path)
    with pytest.raises(comparing.PictureError, match="no reference"):
        comparing.check(path)
    monkeypatch.setenv("PICTURES", "renew")
    comparing.check(path)
    assert (tmp_path / "drawn.png").stat().st_size < 30_000
    monkeypatch.delenv("PICTURES")
    comparing.check(path)
    drawn(path, color="tab:green")
    with pytest.raises(comparing.PictureError, match="looks unlike"):
        comparing.check(path)


def test_every_picture_has_a_reference_and_no_other():
    pages = [page.read_text(encoding="utf-8") for page in [*GALLERY, *LESSONS]]
    saved = {name for text in pages for name in re.findall(r"(\w+)\.png\"", text)}
    references = list(comparing.REFERENCES.glob("*.png"))
    assert saved - comparing.BY_ROUNDING == {path.stem for path in references}
    assert max(path.stat().st_size for path in references) < 30_000
