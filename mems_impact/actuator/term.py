"""Terms in one place: those that `terms.TERMS` lists, and `Term`."""

from typing import TYPE_CHECKING

from mems_impact.actuator.terms import TERMS
from mems_impact.actuator.terms.base import Term as Term
from mems_impact.actuator.terms.files import term_type

if TYPE_CHECKING:  # for editors and mypy, which run nothing; a term works without
    from mems_impact.actuator.terms.adhesion import Adhesion as Adhesion
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

    def __getattr__(name: str) -> type[Term]:
        for kind, term in TERMS.items():
            if term == name:
                return term_type(kind)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
