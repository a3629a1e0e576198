"""The notebooks run, and their pages are what they print."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def _script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("notebooks", ROOT / "scripts" / "notebooks.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_page_of_a_notebook_is_what_it_prints(path: Path, tmp_path: Path) -> None:
    book = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    assert not [cell for cell in code if any(out["output_type"] == "error" for out in cell["outputs"])]
    assert "from dynident." not in "".join("".join(cell["source"]) for cell in code), "only names that are exported"
    _script().write_page(path.stem, book, tmp_path)
    for file in tmp_path.iterdir():
        assert (ROOT / "docs" / "notebooks" / file.name).read_bytes() == file.read_bytes(), file.name


@pytest.mark.battery
def test_the_notebooks_run(tmp_path: Path) -> None:
    if importlib.util.find_spec("nbclient") is None:
        pytest.skip("nbclient is not installed: make notebooks")
    command = [sys.executable, str(ROOT / "scripts" / "notebooks.py"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert {path.name for path in tmp_path.glob("*.ipynb")} == {path.name for path in NOTEBOOKS}
