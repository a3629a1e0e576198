"""URDF against Pinocchio, and against values written out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.documents.robot_data import robot_from_dict, robot_to_dict
from dynident.model.inertia import Inertia
from dynident.model.joint import rotation_about
from dynident.model.kernels.batched import inverse_dynamics, link_poses
from dynident.model.plausible import consistency_defects
from dynident.model.robot import Robot
from dynident.robot_files.formats.urdf import read_urdf
from real_data import real

#: Pinocchio's order of the ten, as positions in ours: m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
PINOCCHIO = [9, 6, 7, 8, 0, 1, 3, 2, 4, 5]
SETS = {
    "kuka_lwr4_flobaroid/robot.urdf": 7,
    "kuka_lwr4_flobaroid/reference_gaz.urdf": 7,
    "kuka_lwr4_flobaroid/reference_identified.urdf": 7,
    "panda_gaz2019/robot.urdf": 7,
    "staubli_tx40_figaroh/robot.urdf": 6,
    "tiago_figaroh/robot_full.urdf": 23,
    "ur10e_mamedov/robot.urdf": 6,
}


def urdf(text: str) -> Robot:
    return read_urdf("arm.urdf", f'<robot name="arm">{text}</robot>'.encode())


def one_joint(joint: str, kind: str = "revolute", link: str = "") -> Robot:
    return urdf(
        f'<link name="base"/><link name="arm">{link}</link>'
        f'<joint name="j" type="{kind}"><parent link="base"/><child link="arm"/>{joint}</joint>'
    )


def random_urdf(seed: int) -> str:
    """Return a random tree of 4 to 8 links with every kind of joint; no two moving links are rigidly one."""
    random = np.random.default_rng(seed)

    def row(values: Array) -> str:
        return " ".join(repr(float(value)) for value in values)

    def origin() -> str:
        return f'<origin xyz="{row(random.normal(size=3))}" rpy="{row(random.uniform(-4, 4, 3))}"/>'

    count = int(random.integers(4, 9))
    parts = ['<link name="l0"/>']
    kinds = ["revolute", "prismatic", "continuous", "fixed"]
    for i in range(1, count + 1):
        body = Inertia.from_log_cholesky(random.normal(scale=0.5, size=10))
        turn = rotation_about([0.6, 0.0, 0.8], float(random.uniform(-3, 3)))
        tensor = turn.T @ body.about_centre @ turn
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        values = tensor[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
        yaw, pitch, roll = _euler(turn)
        moments = " ".join(f'{name}="{float(value)!r}"' for name, value in zip(names, values, strict=True))
        inertial = (
            f'<inertial><origin xyz="{row(body.centre_of_mass)}" rpy="{row(np.array([roll, pitch, yaw]))}"/>'
            f'<mass value="{body.mass!r}"/>'
            f"<inertia {moments}/></inertial>"
        )
        kind = "revolute" if i == 1 else str(random.choice(kinds))
        parent = int(random.integers(0, i))
        parts.append(
            f'<link name="l{i}">{inertial}<visual><geometry><sphere radius="1"/></geometry></visual></link>'
            f'<joint name="j{i}" type="{kind}"><parent link="l{parent}"/><child link="l{i}"/>{origin()}'
            f'<axis xyz="{row(random.normal(size=3))}"/>'
            '<limit lower="-1" upper="2" effort="3" velocity="4"/></joint>'
        )
    return f'<robot name="random">{"".join(parts)}</robot>'


def _euler(rotation: Array) -> tuple[float, float, float]:
    """Return yaw, pitch and roll of a rotation."""
    pitch = math.asin(-rotation[2, 0])
    return math.atan2(rotation[1, 0], rotation[0, 0]), pitch, math.atan2(rotation[2, 1], rotation[2, 2])


def assert_same_as_pinocchio(robot: Robot, text: str, seed: int) -> None:
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromXML(text)
    data = model.createData()
    model.gravity.linear = robot.gravity
    assert sorted(model.names[1:]) == sorted(joint.name for joint in robot.joints)
    chain = robot.chain
    q, speed, rate = np.random.default_rng(seed).uniform(-2, 2, (3, robot.dof))
    follow = np.zeros((chain.links, robot.dof))  # Pinocchio knows no mimic joint here
    follow[np.arange(chain.links), chain.joint] = chain.multiplier
    ids = [model.getJointId(joint.name) for joint in robot.joints]
    columns = [model.joints[i].idx_v for i in ids]
    turned, dq, ddq = np.zeros((3, model.nv))
    turned[columns], dq[columns], ddq[columns] = follow @ q + chain.offset, follow @ speed, follow @ rate
    configuration = pin.integrate(model, pin.neutral(model), turned)
    theta = np.array([np.zeros(10) if link.inertia is None else link.inertia.vector for link in robot.links])
    for i, ours in zip(ids, theta[:, PINOCCHIO], strict=True):
        theirs = model.inertias[i].toDynamicParameters()
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-13 * max(1.0, np.abs(theirs).max()))
    pin.forwardKinematics(model, data, configuration)
    (turns,), (places,) = link_poses(chain, q[None])
    for i, turn, place in zip(ids, turns, places, strict=True):
        np.testing.assert_allclose(turn, data.oMi[i].rotation, rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(place, data.oMi[i].translation, rtol=0.0, atol=1e-10 * max(1.0, np.abs(place).max()))
    pin.updateFramePlacements(model, data)
    for name, frame in robot.frames.items():
        turn, place = (np.eye(3), np.zeros(3)) if frame.link < 0 else (turns[frame.link], places[frame.link])
        theirs = data.oMf[model.getFrameId(name)]
        np.testing.assert_allclose(turn @ frame.rotation, theirs.rotation, rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(place + turn @ frame.translation, theirs.translation, rtol=0.0, atol=1e-10)
    torque = inverse_dynamics(chain, theta.ravel(), q[None], speed[None], rate[None])[0]
    expected = pin.rnea(model, data, configuration, dq, ddq)[columns] @ follow
    np.testing.assert_allclose(torque, expected, rtol=0.0, atol=1e-10 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("seed", range(20))
def test_random_tree_against_pinocchio(seed: int) -> None:
    text = random_urdf(seed)
    assert_same_as_pinocchio(read_urdf("random.urdf", text.encode()), text, seed)


@pytest.mark.parametrize("name", SETS)
def test_reference_sets_read_and_agree_with_pinocchio(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = real(name, monkeypatch)
    data = path.read_bytes()
    robot = read_urdf(path, data)
    assert robot.dof == SETS[name]
    assert all(link.inertia is not None for link in robot.links)
    assert_same_as_pinocchio(robot, data.decode(), 1)


def test_order_is_depth_first_in_the_order_of_the_file() -> None:
    def joint(name: str, parent: str, child: str, kind: str = "revolute") -> str:
        return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/></joint>'

    links = "".join(f'<link name="{name}"/>' for name in "fedcba")
    robot = urdf(
        joint("z", "b", "c") + links + joint("y", "a", "b", "fixed") + joint("x", "c", "d") + joint("w", "b", "e")
        + joint("v", "e", "f")
    )  # fmt: skip
    assert robot.joint_names == ("z", "x", "w", "v")
    assert [joint.parent for joint in robot.joints] == [-1, 0, -1, 2]
    assert robot.base == "a"
    assert {name: frame.link for name, frame in robot.frames.items()} == {"b": -1}


def test_long_chain_needs_no_recursion() -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(1000))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/></joint>' for i in range(999)
    )
    assert urdf(links + joints).dof == 999


def test_fixed_links_are_merged_named_and_framed() -> None:
    ball = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    robot = urdf(
        f'<link name="base">{ball}</link><link name="arm"/><link name="hand">{ball}</link><link name="tip"/>'
        '<joint name="j" type="revolute"><parent link="base"/><child link="arm"/></joint>'
        '<joint name="f" type="fixed"><parent link="arm"/><child link="hand"/><origin xyz="3 0 0"/></joint>'
        '<joint name="g" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0 1 0" rpy="0 0 0"/></joint>'
    )
    (link,) = robot.links
    assert (link.name, link.fixed) == ("arm", ("hand", "tip"))
    assert link.inertia is not None
    np.testing.assert_allclose(link.inertia.vector, [1, 0, 0, 19, 0, 19, 6, 0, 0, 2], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(robot.frames["tip"].translation, [3, 1, 0])
    assert robot.tool == ""


def test_inertia_is_none_only_where_no_part_has_one() -> None:
    assert one_joint("").links[0].inertia is None
    zero = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
    inertia = one_joint("", link=zero).links[0].inertia
    assert inertia is not None and inertia.defect() == "the mass is 0 kg"


def test_impossible_tensor_is_kept_for_the_verdict() -> None:
    body = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="5"/></inertial>'
    inertia = one_joint("", link=body).links[0].inertia
    assert inertia is not None and "triangle inequality" in inertia.defect()


def test_inertial_origin_turns_the_tensor_into_link_axes() -> None:
    body = (
        f'<inertial><origin xyz="0 0 0" rpy="0 0 {math.pi / 2}"/><mass value="1"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial>'
    )
    inertia = one_joint("", link=body).links[0].inertia
    assert inertia is not None
    np.testing.assert_allclose(np.diag(inertia.rotational), [2, 1, 2.5], rtol=0.0, atol=1e-15)


def test_joint_defaults_of_the_format() -> None:
    (joint,) = one_joint("").joints
    assert joint.axis.tolist() == [1, 0, 0]
    assert joint.rotation.tolist() == np.eye(3).tolist()
    assert (joint.limits.lower, joint.limits.upper, joint.limits.effort) == (-math.inf, math.inf, math.inf)
    assert (joint.damping, joint.friction, joint.mimic) == (None, None, None)


@pytest.mark.parametrize(("moment", "hides"), [(0.004, True), (0.4, False)])
def test_the_fixed_link_that_states_an_impossible_inertia_is_named(moment: float, hides: bool) -> None:
    """Whether the sum with its carrier is possible or not."""
    words = '<inertial><mass value="3"/><inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial>'
    own, tool = words.format(0.02, 0.03, 0.025), words.format(0.001, 0.001, moment)
    text = f"""<robot name="r"><link name="base"/><link name="arm">{own}</link><link name="tool">{tool}</link>
      <link name="tip"/><joint name="a" type="continuous"><parent link="base"/><child link="arm"/></joint>
      <joint name="b" type="KIND"><parent link="arm"/><child link="tool"/></joint>
      <joint name="c" type="fixed"><parent link="tool"/><child link="tip"/></joint></robot>"""
    robot = read_urdf("arm.urdf", text.replace("KIND", "fixed").encode())
    locked = read_urdf("arm.urdf", text.replace("KIND", "continuous").encode()).locked({"b": 0.0})
    why = f"tool: the principal moments 0.001, 0.001, {moment:g} kg m^2 break the triangle inequality"
    assert robot.links[0].impossible == locked.links[0].impossible == why
    assert consistency_defects(robot.links) == ({} if hides else {"arm": why})
    assert robot_to_dict(robot_from_dict(robot_to_dict(robot))) == robot_to_dict(robot)


def test_axis_is_normalised_and_a_fixed_joint_may_have_none() -> None:
    (joint,) = one_joint('<axis xyz="0 3 4"/>').joints
    np.testing.assert_allclose(joint.axis, [0, 0.6, 0.8], rtol=0.0, atol=1e-16)
    robot = urdf(
        '<link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="f" type="fixed"><parent link="b"/><child link="c"/><axis xyz="0 0 0"/></joint>'
        '<joint name="j" type="prismatic"><parent link="a"/><child link="b"/></joint>'
    )
    assert robot.joints[0].kind == "prismatic"


def test_limits_of_each_version() -> None:
    (joint,) = one_joint(
        '<limit lower="-1" upper="inf" velocity="2" effort="3" acceleration="5" deceleration="4" jerk="6"/>'
        '<dynamics friction="0.25" damping="0.5"/>'
    ).joints
    limits = joint.limits
    assert (limits.lower, limits.upper, limits.velocity, limits.effort) == (-1, math.inf, 2, 3)
    assert (limits.acceleration, limits.jerk, limits.effort_rate) == (4, 6, math.inf)
    assert (joint.damping, joint.friction) == (0.5, 0.25)


def test_missing_bounds() -> None:
    limits = one_joint('<limit upper="1.5"/>', "prismatic").joints[0].limits
    assert (limits.lower, limits.upper, limits.velocity) == (0, 1.5, math.inf)
    limits = one_joint('<limit lower="7" upper="-7" effort="1" velocity="2"/>', "continuous").joints[0].limits
    assert (limits.lower, limits.upper, limits.velocity) == (-math.inf, math.inf, 2)
    limits = one_joint('<limit lower="-1.7976931348623157e308" upper="1e60"/>').joints[0].limits
    assert (limits.lower, limits.upper) == (-1.7976931348623157e308, 1e60)


@pytest.mark.parametrize("limit", ["", "<limit/>", '<limit effort="3" velocity="2"/>'])
def test_a_joint_without_bounds_is_unbounded_and_the_note_names_it(limit: str) -> None:
    robot = one_joint(limit)
    assert (robot.joints[0].limits.lower, robot.joints[0].limits.upper) == (-math.inf, math.inf)
    assert robot.joints[0].limits.effort == (3 if "effort" in limit else math.inf)
    assert robot.note == "read from arm.urdf; no position limits of j: neither lower nor upper in <limit>"
    for kind, bounds in (
        ("continuous", limit),
        ("revolute", '<limit upper="1"/>'),
        ("prismatic", '<limit lower="-1"/>'),
    ):
        assert one_joint(bounds, kind).note == "read from arm.urdf"


@pytest.mark.parametrize("quaternion", ["0.1 -0.7 0.5 0.5", "0 0 0.3826834323650898 -0.9238795325112867"])
def test_quaternion_origin(quaternion: str) -> None:
    x, y, z, w = (values := np.array(quaternion.split(), dtype=float)) / np.linalg.norm(values)
    sine = float(np.linalg.norm([x, y, z]))
    expected = rotation_about(np.array([x, y, z]) / sine, 2 * math.atan2(sine, w))
    (joint,) = one_joint(f'<origin quat_xyzw="{quaternion}" xyz="1 2 3"/>').joints
    np.testing.assert_allclose(joint.rotation, expected, rtol=0.0, atol=1e-15)
    assert joint.translation.tolist() == [1, 2, 3]


def test_mimic_chain_is_multiplied_out() -> None:
    def joint(name: str, child: str, mimic: str) -> str:
        return f'<joint name="{name}" type="revolute"><parent link="base"/><child link="{child}"/>{mimic}</joint>'

    robot = urdf(
        "".join(f'<link name="{name}"/>' for name in ("base", "a", "b", "c"))
        + joint("ja", "a", '<mimic joint="jb" multiplier="2" offset="0.5"/>')
        + joint("jb", "b", '<mimic joint="jc" multiplier="-3" offset="1"/>')
        + joint("jc", "c", "")
    )
    first, second, last = robot.joints
    assert first.mimic is not None and second.mimic is not None and last.mimic is None
    assert (first.mimic.joint, first.mimic.multiplier, first.mimic.offset) == ("jc", -6, 2.5)
    assert (second.mimic.joint, second.mimic.multiplier, second.mimic.offset) == ("jc", -3, 1)
    assert robot.joint_names == ("jc",)
    with pytest.raises(BadOption):
        robot.locked({"jc": 0.0})


def test_the_first_of_two_origins_counts_and_the_note_says_so() -> None:
    robot = one_joint('<origin xyz="1 0 0"/><origin xyz="2 0 0"/>', "continuous")
    assert robot.joints[0].translation.tolist() == [1, 0, 0]
    assert robot.note == "read from arm.urdf; joint 'j': the first of 2 <origin> counts"


def test_other_elements_are_passed_over() -> None:
    robot = urdf(
        '<material name="m"><color rgba="1 1 1 1"/></material>'
        '<link name="base"><visual><origin xyz="a"/><geometry><mesh filename="package://x/../../etc/y"/></geometry></visual></link>'
        '<link name="arm"><collision><geometry><box size="1 2 3"/><c d="b"/></geometry><x/></collision></link>'
        '<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><safety_controller k="x"/></joint>'
        '<transmission name="t"><joint name="j"><x/></joint><mechanicalReduction>x</mechanicalReduction></transmission>'
        '<gazebo reference="arm"><sensor:camera name="c"/><plugin path="$(find x)"/></gazebo>'
        '<ros2_control><joint name="j"><param name="k">1</param></joint></ros2_control>'
    )
    assert robot.joint_names == ("j",)


def test_other_encodings() -> None:
    text = '<?xml version="1.0" encoding="{}"?><robot name="Kühn"><link name="a"/><link name="b"/>{}</robot>'
    joint = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint>'
    for encoding in ("utf-8", "utf-16", "latin-1"):
        data = text.format(encoding, joint).encode(encoding)
        assert read_urdf("arm.urdf", data).name == "Kühn"


def test_the_largest_numbers_do_not_overflow() -> None:
    link = '<inertial><origin xyz="1e50 1e50 1e50" rpy="0 0 0.5"/><mass value="1e50"/>'
    moments = '<inertia ixx="1e50" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial>'
    body = one_joint("", "continuous", link + moments).links[0].inertia
    assert body is not None and np.all(np.isfinite(body.vector))
