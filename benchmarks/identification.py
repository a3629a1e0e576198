"""25,000 samples of a 6R arm, arrays to base parameters and their covariance, beside a Pinocchio loop with lstsq.

Both start from q, dq, ddq and tau and reach the same estimate. The loop computes the joint-torque regressor sample by
sample into a preallocated matrix and solves it by singular values on one BLAS thread. Beside it: the consistent fit on
the reduced triangle. Run: python -m benchmarks.identification
"""

from __future__ import annotations

import json
import statistics
import time

import numpy as np
import pinocchio
from threadpoolctl import threadpool_limits

from benchmarks.simulation import as_pinocchio
from dynident import DynamicModel, FourierSeries, Log, Preprocessing, base_parameters, preprocess, read_robot
from dynident.estimation.consistency.consistent_fit import consistent_fit
from dynident.estimation.consistency.scale import natural_scale
from dynident.estimation.problem import Observer, make_problem
from dynident.experiment.preprocessing.as_given import AsGiven
from dynident.model.friction import Motion
from dynident.model.parameters import to_pinocchio
from dynident.model.reduction import least_squares, reduce

SAMPLES, REPEATS = 25_000, 7


def log_of(model):
    """Return an exact motion with noisy torques."""
    generator = np.random.default_rng(0)
    sine, cosine = 0.3 * generator.normal(size=(2, model.robot.dof, 5))
    time_ = np.arange(SAMPLES) / 1000
    q, dq, ddq = FourierSeries(np.zeros(model.robot.dof), sine, cosine, 25.0).evaluate(time_)
    torque = model.torque(Motion(q, dq, ddq), model.nominal()) + 0.5 * generator.normal(size=q.shape)
    return Log(model.robot.joint_names, time_, q, dq, ddq, torque)


def naive(oracle, model, base, log):
    """Return beta and its covariance by a loop over samples and numpy.linalg.lstsq on the whole matrix."""
    data, joints = oracle.createData(), model.robot.dof
    inertial = base.independent[base.independent < model.inertial_count]
    order = to_pinocchio(np.arange(10))  # ours at each place of theirs
    columns = (10 * np.arange(joints)[:, None] + np.argsort(order)).ravel()[inertial]
    whole = np.zeros((SAMPLES, joints, base.count))
    for k in range(SAMPLES):
        whole[k, :, : len(inertial)] = pinocchio.computeJointTorqueRegressor(
            oracle, data, log.q[k], log.dq[k], log.ddq[k]
        )[:, columns]
    friction = model.friction_values(Motion(log.q, log.dq, log.ddq))
    for column, k in enumerate(base.independent[len(inertial) :] - model.inertial_count, start=len(inertial)):
        joint, coefficient = divmod(int(k), model.coefficients_per_joint)
        whole[:, joint, column] = friction[:, joint, coefficient]
    matrix, torque = whole.reshape(-1, base.count), (log.torque - log.ddq @ model.robot.reflected_inertia).ravel()
    beta, rest, _, _ = np.linalg.lstsq(matrix, torque, rcond=None)
    factor = np.linalg.qr(matrix, mode="r")
    inverse = np.linalg.inv(factor)
    return beta, inverse @ inverse.T * float(rest[0]) / (len(torque) - base.count)


def ours(observer, model, base, prepared):
    """Return the same by streaming the rows into one triangle per joint."""
    triangles = observer.triangles(prepared, np.ones(prepared.log.q.shape, bool))
    reduced = reduce(triangles, base.count, np.ones(model.robot.dof))
    found = least_squares(reduced)
    variance = reduced.residual_square(found.beta) / (reduced.rows - base.count)
    return found.beta, found.unscaled_covariance * variance


def timed(function, repeats=REPEATS):
    """Return the times of some calls after one that is not counted, and the result."""
    result = function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return times, result


def main() -> None:
    robot = read_robot("generic-6r")
    model = DynamicModel(robot, ("coulomb", "viscous", "rotor_inertia"))
    base = base_parameters(model)
    log = log_of(model)
    prepared = preprocess(log, Preprocessing(AsGiven(), rest="keep"))
    observer = Observer(model, base)  # made once for a robot, like the peer's model
    oracle = as_pinocchio(robot, np.zeros((robot.dof, robot.dof)))
    with threadpool_limits(1, user_api="blas"):
        fast, slow = [], []
        for _ in range(REPEATS):  # in turns, so that both meet the same machine
            times, mine = timed(lambda: ours(observer, model, base, prepared), repeats=3)
            fast += times
            start = time.perf_counter()
            theirs = naive(oracle, model, base, log)
            slow.append(time.perf_counter() - start)
        problem = make_problem(model, base, [prepared])
        weights = 1.0 / problem.joint_deviations(mine[0])
        scale = natural_scale(model, np.full(6, 10.0), np.ones(6))
        fit, _ = timed(lambda: consistent_fit(model, base, problem.reduced(weights), scale), repeats=20)
    apart = np.linalg.norm(mine[0] - theirs[0]) / np.linalg.norm(theirs[0])
    result = {
        "samples": SAMPLES,
        "base_parameters": base.count,
        "ours_ms": 1e3 * statistics.median(fast),
        "pinocchio_loop_lstsq_ms": 1e3 * statistics.median(slow),
        "ratio": statistics.median(slow) / statistics.median(fast),
        "estimates_apart": float(apart),
        "covariances_apart": float(np.abs(mine[1] / theirs[1] - 1).max()),
        "consistent_fit_ms": 1e3 * statistics.median(fit),
    }
    print(json.dumps(result, indent=1))
    if not apart < 1e-8:
        raise SystemExit("the two estimates differ")


if __name__ == "__main__":
    main()
