"""Laws hold for any robot: the kernel for any robot serves them, and none is compiled for each."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module", autouse=True)
def _generic_kernel() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DYNIDENT_KERNEL", "generic")
        yield
