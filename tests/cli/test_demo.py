"""The demo: the whole job on the shipped arm, in one screen and with files that the other commands take."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dynident as di
from dynident.cli.main import main
from real_data import real

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "src" / "dynident" / "api" / "demo_data"


def test_the_demo_in_one_screen(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DYNIDENT_DATA", raising=False)
    monkeypatch.setenv("COLUMNS", "80")
    folder = tmp_path / "demo"
    assert main(["demo", "--out", str(folder), "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert err == "" and len(out.splitlines()) <= 40
    assert "virtual six-joint arm: simulated log" in out and "links: physically consistent" in out
    for engine, module, extra in (("MuJoCo", "mujoco", "mujoco"), ("Pinocchio", "pinocchio", "pin")):
        is_missing = importlib.util.find_spec(module) is None
        assert (f"{engine}: not installed" in out) == is_missing == bool(re.search(rf"dynident\[.*{extra}\b", out))
    names = {path.name for path in folder.iterdir()}
    assert {"case.yaml", "estimate.json", "report.html", "identified.urdf", "identified.xml", "identified.h"} <= names
    # The true arm, which neither its URDF nor the demo states: torques are its, as far as 1 % noise allows.
    truth = di.DynamicModel(di.read_robot("generic-6r"), ["coulomb", "viscous"])
    q, dq, ddq = np.random.default_rng(0).uniform(-1, 1, (3, 50, 6))
    wanted = truth.torque(q, dq, ddq)
    found = di.Estimate.load(folder / "estimate.json").predict(q, dq, ddq)
    stated = di.DynamicModel(di.read_robot(str(folder / "arm.urdf"))).torque(q, dq, ddq)
    assert np.linalg.norm(found - wanted) < 0.03 * np.linalg.norm(wanted) < np.linalg.norm(stated - wanted)
    again = di.read_robot(str(folder / "identified.urdf"))
    np.testing.assert_allclose(
        di.DynamicModel(again).gravity(q), di.Estimate.load(folder / "estimate.json").gravity(q), atol=1e-6
    )


def test_the_shipped_log_is_small_and_made_by_its_command(tmp_path: Path) -> None:
    """The bytes are compared by the battery; here the sizes."""
    assert sum(path.stat().st_size for path in DATA.iterdir()) <= 300_000
    assert (DATA / "run.csv").read_text().count("\n") == 2401


@pytest.mark.battery
def test_the_shipped_files_come_from_their_command(tmp_path: Path) -> None:
    code = f"import sys; sys.path.insert(0, {str(ROOT / 'scripts')!r}); import demo_data; from pathlib import Path; "
    code += f"demo_data.TARGET = Path({str(tmp_path)!r}); demo_data.main()"
    subprocess.run([sys.executable, "-c", code], check=True)
    for name in ("arm.urdf", "run.csv"):
        ours, again = (
            np.array(re.findall(r"-?\d+\.\d+(?:e-?\d+)?", (folder / name).read_text()), dtype=float)
            for folder in (DATA, tmp_path)
        )
        np.testing.assert_allclose(again, ours, rtol=1e-6, atol=2e-3)


@pytest.mark.battery
def test_the_demo_on_a_real_arm(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real("ur10e_mamedov", monkeypatch)
    assert main(["demo", "--out", str(tmp_path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["source"].startswith("real UR10e") and told["test"]["total_relative_error"] < 0.04
