"""Which tests could notice a mutant: those that ran its line, seen once of the right source."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from validation.mutation.mutants import ROOMS

QUICK = 0.5  # seconds; else tests of a file stay together, since they may share what they make


@dataclass(frozen=True)
class Watched:
    """What was seen of the tests of the right source.

    Attributes
    ----------
    seconds : dict of str to float
        Of each test that passes.
    left_out : list of str
        Tests that do not, or take too long.
    lines : dict
        By path and line, the tests that ran it, interpreted.
    """

    seconds: dict[str, float]
    left_out: list[str]
    lines: dict[str, dict[int, list[str]]]

    @classmethod
    def read(cls, places: list[Path]) -> Watched:
        """Read what was seen of each file; of one that could not be run there is nothing."""
        watched = cls({}, [], {})
        for place in places:
            if not place.exists():
                watched.left_out.append(place.stem)
                continue
            told = json.loads(place.read_text(encoding="utf-8"))
            watched.seconds.update(told["seconds"])
            watched.left_out.extend(told["left_out"])
            for path, lines in told["lines"].items():
                of_path = watched.lines.setdefault(path, {})
                for line, tests in lines.items():
                    of_path.setdefault(int(line), []).extend(tests)
        return watched

    def running(self, places: set[tuple[str, int]]) -> set[str]:
        """Return the tests that ran one of these lines."""
        return {test for path, line in places for test in self.lines.get(path, {}).get(line, ())}

    def limits(self, patience: float, beside: float) -> dict[str, float]:
        """Return how long a test of each file may take.

        What the tests of a file share is made by the first of them, so the slowest one counts.
        """
        slowest: dict[str, float] = {}
        for test, taken in self.seconds.items():
            slowest[_file(test)] = max(slowest.get(_file(test), 0.0), taken)
        return {file: patience * taken + beside for file, taken in slowest.items()}

    def in_turn(self, ran: set[str], files: tuple[str, ...], budget: float) -> list[str]:
        """Return tests to try, in their order, that take no longer than `budget` seconds.

        At first those that `ran` the line, then what else stands in their files, then the rest of
        `files`: compiled code runs unseen, and what several tests share is run by one of them. The
        quick ones come first among each.
        """
        theirs = {_file(test) for test in ran}
        beside = {test for test in self.seconds if _file(test) in theirs} - ran
        rest = {test for test in self.seconds if test.startswith(files)} - ran - beside
        chosen: list[str] = []
        spent = 0.0
        for tests in (ran, beside, rest):
            quick = {test for test in tests if self.seconds[test] < QUICK}
            for some in (quick, tests - quick):
                for test in self._by_file(some):
                    if not chosen or spent + self.seconds[test] <= budget:
                        spent += self.seconds[test]
                        chosen.append(test)
        return chosen

    def _by_file(self, tests: set[str]) -> list[str]:
        """Return tests in the order of their files' mean time, as they stand in there."""
        of: dict[str, list[str]] = {}
        for test in self.seconds:
            if test in tests:
                of.setdefault(_file(test), []).append(test)
        mean = {file: sum(self.seconds[t] for t in some) / len(some) for file, some in of.items()}
        return [test for file in sorted(of, key=lambda file: mean[file]) for test in of[file]]


def _file(test: str) -> str:
    return test.partition("::")[0]


def where_seen(root: Path, path: str, line: int) -> set[tuple[str, int]]:
    """Return path and line of what runs if the code at `line` of `path` does.

    The statement's lines. What stands outside of functions runs on import: of a default all lines
    of its function, of names that are given values the lines that use them.
    """
    tree = ast.parse((root / path).read_text(encoding="utf-8"))
    statement, inside = _statement(tree, line)
    if isinstance(statement, ast.FunctionDef):
        return {(path, each) for each in _lines(statement)}
    if inside:
        body = getattr(statement, "body", None)
        return {(path, each) for each in _lines(statement, body[0] if body else None)}
    names = {
        node.id
        for node in ast.walk(statement)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    return {place for name, place in _uses(root) if name in names}


@cache
def _uses(root: Path) -> list[tuple[str, tuple[str, int]]]:
    """Return every name that the rooms use, and where."""
    uses = []
    for room in ROOMS:
        for file in sorted((root / "mems_impact" / room).rglob("*.py")):
            path = file.relative_to(root).as_posix()
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                match node:
                    case ast.Name(id=name) | ast.Attribute(attr=name):
                        uses.append((name, (path, node.lineno)))
    return uses


def _statement(tree: ast.Module, line: int) -> tuple[ast.stmt, bool]:
    """Return the innermost statement at a line, and whether it is inside of a function."""
    found: tuple[ast.stmt, bool] | None = None
    for node, inside in _statements(tree, False):
        if node.lineno <= line <= (node.end_lineno or node.lineno):
            found = node, inside  # those inside of others come later
    assert found is not None
    return found


def _statements(node: ast.AST, inside: bool) -> Iterator[tuple[ast.stmt, bool]]:
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt):
            yield child, inside
        yield from _statements(child, inside or isinstance(child, ast.FunctionDef))


def _lines(statement: ast.stmt, before: ast.stmt | None = None) -> range:
    """Return the lines of a statement, or those of it that stand before another."""
    last = before.lineno - 1 if before else statement.end_lineno or statement.lineno
    return range(statement.lineno, max(last, statement.lineno) + 1)
