"""Exporters of models, a family: one target per part, and the verb that writes an estimate for it and proves the files.

The proof: the files are loaded again in every engine that is installed and reads them, and torques are compared on
1000 random states. Nothing is written where they differ by more than a millionth of the largest torque of a joint.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynident.data.log import Log
from dynident.diagnosis.verdict import causes_against
from dynident.errors import BadOption, FileError, NotAccepted
from dynident.exports.base import Proof, write_files
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving.followed_motion import MotionProof
from dynident.exports.models.subject.drives import Term, drives_of, rigid_torque
from dynident.exports.models.subject.identified import NONE, Identified, identified
from dynident.exports.models.subject.source import files_of, find_source, own_target
from dynident.exports.models.subject.states import motion_of_fit
from dynident.files import check_outputs
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import TOTAL_MASS, Plausibility
from dynident.plugins import Family

MODEL_EXPORTERS: Family[ModelExporter] = Family(
    "dynident.exports.models",
    ModelExporter,  # type: ignore[type-abstract]
    "model exporter",
    aliases={"simulink": "fmu", "c": "c_header", "mujoco": "mjcf", "gazebo": "sdf", "ros": "urdf", "python": "numpy"},
)

__all__ = [
    "MODEL_EXPORTERS",
    "Identified",
    "ModelContent",
    "ModelExport",
    "ModelExporter",
    "Proof",
    "Reloaded",
    "export_model",
    "model_export_data",
    "own_target",
]


def export_model(
    estimate: Estimate,
    exporter: str | ModelExporter,
    path: str | Path,
    *,
    description: str | Path | None = None,
    proof: bool = True,
    motion: Log | None = None,
    write: bool = True,
    force: bool = False,
) -> ModelExport:
    """Write an identified model for a simulator, a controller or a paper: every file whole, none unproved.

    Base parameters become physically consistent standard parameters with the same base parameters first.

    Args:
        estimate: The estimate.
        exporter: Name of an exporter, or a part with its options.
        path: The file to write; further files stand beside it.
        description: The robot model to put the model into; None takes that of the estimate, if it is unchanged.
        proof: Whether the files are loaded again and torques compared.
        motion: A log whose motion, up to 10 s of it, the model follows in simulation; None for no simulation.
        write: False checks and tells what would be written.
        force: Export an estimate that findings of the log checks at error level speak against.

    Raises:
        UnknownChoice: No such exporter.
        BadOption: An option or a name that cannot be, or a description where the target takes none.
        NotAccepted: A finding at error level speaks against the estimate, and ``force`` is not set.
        NotConsistent: No possible robot has these base parameters; the message names the worst body and what to do.
        DescriptionError: The robot model is faulty, or of another robot.
        FileError: A file of the robot model would be overwritten, the proof fails, a simulation diverges, or a file
            cannot be written.
        LogMismatch: The log of the motion does not fit the robot.
    """
    target, part = Path(path), MODEL_EXPORTERS.make(exporter)
    _check_part(part, description)
    if not force:
        _check_accepted(estimate)
    source = find_source(estimate, description)
    subject = identified(estimate, source, part.needs_bodies)
    content = part.content(subject, target)
    check_outputs(tuple(map(str, content.files)), (estimate.file, *files_of(source)))
    proofs = part.prove(subject, content, target) if proof else ()
    simulated = None if motion is None else _followed(subject, motion, target)
    if write:
        write_files(content.files, target)
    return ModelExport(
        exporter=MODEL_EXPORTERS.name_of(part),
        robot=subject.model.robot.name,
        estimator=estimate.estimator,
        parameters=subject.origin,
        files=tuple(str(file) for file in content.files),
        proofs=proofs,
        motion=simulated,
        left_out=content.left_out,
        neglected=neglected_torque(subject, content.left_out),
        notes=(*_body_notes(estimate), *subject.notes, *(() if part.remembers else subject.slipped), *content.notes),
        units=dict(zip(subject.model.robot.joint_names, subject.model.robot.units, strict=True)),
    )


def _body_notes(estimate: Estimate) -> list[str]:
    """Return the notes about masses that nothing determines and bodies beyond the bounds of plausible ones."""
    facts, notes = Plausibility.of(estimate.run), list[str]()
    if facts is None:
        return notes
    if named := [one for one in facts.contradicted if one.is_relaxed]:
        bounds = ", ".join(one.name if one.name == TOTAL_MASS else f"{one.bound} of {one.name}" for one in named)
        why = "beyond the bounds that the robot model gives, as the data contradict them"
        notes.append(f"{why}: {bounds}; check these bodies")
    if facts.massless:
        links = "all links" if len(facts.massless) == len(estimate.model.robot.links) else ", ".join(facts.massless)
        notes.append(
            f"masses of {links} are not known: torques are right, the bodies are one choice of many; state masses"
        )
    return notes


def _check_part(part: ModelExporter, description: str | Path | None) -> None:
    """Refuse a part that exports no models, and a robot model where the target takes none.

    Raises:
        BadOption: It is one.
    """
    if part.takes != "estimate":
        name = MODEL_EXPORTERS.name_of(part)
        raise BadOption("exporter", name, "it does not export models; see 'dynident list model_exporters'")
    if description is not None and not part.edits_description:
        step = f"the target {MODEL_EXPORTERS.name_of(part)} is written from the estimate alone; leave it out"
        raise BadOption("description", str(description), step)


def _check_accepted(estimate: Estimate) -> None:
    """Refuse an estimate that findings at error level speak against.

    Raises:
        NotAccepted: There is one.
    """
    for cause in causes_against(estimate):
        step = "correct it and identify again, or export with force (--force)"
        raise NotAccepted("the estimate is not accepted", str(cause), step)


def _followed(subject: Identified, motion: Log, target: Path) -> MotionProof:
    """Return what was simulated along the motion of a log.

    Raises:
        FileError: A run diverged.
        LogMismatch: The log does not fit the robot.
    """
    from dynident.exports.models.proving.motion_proof import prove_motion  # loads the simulator

    found = prove_motion(subject, motion)
    for run in found.failures:
        how = f"{run.simulator} under '{run.controller}' at {1e3 * run.step:g} ms"
        step = "identify with plausible links (--bodies plausible), or export without --prove"
        step = f"nothing was written; {found.contact or step}"
        raise FileError(target, f"the model does not follow the motion of {found.log} in {how}: {run.failure}", step)
    return found


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
