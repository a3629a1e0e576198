"""A user's MJCF with a model in it loaded again: by the strict reader, and by MuJoCo among the user's own files."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.exports.models.proving.engines import mujoco_torque, mujoco_version
from dynident.exports.models.proving.proof import Reloaded
from dynident.exports.models.subject.drives import rigid_torque
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.subject.states import StateSet, states_of
from dynident.exports.models.writing.mjcf_own import PatchedMjcf
from dynident.model.kernels import batched
from dynident.robot_files.mjcf.model import MjcfModel

_WHAT = "bodies, armature, damping, Coulomb friction"


def reload_mjcf(
    subject: Identified, source: OwnDescription, patched: PatchedMjcf, files: Mapping[Path, bytes], folder: Path
) -> Iterator[Reloaded]:
    """Load the changed files again, by dynident and by MuJoCo where it is installed."""
    states = states_of(subject.model, patched.placement.locked)
    expected = rigid_torque(subject, states.motion) + _drive_torque(patched, states)
    yield Reloaded("dynident", _WHAT, own_torque(patched.after, states, subject), expected)
    name = mujoco_version()
    if not name:
        yield Reloaded("MuJoCo", why_not="not installed")
        return
    main = mirrored(source.path, files, folder)
    try:
        yield Reloaded(name, _WHAT, mujoco_torque(main, "mjcf", states, bodies_only=True), expected)
    except Exception as error:  # an engine of others may raise anything
        try:
            mujoco_torque(source.path, "mjcf", states, bodies_only=True)
        except Exception:
            reason = " ".join(str(error).split())[:150]
            yield Reloaded(name, why_not=f"it gives no torques of your own MJCF either ({reason})")
            return
        raise


def own_torque(model: MjcfModel, states: StateSet, subject: Identified) -> Array:
    """Return the torque of the bodies and joints that a file states, shape (N, n), in N m or N."""
    robot = model.robot()
    joints = [joint.name for joint in robot.active]
    q, dq, ddq = states.of(joints)
    assert robot.nominal is not None
    rigid = batched.inverse_dynamics(robot.chain, robot.nominal, q, dq, ddq)
    found = states.gather(joints, rigid)
    for joint in robot.joints:
        values = (joint.drive.reflected_inertia, joint.damping or 0.0, joint.friction or 0.0)
        found = found + _at_joint(joint.name, values, states)
    return found


def _at_joint(name: str, values: tuple[float, float, float], states: StateSet) -> Array:
    _, dq, ddq = states.of([name])
    return states.gather([name], values[0] * ddq + values[1] * dq + values[2] * np.sign(dq))


def _drive_torque(patched: PatchedMjcf, states: StateSet) -> Array:
    """Return the torque of drives that the changed file has to have: the model's, and what was left as it was."""
    found = np.zeros_like(states.motion.q)
    for joint in patched.before.connections:
        if joint.kind == "fixed":
            continue
        own = (joint.drive.reflected_inertia, joint.damping or 0.0, joint.friction or 0.0)
        new = patched.tags.get(joint.name, (None, None, None))
        values = tuple(old if value is None else value for value, old in zip(new, own, strict=True))
        found = found + _at_joint(joint.name, (values[0], values[1], values[2]), states)
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
