"""Springs and balancers of an estimate in a new MJCF: MuJoCo's own, with the torque of the model to rounding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from identified_arms import FRICTION, estimate_of

from dynident.data.log import Log
from dynident.exports.models import export_model
from dynident.identification.estimate.estimate import Estimate
from dynident.model.friction.balancer import Balancer
from dynident.model.friction.spring import Spring
from dynident.model.robot import Robot


def sprung(robot: Robot, exact_log: Callable[..., Log], sign: float) -> Estimate:
    """Return an estimate with a spring at the first joint and a balancer at each of the others, its force of a sign."""
    first, *others = robot.joint_names
    balancers = (Balancer(0.4 - k, 2.5 - k, joints=(name,)) for k, name in enumerate(others))
    estimate = estimate_of(robot, exact_log, (*FRICTION, Spring(rest=0.7, joints=(first,)), *balancers), exact=True)
    assert estimate.theta is not None
    symbols = np.array([parameter.symbol for parameter in estimate.model.parameters])
    theta = np.where(symbols == "Fb", sign * estimate.theta, estimate.theta)
    return replace(estimate, theta=theta, beta=estimate.base.from_standard(theta))


def test_mujoco_has_the_springs_of_the_model(spatial_3r: Robot, exact_log: Callable[..., Log], tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    done = export_model(sprung(spatial_3r, exact_log, -1.0), "mjcf", tmp_path / "arm.xml")
    what = [proof.what for proof in done.proofs if proof.engine.startswith("MuJoCo")]
    assert what == ["bodies, armature, damping, Coulomb friction, springs"]
    assert {term.symbol for term in done.left_out} == {"F0"}
    text = (tmp_path / "arm.xml").read_text(encoding="utf-8")
    assert text.count("<spatial") == 2 and text.count('springref="0.7"') == 1


def test_a_pull_that_no_spring_has_is_left_out(
    spatial_3r: Robot, exact_log: Callable[..., Log], tmp_path: Path
) -> None:
    done = export_model(sprung(spatial_3r, exact_log, 1.0), "mjcf", tmp_path / "arm.xml")
    assert {term.symbol for term in done.left_out} == {"F0", "Kb", "Fb"}


def test_what_holds_no_spring_says_so(coupled_arm: Robot, exact_log: Callable[..., Log], tmp_path: Path) -> None:
    last = coupled_arm.joint_names[-1]
    estimate = estimate_of(coupled_arm, exact_log, (*FRICTION, Spring(joints=(last,))), exact=True)
    for target, name in (("mjcf", "arm.xml"), ("urdf", "arm.urdf")):
        done = export_model(estimate, target, tmp_path / name)
        assert ("spring", "Ks", last) in {(term.part, term.symbol, term.joint) for term in done.left_out}
