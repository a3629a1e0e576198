"""Springs and balancers of an estimate in a new MJCF: MuJoCo's own, with the torque of the model to rounding."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from identified_arms import FRICTION, estimate_of

from dynident.data.log import Log
from dynident.exports.models import export_model
from dynident.model.friction.balancer import Balancer
from dynident.model.friction.spring import Spring
from dynident.model.robot import Robot


def test_mujoco_has_the_springs_of_the_model(spatial_3r: Robot, exact_log: Callable[..., Log], tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    first, second, third = spatial_3r.joint_names
    springs = (
        Balancer(dead_center=0.3, ratio=2.5, slack=1.2, joints=(second,)),
        Balancer(dead_center=-1.0, ratio=1.5, slack=4.0, joints=(third,)),
        Spring(rest=0.7, joints=(first,)),
    )
    estimate = estimate_of(spatial_3r, exact_log, (*FRICTION, *springs[::2]), exact=True)
    done = export_model(estimate, "mjcf", tmp_path / "arm.xml")
    assert [proof.what for proof in done.proofs if proof.engine.startswith("MuJoCo")] == [
        "bodies, armature, damping, Coulomb friction, springs"
    ]
    assert {term.symbol for term in done.left_out} == {"F0"}
    pushes = estimate_of(spatial_3r, exact_log, (*FRICTION, *springs[1:]), exact=True)
    assert {term.symbol for term in export_model(pushes, "mjcf", tmp_path / "pushed.xml").left_out} == {"F0"}
    text = (tmp_path / "arm.xml").read_text(encoding="utf-8")
    assert text.count("<spatial") == 1 and text.count('springref="0.7"') == 1


def test_what_holds_no_spring_says_so(coupled_arm: Robot, exact_log: Callable[..., Log], tmp_path: Path) -> None:
    last = coupled_arm.joint_names[-1]
    estimate = estimate_of(coupled_arm, exact_log, (*FRICTION, Spring(joints=(last,))), exact=True)
    for target, name in (("mjcf", "arm.xml"), ("urdf", "arm.urdf")):
        done = export_model(estimate, target, tmp_path / name)
        assert ("spring", "Ks", last) in {(term.part, term.symbol, term.joint) for term in done.left_out}
