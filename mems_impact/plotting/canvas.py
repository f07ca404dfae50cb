"""The figure that all others are drawn on."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

__all__ = ["ShownFigure"]

DPI = 120  # in a notebook


class ShownFigure(Figure):
    """A figure that a notebook shows, be pyplot in use there or not.

    A notebook shows matplotlib's own figures once pyplot has made one, and these belong to none.
    """

    def _repr_png_(self) -> bytes:
        picture = BytesIO()
        self.savefig(picture, format="png", dpi=DPI)
        return picture.getvalue()
