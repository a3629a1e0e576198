"""identify: logs, a model and an estimator to an estimate that states how far it can be trusted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.identification.build_problem import PriorKnowledge, build_problem
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators import ESTIMATORS, Estimator
from dynident.identification.fit import fit
from dynident.identification.selection.cutoff.sensitivity import with_cutoff_sensitivity
from dynident.identification.uncertainty.position_noise import without_noise
from dynident.identification.uncertainty.trust import TrustOptions, with_diagnostics
from dynident.identification.validate import with_nominal
from dynident.model.dynamic_model import DynamicModel
from dynident.model.threads import one_blas_thread


@one_blas_thread()
def identify(
    model: DynamicModel,
    logs: Sequence[Log],
    estimator: str | Estimator = "consistent",
    preprocessing: Preprocessing | None = None,
    *,
    choose_friction: bool = False,
    knowledge: PriorKnowledge | None = None,
    trust: TrustOptions | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> Estimate:
    """Identify the base parameters of a model from logs.

    Args:
        model: Robot, drives and friction; fields that its friction parts vary are found first.
        logs: Raw logs with positions and torques; each is preprocessed on its own.
        estimator: Name or part.
        preprocessing: How logs become rows; default: ``default_preprocessing``.
        choose_friction: Choose the friction from the logs, in place of the model's, from the parts of a draft.
        knowledge: What is known about the bodies beforehand.
        trust: What is found out about how far to trust the estimate; default: nothing beyond its covariance.
        progress: Called with each step in words.

    Raises:
        BadOption: One fold, or too few draws.
        ContradictoryConstraints: No robot meets the constraints.
        LogMismatch: A log does not fit the robot, or is too short.
        PoorExcitation: The logs do not determine all base parameters.
        SolverFailed: The estimator found no checked solution.
    """
    part, trust = ESTIMATORS.make(estimator), trust or TrustOptions()
    problem = build_problem(model, logs, preprocessing, progress, choose_friction, knowledge)
    estimate = fit(problem, part, progress)
    ordered = [log.ordered(model.robot.joint_names) for log in logs]
    estimate, problem = without_noise(estimate, problem, part, ordered, partial(fit, progress=progress))
    if trust.sensitivity:
        progress("other cut-offs")
        estimate = with_cutoff_sensitivity(estimate, problem, ordered)
    if trust.nominal:
        progress("nominal model")
        estimate = with_nominal(estimate, problem)
    if not (trust.diagnose or trust.bootstrap):
        return estimate
    progress("diagnostics")
    return with_diagnostics(estimate, problem, part, trust.folds, trust.bootstrap)
