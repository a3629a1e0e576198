"""Rotor inertias that a case leaves out: a spring of negative stiffness before, an inertia of each drive now."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import Trial, virtual

import dynident as di
from dynident.case.case import Case, read_case

ROTORS = np.array([0.8, 0.6, 0.3, 0.12, 0.08, 0.05])


@pytest.fixture(scope="module")
def six(tmp_path_factory: pytest.TempPathFactory) -> Case:
    path = tmp_path_factory.mktemp("case") / "case.yaml"
    path.write_text("case: 2\nrobot: generic-6r\nfriction: [coulomb, viscous, offset]\n")
    case = read_case(path)
    bare = {joint.name: replace(joint.drive, rotor_inertia=0.0) for joint in case.robot.active}
    return replace(case, robot=case.robot.with_drives(bare))


def with_rotors(trial: Trial, rotors: np.ndarray) -> Trial:
    """Return a log with rotors behind gears, by the derivative of its velocities."""
    ddq = np.gradient(trial.columns["dq"], trial.columns["t"], axis=0)
    return trial.with_columns(tau=trial.columns["tau"] + rotors * ddq)


@pytest.mark.parametrize("seed", [0, 1])
def test_rotors_that_a_case_leaves_out_are_named_with_their_inertia(seed: int, six: Case, tmp_path: Path) -> None:
    trial = with_rotors(virtual(six, seed), ROTORS)
    found = trial.examined(tmp_path).findings
    told = {one.joint: one for one in found if one.name == "rotor inertia"}
    names = six.robot.joint_names
    assert set(names[3:]) <= set(told) and not [one for one in found if one.severity == "error"]
    for name in names[3:]:
        assert abs(told[name].numbers["value"] - ROTORS[names.index(name)]) < told[name].numbers["half_width"] + 0.01
        assert "add rotor_inertia to friction:" in told[name].remedy
    assert not [one for one in found if one.name in ("spring", "counterbalance")]


@pytest.mark.parametrize("stated", [True, False])
def test_nothing_is_said_of_rotors_that_are_stated_or_not_there(stated: bool, six: Case, tmp_path: Path) -> None:
    case = replace(six, friction=(*six.friction, di.FRICTION.make("rotor_inertia"))) if stated else six
    trial = replace(with_rotors(virtual(six, 0), ROTORS * stated), case=case)
    assert "rotor inertia" not in [one.name for one in trial.examined(tmp_path).findings]
