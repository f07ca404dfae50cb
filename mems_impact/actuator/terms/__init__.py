"""Optional terms of the model, one per file, with the interface of `terms.base.Term`.

Every other module here is a term: `squeeze_film.py` defines the class `SqueezeFilm`, which is the
table ``[squeeze_film]`` in device files. Importing the package imports none of them.
"""

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

_NO_TERMS = ("base", "files", "table")

TERM_CLASSES = {
    each.name: "".join(word.capitalize() for word in each.name.split("_"))
    for each in iter_modules(__path__)
    if each.name not in _NO_TERMS
}
"""All terms: the name in files and parameters, and the class."""

_HOMES = {"Term": "base", **{name: kind for kind, name in TERM_CLASSES.items()}}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
