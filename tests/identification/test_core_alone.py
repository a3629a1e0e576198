"""The core (model, data, identification without its room of simulating estimators) works with no other wing there."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import dynident

SOURCE = Path(dynident.__file__).parent

#: The wings of the core, and the ground that they stand on.
CORE = ("model", "data", "identification")
GROUND = ("workers", "plugins.py", "methods.py", "files.py", "file_versions.py", "errors.py", "arrays.py")

#: The room of identification that simulates, and is no part of the core.
SIMULATED = SOURCE / "identification" / "simulated"

#: Lines that the core may have: somebody has to read them.
LINES = 31_000


def _run(folder: Path, *words: str, package: Path | None = None) -> dict[str, object]:
    folder.mkdir()
    program = Path(__file__).with_name("core_run.py")
    path = {} if package is None else {"PYTHONPATH": str(package)}
    command = [sys.executable, "-W", "error", str(program), str(folder), *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **path})
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_core_alone_finds_what_the_whole_package_finds(tmp_path: Path) -> None:
    package = tmp_path / "package" / "dynident"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    for name in (*CORE, *GROUND):
        if (SOURCE / name).is_dir():
            ignored = shutil.ignore_patterns("simulated", "__pycache__")
            shutil.copytree(SOURCE / name, package / name, ignore=ignored)
        else:
            shutil.copy(SOURCE / name, package / name)
    alone = _run(tmp_path / "alone", "--alone", package=package.parent)
    whole = _run(tmp_path / "whole")
    assert set(alone) >= {"wls", "consistent", "diagnostics", "streamed"}
    assert alone["base"] and alone == whole


def test_the_core_is_small_enough_to_be_read() -> None:
    files = [file for name in CORE for file in (SOURCE / name).rglob("*.py")]
    lines = sum(len(file.read_text().splitlines()) for file in files if not file.is_relative_to(SIMULATED))
    assert 10_000 < lines <= LINES
