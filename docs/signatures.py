"""Signatures of the reference: what a verb takes, and options without their defaults."""

import inspect
from dataclasses import MISSING, fields, is_dataclass


class Short:
    """A default as it is written: options with the values that are not their own defaults."""

    def __init__(self, value):
        self.value = value

    def __repr__(self):
        given = []
        for field in fields(self.value):
            value = getattr(self.value, field.name)
            if not field.init or (field.default is not MISSING and value == field.default):
                continue
            if field.default_factory is not MISSING and value == field.default_factory():
                continue
            given.append(f"{field.name}={value!r}")
        return f"{type(self.value).__name__}({', '.join(given)})"


def signatures(function):
    """Return the signatures of a function as text: two of a verb, of a system and of a device."""
    empty = inspect.Parameter.empty
    parameters = [
        each.replace(
            annotation=empty,
            default=Short(each.default) if is_dataclass(each.default) else each.default,
        )
        for each in inspect.signature(function).parameters.values()
    ]
    found = [parameters]
    if hasattr(function, "__wrapped__") and parameters and parameters[0].name == "system":
        device = [parameters[0].replace(name=name) for name in ("actuator", "drive")]
        found.append([*device, *parameters[1:]])
    return [str(inspect.Signature(each)) for each in found]


def shorten(app, what, name, obj, options, signature, returned):
    """Replace the signature of a function; the others stay."""
    if what == "function" and signature is not None:
        import sphinx

        first, *others = signatures(obj)
        # Before version 9 Sphinx writes the name before each of several signatures itself.
        start = name.rpartition(".")[2] if sphinx.version_info >= (9,) else ""
        return "\n".join([first, *(start + each for each in others)]), returned
    return None


def setup(app):
    app.connect("autodoc-process-signature", shorten)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
