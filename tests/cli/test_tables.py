"""Tables and texts on the screen: as wide as the terminal."""

import pandas as pd
import pytest

from mems_impact.cli.output import folded, reflowed

FORM = "{:.6g}".format


def table(columns):
    names = ["amplitude [V]", *(f"displacement per period {i} [m]" for i in range(columns))]
    return pd.DataFrame([[0.16, *range(columns)], [0.2, *range(columns)]], columns=names)


def test_a_narrow_table_is_left_as_it_is():
    frame = table(1)
    assert folded(frame, FORM, 80) == frame.to_string(index=False, float_format=FORM)


@pytest.mark.parametrize("width", [40, 80, 120])
def test_a_wide_table_is_folded_to_the_width(width):
    text = folded(table(12), FORM, width)
    assert max(map(len, text.splitlines())) <= width
    blocks = text.split("\n\n")
    assert all(block.splitlines()[-1].split()[0] == "0.2" for block in blocks)  # the first column
    cells = [cell for block in blocks for cell in block.splitlines()[-1].split()[1:]]
    assert cells == [str(i) for i in range(12)]


def test_headings_are_wrapped_before_columns_are_folded():
    text = folded(table(3), FORM, 60)
    assert "\n\n" not in text
    assert text.splitlines()[0].split() == ["displacement"] * 3


def test_a_cell_wider_than_the_terminal_stays_whole():
    frame = pd.DataFrame({"status": ["x" * 100], "n": [1]})
    assert "x" * 100 in folded(frame, FORM, 80)


def test_a_long_text_is_wrapped_beside_the_first_column():
    long = "amplitude = 100 V, omega = 6.28318531 rad/s, bias = 0 V, phase = 0"
    frame = pd.DataFrame({"quantity": ["mean speed", "step"], "drive": [long, "a"], "n": [1, 2]})
    words = long.split()
    words.insert(words.index("rad/s,"), "1")  # the last column, on the first line of its row
    text = folded(frame, FORM, 50)
    assert max(map(len, text.splitlines())) <= 50
    assert text.split() == ["quantity", "drive", "n", "mean", "speed", *words, "step", "a", "2"]


def test_paragraphs_of_docstrings_are_filled_and_code_stays():
    words = ["one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten"]
    filled = " ".join(words * 2)[:90]
    text = f"values : float\n    {filled[:86]}\n    {filled[:20]}\nother : int\n\n>>> {filled}\n"
    shown = reflowed(text, 40).splitlines()
    assert [line for line in shown if len(line) > 40] == [f">>> {filled}"]
    assert shown[0] == "values : float"
    assert shown[shown.index("other : int") - 1].startswith("    ")
    inner = shown[1 : shown.index("other : int")]
    assert " ".join(" ".join(inner).split()) == f"{filled[:86]} {filled[:20]}"
    assert all(len(line) + 6 > 40 - len("seven") for line in inner[:-1])


def test_entries_of_one_line_stay_apart():
    text = "Actuator: " + "word " * 20 + "\nring_down: a free decay"
    shown = reflowed(text, 40).splitlines()
    assert shown[-1] == "ring_down: a free decay"
    assert max(map(len, shown)) <= 40
