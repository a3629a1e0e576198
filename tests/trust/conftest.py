"""Packages of one friction part, installed for a test in a temporary folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dynident.model.friction import FRICTION
from dynident.plugins import added, installed_entry_points


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str, str], None]]:
    """Return what makes a package of one module that adds one friction part: package, entry point, text."""

    def make(package: str, point: str, text: str) -> None:
        (tmp_path / f"{package}.py").write_text(text)
        facts = tmp_path / f"{package}-1.0.dist-info"
        facts.mkdir()
        (facts / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        (facts / "entry_points.txt").write_text(f"[{FRICTION.package}]\n{point}\n")
        added.cache_clear()
        installed_entry_points.cache_clear()

    monkeypatch.syspath_prepend(tmp_path)
    yield make
    monkeypatch.undo()
    added.cache_clear()
    installed_entry_points.cache_clear()
