"""The options that commands share, and what is made of them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from mems_impact.engines.options import ENGINES, METHODS, Options

if TYPE_CHECKING:
    from mems_impact.actuator.parameters import Actuator

Decorator = Callable[[Any], Any]


def combined(*decorators: Decorator) -> Decorator:
    """Return one decorator that applies `decorators`, the first outermost."""

    def decorate(function: Any) -> Any:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return decorate


def assignment(text: str) -> tuple[str, float]:
    """Return name and number of a text such as e=0.7."""
    name, _, number = (part.strip() for part in text.partition("="))
    try:
        value = float(number)
    except ValueError:
        name = ""
    if not name:
        raise click.BadParameter(f"{text!r} must be NAME=NUMBER, such as e=0.7")
    return name, value


def _assignments(
    _ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> dict[str, float]:
    return dict(map(assignment, texts))


device_options = combined(
    click.argument("device"),
    click.option(
        "--set",
        "changes",
        multiple=True,
        metavar="NAME=NUMBER",
        callback=_assignments,
        help="Change a parameter of the device, such as e=0.7. May be repeated.",
    ),
)

state_options = combined(
    click.option("--x2", type=float, default=0.0, help="Initial position of the block.  [0]"),
    click.option("--v2", type=float, default=0.0, help="Initial velocity of the block.  [0]"),
    click.option("--v1", type=float, default=0.0, help="Initial velocity of the frame.  [0]"),
)


def _integrator(rtol: float, atol: float) -> Decorator:
    return combined(
        click.option(
            "--method",
            type=click.Choice(METHODS),
            default=Options.method,
            help="CVODE's Adams or BDF formulas, or a one-step method of order 8.  "
            f"[{Options.method}]",
        ),
        click.option("--rtol", type=float, default=rtol, help=f"Relative tolerance.  [{rtol:g}]"),
        click.option("--atol", type=float, default=atol, help=f"Absolute tolerance.  [{atol:g}]"),
        click.option(
            "--engine",
            type=click.Choice(ENGINES),
            default=Options.engine,
            help="Compiled, or interpreted (slower).  "
            f"[{Options.engine}: compiled where it is available]",
        ),
    )


integrator_options = _integrator(Options.rtol, Options.atol)
# Those of `mems_impact.analysis.orbit.ORBIT_OPTIONS`, which is slow to import.
orbit_integrator_options = _integrator(1e-11, 1e-13)

guess_options = combined(
    state_options,
    click.option(
        "--transient", type=float, default=300.0,
        help="Forcing periods to run before the orbit is looked for.  [300]",
    ),
    click.option(
        "--periods", type=int, default=1,
        help="Forcing periods after which the orbit closes.  [1]",
    ),
)  # fmt: skip

directory_option = click.option(
    "--output",
    type=click.Path(),
    default="out",
    metavar="DIR",
    help="Where tables and figure go; created if need be.  [./out]",
)


def _wanted(_ctx: click.Context, _parameter: click.Parameter, asked: bool | None) -> bool:
    # A log would take hundreds of updates of a bar.
    return _is_terminal() if asked is None else asked


def _is_terminal() -> bool:
    """Return whether somebody may be watching standard error, which may be closed."""
    return sys.stderr is not None and sys.stderr.isatty()


progress_option = click.option(
    "--progress/--no-progress",
    default=None,
    callback=_wanted,
    help="Say how far the work is.  [if standard error is a terminal]",
)

output_options = combined(
    directory_option,
    click.option(
        "--figure",
        type=click.Path(dir_okay=False),
        metavar="FILE",
        help="Where the figure goes: .png, .pdf or .svg.  [a PNG in DIR]",
    ),
    click.option("--no-figure", is_flag=True, help="Draw no figure."),
)


def actuator_from(device: str, changes: dict[str, float]) -> Actuator:
    """Load the device and apply what ``--set`` changes."""
    from mems_impact.actuator.parameters import load_actuator

    actuator = load_actuator(device)
    return actuator.replace(**changes) if changes else actuator
