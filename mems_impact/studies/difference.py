"""How two studies differ, in words for one line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from mems_impact.studies.frames import plain
from mems_impact.wording import label, shown

__all__ = ["difference"]

KINDS = ("dict", "list")  # what `storing.coding` says beside parts: not names that users know
_NONE = "nothing"


def difference(there: Mapping[str, Any], here: Mapping[str, Any]) -> str:
    """Return where two descriptions differ, with both values; nothing if they are the same.

    Parameters
    ----------
    there, here : mapping of str to JSON value
        What is stored, and what is wanted.
    """
    there, here = plain(dict(there)), plain(dict(here))
    names = _differing(there, here)
    if not names:
        return ""
    place, its, mine = _first(names[0], there, here)
    more = f" (and {', '.join(map(label, names[1:]))} differ)" if len(names) > 1 else ""
    return f"{place} is {shown(its)} there, {shown(mine)} here{more}"


def _differing(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    names = {**here, **there}
    return [name for name in names if _text(there.get(name)) != _text(here.get(name))]


def _first(name: str, there: Any, here: Any) -> tuple[str, Any, Any]:
    """Return the innermost place at which values differ, within lists and tables."""
    place, its, mine = label(name), there.get(name, _NONE), here.get(name, _NONE)
    while True:
        if isinstance(its, dict) and isinstance(mine, dict):
            inner = _differing(its, mine)[0]
            if inner not in KINDS:
                place = f"{place}.{label(inner)}"
            its, mine = its.get(inner, _NONE), mine.get(inner, _NONE)
        elif isinstance(its, list) and isinstance(mine, list) and len(its) == len(mine):
            i = next(i for i in range(len(its)) if _text(its[i]) != _text(mine[i]))
            place, its, mine = f"{place}[{i}]", its[i], mine[i]
        else:
            return place, its, mine


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)  # nan is nan here
