"""A written SDF loaded again: by the strict reader, and by Drake where it is installed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.proving.engines import drake_torque, drake_version
from dynident.exports.models.proving.proof import Reloaded
from dynident.exports.models.subject.drives import drives_of, rigid_torque
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.subject.states import StateSet, states_of
from dynident.exports.models.writing.sdf_own import PatchedSdf
from dynident.exports.models.writing.sdf_text import base_name
from dynident.exports.models.writing.xml_edit import without_elements
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.robot_files.sdf_model import read_sdf_model


def sdf_by_reader(subject: Identified, path: Path, states: StateSet) -> Reloaded:
    """Return the torques of an SDF by the strict reader."""
    found = _own_torque(read_sdf_model(path, path.read_bytes()).robot(), subject, states)
    own = drives_of(subject).torque(states.motion, armature=True, coupled=False)
    what = "bodies, armature, damping, Coulomb friction"
    return Reloaded("dynident", what, found, rigid_torque(subject, states.motion) + own)


def sdf_by_drake(subject: Identified, path: Path, states: StateSet, package: str = "") -> Reloaded:
    """Return the torques of an SDF, or of directives that name one, by Drake."""
    name = drake_version()
    if not name:
        return Reloaded("Drake", why_not="not installed")
    base = base_name(subject.model.robot)
    found = drake_torque(path if package else path.read_text(encoding="utf-8"), states, base, package)
    own = drives_of(subject).torque(states.motion, armature=True, coupled=False, dry=False)
    return Reloaded(name, "bodies, armature, damping", found, rigid_torque(subject, states.motion) + own)


def reload_own_sdf(subject: Identified, source: OwnDescription, patched: PatchedSdf) -> Iterator[Reloaded]:
    """Load the changed file again by the strict reader, and by Drake without the shapes of its links."""
    states = states_of(subject.model, patched.placement.locked)
    smooth = rigid_torque(subject, states.motion)
    dry = np.zeros_like(smooth)
    for joint in patched.before.connections:
        if joint.kind != "fixed":
            damping, level = patched.tags.get(joint.name, (joint.damping or 0.0, joint.friction or 0.0))
            rotor = patched.rotors.get(joint.name, 0.0)
            smooth = smooth + _at_joint(joint.name, rotor, damping, 0.0, states)
            dry = dry + _at_joint(joint.name, 0.0, 0.0, level, states)
    robot = read_sdf_model(source.path, patched.data).robot()
    found = _own_torque(robot, subject, states)
    yield Reloaded("dynident", "bodies, armature, damping, Coulomb friction", found, smooth + dry)
    yield _own_by_drake(robot.base, patched.data, states, smooth)
    yield Reloaded("Gazebo", why_not="not a Python package; Drake reads with its parser, libsdformat")


def _own_by_drake(base: str, data: bytes, states: StateSet, expected: Array) -> Reloaded:
    """Return the torques of a user's file by Drake; what it cannot read is said, as the file was so before."""
    name = drake_version()
    if not name:
        return Reloaded("Drake", why_not="not installed")
    text = without_elements(data, ("visual", "collision")).decode("utf-8")
    try:
        found = drake_torque(text, states, base)
    except RuntimeError as error:
        return Reloaded(name, why_not=f"it does not read this file: {str(error).splitlines()[0][:200]}")
    return Reloaded(name, "bodies, armature, damping", found, expected)


def _own_torque(robot: Robot, subject: Identified, states: StateSet) -> Array:
    """Return the torque of the bodies and joints that a file states, shape (N, n), in N m or N."""
    robot = robot.with_gravity(subject.model.robot.gravity)
    names = [joint.name for joint in robot.active]
    assert robot.nominal is not None
    found = states.gather(names, batched.inverse_dynamics(robot.chain, robot.nominal, *states.of(names)))
    for joint in robot.joints:
        rotor = joint.drive.reflected_inertia
        found = found + _at_joint(joint.name, rotor, joint.damping or 0.0, joint.friction or 0.0, states)
    return found


def _at_joint(name: str, rotor: float, damping: float, dry: float, states: StateSet) -> Array:
    _, dq, ddq = states.of([name])
    return states.gather([name], rotor * ddq + damping * dq + dry * np.sign(dq))
