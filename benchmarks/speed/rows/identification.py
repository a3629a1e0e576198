"""25,000 samples of a 6R arm, arrays to base parameters and their covariance, beside a Pinocchio loop with lstsq.

Both start from q, dq, ddq and torque and reach the same estimate. The loop computes the regressor sample by sample into
a preallocated matrix, solves it by singular values and takes the covariance from its triangle: what tools of the field
do. With the pivoted QR of the whole matrix, from which they choose base columns, it takes longer still.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg

from benchmarks.speed.arms import as_pinocchio, motion, pinocchio_columns
from benchmarks.speed.harness import Line, Record
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.reduction import least_squares, reduce
from dynident.robot_files import read_robot

SAMPLES, REPEATS = 25_000, 5
HERE, LOOP, PIVOTED = "streamed triangles", "Pinocchio loop, lstsq, QR", "the same and pivoted QR of all columns"

Estimate = tuple[Array, Array]


def noisy_log(model: DynamicModel, samples: int) -> Log:
    """Return an exact motion with noise of 0.5 N m in its torques."""
    states, theta = motion(samples, model.robot.dof), model.nominal()
    assert theta is not None
    torque = model.torque(states, theta) + 0.5 * np.random.default_rng(1).normal(size=states.q.shape)
    return Log(model.robot.joint_names, np.arange(samples) / 1000, states.q, states.dq, states.ddq, torque)


def as_taken(log: Log) -> Prepared:
    """Return the log with all its rows, not filtered."""
    return preprocess(log, Preprocessing(AsGiven(), rest="keep"))


def streamed(regressor: RegressorStream, prepared: Prepared) -> Estimate:
    """Return the base parameters and their covariance from triangles."""
    triangles = regressor.triangles(prepared, np.ones(prepared.log.q.shape, bool))
    reduced = reduce(triangles, regressor.base.count, np.ones(regressor.model.robot.dof))
    found = least_squares(reduced)
    variance = reduced.residual_square(found.beta) / (reduced.rows - regressor.base.count)
    return found.beta, found.unscaled_covariance * variance


def looped(pinocchio: Any, oracle: Any, model: DynamicModel, base: BaseParameters, log: Log, pivot: bool) -> Estimate:
    """Return the same by a loop over the samples and singular values of the whole matrix."""
    data, joints, count = oracle.createData(), model.robot.dof, model.inertial_count
    inertial = base.independent[base.independent < count]
    columns = np.arange(count) if pivot else pinocchio_columns(inertial)
    whole = np.zeros((log.samples, joints, len(columns) + base.count - len(inertial)))
    for k in range(log.samples):
        regressor = pinocchio.computeJointTorqueRegressor(oracle, data, log.q[k], log.dq[k], log.ddq[k])
        whole[k, :, : len(columns)] = regressor[:, columns]
    friction = model.friction_values(Motion(log.q, log.dq, log.ddq))
    for column, k in enumerate(base.independent[len(inertial) :] - count, start=len(columns)):
        joint, coefficient = divmod(int(k), model.coefficients_per_joint)
        whole[:, joint, column] = friction[:, joint, coefficient]
    matrix = whole.reshape(-1, whole.shape[2])
    if pivot:
        scipy.linalg.qr(matrix, mode="r", pivoting=True)
        matrix = matrix[:, [*pinocchio_columns(inertial), *range(count, whole.shape[2])]]
    torque = (log.torque - log.ddq @ model.robot.reflected_inertia).ravel()
    beta, rest, _, _ = np.linalg.lstsq(matrix, torque, rcond=None)
    inverse = np.linalg.inv(np.linalg.qr(matrix, mode="r"))
    return beta, inverse @ inverse.T * float(rest[0]) / (len(torque) - base.count)


def measure() -> Record:
    found = Record("identification", f"6R arm, {SAMPLES} samples x 6 joints to base parameters and covariance, QR")
    model = DynamicModel(read_robot("generic-6r"), ("coulomb", "viscous", "rotor_inertia"))
    base, log = base_parameters(model), noisy_log(model, SAMPLES)
    regressor, prepared = RegressorStream(model, base), as_taken(log)  # made once for a robot, like the peer's model
    calls: dict[str, Callable[[], object]] = {HERE: lambda: streamed(regressor, prepared)}
    if pinocchio := found.peer("pinocchio", "pin"):
        oracle = as_pinocchio(model.robot)
        (mine, own), (theirs, other) = calls[HERE](), looped(pinocchio, oracle, model, base, log, False)
        found.agree("estimates, relative", np.linalg.norm(mine - theirs) / np.linalg.norm(theirs), 1e-8)
        found.agree("covariances, entry by entry", np.abs(own / other - 1).max(), 1e-6)
        calls[LOOP] = lambda: looped(pinocchio, oracle, model, base, log, False)
        calls[PIVOTED] = lambda: looped(pinocchio, oracle, model, base, log, True)
    found.time(calls, REPEATS)
    found.facts["base parameters"] = base.count
    found.lines = [
        Line(f"{SAMPLES} samples x 6 joints to {base.count} base parameters and covariance", HERE, LOOP, 25.0),
        Line("the same beside a peer that also chooses its base columns", HERE, PIVOTED),
    ]
    return found
