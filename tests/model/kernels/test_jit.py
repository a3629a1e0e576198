"""The cache of compiled functions may only cost time: missing, full, damaged or aged, the function still works."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from numba.core import caching

from dynident.model.kernels import jit

SOURCE = """
from dynident.model.kernels.jit import compiled

@compiled
def doubled(x):
    return 2.0 * x
"""


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], ModuleType]:
    """Return a function that loads a module with a compiled function as a new process would."""
    monkeypatch.setattr("numba.core.config.CACHE_DIR", "")
    path = tmp_path / "module_of_the_user.py"
    path.write_text(SOURCE, encoding="ascii")

    def again() -> ModuleType:
        spec = importlib.util.spec_from_file_location("module_of_the_user", path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return again


def hits(module: ModuleType) -> int:
    return sum(module.doubled.stats.cache_hits.values())


def test_the_second_process_loads_what_the_first_compiled(load: Callable[[], ModuleType], tmp_path: Path) -> None:
    first, second = load(), load()
    assert first.doubled(4.0) == second.doubled(4.0) == 8.0
    assert (hits(first), hits(second)) == (0, 1)
    assert len(list((tmp_path / "__pycache__").glob("*.nbc"))) == 1


def test_a_change_of_the_kernels_makes_cached_callers_old(
    load: Callable[[], ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    load().doubled(4.0)
    monkeypatch.setattr(jit, "kernel_sources", lambda: "another version of generic.py")
    changed = load()
    assert changed.doubled(4.0) == 8.0
    assert hits(changed) == 0


def test_damaged_files_are_compiled_again(load: Callable[[], ModuleType], tmp_path: Path) -> None:
    load().doubled(4.0)
    for file in (tmp_path / "__pycache__").glob("*.nb?"):
        file.write_bytes(file.read_bytes()[:40])
        module = load()
        assert module.doubled(4.0) == 8.0


def test_no_place_for_a_cache_is_no_error(load: Callable[[], ModuleType], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    module = load()
    assert module.doubled(4.0) == 8.0
    assert hits(module) == 0


def test_a_full_disk_is_no_error(load: Callable[[], ModuleType], monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    assert load().doubled(4.0) == 8.0


def test_a_part_of_compiled_functions_is_called_from_python_by_its_own_code(tmp_path: Path) -> None:
    """Both versions of its code are kept, and neither process takes the one for the other."""
    path, text = tmp_path / "parts_of_the_user.py", SOURCE.replace("import compiled", "import compiled, inlined")
    path.write_text(
        text.replace("@compiled", "@inlined") + "\n@compiled\ndef half(x):\n    return doubled(x) / 4.0\n",
        encoding="ascii",
    )
    for _ in range(2):
        spec = importlib.util.spec_from_file_location("parts_of_the_user", path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        assert module.half(4.0) == 2.0
        assert jit.compiled(module.doubled.py_func)(4.0) == 8.0
