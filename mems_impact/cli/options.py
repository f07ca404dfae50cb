"""The options that commands share, and what is made of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

import click
from click.shell_completion import CompletionItem

from mems_impact.cli.everywhere import quiet
from mems_impact.engines.options import ENGINES, METHODS, Options

if TYPE_CHECKING:
    from mems_impact.actuator.parameters import Actuator
    from mems_impact.analysis.state import State

Decorator = Callable[[Any], Any]

# Of modules that are slow to import: `mems_impact.studies.words`, `mems_impact.analysis.attractor`.
EXECUTORS = ("threads", "processes")
SAMPLINGS = ("sobol", "lhs", "random")
EXPONENTS = ("unsettled", "all", "none")


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


def _tolerances(
    _ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> dict[str, float | str]:
    """Return tolerances by name; those in per cent as they stand."""
    found: dict[str, float | str] = {}
    for text in texts:
        name, _, given = (part.strip() for part in text.partition("="))
        found |= {name: given} if name and given.endswith("%") else dict([assignment(text)])
    return found


def _devices(_ctx: click.Context, _parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Return what a shell offers for DEVICE: the presets, and files."""
    from mems_impact.actuator.parameters import preset_names

    names = [CompletionItem(name) for name in preset_names() if name.startswith(begun)]
    return [*names, CompletionItem(begun, type="file")]


def device_argument(**settings: Any) -> Decorator:
    """Return the argument of what a command is about."""
    return click.argument("device", shell_complete=_devices, **settings)


changes_option = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="NAME=NUMBER",
    callback=_assignments,
    help="Change a parameter of the device, such as e=0.7, or of a term, such as "
    "tilt.angle=0.1, which is added if need be. May be repeated.",
)

device_options = combined(device_argument(), changes_option)

Initial = dict[str, float] | Literal["kicked"]
KICKED: Literal["kicked"] = "kicked"


def _initial(ctx: click.Context, parameter: click.Parameter, texts: tuple[str, ...]) -> Initial:
    return KICKED if texts == (KICKED,) else _assignments(ctx, parameter, texts)


initial_option = click.option(
    "--initial",
    multiple=True,
    metavar="NAME=NUMBER",
    callback=_initial,
    help="A component of the initial state, such as x2=0.1: x1, x2 [m], v1, v2 [m/s], or time [s] "
    "since the forcing period began. May be repeated. Or kicked: the block passes the middle fast "
    "enough to strike a stopper.",
    show_default="0 each",
)

parameter_option = click.option(
    "--parameter",
    required=True,
    metavar="NAME",
    help="What to vary: a parameter of drive or device, or of a term, such as tilt.angle.",
)


tolerance_option = click.option(
    "--tolerance",
    "tolerances",
    multiple=True,
    metavar="NAME=NUMBER[%]",
    callback=_tolerances,
    help="Standard deviation of a parameter, such as delta=0.005, or delta=2% of its value. May be "
    "repeated.",
)


def range_options(start: str, stop: str, defaults: tuple[str, str] | None = None) -> Decorator:
    """Return the options of where a varied parameter starts and stops.

    Parameters
    ----------
    start, stop : str
        Their help texts.
    defaults : tuple of str, optional
        What the command takes for each that is not given, in words; without, both are required.
    """
    words = defaults or (None, None)
    return combined(
        *(
            click.option(
                option, type=float, required=defaults is None, show_default=default, help=text
            )
            for option, text, default in zip(
                ("--start", "--stop"), (start, stop), words, strict=True
            )
        )
    )


def periods_option(text: str, default: float, kind: type = int) -> Decorator:
    """Return the option of how many forcing periods a command's work takes."""
    return click.option("--periods", type=kind, default=default, show_default=True, help=text)


def transient_option(text: str, default: float, kind: type = int) -> Decorator:
    """Return the option of how many forcing periods pass before a command looks."""
    return click.option("--transient", type=kind, default=default, show_default=True, help=text)


def workers_option(text: str, **settings: Any) -> Decorator:
    """Return the option of how much is done at once."""
    settings = {"show_default": True, **settings}
    return click.option("--workers", type=click.IntRange(1, 64), help=text, **settings)


SUITED = "adams; auto with a term that may be stiff"


def _integrator(method: str | None, rtol: float, atol: float) -> Decorator:
    return combined(
        click.option(
            "--method",
            type=click.Choice(METHODS),
            default=method,
            show_default=method or SUITED,
            help="CVODE's Adams or BDF formulas, or a one-step method of order 8; auto: that one, "
            "and BDF wherever the system is stiff.",
        ),
        click.option(
            "--rtol", type=float, default=rtol, show_default=True, help="Relative tolerance."
        ),
        click.option(
            "--atol",
            type=float,
            default=atol,
            show_default=True,
            help="Absolute tolerance, of the dimensionless state.",
        ),
        click.option(
            "--engine",
            type=click.Choice(ENGINES),
            default=Options.engine,
            show_default=True,
            help="Compiled, or interpreted (slower); auto: compiled where it is available.",
        ),
    )


AXIS = click.Tuple([str, float, float, click.IntRange(1, 1_000_000)])


