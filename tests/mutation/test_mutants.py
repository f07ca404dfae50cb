"""Mutants are small, stand where they should, and are tried on a copy."""

import ast
from pathlib import Path

import pytest

from validation.mutation.__main__ import PROJECT, drawn
from validation.mutation.equivalent import EQUIVALENT
from validation.mutation.mutants import mutants
from validation.mutation.trial import ROOMS, TESTS, Copy, files_for


def wrong(source, kind=None):
    """Return what each mutant makes of a source."""
    found = mutants("a.py", source)
    return [one.applied(source) for one in found if kind is None or one.kind == kind]


@pytest.mark.parametrize(
    ("source", "kind", "expected"),
    [
        ("a < b\n", "comparison reversed", ["(a > b)\n"]),
        ("a is None\n", "comparison reversed", ["(a is not None)\n"]),
        ("x.size <= 3\n", "comparison weakened", ["(x.size < 3)\n"]),
        ("if a < b:\n    c()\n", "comparison weakened", ["if True:\n    c()\n"]),
        ("a and b or c\n", "and for or", ["((a and b) and c)\n", "(a or b) or c\n"]),
        ("a * (b - c)\n", "operator swapped", ["(a / (b - c))\n", "a * ((b + c))\n"]),
        ("a += b\n", "operator swapped", ["a -= b\n"]),
        ("f(-x)\n", "sign flipped", ["f((x))\n"]),
        ("x = not y\n", "negation dropped", ["x = (y)\n"]),
        ("x = 2\n", "off by one", ["x = 3\n"]),
        ("x = 2.5\n", "number changed", ["x = 2500.0\n"]),
        ("x = 0.0\n", "number changed", ["x = 1.0\n"]),
        ("x = True\n", "truth negated", ["x = False\n"]),
        (
            "def f() -> bool:\n    return g\n",
            "answer negated",
            ["def f() -> bool:\n    return not g\n"],
        ),
    ],
)
def test_kinds(source, kind, expected):
    assert sorted(wrong(source, kind)) == sorted(expected)


@pytest.mark.parametrize(
    "source",
    [
        '"""Text, 1 < 2."""\n',
        "A, B, C = 0, 1, 2\n",
        "raise Bad(1 + 2)\n",
        "x: Literal[1] = y\n",
        "f'{a + b}'\n",
        "'a' + b\n",
        "def f() -> int:\n    return g\n",
        "x = np.zeros(3 * n)\n",
    ],
)
def test_what_is_left_alone(source):
    assert wrong(source) == []


def test_characters_of_several_bytes_do_not_shift_a_mutant():
    assert wrong("x = '× –' if a < b else c  # ×\n", "comparison reversed") == [
        "x = '× –' if (a > b) else c  # ×\n"
    ]


@pytest.mark.slow
def test_every_mutant_of_the_numerics_is_a_program_that_differs():
    every = drawn(PROJECT, 1, 10**6)
    assert len(every) > 1000
    for mutant in every[::20]:
        source = (PROJECT / mutant.path).read_text(encoding="utf-8")
        assert ast.dump(ast.parse(mutant.applied(source))) != ast.dump(ast.parse(source))


@pytest.mark.slow
def test_the_draw_repeats():
    assert drawn(PROJECT, 3, 20) == drawn(PROJECT, 3, 20)
    assert drawn(PROJECT, 3, 20) != drawn(PROJECT, 4, 20)


def test_every_module_has_tests_that_exist():
    for room in ROOMS:
        for place in (PROJECT / "mems_impact" / room).glob("*.py"):
            assert all(
                (PROJECT / test).is_file() for test in files_for(f"mems_impact/{room}/{place.name}")
            )
    for module in TESTS:
        place = PROJECT / "mems_impact" / module
        assert place.is_dir() or place.with_suffix(".py").is_file(), module


def test_what_is_said_to_be_equivalent_still_stands_in_the_sources():
    every = set()
    for path in {path for path, _, _ in EQUIVALENT}:
        source = (PROJECT / path).read_text(encoding="utf-8")
        every |= {(path, *mutant.lines(source)) for mutant in mutants(path, source)}
    assert set(EQUIVALENT) <= every


@pytest.fixture
def copy(tmp_path, monkeypatch):
    """A project of two lines and two tests."""
    project = tmp_path / "project"
    (project / "mems_impact" / "hybrid").mkdir(parents=True)
    for room in ("mems_impact", "mems_impact/hybrid"):
        (project / room / "__init__.py").touch()
    module = project / "mems_impact" / "hybrid" / "sums.py"
    module.write_text("def total(a, b):\n    return a + b\n\n\nSPARE = 2\n")
    (project / "tests").mkdir()
    (project / "tests" / "test_sums.py").write_text(
        "from mems_impact.hybrid.sums import total\n\n\n"
        "def test_total():\n    assert total(1, 2) == 3\n"
    )
    monkeypatch.setitem(TESTS, "hybrid/sums", ["tests/test_sums.py"])
    return Copy.make(project, tmp_path / "copy"), module


def test_a_trial(copy: tuple[Copy, Path]):
    """The swapped sum is noticed, the spare number is not; the source is as before after both."""
    trial, module = copy
    source = module.read_text()
    of_sum, of_spare = mutants("mems_impact/hybrid/sums.py", source)
    assert trial.passes(["tests/test_sums.py"], 60.0)
    assert not trial.survives(of_sum, 60.0)
    assert trial.survives(of_spare, 60.0)
    copied = trial.root / of_sum.path
    assert copied.read_text() == source
    assert copied.stat().st_mtime_ns == module.stat().st_mtime_ns


@pytest.mark.slow
def test_a_mutant_that_hangs_is_killed(copy: tuple[Copy, Path]):
    trial, _ = copy
    test = "from pathlib import Path\n\n\ndef test():\n"
    test += "    Path('began').touch()\n    while True:\n        pass\n"
    (trial.root / "tests" / "test_sums.py").write_text(test)
    assert not trial.passes(["tests/test_sums.py"], 12.0)
    assert (trial.root / "began").exists()
