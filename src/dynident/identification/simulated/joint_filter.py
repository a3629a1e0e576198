"""The extended Kalman filter of states and base parameters together.

State (q, dq, w, beta), w the error of the torque at the row; the measured torques drive the model from one row to the
next, the measured positions correct it. Between rows the error of the torque goes from one row's to the next one's in a
straight line, as the torque does. Slopes are those of the integration rule itself (forward sensitivity equations),
along the measured motion: along the predicted one they hold the noise of the torque that is in the innovation as well,
which biases the parameters as noise in the columns of a regression does (on the filter: Ljung 1979). Source: Jazwinski
1970, section 8.3; parameters as states without a motion of their own: Friedland 1969.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.excitation.design.observation import Observation
from dynident.identification.simulated.closed_loop import goals_of
from dynident.identification.simulated.course import HALVES, Course, refuse_states
from dynident.identification.simulated.sensitivities import inverse_slopes
from dynident.simulation.plant import MAX_RATE, MIN_RATE, Plant, plant

#: A step of the integration times the fastest decay of friction stays below this.
STEP = 1.0

#: Rows along which slopes are found at once.
ROWS = 32

#: The speed at the start is known to this many times the position noise over the time between rows.
FIRST_SPEED = 3.0


@dataclass(frozen=True)
class Tuning:
    """What the filter takes to be uncertain.

    Attributes:
        position: Standard deviation of the measured positions, shape (n,), in rad or m.
        torque: Standard deviation of the torques from row to row, shape (N, n), in N m or N.
        drift: Standard deviation of the parameters' random walk over one second, shape (b,).
    """

    position: Array
    torque: Array
    drift: Array


@dataclass(frozen=True)
class Belief:
    """Parameters and what is known of them.

    Attributes:
        beta: Shape (b,).
        covariance: Shape (b, b).
    """

    beta: Array
    covariance: Array


@dataclass(frozen=True)
class Prediction:
    """One row ahead.

    Attributes:
        state: q and dq, shape (2 n,).
        by_state: Its derivative by the state before, shape (2 n, 2 n).
        by_beta: By the parameters, shape (2 n, b).
        by_torque: By the error of the torque at the row, shape (2 n, n).
        by_next: By that at the row after it, shape (2 n, n).
    """

    state: Array
    by_state: Array
    by_beta: Array
    by_torque: Array
    by_next: Array


@dataclass(frozen=True)
class Innovations:
    """What a run of the filter over one log saw.

    Attributes:
        normalised: Innovation squared over its variance, about n each where the tuning is right, shape (N - 1,).
        rows: Slopes of the innovations by the parameters over their deviations for known parameters, (N - 1, n, b).
        values: Innovations over these deviations, less ``rows`` times the parameters of the moment, shape (N - 1, n).
    """

    normalised: Array
    rows: Array
    values: Array


class Predictor:
    """Integrates the robot from one sample of a log to the next, with exact derivatives."""

    def __init__(self, observation: Observation, course: Course) -> None:
        refuse_states(observation.model, "the Kalman filter")
        self._observation, self._course = observation, course
        self._loop: Any = importlib.import_module("dynident.simulation.tracking_loop")
        self._tangent: Any = importlib.import_module("dynident.simulation.tangent_loop")
        self._joints = course.reference.shape[2]
        self.steps, self._first = 1, -ROWS
        self._goals: Array = np.zeros((0, 3, self._joints))
        self._slopes: tuple[Array, ...] = ()

    def set_pace(self, beta: Array) -> None:
        """Choose the steps of the integration for parameters ``beta``, shape (b,).

        Raises:
            NotConsistent: Their mass matrix is not positive definite along the motion.
            SolverFailed: Friction turns too fast to be integrated.
        """
        body = plant(self._observation.model, self._observation.base.to_standard(beta))
        needed = max(MIN_RATE, 1.5 * self._decay(body) / STEP)
        if needed > MAX_RATE:
            step = "give the Coulomb part a greater width"
            raise SolverFailed("the Kalman filter", f"friction needs {needed:.3g} steps a second", step)
        self.steps, self._first = math.ceil(needed / self._course.rate), -ROWS

    def _decay(self, body: Plant) -> float:
        q, dq, _ = self._course.reference
        return body.fastest_decay(self._course.masses(body), q, dq)

    def predict(self, row: int, state: Array, beta: Array) -> Prediction:
        """Return the state at the row after ``row``.

        Raises:
            SolverFailed: The motion is lost.
        """
        joints, count, steps = self._joints, len(beta), self.steps
        body = plant(self._observation.model, self._observation.base.to_standard(beta))
        if not self._first <= row < self._first + ROWS:
            self._look_ahead(row, beta)
        at = (row - self._first) * steps
        goals = self._goals[2 * at : 2 * (at + steps) + 1]
        gains, counts = np.zeros((2, joints)), np.array([steps, 0, 0], dtype=np.int64)
        step = 1.0 / (self._course.rate * steps)
        moved, out = state.reshape(2, joints).copy(), np.empty((1, 4, joints))
        stages = np.empty((steps, 4, 3, joints))
        if self._loop.tracking(body.tables(), gains, goals, (counts, step), moved, np.zeros(joints), out, stages) >= 0:
            raise SolverFailed("the Kalman filter", f"the motion is lost at row {row}", "state more torque_noise")
        by_q, by_dq, by_beta, inverse = (slopes[at : at + steps] for slopes in self._slopes)
        wide = np.zeros((steps, 4, joints, 4 * joints + count))
        wide[..., 2 * joints : 2 * joints + count] = by_beta
        fed = np.zeros((2 * steps + 1, joints, wide.shape[-1]))
        place = np.arange(2 * steps + 1)[:, None, None] / (2 * steps)
        fed[:, :, -2 * joints : -joints] = (1.0 - place) * np.eye(joints)
        fed[:, :, -joints:] = place * np.eye(joints)
        slopes = np.zeros((2, joints, wide.shape[-1]))
        slopes.reshape(2 * joints, -1)[:, : 2 * joints] = np.eye(2 * joints)
        none, rows = np.zeros((joints, wide.shape[-1])), np.empty((1, 2, joints, wide.shape[-1]))
        self._tangent.tangent((by_q, by_dq, wide, inverse), gains, fed, counts, step, slopes, none, rows)
        flat = slopes.reshape(2 * joints, -1)
        by_state, by_beta, by_torque, by_next = np.split(flat, np.cumsum([2 * joints, count, joints]), axis=1)
        return Prediction(moved.ravel(), by_state, by_beta, by_torque, by_next)

    def _look_ahead(self, row: int, beta: Array) -> None:
        """Keep torques and slopes along the measured motion of the next rows, with the parameters of the moment."""
        rows = slice(row, min(row + ROWS, self._course.reference.shape[1]))
        along, torque = self._course.between(rows, self.steps, HALVES)
        measured = np.stack([along.q, along.dq, along.ddq], axis=1)
        halves = 2 * np.arange((len(measured) - 1) // 2)[:, None] + np.array([0, 1, 1, 2])
        still = np.zeros_like(along.q)
        self._first, self._goals = row, goals_of(replace(along, q=still, dq=still), np.asarray(torque))
        steps = None if along.temperature is None else along.temperature[:-1:2]
        self._slopes = inverse_slopes(self._observation, measured[halves], beta, steps)


def filter_log(
    predictor: Predictor,
    positions: Array,
    belief: Belief,
    start: Array,
    tuning: Tuning,
    rate: float,
    watch: Callable[[int, Array], None] = lambda row, beta: None,
) -> tuple[Belief, Innovations]:
    """Run the filter over one log.

    Args:
        predictor: Of the log.
        positions: Measured positions, shape (N, n).
        belief: What is known of the parameters before.
        start: q and dq at the first row, shape (2, n).
        tuning: What is uncertain.
        rate: Samples a second.
        watch: Called with each row and its parameters.

    Returns:
        What is known after, and what was seen on the way.

    Raises:
        NotConsistent: Parameters on the way cannot be simulated.
        SolverFailed: The motion, the parameters or the covariance are lost.
    """
    rows, joints = positions.shape
    own = 3 * joints
    state, beta = np.append(np.array(start).ravel(), np.zeros(joints)), np.array(belief.beta)
    size = own + len(beta)
    covariance = np.zeros((size, size))
    speed = FIRST_SPEED * tuning.position * rate
    covariance[:own, :own] = np.diag(np.concatenate([tuning.position, speed, tuning.torque[0]]) ** 2)
    covariance[own:, own:] = belief.covariance
    walk = np.diag(tuning.drift**2 / rate)
    normalised, seen_rows, seen_values = np.empty(rows - 1), np.empty((rows - 1, joints, len(beta))), positions[1:] * 0
    predictor.set_pace(beta)
    for row in range(rows - 1):
        ahead = predictor.predict(row, state[: 2 * joints], beta)
        covariance = _carried(ahead, covariance, tuning.torque[row + 1])
        covariance[own:, own:] += walk
        moved = ahead.state + ahead.by_torque @ state[2 * joints :]
        innovation = positions[row + 1] - moved[:joints]
        seen = covariance[:joints, :joints] + np.diag(tuning.position**2)
        gain = np.linalg.solve(seen, covariance[:joints]).T
        normalised[row] = innovation @ np.linalg.solve(seen, innovation)
        seen_rows[row], root = _known_parameters(covariance, seen, own, row + 1)
        seen_values[row] = np.linalg.solve(root, innovation) + seen_rows[row] @ beta
        change = gain @ innovation
        state, beta = np.append(moved, np.zeros(joints)) + change[:own], beta + change[own:]
        if not np.all(np.isfinite(beta)):
            step = "state a smaller spread, or position_noise and torque_noise"
            raise SolverFailed("the Kalman filter", f"the parameters are lost at row {row + 1}", step)
        kept = np.eye(size)
        kept[:, :joints] -= gain  # Joseph's form: symmetric and non-negative whatever the rounding
        covariance = kept @ covariance @ kept.T + (gain * tuning.position**2) @ gain.T
        watch(row + 1, beta)
    return Belief(beta, covariance[own:, own:]), Innovations(normalised, seen_rows, seen_values)


def _carried(ahead: Prediction, covariance: Array, torque: Array) -> Array:
    """Return the covariance of the state one row ahead; ``torque`` (n,) are the deviations of the torques there."""
    joints = len(torque)
    both, own = 2 * joints, 3 * joints
    transition = np.eye(len(covariance))
    transition[:both, :both], transition[:both, both:own] = ahead.by_state, ahead.by_torque
    transition[:both, own:], transition[both:own, both:own] = ahead.by_beta, 0.0
    new = np.vstack([ahead.by_next, np.eye(joints)]) * torque
    covariance = transition @ covariance @ transition.T
    covariance[:own, :own] += new @ new.T
    return covariance


def _known_parameters(covariance: Array, seen: Array, own: int, row: int) -> tuple[Array, Array]:
    """Return the slopes of the innovation by the parameters over its deviations were they known, and these, (n, n).

    Raises:
        SolverFailed: The covariance is lost to rounding, at ``row``.
    """
    joints = len(seen)
    of_beta, size = covariance[own:, own:], np.sqrt(np.diag(covariance)[own:])
    scaled = of_beta / size / size[:, None]
    try:
        slopes = np.linalg.solve(scaled, covariance[own:, :joints] / size[:, None]).T / size
        root = np.linalg.cholesky(seen - slopes @ covariance[own:, :joints])
    except np.linalg.LinAlgError as error:
        step = "state a greater position_noise: positions that were filtered have no white noise of their own"
        raise SolverFailed("the Kalman filter", f"row {row}: the covariance is lost to rounding", step) from error
    return np.linalg.solve(root, slopes), root


def position_noise(positions: npt.ArrayLike) -> Array:
    """Return the white noise of positions (N, n) from their fourth differences, robustly, shape (n,).

    A motion that is sampled well has next to nothing there; white noise of variance s^2 has 70 s^2.
    """
    differences = np.diff(np.asarray(positions, dtype=float), 4, axis=0)
    return 1.4826 * np.median(np.abs(differences), axis=0) / np.sqrt(70.0)
