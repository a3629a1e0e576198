"""identify: a case, or a model and its logs, to an estimate, with the defaults of the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from dynident.api.case_logs import read_data
from dynident.api.case_options import estimator_of, prior_of
from dynident.api.given_logs import LogLike, case_of, check_kinds, logs_of
from dynident.api.given_robots import RobotLike
from dynident.api.log_checks import add_causes, check_logs, refuse_faulty, warn_of
from dynident.applications.standstill import with_rest_in_training
from dynident.applications.start_states import with_warm_starts
from dynident.case.case import Case
from dynident.case.mesh_bounds import with_mesh_points
from dynident.data.formats import ColumnMap
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.diagnosis.verdict import causes_against
from dynident.errors import BadOption, DynidentError
from dynident.files import sha256_of
from dynident.identification.build_problem import PriorKnowledge
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators import ESTIMATORS, Estimator
from dynident.identification.identify import identify as identify_model
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.model.dynamic_model import DynamicModel
from dynident.robot_files.robot_origin import robot_facts

if TYPE_CHECKING:
    from dynident.identification.streaming.digest import Digest

#: What is found out about how far to trust an estimate where nothing else is asked for.
DEFAULT_TRUST = TrustOptions(diagnose=True, sensitivity=True, nominal=True)

#: Folds of a cross-validation at most: a part more leaves a hundredth of the logs out, and its error is the same.
MOST_FOLDS = 100


@dataclass(frozen=True)
class Record:
    """What is kept beside an estimate: how its logs were read, what was typed, and what the log checks find.

    Attributes:
        columns: How the logs were read, so that other logs of the robot are read alike; None: that of the case.
        command: What was typed, to be repeated; empty for nothing.
        checks: Make the log checks; without them the verdict on the estimate says that they were not made.
        strict: Raise where a finding is at error level, in place of an estimate that is not accepted.
        quality: Findings that were made before the logs were reduced, as plain data; None for none.
    """

    columns: ColumnMap | None = None
    command: str = ""
    checks: bool = True
    strict: bool = False
    quality: Sequence[Mapping[str, Any]] | None = None


def identify(
    subject: Case | DynamicModel | RobotLike,
    logs: LogLike | Sequence[LogLike] | Digest | None = None,
    estimator: str | Estimator | None = None,
    preprocessing: Preprocessing | None = None,
    *,
    knowledge: PriorKnowledge | None = None,
    trust: TrustOptions = DEFAULT_TRUST,
    record: Record | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Estimate:
    """Identify the base parameters of a robot from logs, once the log checks have looked at them.

    A finding that leaves a fit without a meaning stops it. With any other finding at error level the fit runs, and
    :func:`verdict_of` of the estimate is ``not accepted``, and a Python warning has the cause; ``record`` can raise it.

    Args:
        subject: Case, file, model, robot (rotor inertia is chosen); ``read_case(path, friction="auto")`` chooses more.
        logs: One raw log or several, as :func:`log_of` takes them, or a digest; None for those of the case that train.
        estimator: Name or part; None for that of the case, else ``consistent``.
        preprocessing: How logs become rows; None for that of the case, else the default of :class:`Case`.
        knowledge: What is known about the bodies beforehand; None for that of the case.
        trust: What is found out about how far to trust the estimate.
        record: What is kept beside the estimate.
        progress: Called with each step in words.

    Raises:
        BadArgument: An argument of a wrong kind or shape; the message has the line that works.
        BadOption: A model without logs, too few or too many folds, or too few draws.
        NotAccepted: The unit of the time or a column makes no sense, or with ``strict`` any finding at error level.
        ContradictoryConstraints: No robot meets the constraints.
        LogMismatch: A log does not fit the robot, or is too short.
        PoorExcitation: The logs do not determine all base parameters.
        SolverFailed: The estimator found no checked solution.
    """
    _check_options(preprocessing, knowledge, trust, record, estimator)
    record, subject = record or Record(), case_of(subject, learns=not is_digest(logs))
    if logs is None and not subject.train and not subject.path:
        raise BadOption("logs", None, "give logs with a model, or a case that names its logs")
    case = subject if preprocessing is None else replace(subject, preprocessing=preprocessing)
    part = estimator_of(case) if estimator is None else estimator
    knowledge, provenance = knowledge or PriorKnowledge(case.constraints, prior_of(case)), _provenance(case, record)
    case = _with_meshes(case, provenance)
    if is_digest(logs):
        from dynident.identification.streaming.estimate import identify_digest

        return identify_digest(logs, part, knowledge.constraints, knowledge.prior, provenance, progress)
    logs = _logs_for(trust.folds, case, logs, "--cross-validate" if record.command else "folds")
    if record.checks:
        provenance["log_quality"] = check_logs(_solved_by(case, part), logs, progress)
        refuse_faulty(provenance["log_quality"], record.strict)
    known: dict[str, Any] = {"choose_friction": case.choose_friction, "knowledge": knowledge, "trust": trust}
    try:
        estimate = identify_model(case.model, logs, part, case.preprocessing, progress=progress, **known)
    except DynidentError as error:
        add_causes(error, provenance.get("log_quality", ()))
        raise
    estimate = _recorded(with_rest_in_training(with_warm_starts(estimate, logs), logs), case, record, provenance)
    warn_of(causes_against(estimate), record.command)
    return estimate


def _solved_by(case: Case, part: str | Estimator) -> Case:
    """Return a case with the name of another estimator: of a robust one no rows need to be left out."""
    name = part.partition(":")[0] if isinstance(part, str) else ESTIMATORS.name_of(part)
    return replace(case, estimator=replace(case.estimator, name=name))


def _logs_for(folds: int, case: Case, given: Any, name: str) -> Sequence[Log]:
    """Return the logs to learn from, and refuse folds that make no parts of them: as many samples each as parameters.

    Raises:
        BadOption: Fewer than two, or more than that.
    """
    logs = read_data(case).train if given is None else logs_of(given, case.robot, case.read)
    samples = sum(log.duration * min(log.rate, case.preprocessing.rows_hz(log.rate) or log.rate) for log in logs)
    most = int(np.clip(samples / len(case.model.parameters), DEFAULT_TRUST.folds, MOST_FOLDS))
    if folds and not 2 <= folds <= most:
        raise BadOption(name, folds, f"give 2 to {most} folds of the training logs, or 0 for none")
    return logs


def _recorded(estimate: Estimate, case: Case, record: Record, provenance: Mapping[str, Any]) -> Estimate:
    """Return an estimate with how its logs were read and what is kept beside it."""
    columns = record.columns or case.columns
    return replace(estimate, columns=columns, provenance={**estimate.provenance, **provenance})


def _with_meshes(case: Case, provenance: dict[str, Any]) -> Case:
    """Return a case whose links have the points of their meshes; meshes that cannot be read go into the provenance."""
    robot, faults = with_mesh_points(case.robot, case.robot_path, case.workspace.mesh_folders if case.workspace else ())
    if faults:
        provenance["meshes"] = [fault.figures() for fault in faults]
    return replace(case, robot=robot)


def is_digest(logs: object) -> TypeGuard[Digest]:
    """Return whether logs are given as QR factors."""
    return hasattr(logs, "chunks")


def _check_options(preprocessing: object, knowledge: object, trust: object, record: object, estimator: object) -> None:
    line = 'preprocessing=di.Preprocessing(di.FILTERS.make("butterworth", {"cutoff_hz": 5.0}))'
    check_kinds(
        {
            "preprocessing": (preprocessing, Preprocessing, line),
            "knowledge": (knowledge, PriorKnowledge, "knowledge=di.PriorKnowledge(constraints, prior)"),
            "trust": (trust, TrustOptions, "trust=di.TrustOptions(diagnose=True, bootstrap=100)"),
            "record": (record, Record, "record=di.Record(strict=True)"),
            "estimator": (estimator, str | Estimator, 'estimator="wls", or di.ESTIMATORS.make("ridge", {...})'),
        }
    )


def _provenance(case: Case, record: Record) -> dict[str, Any]:
    """Return the facts of a case that go with an estimate."""
    facts: dict[str, Any] = {"command": record.command} if record.command else {}
    if case.path:
        facts["case"] = {"path": case.path, "sha256": sha256_of(case.path)}
    if robot := robot_facts(case.robot_path):
        facts["robot"] = robot
    if case.accept:
        facts["accept"] = dict(case.accept.limits)
    if record.quality is not None:
        facts["log_quality"] = list(record.quality)
    return facts
