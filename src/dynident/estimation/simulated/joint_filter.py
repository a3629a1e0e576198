"""The extended Kalman filter of states and base parameters together.

State (q, dq, beta); the measured torques drive the model from one row to the next, the measured positions correct it.
The derivative of each prediction by the state, the parameters and the torque is that of the integration rule itself
(forward sensitivity equations), not a difference quotient. Source: Jazwinski 1970, section 8.3; joint estimation of
states and parameters: Ljung 1979.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import SolverFailed
from dynident.estimation.simulated.course import Course
from dynident.estimation.simulated.sensitivities import inverse_slopes
from dynident.experiment.design.observation import Observation
from dynident.experiment.simulation.plant import MAX_RATE, MIN_RATE, plant

#: A step of the integration times the fastest decay of friction stays below this.
STEP = 1.0

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
        by_torque: By an error of the torque that is held over the row, shape (2 n, n).
    """

    state: Array
    by_state: Array
    by_beta: Array
    by_torque: Array


class Predictor:
    """Integrates the robot from one row of a log to the next, with exact derivatives."""

    def __init__(self, observation: Observation, course: Course) -> None:
        self._observation, self._course = observation, course
        self._loop: Any = importlib.import_module("dynident.experiment.simulation.simulation_loop")
        self._tangent: Any = importlib.import_module("dynident.experiment.simulation.tangent_loop")
        self._joints = course.reference.shape[2]
        self.steps = 1

    def set_pace(self, beta: Array) -> None:
        """Choose the steps of the integration for parameters ``beta``, shape (b,).

        Raises:
            NotConsistent: Their mass matrix is not positive definite along the motion.
            SolverFailed: Friction turns too fast to be integrated.
        """
        body = plant(self._observation.model, self._observation.base.to_standard(beta))
        needed = max(MIN_RATE, 1.5 * body.fastest_decay(self._course.masses(body)) / STEP)
        if needed > MAX_RATE:
            step = "give the Coulomb part a greater width"
            raise SolverFailed("the Kalman filter", f"friction needs {needed:.3g} steps a second", step)
        self.steps = math.ceil(needed / self._course.rate)

    def predict(self, row: int, state: Array, beta: Array) -> Prediction:
        """Return the state at the row after ``row``.

        Raises:
            SolverFailed: The motion is lost.
        """
        joints, count, steps = self._joints, len(beta), self.steps
        body = plant(self._observation.model, self._observation.base.to_standard(beta))
        _, torque = self._course.between(slice(row, row + 1), steps)
        goals = np.zeros((2 * steps + 1, 3, joints))
        goals[:, 2] = np.asarray(torque)
        gains, counts = np.zeros((2, joints)), np.array([steps, 0, 0], dtype=np.int64)
        step = 1.0 / (self._course.rate * steps)
        moved, out = state.reshape(2, joints).copy(), np.empty((1, 4, joints))
        stages = np.empty((steps, 4, 3, joints))
        if self._loop.tracking(body.tables, gains, goals, counts, step, moved, np.zeros(joints), out, stages) >= 0:
            raise SolverFailed("the Kalman filter", f"the motion is lost at row {row}", "state more torque_noise")
        by_q, by_dq, by_beta, inverse = inverse_slopes(self._observation, stages, beta)
        wide = np.zeros((steps, 4, joints, 3 * joints + count))
        wide[..., 2 * joints : 2 * joints + count] = by_beta
        fed = np.zeros((2 * steps + 1, joints, wide.shape[-1]))
        fed[:, :, -joints:] = np.eye(joints)
        slopes = np.zeros((2, joints, wide.shape[-1]))
        slopes.reshape(2 * joints, -1)[:, : 2 * joints] = np.eye(2 * joints)
        none, rows = np.zeros((joints, wide.shape[-1])), np.empty((1, 2, joints, wide.shape[-1]))
        self._tangent.tangent((by_q, by_dq, wide, inverse), gains, fed, counts, step, slopes, none, rows)
        flat = slopes.reshape(2 * joints, -1)
        return Prediction(
            moved.ravel(), flat[:, : 2 * joints], flat[:, 2 * joints : 2 * joints + count], flat[:, -joints:]
        )


def filter_log(
    predictor: Predictor,
    positions: Array,
    belief: Belief,
    start: Array,
    tuning: Tuning,
    rate: float,
    watch: Callable[[int, Array], None] = lambda row, beta: None,
) -> tuple[Belief, Array]:
    """Run the filter over one log.

    Args:
        predictor: Of the log.
        positions: Measured positions, shape (N, n).
        belief: What is known of the parameters before.
        start: q and dq at the first row, shape (2, n).
        tuning: What is uncertain.
        rate: Rows a second.
        watch: Told each row and its parameters.

    Returns:
        What is known after, and the normalised innovation squared of each row, about n each where the tuning is right,
        shape (N - 1,).

    Raises:
        NotConsistent: Parameters on the way cannot be simulated.
        SolverFailed: The motion is lost.
    """
    rows, joints = positions.shape
    own = 2 * joints
    state, beta = np.array(start).ravel(), np.array(belief.beta)
    size = own + len(beta)
    covariance = np.zeros((size, size))
    covariance[:joints, :joints] = np.diag(tuning.position**2)
    covariance[joints:own, joints:own] = np.diag((FIRST_SPEED * tuning.position * rate) ** 2)
    covariance[own:, own:] = belief.covariance
    walk = np.diag(tuning.drift**2 / rate)
    found = np.empty(rows - 1)
    predictor.set_pace(beta)
    for row in range(rows - 1):
        ahead = predictor.predict(row, state, beta)
        transition = np.eye(size)
        transition[:own, :own], transition[:own, own:] = ahead.by_state, ahead.by_beta
        covariance = transition @ covariance @ transition.T
        covariance[:own, :own] += (ahead.by_torque * tuning.torque[row] ** 2) @ ahead.by_torque.T
        covariance[own:, own:] += walk
        innovation = positions[row + 1] - ahead.state[:joints]
        seen = covariance[:joints, :joints] + np.diag(tuning.position**2)
        gain = np.linalg.solve(seen, covariance[:joints]).T
        found[row] = innovation @ np.linalg.solve(seen, innovation)
        change = gain @ innovation
        state, beta = ahead.state + change[:own], beta + change[own:]
        if not np.all(np.isfinite(beta)):
            step = "state a smaller spread, or position_noise and torque_noise"
            raise SolverFailed("the Kalman filter", f"the parameters are lost at row {row + 1}", step)
        kept = np.eye(size)
        kept[:, :joints] -= gain  # Joseph's form: symmetric and non-negative whatever the rounding
        covariance = kept @ covariance @ kept.T + (gain * tuning.position**2) @ gain.T
        watch(row + 1, beta)
    return Belief(beta, covariance[own:, own:]), found


def position_noise(positions: npt.ArrayLike) -> Array:
    """Return the white noise of positions (N, n) from their fourth differences, robustly, shape (n,).

    A motion that is sampled well has next to nothing there; white noise of variance s^2 has 70 s^2.
    """
    differences = np.diff(np.asarray(positions, dtype=float), 4, axis=0)
    return 1.4826 * np.median(np.abs(differences), axis=0) / np.sqrt(70.0)
