"""Impact microactuators, and other systems that switch between smooth modes."""

import sys
from importlib import import_module
from typing import Any

import lazy_loader

from mems_impact.systems.serialization import STORABLE_MODULES

STORABLE_MODULES.append("mems_impact.actuator.serialization")  # of storable classes

# The stub `__init__.pyi` lists the public names with their modules. Each is imported on first use:
# pandas, numba and matplotlib take over a second, which `mems-impact --help` need not wait for.
_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    return _attribute(name)


if "IPython" in sys.modules:  # a notebook, in which results are shown with their pictures
    import_module(f"{__name__}.notebooks").register()
