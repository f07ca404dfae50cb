"""`mems-impact devices`: the preset devices of the package."""

from __future__ import annotations

from typing import Any

import click

from mems_impact.cli.output import add_json_tables, filled, show


@click.command(short_help="List the devices of the package.")
def command() -> None:
    """List the preset devices with their parameters and terms.

    \b
    Example:
      mems-impact devices
    """  # noqa: D301 - click looks for the backspace itself
    import pandas as pd

    from mems_impact.actuator.device_files import load_actuator, preset_names
    from mems_impact.actuator.parameters import PARAMETER_NAMES
    from mems_impact.actuator.units import PARAMETER_UNITS

    rows: list[tuple[str, str, Any, str]] = []
    for name in preset_names():
        actuator = load_actuator(name)
        in_units = actuator.scales.named
        units = PARAMETER_UNITS if in_units else {}
        quantities = [(key, getattr(actuator, key), units.get(key, "")) for key in PARAMETER_NAMES]
        for term in actuator.terms:
            of_term = term.units if in_units else {}
            quantities += [
                (f"{term.name()}.{key}", value, of_term.get(key, ""))
                for key, value in dict(term).items()
            ]
        values = [f"{key} = {_text(value)} {unit}".rstrip() for key, value, unit in quantities]
        show(filled(f"{name}: {', '.join(values)}"))
        rows += [(name, *each) for each in quantities]
    add_json_tables(
        {"devices": pd.DataFrame(rows, columns=["device", "parameter", "value", "unit"])}
    )


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return f"{len(value)} values from {value[0]:g} to {value[-1]:g}"
    return f"{value:g}" if isinstance(value, float) else str(value)
