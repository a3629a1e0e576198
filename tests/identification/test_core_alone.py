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
GROUND = (
    "workers",
    "plugins.py",
    "methods.py",
    "files.py",
    "file_versions.py",
    "errors.py",
    "arrays.py",
)

#: The room of identification that simulates, and is no part of the core.
SIMULATED = SOURCE / "identification" / "simulated"

#: Lines that the core may have: somebody has to read them. It was 31,000 before the readers of robot files went to a
#: wing of their own (1,105 lines); what the core has stood at 29,895 then. That of meshes followed later (138 lines),
#: then that of YAML (109 lines).
#: Friction that remembers, chosen beside the delay, is 190 lines; that of drives that warm up is 146.
#: The size that shapes and stated inertia of a link share is 15, shapes that only show it are 9.
#: The ranges of parameters that data and bounds allow are 6. Friction beside the nominal inertias that brakes is 9.
#: The curve and further elements of friction that remembers are 30, ripple of the motors is 31, widths at their best
#: before a part is judged are 47.
#: Widths of single drives are 149. One procedure for the choice of friction in place of two took out 602. Values of
#: fields by Gauss-Newton steps in place of grids in turn came with as many lines fewer in formats and estimators.
#: Springs and balancers are 72. Intervals that count how uncertain found fields of friction are: 62; the motion of
#: drives in a file of its own: 16. Load friction that fades and a second look at presliding came with 12 fewer, as the
#: matching of compressed logs went to `api`. Noise as encoders with steps have it, and where noise is most of what is
#: known of a direction: 33. Where locked joints stood, for logs that are read with an estimate,
#: links that carry fingers, and ranges of temperatures: 49. Delays of all logs at once, and stops without powers: 43.
#: Torques that are sums of columns, and next steps in messages: 35. Joints in a file of their own: 9.
#: Parts that few cases need, loaded where they do: 9.
#: States of joints whose signals have names (control_msgs): 13. Gaps told before the fit, and what comes after one: 24.
#: Covariances of least squares that are made when asked for: 7.
LINES = 30_872


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
