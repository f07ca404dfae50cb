"""SUNDIALS' C API, resolved through scikit-sundae's own extension module.

Every function of SUNDIALS that this package calls is declared here, once, with its C signature.
scikit-sundae's wheels carry SUNDIALS as shared libraries under hashed names; opening the extension
module that links to them lets the dynamic loader resolve all symbols, whatever the names.

From Python the functions are ctypes functions (`call`). From code compiled by numba they are
external symbols (`symbol`), whose addresses are handed to LLVM under a prefixed name, so that
compiled code can be cached on disk: no address is ever baked into it.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

from mems_impact.errors import EngineUnavailable

SUPPORTED_MAJOR = 7
REMEDY = (
    "install a scikit-sundae wheel of version 1.x, use method='dop853', which needs no SUNDIALS, "
    "or engine='interpreted'"
)

_int, _real, _ptr = ctypes.c_int32, ctypes.c_double, ctypes.c_void_p

# name: (result, arguments). sunrealtype is double and sunindextype int32 (checked in `load`).
SIGNATURES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "SUNContext_Create": (_int, (_int, _ptr)),
    "SUNContext_Free": (_int, (_ptr,)),
    "SUNContext_ClearErrHandlers": (_int, (_ptr,)),
    "N_VMake_Serial": (_ptr, (_int, _ptr, _ptr)),
    "N_VDestroy": (None, (_ptr,)),
    "N_VGetArrayPointer_Serial": (_ptr, (_ptr,)),
    "SUNDenseMatrix": (_ptr, (_int, _int, _ptr)),
    "SUNDenseMatrix_Data": (_ptr, (_ptr,)),
    "SUNMatDestroy": (None, (_ptr,)),
    "SUNLinSol_Dense": (_ptr, (_ptr, _ptr, _ptr)),
    "SUNLinSolFree": (_int, (_ptr,)),
    "SUNNonlinSol_FixedPoint": (_ptr, (_ptr, _int, _ptr)),
    "SUNNonlinSolFree": (_int, (_ptr,)),
    "CVodeCreate": (_ptr, (_int, _ptr)),
    "CVodeFree": (None, (_ptr,)),
    "CVodeInit": (_int, (_ptr, _ptr, _real, _ptr)),
    "CVodeReInit": (_int, (_ptr, _real, _ptr)),
    "CVodeSStolerances": (_int, (_ptr, _real, _real)),
    "CVodeSetUserData": (_int, (_ptr, _ptr)),
    "CVodeSetNonlinearSolver": (_int, (_ptr, _ptr)),
    "CVodeSetLinearSolver": (_int, (_ptr, _ptr, _ptr)),
    "CVodeSetJacFn": (_int, (_ptr, _ptr)),
    "CVodeRootInit": (_int, (_ptr, _int, _ptr)),
    "CVodeSetRootDirection": (_int, (_ptr, _ptr)),
    "CVodeSetNoInactiveRootWarn": (_int, (_ptr,)),
    "CVodeSetMaxStep": (_int, (_ptr, _real)),
    "CVodeSetInitStep": (_int, (_ptr, _real)),
    "CVodeSetMaxHnilWarns": (_int, (_ptr, _int)),
    "CVodeSetEtaFixedStepBounds": (_int, (_ptr, _real, _real)),
    "CVodeSetStopTime": (_int, (_ptr, _real)),
    "CVodeClearStopTime": (_int, (_ptr,)),
    "CVode": (_int, (_ptr, _real, _ptr, _ptr, _int)),
    "CVodeGetRootInfo": (_int, (_ptr, _ptr)),
    "CVodeGetDky": (_int, (_ptr, _real, _int, _ptr)),
}

PREFIX = "mems_impact_"


@cache
def load() -> ctypes.CDLL:
    """Open SUNDIALS, check it, and give every function its signature.

    Returns
    -------
    ctypes.CDLL
        With the functions of `SIGNATURES` declared; their addresses are known to LLVM.

    Raises
    ------
    EngineUnavailable
        If scikit-sundae's build is not the one that is declared here: another major version of
        SUNDIALS, real or index type, or a symbol that can't be found. If numba may not compile.
    """
    from mems_impact.engines.compiling import check_numba

    check_numba()
    try:
        from sksundae import _cy_common, _cy_cvode

        config = _cy_common.config
        library = ctypes.CDLL(_cy_cvode.__file__)
    except (ImportError, AttributeError, OSError) as error:
        raise EngineUnavailable(
            f"scikit-sundae's CVODE can't be opened: {error}", REMEDY
        ) from error
    check(config)
    addresses = {}
    for name, (result, arguments) in SIGNATURES.items():
        try:
            function = getattr(library, name)
        except AttributeError as error:
            reason = f"SUNDIALS' {name} can't be found: {error}"
            raise EngineUnavailable(reason, REMEDY) from error
        function.restype, function.argtypes = result, arguments
        addresses[name] = ctypes.cast(function, ctypes.c_void_p).value

    import llvmlite.binding as llvm

    for name, address in addresses.items():
        llvm.add_symbol(PREFIX + name, address)
    return library


def sundials_version() -> str:
    """Return the version of SUNDIALS that scikit-sundae brings; empty if there is none."""
    try:
        from sksundae import _cy_common
    except ImportError:
        return ""
    return str(_cy_common.config.get("SUNDIALS_VERSION", ""))


def check(config: dict[str, str]) -> None:
    """Raise EngineUnavailable unless scikit-sundae's `config` is one that is declared here."""
    expected = {"SUNDIALS_FLOAT_TYPE": "double", "SUNDIALS_INT_TYPE": "int"}
    for key, value in expected.items():
        if config.get(key) != value:
            reason = f"{key} is {config.get(key)!r} where the bindings need {value!r}"
            raise EngineUnavailable(reason, REMEDY)
    version = str(config.get("SUNDIALS_VERSION", ""))
    if version.split(".")[0] != str(SUPPORTED_MAJOR):
        reason = f"SUNDIALS_VERSION is {version!r} where the bindings need {SUPPORTED_MAJOR}.x"
        raise EngineUnavailable(reason, REMEDY)


def symbol(name: str) -> Any:
    """Return the function `name` as numba code calls it; `load` must have run before it does."""
    from numba import types

    kinds: dict[Any, Any] = {None: types.void, _int: types.int32}
    kinds |= {_real: types.float64, _ptr: types.intp}
    result, arguments = SIGNATURES[name]
    signature = kinds[result](*(kinds[argument] for argument in arguments))
    return types.ExternalFunction(PREFIX + name, signature)
