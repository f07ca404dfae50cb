"""Optional terms of the model, one per file, with the interface of `terms.base.Term`.

Every other module here is a term: `squeeze_film.py` defines the class `SqueezeFilm`, which is the
table ``[squeeze_film]`` in device files. Importing the package imports none of them.
"""

from pkgutil import iter_modules

import lazy_loader

from mems_impact._util.formatting import class_name

_NO_TERMS = ("base", "files", "table")

TERM_CLASSES = {
    each.name: class_name(each.name)
    for each in iter_modules(__path__)
    if each.name not in _NO_TERMS
}
"""All terms: the name in files and parameters, and the class."""

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={"base": ["Term"], **{kind: [name] for kind, name in TERM_CLASSES.items()}},
)
