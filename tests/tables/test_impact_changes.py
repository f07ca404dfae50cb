"""Where a sweep begins or ceases to impact."""

from mems_impact.tables import impact_changes, with_units, without_units
from tests.plotting.sweeps import sweep_table

CHANGES = [("up", 0.2, 0.3, True), ("down", 0.2, 0.1, False)]


def test_impact_changes():
    assert impact_changes(sweep_table()) == CHANGES
    assert impact_changes(sweep_table(("ok", "lost", "ok"))) == [
        ("up", 0.1, 0.3, True),
        ("down", 0.3, 0.1, False),
    ]
    assert impact_changes(sweep_table(("ok", "lost", "lost"))) == []


def test_impact_changes_of_a_table_with_units_in_its_headings():
    table = with_units(sweep_table(units={"amplitude": "V", "v2": "m/s"}))
    assert table.columns[0] == "amplitude [V]"
    assert impact_changes(table) == impact_changes(without_units(table)) == CHANGES
