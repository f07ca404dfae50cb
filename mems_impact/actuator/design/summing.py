"""Works and losses, summed up along the arcs of a run or an orbit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator import equations as eq
from mems_impact.actuator.accounting import SUMMED, Accounts, accounted_automaton, accounts
from mems_impact.actuator.composed import voltages
from mems_impact.actuator.composing import SCRATCH
from mems_impact.actuator.design.arcs import Leg
from mems_impact.actuator.parameters import PARAMETER_NAMES
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.engines.options import Options
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.run import run as integrate
from mems_impact.hybrid.trajectory import Floats, Instant

__all__ = ["Sums", "accounted_problem", "accounts_of", "summed"]

IMPACTS = "impacts"
HAIR = 1e-12  # of a period: nothing is cut off a stretch that is shorter


@dataclass(frozen=True, kw_only=True)
class Sums:
    """What is lost and stored where an arc begins or ends; in the units of the numerics.

    Attributes
    ----------
    columns : tuple of str
        Of `sums`: "lost ..." and "stored ...".
    place : float array, shape (k,)
        Where, in forcing periods, ascending; twice where an impact is.
    work : float array, shape (k,)
        Of the electrodes on the block since the beginning.
    slip : float array, shape (k,)
        The path on which the frame has slipped since the beginning, to and fro.
    sums : float array, shape (k, columns)
        What was lost since the beginning, and what is stored.
    marks : mapping of str to int array
        Rows at which a period begins ("period") or a blow ("blow").
    """

    columns: tuple[str, ...]
    place: Floats
    work: Floats
    slip: Floats
    sums: Floats
    marks: Mapping[str, NDArray[np.int64]]


def accounts_of(system: ActuatorSystem) -> Accounts:
    """Return the stores and losses of a system."""
    kinds = tuple(term.kind for term in system.actuator.terms)
    return accounts(kinds, 1 if system.drive.left_voltage is None else 2)


def accounted_problem(system: ActuatorSystem, options: Options) -> Problem:
    """Return the problem of single arcs, with works and losses among the states.

    Interpreted: thousands of arcs take less time than to compile what follows them. By the one-step
    method in place of Adams, which takes several times as long to get under way on so short arcs.
    """
    problem = system.problem(replace(options, engine="interpreted"))
    if problem.options.method == "adams":
        problem = replace(problem, options=replace(problem.options, method="dop853"))
    drive, kinds = system.drive, tuple(term.kind for term in system.actuator.terms)
    automaton = accounted_automaton(
        kinds, drive.voltage, drive.voltage_rate, drive.left_voltage, drive.left_rate,
        not system.told_by_numbers,
    )  # fmt: skip
    p = problem.parameters
    if not kinds:  # the paper's equations need no scratch, those with terms do
        first = len(PARAMETER_NAMES)
        p = np.concatenate([p[:first], np.zeros(SCRATCH * len(system.states)), p[first:]])
    return replace(problem, automaton=automaton, parameters=p, section=None)


class Rows:
    """What is noted while arcs are followed."""

    def __init__(self, system: ActuatorSystem, problem: Problem) -> None:
        own, drive = accounts_of(system), system.drive
        self.problem, self.n = problem, len(system.states)
        self.stored = tuple(own.stored.values())
        first = problem.parameters.size - drive.parameters().size
        self.volts = voltages(drive.voltage, drive.left_voltage, first)
        losses = (*SUMMED[2:], *own.lost, IMPACTS)
        self.columns = tuple(
            [f"lost {name}" for name in losses] + [f"stored {name}" for name in own.stored]
        )
        self.place: list[float] = []
        self.work: list[float] = []
        self.slip: list[float] = []
        self.sums: list[list[float]] = []
        self.summed = np.zeros(2 + len(losses))  # work of the electrodes and path first

    def note(self, now: Instant) -> int:
        """Note what was summed up, and what is stored now; return the number of the row."""
        p = self.problem.parameters
        v, w = self.volts(now.time, p)
        work, slip, *lost = self.summed.tolist()
        self.place.append(now.cycle + now.time / self.problem.period)
        self.work.append(work)
        self.slip.append(slip)
        self.sums.append([*lost, *(float(energy(v, w, now.y, p)) for energy in self.stored)])
        return len(self.place) - 1

    def follow(self, now: Instant, length: float, *, summing: bool) -> Floats:
        """Follow an arc over `length`; return the state there."""
        y = np.concatenate([now.y, np.zeros(self.summed.size - 1)])
        done = integrate(self.problem, replace(now, y=y), length / self.problem.period).final.y
        if summing:
            self.summed[:-1] += done[self.n :]
        return done[: self.n]


def summed(
    system: ActuatorSystem,
    options: Options,
    arcs: Iterator[Leg],
    window: tuple[float, float],
    blows: set[int],
) -> Sums:
    """Follow arcs, each from where it began, and note what was summed up where one ends.

    Parameters
    ----------
    system : ActuatorSystem
    options : Options
        By which arcs are integrated.
    arcs : iterator of Leg
    window : tuple of float
        Forcing periods between which works and losses count.
    blows : set of int
        Rows of the event log with which blows begin.
    """
    low, high = window
    problem = accounted_problem(system, options)
    rows, period = Rows(system, problem), problem.period
    device = system.inner_actuator
    marks: dict[str, list[int]] = {"period": [], "blow": []}
    for arc in arcs:
        y, inside = arc.begin.y, False
        for begin, end in pairwise(_cuts(arc, low, high, period)):
            whole = math.floor(begin + HAIR)
            now = replace(
                arc.begin,
                cycle=arc.begin.cycle + whole,
                time=max(0.0, (begin - whole) * period),
                y=y,
            )
            inside = low - HAIR <= now.cycle + now.time / period < high - HAIR
            if inside:
                row = rows.note(now)
                if now.time < HAIR * period:
                    marks["period"].append(row)
            y = rows.follow(now, (end - begin) * period, summing=inside)
            if inside:
                rows.note(replace(now, time=now.time + (end - begin) * period, y=y))
        ended = arc.begin.cycle + (arc.begin.time + arc.length) / period
        if inside and arc.row >= 0 and ended < high - HAIR:
            rows.summed[-1] += eq.impact_loss(device.m1, device.m2, *arc.v2)
            if arc.row in blows:
                marks["blow"].append(len(rows.place) - 1)
    end = len(rows.place) - 1
    if abs(rows.place[end] - round(rows.place[end])) < HAIR:
        marks["period"].append(end)
    return Sums(
        columns=rows.columns,
        place=np.array(rows.place),
        work=np.array(rows.work),
        slip=np.array(rows.slip),
        sums=np.array(rows.sums),
        marks={name: np.array(each, dtype=np.int64) for name, each in marks.items()},
    )


def _cuts(arc: Leg, low: float, high: float, period: float) -> list[float]:
    """Return where an arc is cut, in periods since that in which it begins: where periods begin."""
    first = arc.begin.time / period
    last = first + arc.length / period
    inner = [
        *range(math.ceil(first), math.ceil(last)),
        low - arc.begin.cycle,
        high - arc.begin.cycle,
    ]
    cuts = [first]
    for cut in sorted(inner):
        if cuts[-1] + HAIR < cut < last - HAIR:
            cuts.append(float(cut))
    return [*cuts, last] if last > first else cuts
