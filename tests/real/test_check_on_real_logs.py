"""Log checks of a recorded log below a low cut-off, as drafts of slow logs have it; skipped without the log."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from dynident.case.case import read_case
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.diagnosis.checks import examine
from dynident.model.friction import FRICTION

pytestmark = pytest.mark.battery

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("DYNIDENT_DATA") or ROOT.parent / "shared" / "data")


@pytest.mark.parametrize("run", [1, 2, 3])
def test_a_wrist_torque_that_follows_its_position_is_no_other_order(run: int, monkeypatch: pytest.MonkeyPatch) -> None:
    log = f"kuka_lwr4_flobaroid/measurements_{run}.csv"
    if not (DATA / log).is_file():
        pytest.skip(f"no {log} under DYNIDENT_DATA or ../shared/data")
    monkeypatch.setenv("DYNIDENT_DATA", str(DATA))
    case = read_case(ROOT / "examples" / "cases" / "lwr4.yaml")
    friction = (FRICTION.make("coulomb", {"width": 0.01}), FRICTION.make("rotor_inertia"))
    how = replace(case.preprocessing, filter=Butterworth(2.0), trim_s=1.2)
    case = replace(case, friction=friction, preprocessing=how)
    assert examine(case, log).sound
