"""Extended Kalman filter of states and base parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.errors import BadOption
from dynident.excitation.design.observation import Observation
from dynident.identification.consistency.consistent_fit import scale_of
from dynident.identification.estimators.wls import WLS
from dynident.identification.problem.estimator import Estimator, Solution
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.bands import Band
from dynident.identification.residuals.coloured import Influence, Uncertainty, uncertainty_of
from dynident.identification.residuals.stretches import LENGTH
from dynident.identification.simulated.course import Course, LoopOptions, course_of
from dynident.identification.simulated.iteration import start_of
from dynident.identification.simulated.joint_filter import (
    Belief,
    Innovations,
    Predictor,
    Tuning,
    filter_log,
    position_noise,
)
from dynident.plugins import bounded

#: Torques of a joint at rest are this many times less certain: its static friction is not known.
AT_REST = 100.0

#: Points of the course of the parameters in the run.
POINTS = 50


@dataclass(frozen=True, kw_only=True)
class KalmanRun(MethodRun):
    """Normalised innovation squared over n, mean of the last pass, about 1 where the tuning is right; passes."""

    innovation: float
    passes: int


@dataclass(frozen=True)
class Kalman(Estimator):
    """Extended Kalman filter with the base parameters among its states (Jazwinski 1970, section 8.3; Ljung 1979).

    The measured torques, with an error at each row, drive the model; the measured positions correct states, errors and
    parameters row by row. Slopes are those of the integration rule, exact, along the smoothed measured motion, so that
    noise of the torque is not in them. It starts from the physically consistent fit with a deviation of ``spread``
    natural sizes, far more than what the data leave open: the start serves to linearise, and each further pass starts
    anew from the parameters of the last one. Rows come at the log's own rate, before the log is thinned out: the filter
    wants them close. The covariance is taken from the innovations, which need not be white; with a drift it is the
    filter's own, times what the innovations are larger than tuned. About a millisecond a row of a 3R arm.

    Attributes:
        torque_noise: Standard deviation of the torques from row to row in N m or N; None: of the residuals of weighted
            least squares, before any filter.
        position_noise: Standard deviation of the positions in rad or m; None: from their fourth differences.
        spread: Standard deviation of the parameters at the start in natural sizes.
        drift: Standard deviation of their random walk over one second in natural sizes; 0 keeps them constant.
        passes: How often the logs are run through.
        slopes_hz: Cut-off in Hz of a zero-phase filter of the measured motion along which slopes are taken, well above
            the motion: noise in the slopes biases the parameters.
    """

    torque_noise: float | None = bounded(None, least=1e-15, most=1e6)
    position_noise: float | None = bounded(None, least=1e-15, most=1e6)
    spread: float = bounded(0.1, least=1e-12, most=1e6)
    drift: float = 0.0
    passes: int = bounded(1, most=1_000)
    slopes_hz: float = bounded(10.0, least=1e-3, most=1e5)

    def __post_init__(self) -> None:
        for name in ("torque_noise", "position_noise", "spread"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise BadOption(name, value, "give a standard deviation above 0")
        if not 0 < self.slopes_hz < np.inf:
            raise BadOption("slopes_hz", self.slopes_hz, "give a frequency in Hz above 0, such as 10")
        if not 0 <= self.drift < np.inf:
            raise BadOption("drift", self.drift, "give a standard deviation, 0 or more")
        if self.passes < 1:
            raise BadOption("passes", self.passes, "give 1 or more")

    def solve(self, problem: Problem) -> Solution:
        """Run the filter.

        Raises:
            NotConsistent: Parameters on the way cannot be simulated.
            SolverFailed: The motion is lost.
        """
        scale = scale_of(problem)
        size = problem.base.matrix * scale.parameters
        beta = start_of(problem)
        plain = WLS().solve(problem).beta
        observation = Observation(problem.model, problem.base)
        courses = [self._course(log) for log in problem.logs]
        tunings = [
            self._tuning(problem, i, plain, self.drift * np.linalg.norm(size, axis=1)) for i in range(len(courses))
        ]
        innovations: list[Innovations] = []
        course: list[tuple[float, list[float]]] = []
        belief = Belief(beta, self.spread**2 * size @ size.T)
        for _ in range(self.passes):
            belief = Belief(belief.beta, self.spread**2 * size @ size.T)
            innovations, course, seconds = [], [], 0.0
            for path, tuning in zip(courses, tunings, strict=True):
                watch = _watch(course, seconds, path, len(courses))
                predictor = Predictor(observation, path)
                belief, found = filter_log(predictor, path.log.log.q, belief, path.start, tuning, path.rate, watch)
                innovations.append(found)
                seconds += path.log.log.duration
        excess = float(np.mean(np.concatenate([seen.normalised for seen in innovations]))) / problem.model.robot.dof
        run = KalmanRun(
            innovation=excess,
            passes=self.passes,
            times=[time for time, _ in course],
            course=[values for _, values in course],
        )
        weights = 1.0 / problem.joint_deviations(belief.beta)
        if self.drift > 0:
            return Solution(belief.beta, weights, covariance=belief.covariance * max(excess, 1.0), run=run)
        sure = _uncertainty(belief, self.spread * size, innovations)
        return Solution(belief.beta, weights, covariance=sure.covariance, degrees=sure.degrees, run=run)

    def _course(self, log: Prepared) -> Course:
        """Return what drives the filter over a log, from the first measured state along the smoothed motion."""
        driven = course_of(log, LoopOptions(reference="measured"), "measured", known=False)
        calm = course_of(log, LoopOptions(reference="measured", reference_hz=self.slopes_hz), "none", known=False)
        return replace(driven, reference=calm.reference)

    def _tuning(self, problem: Problem, log: int, beta: Array, drift: Array) -> Tuning:
        prepared, mask = problem.logs[log], problem.masks[log]
        data = prepared.log
        joints = data.q.shape[1]
        floor = 1e-9 * np.ptp(data.q, axis=0) + 1e-12
        position = (
            position_noise(data.q) if self.position_noise is None else np.full(data.q.shape[1], self.position_noise)
        )
        if self.torque_noise is None:
            measured = np.asarray(data.torque if data.raw_torque is None else data.raw_torque)
            missed = (measured - RegressorStream(problem.model, problem.base).predict(data, beta))[prepared.keep]
            counting = np.maximum(mask.sum(axis=0), 1)
            torque = np.sqrt(np.sum(np.where(mask, missed, 0.0) ** 2, axis=0) / counting)
            torque = np.maximum(torque, 1e-9 * np.std(measured, axis=0) + 1e-12)
        else:
            torque = np.full(joints, self.torque_noise)
        nearest = np.clip(np.searchsorted(prepared.keep, np.arange(data.samples)), 0, len(prepared.keep) - 1)
        return Tuning(np.maximum(position, floor), torque * np.where(mask[nearest], 1.0, AT_REST), drift)


def _uncertainty(belief: Belief, prior: Array, innovations: Sequence[Innovations]) -> Uncertainty:
    """Return the covariance with innovations that need not be white; ``prior`` (b, p) is the root of the first one.

    Without drift the estimate is that of a regression of the innovations, of deviation one were all noise as it is
    tuned, on their slopes (Friedland 1969): its error is P (sum_t y_t' v_t + P0^-1 (beta_0 - beta)).
    """
    found = belief.covariance
    scale = np.sqrt(np.diag(found))
    first = np.linalg.inv((prior / scale[:, None]) @ (prior / scale[:, None]).T)
    pulled = found / scale @ first @ (found / scale).T
    joints = innovations[0].values.shape[1]
    influence = Influence(np.tile(found, (joints, 1, 1)), found - pulled, np.eye(joints))
    values = np.concatenate([seen.values - seen.rows @ belief.beta for seen in innovations])
    return uncertainty_of(bands_of_rows([seen.rows for seen in innovations]), values, influence).with_prior(pulled)


def _watch(
    course: list[tuple[float, list[float]]], seconds: float, path: Course, logs: int
) -> Callable[[int, Array], None]:
    every = max(1, path.reference.shape[1] * logs // POINTS)

    def watch(row: int, beta: Array) -> None:
        if row % every == 0:
            course.append((seconds + row / path.rate, beta.tolist()))

    return watch


def bands_of_rows(logs: Iterable[Array]) -> Iterator[Band]:
    """Yield rows that all count and that no filter has passed, shape (N, n, m) each log, by frequency."""
    start = 0
    for rows in logs:
        for part in np.array_split(np.arange(len(rows)), max(1, round(len(rows) / LENGTH))):
            found = np.fft.rfft(rows[part], axis=0) / np.sqrt(len(part))
            counting = np.ones((len(part), rows.shape[1]), bool)
            yield Band(start + part, counting, found, np.ones(len(found)), 1)
        start += len(rows)
