"""One BLAS thread for small matrices, on which several are slower; finding the libraries is done once."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache
from typing import Any

from threadpoolctl import ThreadpoolController


@cache
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # its BLAS may be another one than NumPy's; both must be loaded to be found

    assert scipy.linalg
    return ThreadpoolController()


def one_blas_thread() -> AbstractContextManager[Any]:
    """Return a context in which NumPy and SciPy work on one thread."""
    return _libraries().limit(limits=1, user_api="blas")
