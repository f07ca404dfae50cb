"""Compiling, and numba's cache on disk under keys of our own."""

from __future__ import annotations

import inspect
import logging
import sys
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache, NullCache
from numba.core.ccallback import CFunc
from numba.core.typing import Signature

from mems_impact.engines.compiling import FOR_C, INNER, JIT

_log = logging.getLogger("mems_impact")


class _Cache(FunctionCache):
    """A cache whose key is a name given, and which a bad file or directory does not stop.

    numba itself notices a change of the file in which a function stands and of its closure, not of
    what the functions draw on that it calls.
    """

    def __init__(self, function: Callable[..., Any], name: str) -> None:
        super().__init__(function)
        self._name_of_ours = name

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return sig, codegen.magic_tuple(), self._name_of_ours

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return compiled code, or None where there is none that can be read."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception as error:  # what unpickling half a file raises may be anything
            _log.info("compiled code in %s cannot be read (%s)", self.cache_path, error)
            found = None
            self._discard()
        if found is None:
            announce()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code if the directory lets us."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _log.info("compiled code cannot be kept in %s (%s)", self.cache_path, error)

    def _discard(self) -> None:
        try:
            self.flush()
        except OSError as error:
            _log.info("%s cannot be written (%s)", self.cache_path, error)


class _NoCache(NullCache):
    def load_overload(self, sig: Any, target_context: Any) -> None:
        announce()


def _cache_of(function: Callable[..., Any], name: str | None) -> Any:
    if name is None:
        return _NoCache()
    try:
        return _Cache(function, name)
    except RuntimeError as error:  # no directory can be written
        _log.info("compiled code is not kept: %s", error)
        return _NoCache()


def compile_callback(
    function: Callable[..., Any], signature: Signature, name: str | None, **options: Any
) -> Any:
    """Compile `function` to a C function.

    Parameters
    ----------
    function : callable
    signature : numba signature
    name : str or None
        Names the function and all that it draws on, the same in every process; None if that can't
        be told. Compiled code that has a name is kept on disk.
    options
        Of numba, beside our own.
    """
    compiled: Any = CFunc(
        function, (signature.args, signature.return_type), {}, {**FOR_C, **options}
    )
    compiled._cache = _cache_of(function, name)
    compiled.compile()
    return compiled


def compile_loop(function: Callable[..., Any], name: str | None) -> Callable[..., Any]:
    """Have `function` compiled for what it is called with; it releases the GIL.

    The parameters are those of `compile_callback`.
    """
    # numba compiles a function anew for each set of options of its callers. So they are those of an
    # inner function from here on.
    space = {"inner": njit(**JIT, **INNER)(function)}
    # By name, not by star: as a C function it could not take a tuple.
    names = ", ".join(inspect.signature(function).parameters)
    exec(compile(f"def entry({names}):\n    return inner({names})", __file__, "exec"), space)
    entry: Any = space["entry"]
    entry.__qualname__ = function.__qualname__
    entry.__module__ = __name__
    compiled: Any = njit(nogil=True, **JIT)(entry)
    compiled._cache = _cache_of(function, name)
    result: Callable[..., Any] = compiled
    return result


@cache
def announce() -> None:
    """Say, once in a process, that some seconds go into compiling.

    On a terminal, where somebody waits; elsewhere in the log named ``mems_impact``.
    """
    _say("compiling to native code: some seconds, once for an installation and for each new system")


def announce_unkept(things: Iterable[Any]) -> None:
    """Say that compiled code cannot be kept on disk, since it draws on `things`."""
    kinds = ", ".join(sorted({type(thing).__name__ for thing in things}))
    _say(
        "the compiled code of this system is not kept: its functions draw on objects that are "
        f"others in every process ({kinds}); let them draw on numbers"
    )


def _say(text: str) -> None:
    if sys.stderr is not None and sys.stderr.isatty():
        sys.stderr.write(f"mems-impact: {text}\n")
    else:
        _log.info(text)
