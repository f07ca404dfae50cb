"""Tests of BifurcationKit: special points of equilibria, and points of codimension two."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path

import mems_impact as mi
from validation.outside.case import Case, Suite

__all__ = ["SUITE"]

FOLDER = "test/hopf_codim_2"
DIGITS = 1.5e-8  # relative, of a test that names no tolerance


def carbon_monoxide() -> mi.System:
    """The oxidation of carbon monoxide."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        z = 1.0 - y.x - y.y - y.s
        return (
            5.0 * z**2 - 2.0 * y.x**2 - 10.0 * y.x * y.y,
            p.q2 * z - 0.1 * y.y - 10.0 * y.x * y.y,
            0.0675 * (z - p.k * y.s),
        )

    return mi.System(
        states=("x", "y", "s"),
        flow=flow,
        parameters={"q2": 1.0, "k": 0.4},
        initial={"x": 0.106, "y": 0.176, "s": 0.513},
    )


def lorenz84() -> mi.System:
    """Lorenz's model of the atmosphere, with a fourth state."""

    def flow(mode, t, y, p):  # type: ignore[no-untyped-def]
        return (
            -(y.Y**2) - y.Z**2 - 0.25 * y.X + 0.25 * p.F - 0.987 * y.U**2,
            y.X * y.Y - y.X * y.Z - y.Y + 0.25,
            y.X * y.Y + y.X * y.Z - y.Z,
            -1.04 * y.U + 0.987 * y.U * y.X + p.T,
        )

    return mi.System(
        states=("X", "Y", "Z", "U"),
        flow=flow,
        parameters={"F": 3.0, "T": 0.04},
        initial={"X": 2.9787, "Y": -0.03868, "Z": 0.05823, "U": -0.02105},
    )


Points = tuple[int, list[dict[str, float]]]  # the number of the first, and their values


@cache
def oxidation_points() -> dict[str, Points]:
    """Return the points of the branch, of the curve of folds and of that of Hopf points."""
    start = mi.find_equilibria(carbon_monoxide())[0]
    branch = mi.continue_solution(start, "q2", stop=2.3, back=0.5)
    hopf, fold, *_ = branch.special_points
    curves = [
        mi.continue_curve(fold, "k", stop=2.2),
        mi.continue_curve(fold, "k", stop=0.01, back=2.2),
        mi.continue_curve(hopf, "k", stop=0.01),
    ]
    beyond, folds, hopfs = (
        [
            {"param": each["k"], "printsol.k": each["k"], "printsol.q2": each["q2"]}
            for each in (point.values for point in curve.special_points)
        ]
        for curve in curves
    )
    on_branch = [{"param": point.value} for point in branch.special_points]
    return {"br": (2, on_branch), "sn_codim2": (2, beyond + folds), "hp_codim2": (3, hopfs)}


@cache
def lorenz84_points() -> dict[str, Points]:
    """Return the points of the curve of folds, and where two pairs are on the axis."""
    start = mi.find_equilibria(lorenz84())[0]
    branch = mi.continue_solution(start, "F", stop=-1.5, back=3.0)
    fold, *_, hopf = branch.special_points
    folds, hopfs = (mi.continue_curve(each, "T", stop=-0.1, back=0.2) for each in (fold, hopf))
    double = [point for point in hopfs.special_points if point.kind == "Hopf-Hopf"]
    return {
        "br": (2, [{"param": point.value} for point in reversed(branch.special_points)]),
        "sn_codim2_test": (1, [{"param": point.values["T"]} for point in folds.special_points]),
        "hp_codim2_test": (2, [{"param": point.values["T"]} for point in double]),
    }


# --- Cases

TESTS = {"COModel": oxidation_points, "lorenz84": lorenz84_points}
ASSERTION = re.compile(
    r"@test (?:prod\()?(\w+)\.specialpoint\[(\d)\]\.(param|printsol\.\w+|interval) *\.?≈ "
    r"\(?([-+\d.]+)(?:, ([\d.]+)\))?(?: *(atol|rtol) = (\S+))?"
)


def cases(folder: Path) -> Iterator[Case]:
    """Yield the cases: an assertion each; of an interval its middle, within half its width."""
    for name, points in TESTS.items():
        for match in ASSERTION.finditer((folder / FOLDER / f"{name}.jl").read_text()):
            branch, number, quantity, first, last, kind, size = match.groups()
            low, high = float(first), float(last or first)
            quantity = "param" if quantity == "interval" else quantity
            yield Case(
                name=f"{name} {branch} {number} {quantity}",
                group="equilibria" if branch == "br" else "codimension two",
                values=partial(value, points, branch, int(number), quantity),
                reference=0.5 * (low + high),
                absolute=float(size) if kind == "atol" else 0.5 * (high - low) + 1e-15,
                relative=0.0 if kind == "atol" else float(size or DIGITS),
            )


def value(points: Callable[[], dict[str, Points]], branch: str, number: int, name: str) -> float:
    """Return a value of a special point."""
    first, found = points()[branch]
    return found[number - first][name]


SUITE = Suite(
    repository="https://github.com/bifurcationkit/BifurcationKit.jl",
    licence="MIT",
    files=FOLDER,
    cases=cases,
)
