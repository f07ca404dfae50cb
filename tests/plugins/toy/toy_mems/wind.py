"""A constant force on the frame to the right."""

from mems_impact.actuator.parameter_base import Number
from mems_impact.actuator.terms.base import Term, TermContribution


class Wind(Term):
    """A wind from the left."""

    force: Number

    units = {"force": "N"}  # noqa: RUF012

    @classmethod
    def contribution(cls, indices, shape):
        force = indices.p["force"]

        def on_frame(y, p):
            return p[force]

        return TermContribution(on_frame=on_frame)
