"""How a function is compiled by numba: the settings of this project, and a cache that can only cost time."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache

Function = TypeVar("Function", bound=Callable[..., Any])

#: Floating-point freedom of the compiled code: fused multiply-add and signless zeros. Sums are never reordered
#: ("reassoc"), so results repeat from run to run; NaN and infinity keep their meaning.
FAST = {"contract", "nsz"}


@cache
def kernel_sources() -> str:
    """Return a digest of all sources with compiled functions, which those of other files inline."""
    package = Path(__file__).parents[2]
    contents = (file.read_bytes() for file in sorted(package.rglob("*.py")))
    return hashlib.sha256(b"".join(text for text in contents if b"kernels.jit import" in text)).hexdigest()


class PatientCache(FunctionCache):
    """The cache of numba, but a file that cannot be read or written leads to compiling, never to an error.

    Cached code holds the code of the functions it calls, so it counts as old when any such file changes; numba alone
    watches only the caller's own file. It is known by its ``settings`` as well, those of the compiler.
    """

    settings = ""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached code, or None where there is none that can be read."""
        with suppress(Exception):  # a damaged file: unpickling can raise anything
            return super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for the next process where the disk allows it."""
        with suppress(Exception):  # full or read-only disk, or an index that cannot be read
            super().save_overload(sig, data)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), kernel_sources(), self.settings)  # pyright: ignore[reportAttributeAccessIssue]


#: Settings of all compiled functions (no interpreter lock, no division checks), and of those that only they call, which
#: count no references to arrays (that takes longer than what they do) and have no way in from Python.
_SETTINGS: dict[str, Any] = {"nogil": True, "forceinline": True, "error_model": "numpy", "fastmath": FAST}
_INNER: dict[str, Any] = _SETTINGS | {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(function: Function, settings: dict[str, Any] = _SETTINGS) -> Function:
    """Return ``function`` compiled on its first call, cached on disk.

    Where neither the folder of the source nor the user's cache can be written, it is compiled once per process.
    """
    dispatcher: Any = numba.njit(**settings)(function)
    with suppress(RuntimeError):  # numba: "cannot cache function ...: no locator available for file ..."
        dispatcher._cache = PatientCache(function)
        dispatcher._cache.settings = repr(sorted(settings))
    return dispatcher


def inlined(function: Function) -> Function:
    """Return ``function`` as a part of compiled ones, which makes no array.

    Python must not call it, which would end the process, but ``compiled(function.py_func)``.
    """
    return compiled(function, _INNER)
