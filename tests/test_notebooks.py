"""What a notebook shows of results."""

import importlib
import re
import sys
from base64 import b64decode
from types import SimpleNamespace

import pytest

import mems_impact as mi
from mems_impact import notebooks

DRIVE = mi.Sine(amplitude=0.24, omega=0.5)


class Formatter:
    """Of IPython, by name."""

    def __init__(self):
        self.known = {}

    def for_type_by_name(self, module, name, show):
        self.known[module, name] = show


@pytest.fixture
def formatter(monkeypatch):
    html = Formatter()
    session = SimpleNamespace(display_formatter=SimpleNamespace(formatters={"text/html": html}))
    ipython = SimpleNamespace(get_ipython=lambda: session)
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "IPython", ipython)
        notebooks.register()
    return html


def shown(formatter, result):
    """Return the HTML by the formatter of the first of its classes that has one."""
    known = formatter.known
    places = [(kind.__module__, kind.__name__) for kind in type(result).__mro__]
    return next(known[place] for place in places if place in known)(result)


@pytest.mark.slow
def test_results_come_with_their_pictures(formatter):
    zhao = mi.load_actuator("zhao2004")
    orbit = mi.find_orbit(zhao, DRIVE, guess=mi.kicked_state(zhao), transient=300)
    run = mi.simulate(zhao, DRIVE, periods=3, initial=mi.kicked_state(zhao))
    for result in (run, orbit):
        html = shown(formatter, result)
        assert html.startswith(result._repr_html_())
        [data] = re.findall(r'src="data:image/png;base64,([^"]+)"', html)
        assert b64decode(data).startswith(b"\x89PNG")


def test_a_result_that_cannot_be_drawn_is_its_table(formatter):
    zhao = mi.load_actuator("zhao2004")
    run = mi.simulate(zhao, DRIVE, periods=3, keep="statistics")
    assert shown(formatter, run) == run._repr_html_()


def test_every_class_is_there_and_drawn_by_a_public_function(formatter):
    assert len(formatter.known) == len(notebooks.PICTURES)
    for (module, name), draw in zip(formatter.known, notebooks.PICTURES.values(), strict=True):
        assert isinstance(getattr(importlib.import_module(module), name), type)
        assert draw in mi.__all__


def test_without_a_session_nothing_is_reported(monkeypatch):
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: None))
    notebooks.register()


CELLS = (
    "import mems_impact as mi\n"
    "run = mi.simulate(mi.load_actuator('zhao2004'), mi.Sine(amplitude=0.24, omega=0.5), 3)",
    "run",
    "ax = mi.plot_run(run)",
)


@pytest.mark.slow
def test_an_executed_notebook_shows_each_picture_once():
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    notebook = nbformat.v4.new_notebook(cells=list(map(nbformat.v4.new_code_cell, CELLS)))
    nbclient.NotebookClient(notebook, timeout=300).execute()
    _, result, figure = (
        [dict(each.get("data", {})) for each in cell.outputs] for cell in notebook.cells
    )
    assert len(result) == 1
    assert "data:image/png;base64," in result[0]["text/html"]
    assert len(figure) == 1
    assert "image/png" in figure[0]
