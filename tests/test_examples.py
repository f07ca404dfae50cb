"""The pages of the gallery run as they stand; each ends with checks of its own."""

import runpy
from pathlib import Path

import pytest

PAGES = sorted((Path(__file__).resolve().parents[1] / "docs" / "examples").glob("*.py"))
PICTURES = {  # where they are not run, orbit, branch
    "operating_map": {"motions", "speed"},
    "optimal_drive": {"branch", "front", "tornado"},
    "real_device": {"chart", "step"},
    "tolerances": {"scatter"},
}


def test_there_are_pages():
    assert len(PAGES) >= 9


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    runpy.run_path(str(page), run_name="__main__")
    # What the gallery shows of it, under names that no other page takes.
    pictures = {path.stem for path in tmp_path.glob("*.png")}
    kinds = PICTURES.get(page.stem, {"run", "orbit", "branch"})
    assert pictures == {f"{page.stem}_{kind}" for kind in kinds}
