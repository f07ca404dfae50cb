"""Section 4 of the paper, number by number, beside what is computed; nothing is tuned.

python validation/paper_section4.py [--output DIR] [--brute]

--brute checks the boundaries of Fig. 7 by simulation at a dozen frequencies; it takes minutes.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import pandas as pd

import mems_impact as mi
from mems_impact.actuator.design.chart import crisis

ACTUATOR = mi.load_actuator("zhao2004")
# Figure of the paper: omega, amplitude with a period-one orbit, lowest amplitude, kinds it names.
FIGURES = {
    "Fig. 4": (0.5, 0.24, 0.16, "I", {"G", "CF"}),
    "Fig. 5": (0.485, 0.177, 0.171, "II", {"G", "PD"}),
    "Fig. 6": (0.45, 0.29, 0.22, "III", {"CF", "PD"}),
}
ON_THE_WAY = {
    "Fig. 6": "; G: the unstable orbit without impacts grazes, which brute force does not show",
}


def branches_of(figure: str) -> tuple[mi.Orbit, mi.Branch, mi.Branch]:
    omega, high, low, *_ = FIGURES[figure]
    drive = mi.Sine(amplitude=high, omega=omega)
    orbit = mi.find_orbit(ACTUATOR, drive, guess=mi.kicked(ACTUATOR), transient=300)
    off = mi.find_orbit(ACTUATOR, drive.replace(amplitude=0.1))
    return (
        orbit,
        mi.continue_orbit(orbit, "amplitude", low),
        mi.continue_orbit(off, "amplitude", high),
    )


def special(branch: mi.Branch, label: str, impacts: int | None = None) -> mi.SpecialPoint:
    return next(
        s
        for s in branch.special_points
        if s.label == label and (impacts is None or len(s.orbit.impacts) == impacts)
    )


def compared(folder: Path) -> pd.DataFrame:
    rows: list[tuple[str, str, str, str, str]] = []

    def add(where: str, what: str, paper: object, found: object, why: str = "") -> None:
        difference = ""
        if isinstance(paper, float) and isinstance(found, float):
            difference = f"{found - paper:+.2g}"
        text = f"{found:.10g}" if isinstance(found, float) else str(found)
        rows.append((where, what, str(paper), text, f"{difference} {why}".strip()))

    for figure, (omega, high, low, kind, kinds) in FIGURES.items():
        orbit, branch, off = branches_of(figure)
        stable = "stable" if orbit.stable and orbit.admissible else "not stable"
        count = len(orbit.impacts)
        add(figure, f"orbit at f = {high:g}, omega = {omega:g}", "period one",
            f"period {orbit.periods}, {count} impact, {stable}")  # fmt: skip
        met = {s.label for s in [*branch.special_points, *off.special_points]}
        remark = "all named are there" + ON_THE_WAY.get(figure, "") if kinds <= met else "MISSING"
        found = ", ".join(sorted(met & {"G", "CF", "PD"}))
        add(figure, "bifurcations", ", ".join(sorted(kinds)), found, remark)
        type_found = mi.grazing_type(special(off, "G"))
        add(figure, "type", kind, type_found.paper, str(type_found))
        for s in branch.special_points:
            hits = len(s.orbit.impacts)
            add(figure, f"{s.label} ({s.kind}, {hits} impacts)", "not given", float(s.value))
        doubled = [branch.switch(s) for s in branch.special_points if s.label == "PD"]
        sweep = mi.sweep(
            ACTUATOR, mi.Sine(amplitude=high, omega=omega), "amplitude",
            np.linspace(low, high, 201), direction="both", transient=300, periods=40,
        )  # fmt: skip
        name = figure.replace(". ", "").lower()
        ax = mi.plot_branch([branch, *doubled], sweep=sweep)
        ax.figure.savefig(folder / f"{name}-branches.png", dpi=150)
        branch.table.to_csv(folder / f"{name}-branch.csv", index=False)
        if figure == "Fig. 6":
            fold = special(off, "CF", impacts=0).value
            add(figure, "on: fold of the orbit without impacts", 0.2356, fold, "(4 digits given)")
            value = crisis(
                ACTUATOR, mi.Sine(amplitude=fold, omega=omega), below=fold, begin=fold * 1.001,
                width=0.05, periods=5000,
            )  # fmt: skip
            add(figure, "off: crisis, simulated over 5000 periods", 0.2355, value,
                "rises with the wait, as transients near a crisis are long: 0.23508, 0.23521, "
                "0.23532, 0.23537 for 300, 1000, 3000, 10000 periods; a sweep in steps of 1e-4 "
                "is last on at 0.2353 or 0.2354")  # fmt: skip
    begin = time.perf_counter()
    chart = mi.operating_chart(ACTUATOR, crises=0)
    seconds = time.perf_counter() - begin
    marks = {s.kind: s for s in chart.special_points}
    add("Fig. 7", "omega between types III and II", 0.48, marks["grazing-fold"].values["omega"],
        "(3 digits given)")  # fmt: skip
    degenerate = marks["degenerate grazing"].values
    width = hysteresis(0.489)
    add("Fig. 7", "omega between types II and I", 0.489, degenerate["omega"],
        f"the hysteresis grows from nothing there: at omega = 0.489 it is {width:.1e} wide in f, "
        "one step or two of a sweep")  # fmt: skip
    print(f"Fig. 7 by curves: {seconds:.1f} s (compilation included if it was due)")
    return pd.DataFrame(rows, columns=["figure", "what", "paper", "computed", "difference, remark"])


def hysteresis(omega: float) -> float:
    """Width in f between switching on (G) and off (CF) at one frequency of type I."""
    on, off = boundaries(omega)
    return on - off


def boundaries(omega: float) -> tuple[float, float]:
    """On and off at one frequency, by continuation; NaN for a crisis."""
    orbit = mi.find_orbit(ACTUATOR, mi.Sine(amplitude=0.05, omega=omega))
    branch = mi.continue_orbit(orbit, "amplitude", 0.36)
    first = branch.special_points[0]
    if first.label == "CF":
        return first.value, float("nan")
    if mi.grazing_type(first) == mi.GrazingType.CONTINUOUS:
        return first.value, first.value
    return first.value, special(branch, "CF").value


def brute_on(omega: float, near: float, tolerance: float = 2e-7) -> float:
    """Smallest amplitude at which a slow rise begins to impact; each step is a ramp."""
    low, high = 0.9951 * near, 1.005 * near
    drive = mi.Sine(amplitude=low, omega=omega)
    state = mi.State()
    # Slowly from far below: a start from rest may overshoot and switch on early.
    for amplitude in np.linspace(0.3 * near, low, 60):
        state = mi.simulate(ACTUATOR, drive.replace(amplitude=amplitude), 100, initial=state).final
    while high - low > tolerance:
        middle, here, hit = 0.5 * (low + high), state, False
        for amplitude in np.linspace(low, middle, 12)[1:]:
            run = mi.simulate(ACTUATOR, drive.replace(amplitude=amplitude), 250, initial=here,
                              window=(0, 250), keep="statistics")  # fmt: skip
            here, hit = run.final, hit or run.statistics["impacts"] > 0
        # Where an orbit has just vanished in a fold, a run lingers for long.
        run = mi.simulate(ACTUATOR, drive.replace(amplitude=middle), 4000, initial=here,
                          window=(0, 4000), keep="statistics")  # fmt: skip
        hit = hit or run.statistics["impacts"] > 0
        low, high, state = (low, middle, state) if hit else (middle, high, run.final)
    return high


def by_brute_force() -> pd.DataFrame:
    rows = []
    for omega in np.linspace(0.443, 0.509, 12):
        on, off = boundaries(omega)
        seen = brute_on(omega, on)
        row = {"omega": omega, "on": on, "on, simulated": seen, "off": off}
        if on != off:  # type II: off is the grazing itself
            # Type III: begun at the fold, from above it; type I: just above the fold that ends it.
            below = on if np.isnan(off) else 1.002 * off
            row["off, simulated"] = crisis(
                ACTUATOR, mi.Sine(amplitude=on, omega=omega), below=below,
                begin=on * 1.01, width=0.05, tolerance=5e-7, periods=5000,
            )  # fmt: skip
        rows.append(row)
        print(row, flush=True)
    table = pd.DataFrame(rows)
    table["on: difference"] = table["on, simulated"] - table["on"]
    table["off: difference"] = table["off, simulated"] - table["off"]
    return table


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", default="out")
    parser.add_argument("--brute", action="store_true")
    arguments = parser.parse_args()
    folder = Path(arguments.output)
    folder.mkdir(parents=True, exist_ok=True)
    table = compared(folder)
    table.to_csv(folder / "section4.csv", index=False)
    print(table.to_string(index=False))
    if arguments.brute:
        table = by_brute_force()
        table.to_csv(folder / "section4-brute.csv", index=False)
        print(table.to_string(index=False))


if __name__ == "__main__":
    main()
