"""Options of the model, one a file, behind the contract of `terms.base.Term`.

Whatever other file stands here is a term: `squeeze_film.py` holds the class `SqueezeFilm`, which
files of devices know as the table ``[squeeze_film]``. Importing this imports none of them.
"""

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

_NO_TERMS = ("base", "files")

TERM_CLASSES = {
    each.name: "".join(word.capitalize() for word in each.name.split("_"))
    for each in iter_modules(__path__)
    if each.name not in _NO_TERMS
}
"""All terms: the name, as files and parameters know it, and the class."""

_HOMES = {"Term": "base", **{name: kind for kind, name in TERM_CLASSES.items()}}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
