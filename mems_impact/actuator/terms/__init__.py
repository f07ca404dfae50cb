"""Options of the model, one a file, behind the contract of `terms.base.Term`.

Whatever other file stands here is a term: `squeeze_film.py` holds the class `SqueezeFilm`, which
files of devices know as the table ``[squeeze_film]``. Importing this imports none of them.
"""

from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

_NO_TERMS = ("base", "files")

TERMS = {
    each.name: "".join(word.capitalize() for word in each.name.split("_"))
    for each in iter_modules(__path__)
    if each.name not in _NO_TERMS
}
"""All terms: the name, as files and parameters know it, and the class."""

if TYPE_CHECKING:  # for editors and mypy, which run nothing; a term works without
    from mems_impact.actuator.terms.adhesion import Adhesion as Adhesion
    from mems_impact.actuator.terms.base import Term as Term
    from mems_impact.actuator.terms.compliant_stopper import CompliantStopper as CompliantStopper
    from mems_impact.actuator.terms.cubic_stiffness import CubicStiffness as CubicStiffness
    from mems_impact.actuator.terms.dielectric_charging import (
        DielectricCharging as DielectricCharging,
    )
    from mems_impact.actuator.terms.frame_load import FrameLoad as FrameLoad
    from mems_impact.actuator.terms.frame_spring import FrameSpring as FrameSpring
    from mems_impact.actuator.terms.fringing import Fringing as Fringing
    from mems_impact.actuator.terms.power_law_restitution import (
        PowerLawRestitution as PowerLawRestitution,
    )
    from mems_impact.actuator.terms.regularized_friction import (
        RegularizedFriction as RegularizedFriction,
    )
    from mems_impact.actuator.terms.series_resistance import SeriesResistance as SeriesResistance
    from mems_impact.actuator.terms.squeeze_film import SqueezeFilm as SqueezeFilm
    from mems_impact.actuator.terms.stribeck_friction import StribeckFriction as StribeckFriction
    from mems_impact.actuator.terms.tabulated_restitution import (
        TabulatedRestitution as TabulatedRestitution,
    )
    from mems_impact.actuator.terms.tilt import Tilt as Tilt
else:
    _HOMES = {"Term": "base", **{name: kind for kind, name in TERMS.items()}}

    def __getattr__(name: str) -> Any:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
