"""Robots of Pinocchio and MuJoCo in, and identified models out as their values: the torques are theirs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import dynident as di

#: A tree with what an MJCF has: an anchor off the origin, a reference position, a slide, a body of two joints, bodies
#: without joints, a site, armature, damping, friction, limits, gravity of its own.
MJCF = """<mujoco model="tree"><compiler angle="radian" autolimits="true"/><option gravity="0.3 -0.2 -9.7"/>
<worldbody>
  <body name="stand" pos="0 0 0.2"><geom type="box" size=".1 .1 .1" mass="3" pos="0 0 -.3"/>
  <body name="upper" pos="0.1 0 0.3" quat="0.9 0.1 -0.2 0.3">
    <joint name="shoulder" axis="0.1 1 0.2" pos="0.02 0.03 -0.05" ref="0.4" range="-2 2" actuatorfrcrange="-40 40"
           armature="0.07" damping="0.6" frictionloss="1.5"/>
    <inertial pos="0.1 0.02 0.05" mass="2.5" fullinertia="0.03 0.05 0.04 0.002 0.001 -0.003"/>
    <body name="box" pos="0.1 -0.1 0" euler="0.3 0.2 0.1"><geom type="box" size=".05 .02 .03" mass="0.7"/></body>
    <body name="fore" pos="0.4 0 0.1" euler="0.5 -0.3 1">
      <joint name="lift" type="slide" axis="0 0.2 1" pos="0.3 0 0" ref="0.05"/>
      <joint name="elbow" axis="1 0 0" pos="0.01 -0.04 0.02"/>
      <inertial pos="0.05 0 0.1" mass="1.5" diaginertia="0.02 0.02 0.01"/>
      <site name="flange" pos="0 0 0.2"/>
      <body name="finger" pos="0 0 0.2"><joint name="grip" type="slide" axis="0 1 0"/>
        <geom size="0.02" mass="0.1" pos="0 0.02 0"/></body>
      <body name="thumb" pos="0 0 0.2"><joint name="other" type="slide" axis="0 -1 0" ref="0.01"/>
        <geom size="0.02" mass="0.1" pos="0 -0.02 0"/></body>
    </body>
  </body></body>
