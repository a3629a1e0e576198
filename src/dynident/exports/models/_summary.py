"""What was exported: files, proofs, what the format cannot hold and the torque of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dynident.exports.base import Proof
from dynident.exports.models.proving.followed_motion import MotionProof
from dynident.exports.models.subject.drives import Term, drives_of, rigid_torque
from dynident.exports.models.subject.identified import NONE, Identified
from dynident.exports.models.subject.states import motion_of_fit


@dataclass(frozen=True, repr=False)
class ModelExport:
    """What an export of a model wrote, or would write.

    Attributes:
        exporter: Name of the exporter.
        robot: Name of the robot.
        estimator: Method of the estimate.
        parameters: Where the standard parameters are from: of the estimate, chosen behind its base parameters, none.
        files: The files, the one that was named first.
        proofs: What each engine made of them.
        motion: How the model follows the motion of a log in simulation; None where that was not asked for.
        left_out: Coefficients that the first file cannot hold; the file beside it has them.
        neglected: Root mean square of the torque that the first file cannot hold, by joint, in N m or N, over
            states like those in the logs of the fit; empty where it holds everything.
        notes: What the reader has to know.
        units: Of the torque, by joint: N m or N.
    """

    exporter: str
    robot: str
    estimator: str
    parameters: str
    files: tuple[str, ...]
    proofs: tuple[Proof, ...]
    motion: MotionProof | None
    left_out: tuple[Term, ...]
    neglected: Mapping[str, float]
    notes: tuple[str, ...]
    units: Mapping[str, str]

    def __repr__(self) -> str:
        engines = ", ".join(f"{one.engine}: {one.why_not}" if one.why_not else one.engine for one in self.proofs)
        return f"<ModelExport {self.exporter} of {self.robot}: {', '.join(self.files)}; proof by {engines or 'none'}>"


def model_export_data(export: ModelExport) -> dict[str, Any]:
    """Return an export as plain data: what ``dynident export --json`` prints."""
    data = asdict(export)
    for key in ("files", "notes", "proofs"):
        data[key] = list(data[key])
    data["motion"] = None if export.motion is None else export.motion.data()
    own = {"neglected": dict(export.neglected), "units": dict(export.units)}
    return data | {"left_out": [term.data() for term in export.left_out], **own}


def neglected_torque(subject: Identified, left_out: tuple[Term, ...]) -> dict[str, float]:
    """Return the torque of each joint, rms, that a format with some coefficients missing does not give."""
    if subject.origin == NONE or not left_out:
        return {}
    motion = motion_of_fit(subject.estimate)
    drives = drives_of(subject)
    lost = {term.held_as for term in left_out if drives.alone[drives.joints.index(term.joint)]}
    coupled = not any(term in left_out for term in drives.coupled_rest())
    taken = drives.torque(motion, armature="armature" not in lost, coupled=coupled, dry="friction" not in lost)
    if not any(term in left_out for term in drives.springs):
        taken = taken + drives.spring_torque(motion)
    held = rigid_torque(subject, motion) + taken
    rest = subject.model.torque(motion, subject.theta) - held
    return dict(zip(subject.model.robot.joint_names, np.sqrt(np.mean(rest**2, axis=0)).tolist(), strict=True))
