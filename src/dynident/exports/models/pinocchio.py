"""Pinocchio: a URDF and what a Model has beside it: armature, damping, friction, gravity."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving.engines import pinocchio_torque, pinocchio_version
from dynident.exports.models.proving.robot_model_proof import locked_of, stated_friction
from dynident.exports.models.subject.drives import Drives, drives_of, rigid_torque
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.document import document_bytes, friction_notes, left_out, place_beside
from dynident.exports.models.writing.urdf import written_urdf
from dynident.model.robot import Robot


@dataclass(frozen=True)
class Pinocchio(ModelExporter):
    """Pinocchio: a URDF and FILE.pinocchio.json with armature, damping, friction and gravity by joint name.

    Attributes:
        lump: Whether links fixed to a moving one lose their inertia to it, in place of keeping what the file states.
    """

    lump: bool = False

    suffix: ClassVar[str] = ".urdf"
    proof: ClassVar[str] = "bodies, armature, damping and Coulomb friction by Pinocchio"
    edits_description: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        drives = drives_of(subject)
        data, notes = written_urdf(subject, drives, self.lump)
        files = {
            path: data,
            path.with_name(f"{path.name}.pinocchio.json"): _settings(subject, drives),
            place_beside(path): document_bytes(subject, drives),
        }
        own = ["rnea has armature; it passes over damping and friction, and regressors pass over armature as well"]
        own += _mimic_notes(subject.model.robot)
        left = left_out(drives, armature=True, coupled=False)
        return ModelContent(files, left, (*notes, *own, *friction_notes(drives, "Pinocchio")))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        path, settings, _ = (folder / file.name for file in content.files)
        name = pinocchio_version()
        if not name:
            yield Reloaded("Pinocchio", why_not="not installed")
            return
        robot, states = locked_of(subject, path)
        expected = rigid_torque(subject, states.motion) + stated_friction(subject, robot, states)
        expected += drives_of(subject).torque(states.motion, armature=True, coupled=False)
        found: dict[str, Any] = json.loads(settings.read_bytes())
        values = {key: found[key] for key in ("armature", "damping", "friction")}
        torque = pinocchio_torque(path, "urdf", states, values)
        yield Reloaded(name, "bodies, armature, damping, Coulomb friction", torque, expected)


def _mimic_notes(robot: Robot) -> list[str]:
    """Return how joints that follow another are loaded; Pinocchio 4 ties no continuous joint to a bounded one."""
    endless = {joint.name: not np.isfinite([joint.limits.lower, joint.limits.upper]).all() for joint in robot.joints}
    follows = [(joint.name, joint.mimic.joint) for joint in robot.joints if joint.mimic is not None]
    if not follows:
        return []
    mixed = [name for name, leader in follows if endless[name] != endless[leader]]
    if mixed:
        told = f"of {', '.join(mixed)} and its leader one is continuous and one has bounds"
        return [f"Pinocchio refuses this URDF with mimic=True ({told}): load it without, and set followers yourself"]
    order = "it reads branches in the order of joint names, and a follower must come after its leader"
    return [
        "load it with mimic=True, or joints that follow another are free; "
        f"where Pinocchio refuses that ({order}), load it without and set followers yourself"
    ]


def _settings(subject: Identified, drives: Drives) -> bytes:
    """Return what a Model is told by joint name; joints of which the model has no friction are not named."""
    armature, damping, dry = drives.at_joints()
    known = np.any((drives.coupling != 0) & drives.has_friction[:, None], axis=0)
    told = [name for name, is_known in zip(drives.joints, known, strict=True) if is_known]
    facts = {
        "kind": "dynident pinocchio settings",
        "format": 1,
        "gravity": subject.model.robot.gravity.tolist(),
        "armature": dict(zip(drives.joints, armature.tolist(), strict=True)),
        "damping": {n: v for n, v in zip(drives.joints, damping.tolist(), strict=True) if n in told},
        "friction": {n: v for n, v in zip(drives.joints, dry.tolist(), strict=True) if n in told},
    }
    return (json.dumps(facts, indent=1, allow_nan=False) + "\n").encode("ascii")
