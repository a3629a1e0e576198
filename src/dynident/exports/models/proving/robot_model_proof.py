"""Written robot models loaded again: by the strict readers, and by engines that are installed.

A URDF is loaded with the file beside it too; a user's own MJCF by MuJoCo among the user's other files; a user's SDF by
Drake without the shapes of its links.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.base import Reloaded
from dynident.exports.models.proving.engines import (
    drake_torque,
    drake_version,
    mujoco_torque,
    mujoco_version,
    pinocchio_torque,
    pinocchio_version,
)
from dynident.exports.models.subject.drives import drives_of, rigid_torque
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.subject.states import StateSet, states_of
from dynident.exports.models.writing.document import read_document
from dynident.exports.models.writing.mjcf_own import PatchedMjcf
from dynident.exports.models.writing.placement import place
from dynident.exports.models.writing.sdf_text import PatchedSdf, base_name
from dynident.exports.models.writing.xml_edit import without_elements
from dynident.model.dynamic_model import DynamicModel
from dynident.model.joint import Joint
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.robot_files.formats.urdf import read_urdf, read_urdf_bodies
from dynident.robot_files.sdf_model import read_sdf_model
from dynident.robot_files.tree import Connection

_WHAT = "bodies, damping, Coulomb friction"


def reload_urdf(subject: Identified, path: Path, beside: Path) -> Iterator[Reloaded]:
    """Load a URDF again in every engine that reads one."""
    robot, states = locked_of(subject, path)
    expected = rigid_torque(subject, states.motion) + drives_of(subject).torque(
        states.motion, armature=False, coupled=False
    )
    expected = expected + stated_friction(subject, robot, states)
    yield Reloaded("dynident", _WHAT, _own_torque(robot, states), expected)
    model, theta, _ = read_document(beside)
    whole = _joined(robot, model.robot, subject)
    joined = DynamicModel(whole, model.friction)
    nominal = whole.nominal
    assert nominal is not None
    values = np.concatenate([nominal, theta[model.inertial_count :]])
    full = subject.model.torque(states.motion, subject.theta)
    yield Reloaded("dynident", "with the file beside it: everything", joined.torque(states.motion, values), full)
    if name := pinocchio_version():
        yield _asked(name, subject, path, lambda file: pinocchio_torque(file, "urdf", states), expected)
    else:
        yield Reloaded("Pinocchio", why_not="not installed")
    if name := mujoco_version():
        yield _asked(name, subject, path, lambda file: mujoco_torque(file, "urdf", states), expected)
    else:
        yield Reloaded("MuJoCo", why_not="not installed")


def _asked(name: str, subject: Identified, path: Path, torque: Callable[[Path], Array], expected: Array) -> Reloaded:
    """Return what an engine makes of a URDF; it is excused where it does not load the user's own file either."""
    try:
        return Reloaded(name, _WHAT, torque(path), expected)
    except Exception as error:
        source = subject.source
        if source is None or not source.is_urdf:
            raise
        own = path.with_name("own.urdf")
        own.write_bytes(source.data)
        try:
            torque(own)
        except Exception:  # an engine of others may raise anything
            reason = " ".join(str(error).split())[:150]
            return Reloaded(name, why_not=f"it does not load your own URDF either ({reason})")
        raise


def locked_of(subject: Identified, path: Path) -> tuple[Robot, StateSet]:
    """Return the robot of a written URDF with the model's locked joints, and states that hold those still."""
    data, known = path.read_bytes(), subject.model.robot
    locked = place(path, known, *read_urdf_bodies(path, data)).locked
    robot = read_urdf(path, data).with_gravity(known.gravity)
    leaders = {name: position for name, position in locked.items() if name in robot.joint_names}
    found = robot.locked(leaders) if leaders else robot
    return _ordered(found, [joint.name for joint in known.joints]), states_of(subject.model, locked)


def _ordered(robot: Robot, names: Sequence[str]) -> Robot:
    """Return the robot with its joints in the order of the model; a reader takes them depth first."""
    old = [joint.name for joint in robot.joints]
    order = [old.index(name) for name in names]
    parent = {-1: -1, **{before: after for after, before in enumerate(order)}}
    joints = tuple(replace(robot.joints[i], parent=parent[robot.joints[i].parent]) for i in order)
    return replace(robot, links=tuple(robot.links[i] for i in order), joints=joints, frames={}, tool="")


def _joined(robot: Robot, known: Robot, subject: Identified) -> Robot:
    """Return the file's robot with the drives of the document."""
    drives: dict[str, Any] = {joint.name: joint.drive for joint in known.active}
    return replace(robot.with_drives(drives, known.coupling), gravity=subject.model.robot.gravity)


def _own_torque(robot: Robot, states: StateSet) -> Array:
    motion = states.motion
    assert robot.nominal is not None
    rigid = batched.inverse_dynamics(robot.chain, robot.nominal, motion.q, motion.dq, motion.ddq)
    damping, dry = (np.array([getattr(j, key) or 0.0 for j in robot.active]) for key in ("damping", "friction"))
    return rigid + motion.dq * damping + np.sign(motion.dq) * dry


