"""Mutants are small, stand where they should, and are tried on a copy."""

import ast
import shutil

import pytest

from validation.mutation.__main__ import PROJECT, drawn
from validation.mutation.equivalent import EQUIVALENT
from validation.mutation.mutants import ROOMS, mutants
from validation.mutation.trial import UNSEEN, WATCHED, Copy
from validation.mutation.watched import Watched, where_seen


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


@pytest.mark.nightly
def test_every_mutant_of_the_numerics_is_a_program_that_differs():
    every = drawn(PROJECT, 1, 10**6)
    assert len(every) > 1000
    assert "mems_impact/hybrid/event_loop/loop.py" in {mutant.path for mutant in every}
    programs = {}
    for mutant in every[::40]:
        source = (PROJECT / mutant.path).read_text(encoding="utf-8")
        if mutant.path not in programs:
            programs[mutant.path] = ast.dump(ast.parse(source))
        assert ast.dump(ast.parse(mutant.applied(source))) != programs[mutant.path]


def test_the_tests_of_every_room_exist():
    for place in (*WATCHED, *(name for names in UNSEEN.values() for name in names)):
        assert (PROJECT / place).exists(), place
    assert {room for room in UNSEEN if "/" not in room} == set(ROOMS)
    for module in UNSEEN:
        place = PROJECT / "mems_impact" / module
        assert place.is_dir() or place.with_suffix(".py").is_file(), module


def test_a_change_elsewhere_draws_no_other_mutants(tmp_path):
    """Each has a place in the draw of its own: what is new comes in, the others stay in order."""
    room = tmp_path / "mems_impact" / "hybrid"
    room.mkdir(parents=True)
    (room / "sums.py").write_text("".join(f"x{k} = a{k} + b{k}\n" for k in range(30)))
    before = drawn(tmp_path, 1, 10)
    assert len(before) == 10
    (room / "new.py").write_text("".join(f"y{k} = a{k} * b{k}\n" for k in range(30)))
    after = [mutant for mutant in drawn(tmp_path, 1, 60) if mutant.path.endswith("sums.py")]
    assert after[:10] == before


@pytest.mark.nightly
def test_what_is_said_to_be_equivalent_still_stands_in_the_sources():
    every = set()
    for path in {path for path, _, _ in EQUIVALENT}:
        source = (PROJECT / path).read_text(encoding="utf-8")
        every |= {(path, *mutant.lines(source)) for mutant in mutants(path, source)}
    assert set(EQUIVALENT) <= every


SUMS = """LIMIT = 2


def total(a, b):
    return a + b


def bounded(a):
    return min(
        a,
        LIMIT,
    )


def spare(a, b=3):
    return a * b
"""
TESTS = """from mems_impact.hybrid.sums import bounded, total


def test_total():
    assert total(1, 2) == 3


def test_bounded():
    assert bounded(5) == 2


def test_nothing():
    pass
"""


@pytest.fixture
def project(tmp_path):
    """A project of a module and three tests."""
    project = tmp_path / "project"
    (project / "mems_impact" / "hybrid").mkdir(parents=True)
    for room in ("mems_impact", "mems_impact/hybrid"):
        (project / room / "__init__.py").touch()
    (project / "mems_impact" / "hybrid" / "sums.py").write_text(SUMS)
    (project / "tests").mkdir()
    (project / "tests" / "test_sums.py").write_text(TESTS)
    shutil.copytree(PROJECT / "validation" / "mutation", project / "validation" / "mutation")
    return project


MODULE = "mems_impact/hybrid/sums.py"
FILE = "tests/test_sums.py"


@pytest.mark.nightly
def test_a_trial(project, tmp_path):
    """Tests are watched; what they run is noticed, the spare product is not; nothing is left."""
    trial = Copy.make(project, tmp_path / "copy")
    into = tmp_path / "watched.json"
    trial.watch(FILE, into)
    watched = Watched.read([into])
    assert list(watched.seconds) == [
        f"{FILE}::test_{name}" for name in ("total", "bounded", "nothing")
    ]
    # The limit is no line of a function: who uses it counts, here within a longer statement.
    for line, tests in ((1, {"bounded"}), (5, {"total"}), (11, {"bounded"}), (15, set())):
        ran = watched.running(where_seen(trial.root, MODULE, line))
        assert ran == {f"{FILE}::test_{name}" for name in tests}, line

    of_limit, of_total, _, of_spare = mutants(MODULE, SUMS)
    assert not trial.survives(of_limit, watched)
    assert not trial.survives(of_total, watched)
    assert trial.survives(of_spare, watched)
    copied = trial.root / MODULE
    assert copied.read_text() == SUMS
    assert copied.stat().st_mtime_ns == (project / MODULE).stat().st_mtime_ns


def test_tests_in_turn():
    """Those that ran the line, then the rest of their files, then others; quick ones first."""
    seconds = {"a::slow": 9.0, "a::quick": 0.1, "b::one": 0.3, "b::two": 0.2, "c::one": 0.1}
    watched = Watched({**seconds, "d::never": 0.1, "b::longest": 50.0}, [], {})
    ran = {"a::slow", "b::two"}
    chosen = watched.in_turn(ran, ("c",), budget=20.0)
    assert chosen == ["b::two", "a::slow", "a::quick", "b::one", "c::one"]
    assert watched.in_turn(ran, (), budget=1.0) == ["b::two", "a::quick", "b::one"]
