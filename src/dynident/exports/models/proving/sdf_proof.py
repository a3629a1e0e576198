"""A written SDF loaded again: by a reader of the specification, and by Drake where it is installed."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from defusedxml import ElementTree

from dynident.arrays import Array
from dynident.exports.models.proving.engines import drake_torque, drake_version
from dynident.exports.models.proving.proof import Reloaded
from dynident.exports.models.subject.drives import drives_of, rigid_torque
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.sdf_text import base_name
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched
from dynident.model.robot import Drive, Joint, Link, Mimic, Robot
from dynident.robot_files.rotations import rotation_from_rpy


def sdf_by_reader(subject: Identified, path: Path, states: StateSet) -> Reloaded:
    """Return the torques of an SDF by the rules of the specification."""
    known, motion = subject.model.robot, states.motion
    follows = {joint.name: joint.mimic for joint in known.joints if joint.mimic is not None}
    robot = read_sdf(path.read_bytes(), known.gravity, follows)
    assert robot.nominal is not None
    rigid = batched.inverse_dynamics(robot.chain, robot.nominal, motion.q, motion.dq, motion.ddq)
    damping, dry = (np.array([getattr(j, key) or 0.0 for j in robot.active]) for key in ("damping", "friction"))
    found = rigid + motion.ddq @ robot.reflected_inertia + motion.dq * damping + np.sign(motion.dq) * dry
    expected = rigid_torque(subject, motion) + drives_of(subject).torque(motion, armature=True, coupled=False)
    return Reloaded("dynident", "bodies, armature, damping, Coulomb friction", found, expected)


def sdf_by_drake(subject: Identified, path: Path, states: StateSet, package: str = "") -> Reloaded:
    """Return the torques of an SDF, or of directives that name one, by Drake."""
    name = drake_version()
    if not name:
        return Reloaded("Drake", why_not="not installed")
    found = drake_torque(path, states, base_name(subject.model.robot), package)
    own = drives_of(subject).torque(states.motion, armature=True, coupled=False, dry=False)
    return Reloaded(name, "bodies, armature, damping", found, rigid_torque(subject, states.motion) + own)


_DRAKE = "{http://drake.mit.edu}"


def read_sdf(data: bytes, gravity: Array, follows: dict[str, Mimic]) -> Robot:
    """Return the robot of an SDF; joints that follow another, which SDF 1.7 cannot say, are told."""
    model = ElementTree.fromstring(data).find("model")
    assert model is not None
    joints = {_name(joint): joint for joint in model.findall("joint")}
    bodies = {_name(link): link for link in model.findall("link")}
    carried = {_text(joint, "child"): name for name, joint in joints.items()}
    (base,) = (name for name in bodies if name not in carried)
    order: list[str] = []
    for name in bodies:  # a link stands behind its parent in the file
        if name != base:
            order.append(name)
    links, moving = [], []
    for name in order:
        joint = joints[carried[name]]
        pose = bodies[name].find("pose")
        assert pose is not None and pose.get("relative_to") == _name(joint) and not _numbers(pose).any()
        parent = _text(joint, "parent")
        moving.append(_joint(joint, -1 if parent == base else order.index(parent), follows.get(_name(joint))))
        links.append(Link(name, _inertia(bodies[name])))
    return Robot(str(model.get("name")), tuple(links), tuple(moving), gravity, base=base)


def _joint(joint: Element, parent: int, mimic: Mimic | None) -> Joint:
    pose = joint.find("pose")
    assert pose is not None and pose.get("relative_to") == _text(joint, "parent")
    values = _numbers(pose)
    rotor, ratio = (float(joint.findtext(f"{_DRAKE}{key}") or default) for key, default in _ROTOR)
    return Joint(
        _name(joint),
        "prismatic" if joint.get("type") == "prismatic" else "revolute",
        parent,
        rotation_from_rpy(values[3:]),
        values[:3],
        np.array(_text(joint, "axis/xyz").split(), dtype=float),
        drive=Drive(ratio, rotor),
        mimic=mimic,
        damping=float(_text(joint, "axis/dynamics/damping")),
        friction=float(_text(joint, "axis/dynamics/friction")),
    )


_ROTOR = (("rotor_inertia", "0"), ("gear_ratio", "1"))


def _inertia(link: Element) -> Inertia:
    pose = link.find("inertial/pose")
    assert pose is not None
    values = _numbers(pose)
    ixx, ixy, ixz, iyy, iyz, izz = (
        float(_text(link, f"inertial/inertia/{key}")) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    turn = rotation_from_rpy(values[3:])
    tensor = turn @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ turn.T
    return Inertia.from_centre_of_mass(float(_text(link, "inertial/mass")), values[:3], tensor)


def _name(element: Element) -> str:
    return str(element.get("name"))


def _text(element: Element, path: str) -> str:
    found = element.findtext(path)
    assert found is not None
    return found


def _numbers(element: Element) -> Array:
    return np.array((element.text or "").split(), dtype=float)
