"""Deflection and mean speed over the frequency."""

import mems_impact as mi
from tests.plotting.test_print import response


def words(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_amplitudes_have_the_unit_of_the_device():
    above, below = mi.plot_response(response())
    assert words(above) == ["20 V", "40 V", "60 V", "up", "down"]
    assert below.get_xlabel() == r"$\omega$ [rad/s]"


def test_amplitudes_without_units_are_the_f_of_the_paper():
    table = response()
    table.attrs = {"symbols": {"amplitude": "$f$"}}
    assert words(mi.plot_response(table)[0])[0] == "$f$ = 20"
