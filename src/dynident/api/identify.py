"""identify: a case, or a model and its logs, to an estimate, with the defaults of the command line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynident.api.case_logs import log_quality, read_data
from dynident.api.case_options import estimator_of, prior_of
from dynident.case.case import Case
from dynident.data.formats import ColumnMap
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.errors import BadOption
from dynident.files import sha256_of
from dynident.identification.build_problem import PriorKnowledge
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators import Estimator
from dynident.identification.identify import identify as identify_model
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.model.dynamic_model import DynamicModel

if TYPE_CHECKING:
    from dynident.identification.streaming.digest import Digest

#: What is found out about how far to trust an estimate where nothing else is asked for.
DEFAULT_TRUST = TrustOptions(diagnose=True, sensitivity=True)


@dataclass(frozen=True)
class Record:
    """What is kept beside an estimate.

    Attributes:
        columns: How the logs were read, so that other logs of the robot are read alike; None: that of the case.
        command: What was typed, to be repeated; empty for nothing.
        with_log_quality: Keep what the checks find in the logs of the case.
    """

    columns: ColumnMap | None = None
    command: str = ""
    with_log_quality: bool = False


def identify(
    subject: Case | DynamicModel,
    logs: Sequence[Log] | Digest | None = None,
    estimator: str | Estimator | None = None,
    preprocessing: Preprocessing | None = None,
    *,
    knowledge: PriorKnowledge | None = None,
    trust: TrustOptions = DEFAULT_TRUST,
    record: Record | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Estimate:
    """Identify the base parameters of a robot from logs.

    Args:
        subject: The case, or the dynamic model. To choose the friction from the logs, give a case that says so.
        logs: Raw logs with positions and torques, or a digest of them; None for those of the case that train.
        estimator: Name or part; None for that of the case, else ``consistent``.
        preprocessing: How logs become rows; None for that of the case, else the default of :class:`Case`.
        knowledge: What is known about the bodies beforehand; None for that of the case.
        trust: What is found out about how far to trust the estimate.
        record: What is kept beside the estimate.
        progress: Told each step in words.

    Raises:
        BadOption: A model without logs, one fold, or too few draws.
        ContradictoryConstraints: No robot meets the constraints.
        LogMismatch: A log does not fit the robot, or is too short.
        PoorExcitation: The logs do not determine all base parameters.
        SolverFailed: The estimator found no checked solution.
    """
    record = record or Record()
    if isinstance(subject, DynamicModel):
        if logs is None:
            raise BadOption("logs", None, "give logs with a model, or a case that names its logs")
        part, choose_friction, columns, provenance = estimator or "consistent", False, record.columns, {}
        model = subject
    else:
        model, choose_friction, columns = subject.model, subject.choose_friction, record.columns or subject.columns
        part = estimator_of(subject) if estimator is None else estimator
        preprocessing = preprocessing or subject.preprocessing
        knowledge = knowledge or PriorKnowledge(subject.constraints, prior_of(subject))
        logs = read_data(subject).train if logs is None else logs
        provenance = _provenance(subject, record, progress)
    if not isinstance(logs, Sequence):
        from dynident.identification.streaming.estimate import identify_digest

        known = knowledge or PriorKnowledge()
        return identify_digest(logs, part, known.constraints, known.prior, provenance, progress)
    estimate = identify_model(
        model,
        logs,
        part,
        preprocessing,
        choose_friction=choose_friction,
        knowledge=knowledge,
        trust=trust,
        progress=progress,
    )
    estimate = estimate if columns is None else replace(estimate, columns=columns)
    return replace(estimate, provenance={**estimate.provenance, **provenance})


def _provenance(case: Case, record: Record, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the facts of a case that go with an estimate."""
    facts: dict[str, Any] = {"command": record.command} if record.command else {}
    if case.path:
        facts["case"] = {"path": case.path, "sha256": sha256_of(case.path)}
    if Path(case.robot_path).is_file():
        facts["robot"] = {"path": case.robot_path, "sha256": sha256_of(case.robot_path)}
    if record.with_log_quality:
        progress("looking at the logs")
        facts["log_quality"] = log_quality(case)
    return facts