def stated_friction(subject: Identified, robot: Robot, states: StateSet) -> Array:
    """Return the friction that the file states for joints of which the model has none, shape (N, n)."""
    drives = drives_of(subject)
    untold = ~np.any((drives.coupling != 0) & drives.has_friction[:, None], axis=0)
    damping, dry = (np.array([getattr(j, key) or 0.0 for j in robot.active]) for key in ("damping", "friction"))
    return states.motion.dq * damping * untold + np.sign(states.motion.dq) * dry * untold


_WITH_ROTORS = "bodies, armature, damping, Coulomb friction"


def reload_mjcf(
    subject: Identified, source: OwnDescription, patched: PatchedMjcf, files: Mapping[Path, bytes], folder: Path
) -> Iterator[Reloaded]:
    """Load the changed files again, by dynident and by MuJoCo where it is installed."""
    states = states_of(subject.model, patched.placement.locked)
    expected = rigid_torque(subject, states.motion) + _drive_torque(patched, states)
    yield Reloaded("dynident", _WITH_ROTORS, own_torque(patched.after.robot(), states), expected)
    name = mujoco_version()
    if not name:
        yield Reloaded("MuJoCo", why_not="not installed")
        return
    main = mirrored(source.path, files, folder)
    try:
        yield Reloaded(name, _WITH_ROTORS, mujoco_torque(main, "mjcf", states, bodies_only=True), expected)
    except Exception as error:  # an engine of others may raise anything
        try:
            mujoco_torque(source.path, "mjcf", states, bodies_only=True)
        except Exception:
            reason = " ".join(str(error).split())[:150]
            yield Reloaded(name, why_not=f"it gives no torques of your own MJCF either ({reason})")
            return
        raise


def own_torque(robot: Robot, states: StateSet) -> Array:
    """Return the torque of the bodies and joints that a file states, shape (N, n), in N m or N."""
    names = [joint.name for joint in robot.active]
    assert robot.nominal is not None
    found = states.gather(names, batched.inverse_dynamics(robot.chain, robot.nominal, *states.of(names)))
    for joint in robot.joints:
        found = found + at_joint(joint.name, _stated(joint), states)
    return found


def at_joint(name: str, values: tuple[float, float, float], states: StateSet) -> Array:
    """Return the torque of rotor inertia, viscous and Coulomb friction of one joint of a file, shape (N, n)."""
    _, dq, ddq = states.of([name])
    return states.gather([name], values[0] * ddq + values[1] * dq + values[2] * np.sign(dq))


def _stated(joint: Joint | Connection) -> tuple[float, float, float]:
    return joint.drive.reflected_inertia, joint.damping or 0.0, joint.friction or 0.0


def _drive_torque(patched: PatchedMjcf, states: StateSet) -> Array:
    """Return the torque of drives that the changed file has to have: the model's, and what was left as it was."""
    found = np.zeros_like(states.motion.q)
    for joint in patched.before.connections:
        if joint.kind == "fixed":
            continue
        new = patched.tags.get(joint.name, (None, None, None))
        values = tuple(old if value is None else value for value, old in zip(new, _stated(joint), strict=True))
        found = found + at_joint(joint.name, (values[0], values[1], values[2]), states)
    return found


def mirrored(own: Path, files: Mapping[Path, bytes], folder: Path) -> Path:
    """Return the main file at its place in a copy of the file tree, with links to the user's own and other files.

    What is in the folder of the user's file and in the one above it is there, beside the files that are written.
    """
    home, main = own.resolve().parent, next(iter(files)).resolve()
    root = folder / "tree"
    copies = {one: root / one.relative_to(one.anchor) for one in (main.parent, home, home.parent)}
    for copy in copies.values():
        copy.mkdir(parents=True, exist_ok=True)
    for file, data in files.items():
        (copies[main.parent] / file.name).write_bytes(data)
    for target in (home, home.parent):
        for entry in target.iterdir():
            if not os.path.lexists(copies[target] / entry.name):
                os.symlink(entry, copies[target] / entry.name)
    return copies[main.parent] / main.name


def sdf_by_reader(subject: Identified, path: Path, states: StateSet) -> Reloaded:
    """Return the torques of an SDF by the strict reader."""
    found = _torque_under(subject, read_sdf_model(path, path.read_bytes()).robot(), states)
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
            smooth = smooth + at_joint(joint.name, (rotor, damping, 0.0), states)
            dry = dry + at_joint(joint.name, (0.0, 0.0, level), states)
    robot = read_sdf_model(source.path, patched.data).robot()
    found = _torque_under(subject, robot, states)
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


def _torque_under(subject: Identified, robot: Robot, states: StateSet) -> Array:
    """Return the torque of an SDF under the gravity of the model: an SDF leaves it to the world."""
    return own_torque(robot.with_gravity(subject.model.robot.gravity), states)
