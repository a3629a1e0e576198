"""A joint that the model predicts worse than a constant, although its torque follows the motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.injections import other_arm, spreads
from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import read_case
from dynident.diagnosis.causes.robot_misfit import robot_misfit, unpredicted
from dynident.diagnosis.causes.thin_fit import quick_fit
from dynident.model.friction import Motion
from dynident.model.friction.presliding import Presliding

NAME = "torque not explained"

SLOW = ("generic-7r", 1), ("er16", 5)


def of_another_motion(trial: Trial, joint: int) -> Trial:
    """Return a log in which one joint has the positions of another motion: the same backwards."""
    q, dq = (np.array(trial.columns[name]) for name in ("q", "dq"))
    q[:, joint], dq[:, joint] = q[::-1, joint].copy(), -dq[::-1, joint]
    return trial.with_columns(q=q, dq=dq)


@pytest.mark.parametrize(
    ("robot", "joint"),
    [("generic-6r", 5), ("generic-7r", 2), *(pytest.param(*one, marks=pytest.mark.battery) for one in SLOW)],
)
def test_a_joint_with_the_positions_of_another_motion_is_an_error(robot: str, joint: int, tmp_path: Path) -> None:
    trial = of_another_motion(virtual(read_case(robot)), joint)
    name = trial.case.robot.joint_names[joint]
    (found,) = [one for one in trial.examined(tmp_path).findings if one.severity == "error"]
    assert (found.name, found.joint) == (NAME, name) and found.numbers[name] > 1.0
    assert "origins" in found.remedy


@pytest.mark.parametrize("kind", ["white", "slow"])
def test_a_torque_of_noise_is_none_that_the_model_misses(kind: str, tmp_path: Path) -> None:
    right = virtual(read_case("generic-6r"))
    tau = np.array(right.columns["tau"])
    noise = np.random.default_rng(3).normal(size=len(tau))
    tau[:, -1] = noise if kind == "white" else np.cumsum(noise) / 10.0
    trial = right.with_columns(tau=tau)
    fit = quick_fit(trial.case, trial.case.read(str(trial.written(tmp_path))))
    assert fit is not None and robot_misfit(fit).joints[-1] > 1.0
    assert unpredicted(fit) == {}
    assert NAME not in [one.name for one in trial.examined(tmp_path).findings]


@pytest.mark.parametrize("robot", ["generic-6r", pytest.param("er16", marks=pytest.mark.battery)])
def test_strong_friction_that_builds_up_after_reversals_is_no_other_robot(robot: str, tmp_path: Path) -> None:
    """Over 40 mrad, a quarter of the torque; other axes and lengths are another robot beside it too."""
    right = virtual(read_case(robot))
    motion = Motion(right.columns["q"], right.columns["dq"], np.zeros_like(right.columns["q"]))
    bent = Presliding(length=0.04).states_along(motion, 0.005)[..., 0] / 0.04
    trial = right.with_columns(tau=right.columns["tau"] + 0.25 * spreads(right, "tau") * bent)
    assert not [one for one in trial.examined(tmp_path).findings if one.severity != "note"]
    wrong = other_arm(trial, 2)
    assert "another robot" in [one.name for one in wrong.examined(tmp_path).findings if one.severity != "note"]