def axis_options(first: str, second: str) -> Decorator:
    """Return the options of what a study is over, with these help texts."""
    return combined(
        *(
            click.option(option, type=AXIS, metavar="NAME START STOP POINTS", help=text)
            for option, text in (("--x", first), ("--y", second))
        )
    )


def sample_options(samples: int, sampling: str) -> Decorator:
    """Return the options of how a study draws its points, with these defaults."""
    return combined(
        click.option(
            "--samples", type=int, default=samples, show_default=True, help="How many are drawn."
        ),
        click.option(
            "--sampling",
            type=click.Choice(SAMPLINGS),
            default=sampling,
            show_default=True,
            help="How: Sobol's sequence, a Latin hypercube, or independent of each other.",
        ),
        click.option("--seed", type=int, default=0, show_default=True, help="Of what is drawn."),
    )


settle_options = combined(
    transient_option("Forcing periods in which a motion may become periodic.", 300),
    periods_option("Forcing periods over which it is measured then, if it has not.", 100),
    click.option(
        "--longest",
        type=int,
        default=16,
        show_default=True,
        help="Forcing periods after which a motion may repeat itself, at most.",
    ),
    click.option(
        "--settle-tolerance",  # --tolerance is that of a parameter
        "tolerance",
        type=float,
        default=1e-6,
        show_default=True,
        help="To which it has to, relative to the size of each state.",
    ),
    click.option(
        "--exponents",
        type=click.Choice(EXPONENTS),
        default=EXPONENTS[0],
        show_default=True,
        help="Of which motions the largest Lyapunov exponent is computed; it tells chaotic from "
        "quasi-periodic ones.",
    ),
    click.option(
        "--lasting",
        type=float,
        default=16.0,
        show_default=True,
        help="Times --transient and --periods after which a chaotic motion has to be so still.",
    ),
)

study_options = combined(
    click.option(
        "--store",
        type=click.Path(),
        metavar="DIR",
        help="Keep points there as they are done; the same command goes on from them.",
    ),
    click.option(
        "--executor",
        type=click.Choice(EXECUTORS),
        show_default=EXECUTORS[0],
        help="What computes: threads, or processes of their own.",
    ),
    workers_option("How many of them.", show_default="as many as there are cores"),
)

integrator_options = _integrator(Options.method, Options.rtol, Options.atol)
# Those of `mems_impact.analysis.finding` and `attractor`, which are slow to import.
orbit_integrator_options = _integrator("auto", 1e-11, 1e-13)
study_integrator_options = _integrator("auto", Options.rtol, Options.atol)


guess_options = combined(
    initial_option,
    transient_option("Forcing periods to run before the orbit is looked for.", 300, float),
    click.option(
        "--periods",
        type=int,
        default=None,
        help="Forcing periods after which the orbit closes; recognised by default.",
    ),
)


def directory_options(default: str, text: str) -> Decorator:
    """Return the option of the directory that a command writes to."""
    return click.option(
        "--output",
        type=click.Path(),
        default=default,
        show_default=True,
        metavar="DIR",
        help=f"{text}; created if need be.",
    )


directory_option = directory_options("out", "Where tables and figure go")


def _wanted(_ctx: click.Context, _parameter: click.Parameter, asked: bool | None) -> bool:
    return not quiet() if asked is None else asked


progress_option = click.option(
    "--progress/--no-progress",
    default=None,
    callback=_wanted,
    show_default="progress, unless --quiet",
    help="Say how far the work is: on a terminal a bar, elsewhere a line now and then.",
)

output_options = combined(
    directory_option,
    click.option(
        "--figure",
        type=click.Path(dir_okay=False),
        metavar="FILE",
        show_default="a PNG in DIR",
        help="Where the figure goes: .png, .pdf or .svg.",
    ),
    click.option("--no-figure", is_flag=True, help="Draw no figure."),
)


def actuator_from(device: str, changes: dict[str, float]) -> Actuator:
    """Load the device and apply what ``--set`` changes."""
    from mems_impact.actuator.parameters import load_actuator

    refuse_system(device)
    actuator = load_actuator(device)
    return actuator.setting(changes)


def refuse_system(device: str) -> None:
    """Refuse the name of a system where a device is wanted, and Python code without a name."""
    from pathlib import Path

    from mems_impact.actuator.own_system import is_system_name

    if device.endswith(".py"):
        problem = "Python code; name the system in it, such as"
        raise click.UsageError(f"{device}: {problem} {device}:oscillator")
    if is_system_name(device) and not Path(device).exists():
        raise click.UsageError(
            f"{device}: a system, where this command takes a device; simulate and explore take "
            "systems, map, basins and scatter those of a study file, and Python's verbs any"
        )


def state_from(initial: Initial, actuator: Actuator) -> State:
    """Return the state that ``--initial`` describes."""
    from mems_impact.actuator.modes import STATES
    from mems_impact.actuator.system import kicked
    from mems_impact.analysis.state import state_from as state_of

    if initial == KICKED:
        return kicked(actuator)
    assert isinstance(initial, dict)
    for name in initial:
        if name not in (*STATES, "time"):
            raise click.UsageError(f"--initial {name}: must be one of {', '.join(STATES)}, time")
    components = {name: value for name, value in initial.items() if name != "time"}
    return state_of(components, time=initial.get("time", 0.0))
