"""A plan looked at again: against closed forms of a pendulum, and against files that were changed by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.collision.clearance import clearance_of
from dynident.excitation.collision.tool_speed import tool_point_of
from dynident.excitation.collision.workspace import HalfSpace, Tool, Workspace
from dynident.excitation.design.limits import LimitRow, MotionLimits, ToolLimit, check_limits, limits_of
from dynident.excitation.design.observation import TorqueUncertainty
from dynident.excitation.design.plan import Plan
from dynident.excitation.design.recheck import Recheck, recheck, with_friction_of
from dynident.excitation.trajectories.rest_fourier import RestFourier
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, JointLimits
from dynident.model.robot import Link, Robot

LENGTH, MASS, SPIN, G = 0.4, 3.0, 0.02, 9.81


def pendulum(name: str = "pendulum", velocity: float = 3.0) -> Robot:
    """Return a rod that turns about y and hangs along x at q = 0, 1 m above the base."""
    body = Inertia.from_centre_of_mass(MASS, [LENGTH, 0.0, 0.0], SPIN * np.eye(3))
    limits = JointLimits(-3.0, 3.0, velocity, 40.0, effort=60.0)
    joint = Joint("swing", "revolute", -1, np.eye(3), np.array([0, 0, 1.0]), np.array([0, 1.0, 0]), limits, Drive())
    return Robot(name, (Link("rod", body),), (joint,))


def plan_of(robot: Robot, **facts: Any) -> Plan:
    """Return a plan made of values alone with its check of position to jerk and torque."""
    motion = RestFourier.from_free(np.array([[0.1, 0.35, -0.2, 0.15, 0.1]]), 4.0)
    limits = limits_of(robot)
    settings = {"noise": [0.5], "samples": 100, "friction": ["viscous"], **facts}
    draft = Plan(robot.name, motion, 0.0, "condition", {}, limits, (), 1001, settings)
    return replace(draft, rows=check_limits(draft.motion(), limits, draft.samples, torque_by_hand))


def torque_by_hand(motion: Motion) -> Array:
    """Return the torque of the pendulum: gravity pulls the rod towards positive q."""
    return (SPIN + MASS * LENGTH**2) * motion.ddq - MASS * G * LENGTH * np.cos(motion.q)


def row_of(check: Recheck, quantity: str) -> LimitRow:
    (found,) = (row for row in check.rows if row.quantity == quantity)
    return found


@pytest.fixture(scope="module")
def model() -> DynamicModel:
    return DynamicModel(pendulum(), ("viscous",))  # type: ignore[arg-type]


def test_a_plan_alone_is_sampled_again_and_the_rest_is_the_files(model: DynamicModel) -> None:
    plan = plan_of(model.robot)
    found = recheck(plan)
    assert found.rows == plan.rows and found.kept and found.findings == () and found.values == {}
    assert found.again == (True, True, True, True, False)
    assert found.remarks == (
        "position to jerk: sampled again at 1001 times",
        "as the file states, not computed again: torque",
    )


def test_the_torque_is_that_of_the_closed_form(model: DynamicModel) -> None:
    plan = plan_of(model.robot)
    found = recheck(plan, model)
    assert all(found.again) and found.findings == ()
    assert row_of(found, "torque").value == pytest.approx(row_of(recheck(plan), "torque").value, rel=1e-10)


def test_the_chance_margin_is_that_of_the_regressor(model: DynamicModel) -> None:
    plan, base = plan_of(model.robot), base_parameters(model)
    covariance = np.diag(np.arange(1.0, base.count + 1) * 1e-2)
    value = row_of(recheck(plan, model, uncertainty=TorqueUncertainty(covariance, 3.0)), "torque").value
    motion = Motion(*plan.motion().evaluate(np.linspace(0, 4, 1001)))
    y = np.asarray(model.regressor(motion))[:, 0, base.independent]
    spread = 3.0 * np.sqrt(np.einsum("ni,ij,nj->n", y, covariance, y))
    torque = torque_by_hand(motion)[:, 0]
    assert abs(value) == pytest.approx(np.max(np.abs(torque) + spread), rel=1e-9)


def test_figures_of_the_criteria_are_computed_again(model: DynamicModel) -> None:
    plan = replace(plan_of(model.robot), values={"condition": 1.0, "unit_condition": 2.0, "d_optimal": 3.0})
    found = recheck(plan, model)
    base, motion = base_parameters(model), plan.trajectory
    grid = Motion(*motion.evaluate(np.arange(1000) * 4.0 / 1000))
    w = np.asarray(model.regressor(grid))[:, 0, base.independent]
    assert found.values["condition"] == pytest.approx(np.linalg.cond(w), rel=1e-9)
    scaled = w / np.linalg.norm(w, axis=0)
    assert found.values["unit_condition"] == pytest.approx(np.linalg.cond(scaled), rel=1e-9)
    assert len(found.findings) == 3 and found.findings[0].startswith("condition: 1 in the file, ")
    known = replace(plan, criterion="d_optimal", settings={**plan.settings, "outlook": {"before": "a run"}})
    later = recheck(known, model)
    assert set(later.values) == {"condition", "unit_condition"}
    assert later.remarks[-1] == "as the file states, because earlier runs or unknown noise count in them: d_optimal"
    unknown = recheck(replace(plan, settings={}), model)
    assert set(unknown.values) == {"condition", "unit_condition"}


def test_a_motion_changed_by_hand_is_found(model: DynamicModel) -> None:
    plan = plan_of(model.robot)
    faster = replace(plan, trajectory=RestFourier.from_free(2.2 * np.array([[0.1, 0.35, -0.2, 0.15, 0.1]]), 4.0))
    found = recheck(faster)
    assert not found.kept and found.worst.quantity == "velocity"
    old = row_of(recheck(plan), "velocity").value
    assert f"velocity of swing: {old:.5g} rad/s in the file, {2.2 * old:.5g} rad/s computed again" in found.findings
    assert recheck(faster, model).findings[-1].startswith("torque of swing: ")


def test_distances_and_the_speed_of_the_tool_are_those_of_the_closed_form(model: DynamicModel) -> None:
    around = Workspace({"floor": HalfSpace(np.array([0, 0, 1.0]), 0.2)}, tool=Tool(offset=np.array([0.5, 0, 0])),
                       joint_radius=0.03)  # fmt: skip
    clearance = clearance_of(model.robot, around)
    tool = ToolLimit(tool_point_of(model.robot, around), 2.0)
    plan = plan_of(model.robot)
    found = recheck(plan, model, clearance=clearance, tool=tool)
    q, dq, _ = plan.motion().evaluate(np.linspace(0, 4, 100_001))
    exact = float((1.0 - 0.5 * np.maximum(np.sin(q), 0.0)).min()) - 0.03 - 0.2  # the rod's ends: joint and tool point
    (pair,) = found.clearances
    assert pair.joint == "rod | floor" and exact - 1e-3 < pair.value <= exact + 1e-9
    assert row_of(found, "tool speed").value == pytest.approx(0.5 * np.abs(dq).max(), rel=1e-4)
    assert "a clearance of this workspace, not in the file: rod | floor" in found.findings
    other = replace(plan, rows=(*plan.rows, replace(pair, joint="rod | wall")))
    again = recheck(other, model, clearance=clearance)
    assert "a clearance in the file, not of this workspace: rod | wall" in again.findings
    assert [row.joint for row, fresh in zip(again.rows, again.again, strict=True) if not fresh] == ["rod | wall"]
    nearer = replace(plan, rows=(*plan.rows, replace(pair, value=pair.value + 0.01)))
    assert any("clearance of rod | floor" in text for text in recheck(nearer, model, clearance=clearance).findings)


def test_a_description_that_allows_less_is_found(model: DynamicModel) -> None:
    plan = plan_of(model.robot)
    slower = DynamicModel(pendulum("other", velocity=1.0), model.friction)
    found = recheck(plan, slower)
    assert "the plan is of the robot 'pendulum', and this one is called 'other'" in found.findings
    assert "velocity of swing: the plan may use 2.85, the robot model allows 1" in found.findings
    wide = replace(plan.limits, lower=np.array([-5.0]), upper=np.array([2.0]))
    text = "position of swing: the plan may use -5 to 2, the robot model allows -3 to 3"
    assert text in recheck(replace(plan, limits=wide), model).findings


def test_a_robot_with_other_joints_is_refused(model: DynamicModel) -> None:
    plan = plan_of(model.robot)
    limits = plan.limits
    bounds = [getattr(limits, name) for name in ("lower", "upper", "velocity", "acceleration", "jerk", "torque")]
    for names, kinds in ((("elbow",), (True,)), (("swing",), (False,))):
        other = replace(plan, limits=MotionLimits(names, kinds, *bounds))
        with pytest.raises(BadOption, match="its joints are swing, those of the plan are"):
            recheck(other, model)


def test_the_friction_is_that_of_the_plan(model: DynamicModel) -> None:
    plan = plan_of(model.robot)
    assert with_friction_of(plan, model) is model
    bare = DynamicModel(model.robot, ("coulomb", "offset"))  # type: ignore[arg-type]
    assert [type(part).__name__ for part in with_friction_of(plan, bare).friction] == ["Viscous"]
    assert with_friction_of(replace(plan, settings={}), bare) is bare
