"""The pages of gallery, tutorials and ideas run as they stand; each has checks of its own."""

import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
GALLERY = sorted((DOCS / "examples").glob("*.py"))
LESSONS = [*sorted((DOCS / "tutorials").glob("*.py")), *sorted((DOCS / "ideas").glob("*.py"))]
PICTURES = {  # where they are not run, orbit, branch
    "operating_map": {"motions", "speed"},
    "optimal_drive": {"branch", "front", "tornado"},
    "real_device": {"chart", "step"},
    "tolerances": {"scatter"},
}


def test_there_are_pages():
    assert len(GALLERY) >= 9
    assert len(LESSONS) >= 15


@pytest.mark.built
@pytest.mark.slow
@pytest.mark.parametrize("page", GALLERY, ids=lambda page: page.stem)
def test_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    runpy.run_path(str(page), run_name="__main__")
    # What the gallery shows of it, under names that no other page takes.
    pictures = {path.stem for path in tmp_path.glob("*.png")}
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
    pictures = {path.stem for path in tmp_path.glob("*.png")}
    assert all(name.startswith(page.stem.lstrip("0123456789_")) for name in pictures)
