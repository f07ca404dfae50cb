"""`mems-impact validate`."""

import pytest


@pytest.mark.slow
def test_one_figure(cli, tmp_path):
    done = cli("validate", "3", "--quick", "--output", str(tmp_path / "out"))
    assert done.status == 0
    assert "2 statements: 2 agrees" in done.out
    assert (tmp_path / "out" / "report.html").exists()
    again = [
        "validate", "3", "--quick", "--output", str(tmp_path / "again"), "--expect",
    ]  # fmt: skip
    same = cli(*again, str(tmp_path / "out" / "verdicts.csv"))
    assert same.status == 0
    assert "no verdict differs" in same.out
    other = tmp_path / "other.csv"
    other.write_text("id,verdict\n3.displacement,differs\n3.two-impacts,agrees\n")
    changed = cli(*again, str(other))
    assert changed.status == 1
    assert "verdicts changed: 3.displacement: agrees, was: differs" in changed.err


def test_bad_input(cli, tmp_path):
    assert cli("validate", "1", "--output", str(tmp_path)).status == 2
    wrong = cli("validate", "3", "--expect", str(tmp_path / "none.csv"))
    assert wrong.status == 2
    assert "none.csv" in wrong.err
