"""`mems-impact terms`: optional terms of the device model."""

from __future__ import annotations

from typing import Any

import click

from mems_impact.cli.output import add_json_tables, filled, show


@click.command(short_help="List the optional terms of the device model.")
def command() -> None:
    """List the terms that extend the paper's model of a device, and their parameters.

    \b
    Example:
      mems-impact terms

    A device file has one table per term, such as [tilt] with the line angle = 0.1; --set
    tilt.angle=0.1 adds the term to any device. Brackets hold SI unit and default of a parameter.
    """  # noqa: D301 - click looks for the backspace itself
    import pandas as pd

    from mems_impact.actuator.terms.files import term_names, term_type
    from mems_impact.errors import InvalidParameter

    rows: list[tuple[str, str, str, Any]] = []
    for name in term_names():
        try:
            term = term_type(name)
        except InvalidParameter:  # a term of another package that fails
            continue
        description = (term.__doc__ or "").partition("\n")[0].rstrip(".")
        show(filled(f"{name}: {description}"))
        for key, field in term.model_fields.items():
            notes = [unit] if (unit := term.units.get(key)) else []
            notes += [] if field.is_required() else [f"default {field.default!r}"]
            show(f"  {name}.{key}" + (f" [{', '.join(notes)}]" if notes else ""))
            default = None if field.is_required() else field.default
            rows.append((name, key, term.units.get(key, ""), default))
    add_json_tables({"terms": pd.DataFrame(rows, columns=["term", "parameter", "unit", "default"])})
