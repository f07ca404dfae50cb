"""`mems-impact terms`: what a model may have beyond the paper's."""

from __future__ import annotations

from typing import Any

import click

from mems_impact.cli.output import show, tell_tables


@click.command(short_help="List the terms that a model may have.")
def command() -> None:
    """List the terms that the model of a device may have beyond the paper's, and their parameters.

    A file of a device has a table for each, such as [tilt] with the line angle = 0.1; --set
    tilt.angle=0.1 adds it to any device. In brackets the unit of a device in SI, and what a
    parameter is if it is not given.
    """
    import pandas as pd

    from mems_impact.actuator.terms.files import term_names, term_type
    from mems_impact.errors import InvalidParameter

    rows: list[tuple[str, str, str, Any]] = []
    for name in term_names():
        try:
            term = term_type(name)
        except InvalidParameter:  # that of another package, which fails
            continue
        said = (term.__doc__ or "").partition("\n")[0].rstrip(".")
        show(f"{name}: {said}")
        for key, field in term.model_fields.items():
            notes = [unit] if (unit := term.units.get(key)) else []
            notes += [] if field.is_required() else [f"{field.default!r} by default"]
            show(f"  {name}.{key}" + (f" [{', '.join(notes)}]" if notes else ""))
            default = None if field.is_required() else field.default
            rows.append((name, key, term.units.get(key, ""), default))
    tell_tables({"terms": pd.DataFrame(rows, columns=["term", "parameter", "unit", "default"])})
