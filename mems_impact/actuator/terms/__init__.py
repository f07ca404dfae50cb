"""Options of the model, one a file, behind the contract of `terms.base.Term`.

Whatever other file stands here is a term: `squeeze_film.py` holds the class `SqueezeFilm`, which
files of devices know as the table ``[squeeze_film]``. Importing this imports none of them.
"""

from pkgutil import iter_modules

_NO_TERMS = ("base", "files")

TERMS = {
    each.name: "".join(word.capitalize() for word in each.name.split("_"))
    for each in iter_modules(__path__)
    if each.name not in _NO_TERMS
}
"""All terms: the name, as files and parameters know it, and the class."""
