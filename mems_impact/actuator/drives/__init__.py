"""Voltage waveforms, one per file, with the interface of `drives.base.Drive`."""

import lazy_loader

from mems_impact._util.formatting import class_name

_KINDS = (
    "sine", "square", "pulse", "trapezoid", "voltage-step", "pulse-and-hold", "sampled", "burst",
    "voltages", "custom",
)  # fmt: skip
WAVEFORMS = {kind: class_name(kind) for kind in _KINDS}
"""All waveforms: the kind, as used in files and on the command line, and the class.

The kind with underscores is also the name of the file. Importing this module imports none of them.
"""

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "base": ["Drive"],
        "files": ["load_drive"],
        **{kind.replace("-", "_"): [name] for kind, name in WAVEFORMS.items()},
    },
)
