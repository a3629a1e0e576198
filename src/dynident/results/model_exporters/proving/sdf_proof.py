"""A written SDF loaded again: by a reader of the specification, and by Drake where it is installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynident.model.kernels import batched
from dynident.results.model_exporters.base import Reloaded
from dynident.results.model_exporters.proving import engine_drake
from dynident.results.model_exporters.proving.sdf_reader import read_sdf
from dynident.results.model_exporters.subject.drives import drives_of, rigid_torque
from dynident.results.model_exporters.subject.identified import Identified
from dynident.results.model_exporters.subject.states import States
from dynident.results.model_exporters.writing.sdf_text import base_name


def own_torque(subject: Identified, path: Path, states: States) -> Reloaded:
    """Return the torques of an SDF by the rules of the specification."""
    known, motion = subject.model.robot, states.motion
    follows = {joint.name: joint.mimic for joint in known.joints if joint.mimic is not None}
    robot = read_sdf(path.read_bytes(), known.gravity, follows)
    assert robot.nominal is not None
    rigid = batched.inverse_dynamics(robot.chain, robot.nominal, motion.q, motion.dq, motion.ddq)
    damping, dry = (np.array([getattr(j, key) or 0.0 for j in robot.active]) for key in ("damping", "friction"))
    found = rigid + motion.ddq @ robot.reflected_inertia + motion.dq * damping + np.sign(motion.dq) * dry
    expected = rigid_torque(subject, motion) + drives_of(subject).torque(motion, armature=True, coupled=False)
    return Reloaded("dynident", "bodies, armature, damping, dry friction", found, expected)


def drake_torque(subject: Identified, path: Path, states: States, package: str = "") -> Reloaded:
    """Return the torques of an SDF, or of directives that name one, by Drake."""
    name = engine_drake.version()
    if not name:
        return Reloaded("Drake", why_not="not installed")
    found = engine_drake.torque(path, states, base_name(subject.model.robot), package)
    own = drives_of(subject).torque(states.motion, armature=True, coupled=False, dry=False)
    return Reloaded(name, "bodies, armature, damping", found, rigid_torque(subject, states.motion) + own)
