"""The notebooks run, and their pages are what they print."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from loaded_file import loaded_file

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))

#: Runs the cells of a notebook as Jupyter does, in one namespace, and prints what each displays, without Jupyter.
_RUNNER = """
import ast, json, sys
namespace = {"__name__": "__main__"}
for number, source in enumerate(json.load(open(sys.argv[1], encoding="utf-8"))):
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    print(f"cell {number}")
    exec(compile(tree, f"cell {number}", "exec"), namespace)
    if last is not None:
        value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), namespace)
        print("" if value is None else repr(value))
"""


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_page_of_a_notebook_is_what_it_prints(path: Path, tmp_path: Path) -> None:
    book = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    assert not [cell for cell in code if any(out["output_type"] == "error" for out in cell["outputs"])]
    assert "from dynident." not in "".join("".join(cell["source"]) for cell in code), "only names that are exported"
    loaded_file("scripts/notebooks.py").write_page(path.stem, book, tmp_path)
    for file in tmp_path.iterdir():
        assert (ROOT / "docs" / "notebooks" / file.name).read_bytes() == file.read_bytes(), file.name


@pytest.mark.battery
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_displays_what_its_page_shows(path: Path, tmp_path: Path) -> None:
    """Each cell displays something where the page shows something, with the same numbers to a few percent."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'dynident[mujoco]'")
    book = json.loads(path.read_text(encoding="utf-8"))
    cells = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    (tmp_path / "cells.json").write_text(json.dumps(["".join(cell["source"]) for cell in cells]))
    command = [sys.executable, "-c", _RUNNER, "cells.json"]
    settings = {**os.environ, "MPLBACKEND": "agg"}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=settings)
    assert done.returncode == 0, done.stderr
    displayed = re.split(r"^cell \d+\n", done.stdout, flags=re.MULTILINE)[1:]
    for cell, text in zip(cells, displayed, strict=True):
        outputs = [out.get("text") or out.get("data", {}).get("text/plain", "") for out in cell["outputs"]]
        shown = "".join("".join(output) + "\n" for output in outputs)
        assert bool(shown.strip()) == bool(text.strip()), "".join(cell["source"])
        if "proof by" not in shown and "..." not in shown:  # installed engines and widths of tables differ
            assert _numbers(text) == pytest.approx(_numbers(shown), rel=0.1, abs=0.1), "".join(cell["source"])


def _numbers(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"(?<![\w.])-?\d+\.\d*(?:e[-+]\d+)?(?![\w.])", text)]
