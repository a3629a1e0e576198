"""An SDF read again by the rules of its specification: poses relative to frames, bodies, axes, drives.

Read is what :mod:`_sdf_text` writes, and no more; a reader of its own, so that the proof does not repeat the writer.
"""

from __future__ import annotations

from xml.etree.ElementTree import Element

import numpy as np
from defusedxml import ElementTree

from dynident.arrays import Array
from dynident.model.descriptions.base import rotation_from_rpy
from dynident.model.inertia import Inertia
from dynident.model.robot import Drive, Joint, Link, Mimic, Robot

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
