"""Tables of one run, or of one orbit: events, impacts, crossings of the section, samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from mems_impact.hybrid.trajectory import Events, Floats, Samples
from mems_impact.tables.common import (
    Labels,
    event_codes,
    event_words,
    is_shown,
    states,
    table,
    when,
    words,
)

__all__ = [
    "corners",
    "events",
    "handovers",
    "impacts",
    "samples",
    "section",
    "segments",
    "statistics",
    "verification",
]


def events(
    log: Events, period: float, labels: Labels, observed: Mapping[str, Floats]
) -> pd.DataFrame:
    """Return one row a transition.

    Columns: when, what happened, the modes before and after, the state after, and `observed`.
    """
    automaton, shown = labels.automaton, is_shown(log)
    log = log[shown]
    columns = {
        **when(log.cycle, log.time, period, labels),
        "event": words(event_words(automaton)[:-1], event_codes(log, automaton)),
        "mode before": words(automaton.modes, log.mode_before),
        "mode after": words(automaton.modes, log.mode_after),
        **states(automaton.states, log.after),
        **{name: values[shown] for name, values in observed.items()},
    }
    return table(columns, labels)


def corners(log: Events, period: float, labels: Labels) -> pd.DataFrame:
    """Return one row a transition: when, event, modes, impact, the states before and after."""
    automaton = labels.automaton
    log = log[is_shown(log)]
    before, after = (states(automaton.states, y) for y in (log.before, log.after))
    columns: dict[str, Any] = {
        **when(log.cycle, log.time, period, labels),
        "event": words(event_words(automaton)[:-1], event_codes(log, automaton)),
        "mode before": words(automaton.modes, log.mode_before),
        "mode after": words(automaton.modes, log.mode_after),
        "impact": log.impacts(automaton),
    }
    for name in automaton.states:
        columns[f"{name} before"], columns[f"{name} after"] = before[name], after[name]
    return table(columns, labels)


def impacts(
    hits: Events, period: float, labels: Labels, observed: Mapping[str, Floats]
) -> pd.DataFrame:
    """Return one row an impact: when, phase, which guard, states before and after, `observed`."""
    automaton = labels.automaton
    before, after = (states(automaton.states, y) for y in (hits.before, hits.after))
    columns: dict[str, Any] = {
        **when(hits.cycle, hits.time, period, labels),
        **({"phase": hits.time / period} if labels.forced else {}),
        "event": words([guard.name for guard in automaton.guards], hits.guard),
    }
    for name in automaton.states:
        columns[f"{name} before"], columns[f"{name} after"] = before[name], after[name]
    return table({**columns, **observed}, labels)


def section(log: Events, period: float, labels: Labels) -> pd.DataFrame:
    """Return one row a crossing of the Poincaré section: when, the state, the direction."""
    columns = {
        **when(log.cycle, log.time, period, labels),
        **states(labels.automaton.states, log.after),
        "direction": log.guard,
    }
    return table(columns, labels)


def handovers(log: Events, period: float, labels: Labels) -> pd.DataFrame:
    """Return one row a change of method: when, the mode, the method from then on."""
    columns = {
        **when(log.cycle, log.time, period, labels),
        "mode": words(labels.automaton.modes, log.mode_after),
        "method": words(("dop853", "bdf"), (log.guard < 0).astype(np.int64)),
    }
    return table(columns, labels)


def samples(grid: Samples, period: float, labels: Labels) -> pd.DataFrame:
    """Return one row a sample: when, the state, the mode."""
    columns = {
        **when(grid.cycle, grid.time, period, labels),
        **states(labels.automaton.states, grid.y),
        "mode": words(labels.automaton.modes, grid.mode),
    }
    return table(columns, labels)


def segments(
    period: Sequence[int],
    mode: Sequence[int],
    start: Floats,
    end: Floats,
    ends: Sequence[str],
    labels: Labels,
) -> pd.DataFrame:
    """Return one row a stretch of an orbit: its period, mode, start, end and what ends it."""
    columns = {
        "period": np.asarray(period, dtype=np.int64),
        "mode": words(labels.automaton.modes, np.asarray(mode, dtype=np.int64)),
        "start": start,
        "end": end,
        "ends with": list(ends),
    }
    return table(columns, labels)


def statistics(values: Mapping[str, float], labels: Labels) -> pd.Series:
    """Return one number a row, in the order given."""
    wide = table({name: np.array([value]) for name, value in values.items()}, labels)
    result = wide.iloc[0].astype(float).rename("statistics")
    result.attrs = wide.attrs
    return result


def verification(
    matched: Sequence[tuple[int, Floats]],
    alone: Sequence[int],
    differences: Sequence[str],
    labels: Labels,
) -> pd.DataFrame:
    """Return one row a kind of event in two runs: how often, and the largest differences.

    Parameters
    ----------
    matched : sequence of tuple
        Of every event that both have: its place in `event_words`, and the `differences`.
    alone : sequence of int
        Of every event that only one has: its place in `event_words`.
    differences : sequence of str
        Their headings.
    labels : Labels
    """
    names = event_words(labels.automaton)
    codes = np.array([code for code, _ in matched], dtype=np.int64)
    values = np.array([found for _, found in matched]).reshape(-1, len(differences))
    kinds = np.union1d(codes, np.array(alone, dtype=np.int64))
    # A NaN is no difference, of what has no impact speed; all NaN stay so.
    largest = np.array([np.fmax.reduce(values[codes == kind], initial=np.nan) for kind in kinds])
    columns = {
        "event": [names[kind] for kind in kinds],
        "matched": [int((codes == kind).sum()) for kind in kinds],
        "in one run only": [alone.count(kind) for kind in kinds],
        **dict(zip(differences, largest.reshape(-1, len(differences)).T, strict=True)),
    }
    return table(columns, labels)
