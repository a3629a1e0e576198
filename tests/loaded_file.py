"""A Python file outside the package as a module: scripts and benchmarks that tests look into."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parent.parent


def loaded_file(file: str | Path, name: str | None = None) -> ModuleType:
    """Return the module of a file, a path from the root of the project, under its own name or another."""
    path = ROOT / file
    spec = importlib.util.spec_from_file_location(name or path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
