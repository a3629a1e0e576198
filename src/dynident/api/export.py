"""export: an estimate for simulators, controllers and papers, or a plan for a robot's controller, as proved files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import overload

from dynident.api.given_logs import LogLike, logs_of
from dynident.api.validate import read_log
from dynident.data.log import Log
from dynident.errors import BadOption, FileError
from dynident.excitation.design.plan import Plan, read_plan
from dynident.exports.models import MODEL_EXPORTERS, ModelExport, ModelExporter, export_model
from dynident.exports.motions import MOTION_EXPORTERS, MotionExport, MotionExporter, Playback, export_motion
from dynident.files import check_outputs, files_behind, unreadable
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.files.estimate_file import KIND, read_estimate


@overload
def export(
    subject: Estimate,
    exporter: str | ModelExporter,
    path: str | Path,
    *,
    description: str | Path | None = None,
    proof: bool | LogLike = True,
    write: bool = True,
    force: bool = False,
) -> ModelExport: ...
@overload
def export(
    subject: Plan,
    exporter: str | MotionExporter,
    path: str | Path,
    *,
    playback: Playback | None = None,
    write: bool = True,
) -> MotionExport: ...
def export(
    subject: Estimate | Plan,
    exporter: str | ModelExporter | MotionExporter,
    path: str | Path,
    *,
    description: str | Path | None = None,
    proof: bool | LogLike = True,
    playback: Playback | None = None,
    write: bool = True,
    force: bool = False,
) -> ModelExport | MotionExport:
    """Write an identified model, or a plan: every file whole or not at all.

    Args:
        subject: The estimate or the plan.
        exporter: Name of an exporter, or a part with its options, such as
            ``MOTION_EXPORTERS.make("csv", {"degrees": True})``.
        path: The file to write (for a bag: the folder); further files stand beside it.
        description: Of an estimate: the robot model to put the values into, for targets that are one; None takes the
            one that the estimate's provenance names, where it is unchanged.
        proof: Of an estimate: whether the files are loaded again and torques compared. A log, as :func:`log_of` takes
            it: also that the model follows its motion in simulation, up to 10 s of it, under computed torque and PD.
        playback: Of a plan: how it is to be driven; None: once, at the designed speed and the rate of the target.
        write: False checks and tells what would be written.
        force: Of an estimate: export one that findings of the log checks at error level speak against.

    Raises:
        NotAccepted: Findings of the log checks at error level speak against the estimate.
        UnknownChoice: No such exporter.
        BadOption: An option that goes with the other kind of subject, or that cannot be.
        NotConsistent: No physically consistent robot has the base parameters of the estimate.
        DescriptionError: The robot model is faulty, or of another robot.
        FileError: The plan passes a bound, the proof fails, a simulation diverges, a file cannot be written, or the
            estimate was made from it.
        LogMismatch: The log of the motion does not fit the robot.
    """
    check_target(subject, exporter)
    if isinstance(subject, Plan):
        if description is not None or proof is not True:
            name, value = ("proof", proof) if proof is not True else ("description", description)
            raise BadOption(name, str(value), "it goes with an estimate, not with a plan")
        return export_motion(subject, exporter, path, playback, write=write)  # type: ignore[arg-type]
    if playback is not None:
        raise BadOption("playback", playback, "it goes with a plan, not with an estimate")
    check_outputs((str(path),), files_behind(subject.provenance))
    return export_model(
        subject,
        exporter,  # type: ignore[arg-type]
        path,
        description=description,
        proof=proof is not False,
        motion=None if isinstance(proof, bool) else followed_log(subject, proof),
        write=write,
        force=force,
    )


def followed_log(estimate: Estimate, motion: LogLike) -> Log:
    """Return the log whose motion a model is to follow, read as those of the fit were.

    Raises:
        DynidentError: Any fault of the log.
    """
    return logs_of([motion], estimate.model.robot, lambda name: read_log(estimate, name))[0]


def read_subject(path: str, exporter: str = "") -> Estimate | Plan:
    """Return the estimate or the plan of a file, by what the file says that it is.

    Args:
        path: The file.
        exporter: Name of the exporter, which tells what a file of neither kind was meant to be.

    Raises:
        FileError: It cannot be read, or is neither.
    """
    if is_estimate(path):
        return read_estimate(path)
    try:
        return read_plan(path)
    except FileError:
        if exporter in MODEL_EXPORTERS.names():
            read_estimate(path)  # an estimate was meant: its reader says what is to be given
        raise


def is_estimate(path: str) -> bool:
    """Return whether a file states that it is an estimate; a file of neither kind is left to the reader of plans."""
    try:
        data = json.loads(Path(path).read_bytes())
    except OSError as error:
        raise unreadable(path, error) from error
    except (ValueError, RecursionError):
        return False
    return isinstance(data, dict) and data.get("kind") == KIND


def check_target(
    subject: Estimate | Plan, exporter: str | ModelExporter | MotionExporter, option: str = "exporter"
) -> None:
    """Refuse an exporter that takes the other kind of subject.

    Args:
        subject: The estimate or the plan.
        exporter: Name of an exporter, or a part.
        option: What the exporter is called in the message.

    Raises:
        BadOption: It does.
    """
    models, motions = MODEL_EXPORTERS.names(), MOTION_EXPORTERS.names()
    own, others = (motions, models) if isinstance(subject, Plan) else (models, motions)
    name = exporter if isinstance(exporter, str) else type(exporter).__module__.rsplit(".", 1)[-1]
    if name in others and name not in own:
        takes, given = ("an estimate", "a plan") if isinstance(subject, Plan) else ("a plan", "an estimate")
        raise BadOption(option, name, f"it takes {takes}, and this is {given}, for which there are: {', '.join(own)}")
