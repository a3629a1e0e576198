"""The logs of real robots, under the folder that DYNIDENT_DATA names or in shared/data beside the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("DYNIDENT_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data")


def real(name: str, patch: pytest.MonkeyPatch) -> Path:
    """File or folder ``name``, with DYNIDENT_DATA set for case files; where it is missing the test is skipped."""
    if not (DATA / name).exists():
        pytest.skip(f"no {name} under DYNIDENT_DATA or ../shared/data")
    patch.setenv("DYNIDENT_DATA", str(DATA))
    return DATA / name
