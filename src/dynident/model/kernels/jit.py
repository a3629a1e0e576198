"""How a function is compiled by numba: the settings of this project, and a cache that can only cost time."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
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
    watches only the caller's own file.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached code, or None where there is none that can be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # a damaged file: unpickling can raise anything
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for the next process where the disk allows it."""
        try:
            super().save_overload(sig, data)
        except Exception:  # full or read-only disk, or an index that cannot be read
            pass

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return (*super()._index_key(sig, codegen), kernel_sources())  # pyright: ignore[reportAttributeAccessIssue]


def compiled(function: Function) -> Function:
    """Return ``function`` compiled on its first call: no interpreter lock, no division checks, cached on disk.

    Where neither the folder of the source nor the user's cache can be written, it is compiled once per process.
    """
    dispatcher = inlined(function)
    try:
        dispatcher._cache = PatientCache(function)  # pyright: ignore[reportFunctionMemberAccess]
    except RuntimeError:  # numba: "cannot cache function ...: no locator available for file ..."
        pass
    return dispatcher


def inlined(function: Function) -> Function:
    """Return ``function`` for use inside compiled ones: it becomes part of their code and is not cached itself."""
    settings: Any = {"nogil": True, "forceinline": True, "error_model": "numpy", "fastmath": FAST}
    dispatcher: Any = numba.njit(**settings)(function)
    return dispatcher
