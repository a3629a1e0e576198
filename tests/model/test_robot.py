"""Robot values: what they refuse, the flat chain, and locking joints against the robot that keeps them still."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynident.errors import BadOption, UnknownChoice
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, JointLimits, Mimic, joint_pose, rotation_about
from dynident.model.kernels import batched
from dynident.model.plausible import consistency_defects
from dynident.model.robot import Frame, Link, Robot

Z = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"lower": 1.0, "upper": 0.5}, "the lower limit 1 is above the upper limit 0.5"),
        ({"lower": np.nan}, "the lower limit nan is above the upper limit inf"),
        ({"lower": np.inf}, "the lower limit inf is above the upper limit inf"),
        ({"velocity": -1.0}, "the velocity limit is -1"),
        ({"effort": np.nan}, "the effort limit is nan"),
        ({"effort_rate": -2.0}, "the effort_rate limit is -2"),
    ],
)
def test_limits_that_are_none(limits: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        JointLimits(**limits)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({"gear_ratio": 0.0}, "the gear ratio is 0"),
        ({"gear_ratio": np.inf}, "the gear ratio is inf"),
        ({"rotor_inertia": -1e-5}, "the rotor inertia is -1e-05"),
        ({"rotor_inertia": np.nan}, "the rotor inertia is nan"),
        ({"gain": 0.0}, "the gain is 0"),
        ({"gain": np.nan}, "the gain is nan"),
    ],
)
def test_drives_that_are_none(drive: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError) as caught:
        Drive(**drive)
    assert str(caught.value) == message


def test_reflected_inertia_grows_with_the_square_of_the_ratio() -> None:
    assert Drive(-100.0, 2e-5).reflected_inertia == pytest.approx(0.2)


def test_axis_becomes_a_unit_vector_and_stays_exact_where_it_is_one() -> None:
    joint = Joint("j", "revolute", -1, np.eye(3), np.zeros(3), [0.0, 3.0, 4.0])  # type: ignore[arg-type]
    np.testing.assert_allclose(joint.axis, [0, 0.6, 0.8], atol=1e-16)
    exact = np.array([0.36, 0.48, 0.8])
    np.testing.assert_array_equal(Joint("j", "revolute", -1, np.eye(3), np.zeros(3), exact).axis, exact)
    with pytest.raises(ValueError, match=r"joint 'j' has the axis \[0.0, 0.0, 0.0\]"):
        Joint("j", "revolute", -1, np.eye(3), np.zeros(3), np.zeros(3))


def test_robots_that_are_none(planar_2r: Robot) -> None:
    first, second = planar_2r.joints
    with pytest.raises(ValueError, match="1 links and 2 joints: each joint moves one link"):
        replace(planar_2r, links=planar_2r.links[:1])
    with pytest.raises(ValueError, match="a parent must stand before its children"):
        replace(planar_2r, joints=(replace(first, parent=1), second))
    with pytest.raises(ValueError, match="two joints share a name"):
        replace(planar_2r, joints=(first, replace(second, name="joint1")))
    with pytest.raises(ValueError, match="the coupling matrix is singular"):
        replace(planar_2r, coupling=np.ones((2, 2)))
    with pytest.raises(ValueError, match=r"coupling has shape \(3, 3\), expected \(2, 2\)"):
        replace(planar_2r, coupling=np.eye(3))
    with pytest.raises(ValueError, match=r"gravity has shape \(2,\)"):
        planar_2r.with_gravity([0, -9.81])


def test_values_are_frozen(planar_2r: Robot) -> None:
    with pytest.raises(FrozenInstanceError):
        planar_2r.name = "other"  # type: ignore[misc]
    for array in (planar_2r.gravity, planar_2r.coupling, planar_2r.joints[0].rotation, planar_2r.joints[0].axis):
        with pytest.raises(ValueError, match="read-only"):
            np.asarray(array)[0] = 1.0


def test_chain_holds_the_robot(sliding_arm: Robot) -> None:
    chain = sliding_arm.chain
    assert (chain.links, chain.joints, chain.has_mimic) == (3, 3, False)
    np.testing.assert_array_equal(chain.parent, [-1, 0, 1])
    np.testing.assert_array_equal(chain.kind, [0, 1, 0])
    np.testing.assert_array_equal(chain.joint, [0, 1, 2])
    np.testing.assert_array_equal(chain.translation[1], sliding_arm.joints[1].translation)
    np.testing.assert_array_equal(chain.axis[1], np.array([1, 0, 1]) / np.sqrt(2))
    np.testing.assert_array_equal(chain.gravity, [0, 0, -9.81])
    assert sliding_arm.units == ("N m", "N", "N m")


def test_chain_of_a_mimic_joint_shares_a_column(mimic_arm: Robot) -> None:
    chain = mimic_arm.chain
    assert (chain.links, chain.joints, chain.has_mimic) == (3, 2, True)
    np.testing.assert_array_equal(chain.joint, [0, 1, 1])
    np.testing.assert_array_equal(chain.multiplier, [1, 1, -0.5])
    np.testing.assert_array_equal(chain.offset, [0, 0, 0.3])
    assert mimic_arm.joint_names == ("joint1", "joint2")


def test_nominal_needs_every_link(planar_2r: Robot) -> None:
    assert planar_2r.nominal is not None and planar_2r.nominal.shape == (20,)
    np.testing.assert_array_equal(planar_2r.nominal[10:], planar_2r.links[1].inertia.vector)  # type: ignore[union-attr]
    assert replace(planar_2r, links=(planar_2r.links[0], Link("link2"))).nominal is None


def test_reflected_inertia_with_coupling(coupled_arm: Robot) -> None:
    rotors = np.diag([100.0**2, 120.0**2, 80.0**2]) * 2e-5
    coupling = np.array([[1, 0, 0], [0, 1, 0], [0, 0.7, 1]])
    np.testing.assert_allclose(coupled_arm.reflected_inertia, coupling.T @ rotors @ coupling)
    assert coupled_arm.is_coupled


def test_unknown_joint_is_named(planar_2r: Robot) -> None:
    message = r"no joint called 'joint3'; choose one of: joint1, joint2"
    with pytest.raises(UnknownChoice, match=message):
        planar_2r.locked({"joint3": 0.0})
    with pytest.raises(UnknownChoice, match=message):
        planar_2r.with_drives({"joint3": Drive()})


def test_not_all_joints_can_be_locked(planar_2r: Robot) -> None:
    with pytest.raises(BadOption) as caught:
        planar_2r.locked({"joint1": 0.0, "joint2": 0.0})
    assert str(caught.value) == "locked = ['joint1', 'joint2'] is not possible; leave at least one joint free"


def test_a_motor_that_turns_with_a_free_joint_is_not_lost(coupled_arm: Robot) -> None:
    second, third = coupled_arm.joint_names[1:]
    with pytest.raises(BadOption, match=f"the motor of '{third}' turns with '{second}' too"):
        coupled_arm.locked({third: 0.1})
    alone = coupled_arm.locked({second: 0.2})  # its own motor stands still; that of the third turns with the third only
    np.testing.assert_allclose(alone.reflected_inertia, coupled_arm.reflected_inertia[np.ix_([0, 2], [0, 2])])
    assert coupled_arm.locked({second: 0.0, third: 0.0}).dof == 1


def held(robot: Robot, positions: dict[str, float], samples: int, seed: int) -> tuple[list[int], list[np.ndarray]]:
    """Return the free columns, and a motion of the whole robot in which the others stand where they are locked."""
    generator = np.random.default_rng(seed)
    motion = [generator.uniform(-2, 2, (samples, robot.dof)) for _ in range(3)]
    for column, name in enumerate(robot.joint_names):
        if name in positions:
            motion[0][:, column] = positions[name]
            motion[1][:, column] = motion[2][:, column] = 0.0
    return [k for k, name in enumerate(robot.joint_names) if name not in positions], motion


def torque(robot: Robot, motion: list[np.ndarray]) -> np.ndarray:
    q, dq, ddq = motion
    assert robot.nominal is not None
    return batched.inverse_dynamics(robot.chain, robot.nominal, q, dq, ddq)


@settings(deadline=None, max_examples=25)
@given(data=st.data(), seed=st.integers(0, 10_000), links=st.integers(2, 5))
def test_locking_keeps_the_torque_of_the_free_joints(
    random_tree: Callable[..., Robot], data: st.DataObject, seed: int, links: int
) -> None:
    robot = random_tree(seed, links)
    names = data.draw(st.sets(st.sampled_from(robot.joint_names), min_size=1, max_size=links - 1))
    positions = {name: data.draw(st.floats(-2, 2)) for name in sorted(names)}
    locked = robot.locked(positions)
    free, motion = held(robot, positions, 5, seed)
    full = torque(robot, motion)[:, free]
    own = torque(locked, [signal[:, free] for signal in motion])
    np.testing.assert_allclose(own, full, atol=1e-9 * max(1.0, float(np.abs(full).max())))
    assert consistency_defects(locked.links) == {}
    rotations, translations = batched.link_poses(robot.chain, motion[0])
    own_rotations, own_translations = batched.link_poses(locked.chain, motion[0][:, free])
    kept = {link.name: i for i, link in enumerate(locked.links)}
    for i, link in enumerate(robot.links):
        where = Frame(kept[link.name], np.eye(3), np.zeros(3)) if link.name in kept else locked.frames[link.name]
        turn, shift = np.eye(3)[None], np.zeros((1, 3))
        if where.link >= 0:
            turn, shift = own_rotations[:, where.link], own_translations[:, where.link]
        np.testing.assert_allclose(rotations[:, i] - turn @ where.rotation, 0, atol=1e-12)
        np.testing.assert_allclose(translations[:, i] - turn @ where.translation - shift, 0, atol=1e-12)


def test_a_follower_is_locked_with_its_leader(mimic_arm: Robot) -> None:
    locked = mimic_arm.locked({"joint2": 0.8})
    assert locked.joint_names == ("joint1",) and locked.links[0].fixed == ("link2", "link3")
    free, motion = held(mimic_arm, {"joint2": 0.8}, 4, 0)
    full = torque(mimic_arm, motion)[:, free]
    own = torque(locked, [signal[:, free] for signal in motion])
    np.testing.assert_allclose(own, full, atol=1e-12)


def test_a_leader_keeps_its_follower_when_another_joint_is_locked(mimic_arm: Robot) -> None:
    locked = mimic_arm.locked({"joint1": 0.4})
    assert (locked.dof, locked.chain.has_mimic) == (1, True)
    free, motion = held(mimic_arm, {"joint1": 0.4}, 4, 0)
    full = torque(mimic_arm, motion)[:, free]
    own = torque(locked, [signal[:, free] for signal in motion])
    np.testing.assert_allclose(own, full, atol=1e-12)


def test_locking_keeps_the_mass_and_the_tool(planar_3r: Robot) -> None:
    masses = [link.inertia.mass for link in planar_3r.links if link.inertia]
    outer = planar_3r.locked({"joint3": 0.5})
    assert outer.links[1].inertia is not None and outer.links[1].inertia.mass == pytest.approx(masses[1] + masses[2])
    assert outer.tool == "link3" and outer.frames["link3"].link == 1
    inner = planar_3r.locked({"joint1": 0.5})  # the first link becomes part of the base
    assert [link.name for link in inner.links] == ["link2", "link3"] and inner.frames["link1"].link == -1


def test_frames_follow_the_link_that_they_are_fixed_to(planar_3r: Robot) -> None:
    shift = np.array([0.05, 0.02, 0.3])
    robot = replace(planar_3r, frames={"tool": Frame(2, rotation_about(Z, 0.3), shift)}, tool="tool")
    locked = robot.locked({"joint2": -0.4, "joint3": 0.9})
    q = np.array([[0.7, -0.4, 0.9]])
    rotations, translations = batched.link_poses(robot.chain, q)
    own_rotations, own_translations = batched.link_poses(locked.chain, q[:, :1])
    frame = locked.frames["tool"]
    assert frame.link == 0 and locked.tool == "tool"
    np.testing.assert_allclose(rotations[0, 2] @ shift + translations[0, 2],
                               own_rotations[0, 0] @ frame.translation + own_translations[0, 0])  # fmt: skip
    np.testing.assert_allclose(rotations[0, 2] @ rotation_about(Z, 0.3), own_rotations[0, 0] @ frame.rotation)


def test_drives_and_gravity_survive_locking(coupled_arm: Robot) -> None:
    locked = coupled_arm.locked({"joint1": 0.1})
    assert [joint.drive for joint in locked.joints] == [joint.drive for joint in coupled_arm.joints[1:]]
    np.testing.assert_array_equal(np.asarray(locked.coupling), [[1, 0], [0.7, 1]])
    np.testing.assert_array_equal(locked.gravity, coupled_arm.gravity)


def test_defects_are_found_by_link(planar_2r: Robot) -> None:
    bad = replace(planar_2r, links=(Link("link1"), Link("link2", Inertia(-1.0, np.zeros(3), np.eye(3)))))
    assert consistency_defects(bad.links) == {"link2": "the mass is -1 kg"}


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3), st.floats(-7, 7))
def test_rotation_about(axis: list[float], angle: float) -> None:
    vector = np.array(axis) if np.linalg.norm(axis) > 1e-3 else Z
    unit = vector / np.linalg.norm(vector)
    np.testing.assert_allclose(rotation_about(unit, angle), Rotation.from_rotvec(angle * unit).as_matrix(), atol=1e-12)


def test_joint_pose_of_both_kinds() -> None:
    turn = rotation_about(np.array([1.0, 0, 0]), np.pi / 2)  # z of the link is -y of the parent
    slide = Joint("s", "prismatic", -1, turn, np.array([1.0, 2, 3]), Z)
    rotation, translation = joint_pose(slide, 0.5)
    np.testing.assert_array_equal(rotation, turn)
    np.testing.assert_allclose(translation, [1, 1.5, 3])
    hinge = Joint("r", "revolute", -1, turn, np.array([1.0, 2, 3]), Z)
    rotation, translation = joint_pose(hinge, 0.5)
    np.testing.assert_allclose(rotation, turn @ rotation_about(Z, 0.5))
    np.testing.assert_array_equal(translation, [1, 2, 3])


def test_mimic_defaults() -> None:
    assert Mimic("leader") == Mimic("leader", 1.0, 0.0)
