"""The public names and their signatures are those of ``public_api.txt``.

Where they are meant to change, renew the file, and read the difference:

    PUBLIC_API=renew pytest tests/test_public_api.py
"""

import enum
import inspect
import os
from pathlib import Path

import mems_impact as mi

FROZEN = Path(__file__).parent / "public_api.txt"


def described(name):
    """Return a line on a public name: its arguments with their defaults, without types."""
    value = getattr(mi, name)
    if not callable(value):
        return f"{name}: {type(value).__name__}"
    is_error = inspect.isclass(value) and issubclass(value, BaseException)
    if is_error and not inspect.isfunction(value.__init__):  # Python's own, which takes anything
        return f"class {name}(*args)"
    if inspect.isclass(value) and issubclass(value, enum.Enum):  # whose signature is Python's own
        return f"class {name}: {', '.join(member.value for member in value)}"
    signature = inspect.signature(value)
    bare = [each.replace(annotation=each.empty) for each in signature.parameters.values()]
    arguments = signature.replace(parameters=bare, return_annotation=signature.empty)
    return f"{'class ' if inspect.isclass(value) else ''}{name}{arguments}"


def test_public_names_and_signatures_are_those_that_are_frozen():
    now = "".join(f"{described(name)}\n" for name in sorted(mi.__all__))
    if os.environ.get("PUBLIC_API") == "renew":
        FROZEN.write_text(now, encoding="utf-8")
    assert now.splitlines() == FROZEN.read_text(encoding="utf-8").splitlines()
