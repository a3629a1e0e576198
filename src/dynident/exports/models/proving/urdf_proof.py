"""A written URDF loaded again: by the strict reader, with the file beside it, by Pinocchio, MuJoCo and Drake."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.proving.engines import mujoco_torque, mujoco_version, pinocchio_torque, pinocchio_version
from dynident.exports.models.proving.proof import Reloaded
from dynident.exports.models.subject.drives import drives_of, rigid_torque
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet, states_of
from dynident.exports.models.writing.document import read_document
from dynident.exports.models.writing.placement import place
from dynident.model.dynamic_model import DynamicModel
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.robot_files.formats.urdf import read_urdf, read_urdf_bodies

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
