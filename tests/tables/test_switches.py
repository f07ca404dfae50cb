"""Where a sweep begins or ceases to impact."""

from mems_impact.tables import bare, switches, with_units
from tests.plotting.sweeps import made_table


def test_switches():
    assert switches(made_table()) == [("up", 0.3, True), ("down", 0.1, False)]
    assert switches(made_table(("ok", "lost", "ok"))) == [("up", 0.3, True), ("down", 0.1, False)]
    assert switches(made_table(("ok", "lost", "lost"))) == []


def test_switches_of_a_table_with_units_in_its_headings():
    table = with_units(made_table(units={"amplitude": "V", "v2": "m/s"}))
    assert table.columns[0] == "amplitude [V]"
    assert switches(table) == switches(bare(table)) == [("up", 0.3, True), ("down", 0.1, False)]
