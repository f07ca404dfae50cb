"""The warnings of the package: what is computed all the same, and may not be what was wanted."""

from __future__ import annotations

__all__ = [
    "DiscontinuityWarning",
    "EngineFallbackWarning",
    "FitWarning",
    "PluginWarning",
    "ScaleWarning",
    "StartWarning",
    "StiffnessWarning",
    "UnitsWarning",
    "ValidityWarning",
]


class DiscontinuityWarning(UserWarning):
    """The flow of a system jumps where nothing declares it: no step across the jump is accurate.

    See Also
    --------
    System, Guard, Friction, Relay, Surface

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> def flow(mode, t, y, p):
    ...     return y.v, -y.x + (1.0 if t % 3.0 < 1.0 else -1.0)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     system = mi.System(states=("x", "v"), flow=flow, period=3.0)
    >>> "at t = 1, where no step is accurate" in str(caught[0].message)
    True
    """


class EngineFallbackWarning(UserWarning):
    """The engine that was asked for is unavailable, and a slower one does its work.

    See Also
    --------
    EngineUnavailable, Options

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", mi.EngineFallbackWarning)  # rather fail than be slow
    ...     run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), 10)
    """


class FitWarning(UserWarning):
    """A fit does not reach what was measured, or the data do not determine what was fitted.

    See Also
    --------
    fit, Fit

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> pull_in = mi.Target(quantity="pull-in voltage", value=35)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     found = mi.fit(mita, [pull_in], free=["k", "alpha"])  # one number, two parameters
    >>> found.verdict, [warning.category.__name__ for warning in caught]
    ('undetermined', ['FitWarning'])
    """


class PluginWarning(UserWarning):
    """What another package adds cannot be had, and is left out.

    See Also
    --------
    load_system, load_drive

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", mi.PluginWarning)  # rather fail than go without it
    ...     actuator = mi.load_actuator("zhao2004")
    """


class UnitsWarning(UserWarning):
    """Numbers of a device, a drive or a target look like ones in other units.

    A device file that looks like SI and does not say so; or a number of a device in SI, of a term,
    a drive or a target that is far from what such devices have. Of a frequency below a 300th of the
    resonance it is asked whether kilohertz were meant, where the voltage does not pull the block
    in.

    See Also
    --------
    load_actuator, Actuator

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> from pathlib import Path
    >>> mita = mi.load_actuator("mita2003")
    >>> names = ("m1", "m2", "k", "c", "d", "delta", "e", "mu_s", "mu_d", "alpha", "g")
    >>> values = {name: getattr(mita, name) for name in names}
    >>> lines = ["[parameters]", *(f"{name} = {value}" for name, value in values.items())]
    >>> _ = Path("mine.toml").write_text(chr(10).join(lines))
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     device = mi.load_actuator("mine.toml")
    >>> [warning.category.__name__ for warning in caught]
    ['UnitsWarning']
    """


class ScaleWarning(UserWarning):
    """Numbers lie far from order one, and nothing was said of what is typical.

    See Also
    --------
    System

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> def spring(mode, t, y, p):
    ...     return y.v, -1e12 * y.x
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     small = mi.System(states=("x", "v"), flow=spring, initial={"x": 1e-6})
    ...     run = mi.simulate(small, duration=1e-5)
    >>> [warning.category.__name__ for warning in caught]
    ['ScaleWarning']
    """


class StartWarning(UserWarning):
    """A motion starts where a guard that moves the state has a negative margin.

    See Also
    --------
    Guard, Impact, simulate

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> def fall(mode, t, y, p):
    ...     return y.v, -1.0
    >>> def below(mode, t, y, p):  # of a ball above the floor this is negative
    ...     return -y.x
    >>> def rebound(mode, t, y, p):
    ...     return mode, (0.0, -0.5 * y.v)
    >>> floor = mi.Guard("floor", below, rebound)
    >>> ball = mi.System(states=("x", "v"), flow=fall, initial={"x": 1.0}, guards=[floor])
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     run = mi.simulate(ball, duration=0.5)
    >>> [warning.category.__name__ for warning in caught]
    ['StartWarning']
    """


class ValidityWarning(UserWarning):
    """A run went where a term of the model does not hold.

    See Also
    --------
    Term, SqueezeFilm, Run

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> film = mi.SqueezeFilm(length=1, width=0.5, pressure=2, viscosity=1, free_path_pressure=0.1)
    >>> actuator = mi.load_actuator("zhao2004").adding(film)
    >>> drive = mi.Sine(amplitude=0.6, omega=0.5)
    >>> options = mi.Options(engine="interpreted")  # nothing to compile for so short a run
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     run = mi.simulate(actuator, drive, 0.2, initial=mi.State(v2=1.0), options=options)
    >>> [warning.category.__name__ for warning in caught]
    ['ValidityWarning']
    """


class StiffnessWarning(UserWarning):
    """The steps of an explicit method are limited by stability; an implicit one may be faster.

    See Also
    --------
    Options, EngineFallbackWarning

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", mi.StiffnessWarning)
    ...     run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), 10)
    """