</worldbody>{}</mujoco>"""
FOLLOW = '<equality><joint joint1="other" joint2="grip" polycoef="0.01 0.8 0 0 0"/></equality>'


def mujoco_torques(model: Any, q: Any, dq: Any, ddq: Any) -> Any:
    """Torques of all joints by mj_inverse, without constraints; Coulomb friction is one and is left out."""
    mujoco = pytest.importorskip("mujoco")
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, found = mujoco.MjData(model), []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, dq, ddq, strict=True):
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse.copy())
    return np.array(found)


def states(count: int) -> Any:
    return np.random.default_rng(0).normal(size=(3, 20, count))


def torques(robot: di.Robot, q: Any, dq: Any, ddq: Any) -> Any:
    """Torques by the regressor, with damping as the model states it."""
    model = di.DynamicModel(robot, ["viscous"])
    theta = model.nominal()
    assert theta is not None
    np.testing.assert_allclose(model.torque(q, dq, ddq), model.torque(di.Motion(q, dq, ddq), theta), rtol=1e-12)
    return model.regressor(q, dq, ddq) @ theta + ddq @ robot.reflected_inertia


def test_a_model_of_mujoco_has_its_torques() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(MJCF.format(""))
    robot = di.robot_of(model)
    assert robot.joint_names == ("shoulder", "lift", "elbow", "grip", "other") and robot.name == "tree"
    q, dq, ddq = states(5)
    np.testing.assert_allclose(torques(robot, q, dq, ddq), mujoco_torques(model, q, dq, ddq), rtol=0.0, atol=1e-9)
    shoulder = robot.joints[0]
    assert (shoulder.limits.lower, shoulder.limits.upper, shoulder.limits.effort) == (-2.0, 2.0, 40.0)
    assert (shoulder.friction, shoulder.damping) == (1.5, 0.6)
    assert {"stand", "box", "flange"} <= set(robot.frames) and robot.links[0].fixed == ("box",)
    assert di.robot_of(mujoco.MjSpec.from_string(MJCF.format(""))).joint_names == robot.joint_names


def test_actuators_of_mujoco_give_a_joint_inertia_damping_and_a_limit(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    motors = """<actuator><motor joint="lift" gear="50" armature="1e-4" damping="2e-4" forcerange="-0.5 0.5"/>
      <general joint="lift" gear="-4" armature="2e-3" damping="1e-3" forcerange="-3 2"/><motor joint="elbow" gear="2"/>
      </actuator>"""
    path = tmp_path / "tree.xml"
    path.write_text(MJCF.format(motors), encoding="utf-8")
    model = mujoco.MjModel.from_xml_path(str(path))
    q, dq, ddq = states(5)
    expected = mujoco_torques(model, q, dq, ddq)
    for robot in (di.robot_of(model), di.robot_of(str(path))):
        np.testing.assert_allclose(torques(robot, q, dq, ddq), expected, rtol=0.0, atol=1e-9)
        assert robot.joints[1].limits.effort == pytest.approx(50 * 0.5 + 4 * 3)
        assert robot.joints[2].limits.effort == np.inf and robot.joints[0].limits.effort == 40.0


def test_a_joint_follows_as_an_equality_says() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(MJCF.format(FOLLOW))
    robot = di.robot_of(model)
    assert robot.joint_names == ("shoulder", "lift", "elbow", "grip")
    q, dq, ddq = states(4)
    whole = [np.hstack([part, 0.8 * part[:, 3:]]) for part in (q, dq, ddq)]
    whole[0][:, 4] += 0.02  # 0.01 of its reference, 0.01 of the constraint
    expected = mujoco_torques(model, *whole)
    expected[:, 3] += 0.8 * expected[:, 4]
    np.testing.assert_allclose(torques(robot, q, dq, ddq), expected[:, :4], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("body", "end", "told"),
    [
        ("<freejoint/>", "", "'joint1' has more than one degree of freedom; give the model of an arm on a fixed base"),
        ('<joint type="ball"/>', "", "more than one degree of freedom"),
        ("", "", "a model without moving joints"),
        ("<joint/>", "MUSCLE", "the actuator biceps is a muscle, .*; replace muscles by motors"),
        ("<joint/>", "FLEX", r"1 flexible bodies \(flex\); remove them from the model"),
        ('<joint/><body name="c"><joint/><geom size=".1"/></body>', '<weld body1="b" body2="c"/>', "no linear one of"),
    ],
)
def test_models_of_mujoco_that_are_no_arm(body: str, end: str, told: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    tree = f'<worldbody><body name="b"><geom size=".1"/>{body}</body></worldbody>'
    ends = {
        "MUSCLE": '<actuator><muscle name="biceps" joint="j" lengthrange="0 1"/></actuator>',
        "FLEX": """<deformable><flex name="f" dim="1" body="b b" vertex="0 0 0 0.1 0 0" element="0 1"/></deformable>""",
    }
    tree = tree.replace("<joint/>", '<joint name="j"/>') if end in ends else tree
    text = f"<mujoco>{tree}{ends.get(end) or f'<equality>{end}</equality>'}</mujoco>"
    with pytest.raises(di.BadArgument, match=told):
        di.robot_of(mujoco.MjModel.from_xml_string(text))


def test_what_mujoco_adds_is_noted() -> None:
    mujoco = pytest.importorskip("mujoco")
    text = '<mujoco><worldbody><body gravcomp="1"><joint stiffness="2"/><geom size=".1"/></body></worldbody></mujoco>'
    note = di.robot_of(mujoco.MjModel.from_xml_string(text)).note
    assert note == "read from a model of MuJoCo; without springs of joints, gravity compensation of bodies"


def test_a_model_of_pinocchio_has_its_torques() -> None:
    pin = pytest.importorskip("pinocchio")
    random = np.random.default_rng(1)
    model = pin.Model()
    kinds: list[Any] = [pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])), pin.JointModelPY()]
    kinds += [pin.JointModelRX(), pin.JointModelRUBZ(), pin.JointModelPrismaticUnaligned(np.array([0.0, 0.6, 0.8]))]
    for k, (parent, kind) in enumerate(zip((0, 1, 2, 2, 1), kinds, strict=True)):
        number = model.addJoint(parent, kind, pin.SE3.Random(), f"j{k}")
        model.appendBodyToJoint(number, pin.Inertia.Random(), pin.SE3.Random())
        model.addFrame(pin.Frame(f"l{k}", number, 0, pin.SE3.Random(), pin.FrameType.BODY))
    model.gravity.linear = np.array([0.5, 0.2, -9.5])
    model.armature = random.uniform(0, 1, 5)
    model.damping = random.uniform(0, 1, 5)
    robot = di.robot_of(model)
    assert robot.joint_names == ("j0", "j1", "j2", "j3", "j4")
    assert [link.name for link in robot.links] == ["l0", "l1", "l2", "l3", "l4"]
    assert np.isinf(robot.joints[3].limits.upper)
    q, dq, ddq = states(5)
    data = model.createData()
    place = [model.joints[k + 1].idx_v for k in range(5)]
    expected = np.zeros_like(q)
    for row in range(len(q)):
        at = np.zeros(model.nq)
        velocity, acceleration = np.zeros((2, 5))
        for k in range(5):
            start = model.joints[k + 1].idx_q
            at[start : start + model.joints[k + 1].nq] = (
                (np.cos(q[row, k]), np.sin(q[row, k])) if model.joints[k + 1].nq == 2 else q[row, k]
            )
        velocity[place], acceleration[place] = dq[row], ddq[row]
        expected[row] = (pin.rnea(model, data, at, velocity, acceleration) + model.damping * velocity)[place]
    np.testing.assert_allclose(torques(robot, q, dq, ddq), expected, rtol=0.0, atol=1e-9)


def test_a_joint_of_pinocchio_follows_another() -> None:
    pin = pytest.importorskip("pinocchio")
    free = pin.Model()
    for k, kind in enumerate([pin.JointModelRX(), pin.JointModelPY(), pin.JointModelRZ()]):
        number = free.addJoint(k, kind, pin.SE3.Random(), f"j{k}")
        free.appendBodyToJoint(number, pin.Inertia.Random(), pin.SE3.Random())
    model = pin.transformJointIntoMimic(free, 1, 3, -0.6, 0.2)
    robot = di.robot_of(model)
    assert robot.joint_names == ("j0", "j1") and robot.joints[2].mimic == di.robot_of(model).joints[2].mimic
    q, dq, ddq = states(2)
    data = model.createData()
    expected = [pin.rnea(model, data, *state).copy() for state in zip(q, dq, ddq, strict=True)]
    np.testing.assert_allclose(torques(robot, q, dq, ddq), expected, rtol=0.0, atol=1e-9)


def test_a_model_of_pinocchio_with_one_joint() -> None:
    pin = pytest.importorskip("pinocchio")
    model = pin.Model()
    number = model.addJoint(0, pin.JointModelRY(), pin.SE3.Random(), "only")
    model.appendBodyToJoint(number, pin.Inertia.Random(), pin.SE3.Random())
    q, dq, ddq = states(1)
    data = model.createData()
    expected = [pin.rnea(model, data, *state).copy() for state in zip(q, dq, ddq, strict=True)]
    np.testing.assert_allclose(torques(di.robot_of(model), q, dq, ddq), expected, rtol=0.0, atol=1e-9)


def test_models_of_pinocchio_that_are_no_arm() -> None:
    pin = pytest.importorskip("pinocchio")
    told = "is a JointModelFreeFlyer with 6 degrees of freedom; build the model on a fixed base"
    with pytest.raises(di.BadArgument, match=told):
        di.robot_of(pin.buildSampleModelHumanoid())
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX(), pin.SE3.Random())
    for kind, told in (
        (composite, "joint 'j' is a JointModelComposite with 1 degree of freedom; add its joints to the model one by"),
        (pin.JointModelHX(0.1), "joint 'j' is a JointModelHX, which turns and slides at once; build the model with"),
        (pin.JointModelSpherical(), "joint 'j' is a JointModelSpherical with 3 degrees of freedom"),
    ):
        model = pin.Model()
        model.addJoint(0, kind, pin.SE3.Identity(), "j")
        with pytest.raises(di.BadArgument, match=told):
            di.robot_of(model)


@pytest.mark.parametrize("value", [3, None, SimpleNamespace(joints=[])])
def test_what_is_no_robot(value: object) -> None:
    with pytest.raises(di.BadArgument, match=r"where a robot is wanted; give a URDF file, .* a mujoco\.MjModel"):
        di.robot_of(value)


@pytest.fixture(scope="module")
def estimate(planar_2r: di.Robot, exact_log: Callable[..., di.Log]) -> di.Estimate:
    limits = di.JointLimits(-3.0, 3.0)
    planar_2r = replace(planar_2r, joints=tuple(replace(joint, limits=limits) for joint in planar_2r.joints))
    model = di.DynamicModel(planar_2r, ["viscous", "coulomb", "rotor_inertia"])
    assert planar_2r.nominal is not None
    theta = np.append(planar_2r.nominal, [0.3, 0.1, 0.2, 0.4, 0.05, 0.08])
    return di.identify(model, exact_log(model, theta, noise=0.01, samples=800, rate=200.0), trust=di.TrustOptions())


def test_an_estimate_as_a_model_of_pinocchio(estimate: di.Estimate) -> None:
    pin = pytest.importorskip("pinocchio")
    model = di.pinocchio_model(estimate)
    data = model.createData()
    q, _, _ = states(2)
    for at, mass, gravity in zip(q, estimate.mass_matrix(q), estimate.gravity(q), strict=True):
        found = pin.crba(model, data, at)
        np.testing.assert_allclose(np.triu(found) + np.triu(found, 1).T, mass, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(pin.computeGeneralizedGravity(model, data, at), gravity, rtol=0.0, atol=1e-9)
    frame = estimate.to_frame()["value"]
    np.testing.assert_allclose(model.damping, [frame["Fv[joint1]"], frame["Fv[joint2]"]])
    again = di.DynamicModel(di.robot_of(model), ["viscous"])
    np.testing.assert_allclose(again.mass_matrix(q), estimate.mass_matrix(q), rtol=0.0, atol=1e-9)


def test_the_weight_of_a_vertical_slide_is_that_of_its_bodies(
    scara: di.Robot, exact_log: Callable[..., di.Log]
) -> None:
    """Its log tells the weight and the offset together, and the mass and the rotor; no rotor is taken for a weight."""
    pin = pytest.importorskip("pinocchio")
    limits = di.JointLimits(-3.0, 3.0)
    scara = replace(scara, joints=tuple(replace(joint, limits=limits) for joint in scara.joints))
    model = di.DynamicModel(scara, ["viscous", "coulomb", "offset", "rotor_inertia"])
    assert scara.nominal is not None
    friction = np.array([[3.0, 2.0, 0.5, 5.0]] * 4)
    friction[2] = [40.0, 20.0, 6.0, 3.0]
    theta = np.append(scara.nominal, friction.ravel())
    estimate = di.identify(model, exact_log(model, theta, noise=0.01, samples=800, rate=200.0))
    assert estimate.theta is not None
    assert not np.allclose(estimate.theta, estimate.base.to_standard(estimate.beta))
    found, q = di.pinocchio_model(estimate), np.array([0.4, -0.7, 0.1, 0.2])
    weight = pin.computeGeneralizedGravity(found, found.createData(), q)
    np.testing.assert_allclose(estimate.gravity(q), weight, rtol=0.0, atol=1e-9)
    assert weight[2] == pytest.approx(1.6 * 9.81, rel=0.3)


def test_an_estimate_as_a_spec_of_mujoco(estimate: di.Estimate) -> None:
    pytest.importorskip("mujoco")
    spec = di.mujoco_spec(estimate)
    model = spec.compile()
    q, dq, ddq = states(2)
    frame = estimate.to_frame()["value"]
    dry = np.array([frame["Fc[joint1]"], frame["Fc[joint2]"]])
    still = np.zeros_like(q)
    smooth = estimate.predict(q, dq, ddq) - estimate.predict(q, dq, still)  # no sign of a speed is left
    found = mujoco_torques(model, q, dq, ddq) - mujoco_torques(model, q, dq, still)
    np.testing.assert_allclose(found, smooth, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(mujoco_torques(model, q, still, still), estimate.gravity(q), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(model.dof_frictionloss, dry)
    np.testing.assert_allclose(di.DynamicModel(di.robot_of(spec)).gravity(q), estimate.gravity(q), rtol=0.0, atol=1e-9)


def test_verbs_take_them(estimate: di.Estimate, exact_log: Callable[..., di.Log], planar_2r: di.Robot) -> None:
    pytest.importorskip("mujoco")
    model = di.DynamicModel(planar_2r, ["viscous"])
    log = exact_log(model, np.append(np.asarray(planar_2r.nominal), [0.3, 0.1]), noise=0.01, samples=600, rate=200.0)
    arrays = {"time": log.time, "q": log.q, "torque": log.torque}
    found = di.identify(di.mujoco_spec(estimate), arrays, "wls", trust=di.TrustOptions())
    assert found.model.robot.joint_names == planar_2r.joint_names
    assert di.log_of(arrays, di.mujoco_spec(estimate)).joints == planar_2r.joint_names


def test_an_actuator_with_several_controls_is_one_actuator() -> None:
    text = (
        '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>'
        '<actuator><pid joint="j" kp="5" ki="1"/></actuator></mujoco>'
    )
    mujoco = pytest.importorskip("mujoco")
    try:
        model = mujoco.MjModel.from_xml_string(text)
    except ValueError:
        pytest.skip("this MuJoCo has no pid")
    assert di.robot_of(model).dof == 1
