"""The warnings of the package: what is computed all the same, and may not be what was wanted."""

from __future__ import annotations

__all__ = [
    "EngineFallbackWarning",
    "FitWarning",
    "PluginWarning",
    "ScaleWarning",
    "StiffnessWarning",
    "UnitsWarning",
    "ValidityWarning",
]


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
    """The numbers of a device file look like SI, but it does not say so.

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
