"""The paper's own figures."""

import pandas as pd
import pytest

import mems_impact as mi
from validation.paper.diagrams import MEASURED, plot_automaton, plot_displacement


def test_automaton(tmp_path):
    rows = [
        ("stuck-free", "right impact", "forward-free", 3),
        ("forward-free", "slip end", "stuck-free", 3),
        ("forward-free", "right impact", "forward-free", 1),
    ]
    ax = plot_automaton(pd.DataFrame(rows, columns=["mode before", "event", "mode after", "seen"]))
    texts = [text.get_text() for text in ax.texts]
    assert {"stuck\nfree", "forward\nfree", "backward\nleft"} <= set(texts)
    kinds = [text.get_text() for text in ax.get_legend().get_texts()]
    assert kinds == ["impact", "slip end", "never occurs"]
    ax.figure.savefig(tmp_path / "automaton.png")


@pytest.mark.slow
def test_displacement(tmp_path):
    device, drive = mi.load_actuator("mita2003"), mi.Sine(amplitude=100.0, omega=6.283)
    run = mi.simulate(device, drive, 3)
    table = pd.DataFrame(
        {"frequency [Hz]": [1.0, 1.0], "amplitude [V]": [80.0, 100.0],
         "displacement per blow [m]": [1e-8, 2e-8]}
    )  # fmt: skip
    response, block, frame = plot_displacement(table, run, 60.0)
    measured = next(line for line in response.lines if line.get_marker() == "x")
    assert measured.get_xydata().tolist() == [list(MEASURED)]
    assert (block.get_ylabel(), frame.get_ylabel()) == ("$x_2$ [µm]", "$x_1$ [nm]")
    response.figure.savefig(tmp_path / "displacement.png")
