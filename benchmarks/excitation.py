"""Excitation design: the article's trajectory against designs under its own ranges, and designs of 6R and 7R arms.

One section a figure: (1) condition numbers on joints 1-3 of the ER-16, (2) relative standard deviations on the virtual
ER-16, (3) 66 free numbers of a 6R from 20 seeds, and beside finite differences over a Pinocchio loop, (4) the Panda
under the maker's limits, jerk included (needs the robot under the folder that DYNIDENT_DATA names).
Run: python -m benchmarks.excitation [1 2 3 4]
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
from scipy.optimize import minimize
from threadpoolctl import threadpool_limits

from benchmarks.simulation import as_pinocchio
from dynident import DynamicModel, FourierSeries, base_parameters, identify, read_robot, simulate
from dynident.experiment.criteria import CRITERIA
from dynident.experiment.design_problem import GUARD, DesignProblem
from dynident.experiment.design_search import candidates
from dynident.experiment.excitation import design_excitation
from dynident.experiment.feasibility import feasible_start, shrunk
from dynident.experiment.limits import MotionLimits, limits_of
from dynident.experiment.observation import Observation
from dynident.experiment.parametrisation import parametrise
from dynident.experiment.virtual_robot import Noise
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.parameters import to_pinocchio
from dynident.robots import er16_article as article

#: The maker's limits of the Panda: acceleration in rad/s^2 and jerk in rad/s^3.
PANDA = ((15, 7500), (7.5, 3750), (10, 5000), (12.5, 6250), (15, 7500), (20, 10000), (20, 10000))


def er16():
    """Return joints 1-3 of the ER-16, beta_1, its samples, and limits no wider than its own ranges."""
    robot = read_robot("er16").locked(article.LOCKED)
    series = FourierSeries.from_table(list(article.BETA_1), article.PERIOD)
    motion = Motion(*series.evaluate(np.arange(article.SAMPLES) / article.RATE))
    largest = [np.abs(signal).max(axis=0) for signal in (motion.dq, motion.ddq)]
    none = np.full(3, np.inf)
    low, high = motion.q.min(axis=0), motion.q.max(axis=0)
    return robot, series, motion, MotionLimits(robot.joint_names, (True,) * 3, low, high, *largest, none, none)


def article_figures() -> None:
    robot, _, published, limits = er16()
    model = DynamicModel(robot, (Coulomb(), Viscous()))
    sharp = DynamicModel(robot, (Coulomb(width=0.0), Viscous()))  # as the article
    observation = Observation(sharp, base_parameters(sharp))
    print("1. ER-16, joints 1-3, five harmonics, 25 s, sharp sign, 25,000 samples")
    rows = [("beta_1", published, 0.0)]
    for criterion in ("condition", "unit_condition"):
        started = time.perf_counter()
        plan = design_excitation(model, limits, criterion, period=article.PERIOD, starts=8)
        seconds = time.perf_counter() - started
        time_ = np.arange(article.SAMPLES) / article.RATE
        rows.append((f"{criterion}, at rest at both ends", Motion(*plan.trajectory.evaluate(time_)), seconds))
    for name, motion, seconds in rows:
        triangle = observation.triangle(motion, np.ones(3))
        raw, unit = (CRITERIA.make(kind).value(triangle) for kind in ("condition", "unit_condition"))
        print(f"   {name:42s} raw {raw:6.2f}   unit columns {unit:5.2f}   {seconds:5.1f} s")


def virtual_robot() -> None:
    robot, series, published, limits = er16()
    model = DynamicModel(robot, (Coulomb(), Viscous()))
    theta = model.nominal()
    base = base_parameters(model)
    truth = base.from_standard(theta)
    noise = article.NOISE_SHARE * model.torque(published, theta).std(axis=0)
    plan = design_excitation(model, limits, "d_optimal", period=article.PERIOD, starts=8, noise=noise)
    print("2. virtual ER-16, equal torque noise and duration: relative standard deviations of the base parameters")
    for name, motion in (("beta_1", series), ("D-optimal, beta_1's ranges", plan.trajectory)):
        found = []
        for seed in range(3):
            run = simulate(model, theta, motion, noise=Noise(torque=noise), seed=seed)
            estimate = identify(model, [run.log], "wls")
            found.append(np.sqrt(np.diag(estimate.covariance)) / np.abs(truth))
        relative = np.mean(found, axis=0)
        worst = base.names[int(np.argmax(relative))]
        print(f"   {name:28s} mean {100 * relative.mean():7.2f} %   largest {100 * relative.max():7.2f} %  ({worst})")


def six_joints(seeds: int = 20) -> None:
    robot = read_robot("generic-6r")
    model = DynamicModel(robot, ("coulomb", "viscous"))
    design_excitation(model, criterion="condition", trajectory="fourier", starts=1, time_limit=0.01)  # compiles
    print(f"3. {robot.name}, 66 free numbers, 10 s, position to jerk and torque limits less a margin, one start a seed")
    for criterion in ("condition", "unit_condition", "d_optimal"):
        figures, seconds, feasible = [], [], 0
        for seed in range(seeds):
            started = time.perf_counter()
            plan = design_excitation(model, criterion=criterion, trajectory="fourier", starts=1, seed=seed)
            seconds.append(time.perf_counter() - started)
            figures.append(plan.values[criterion])
            feasible += plan.feasible
        ends = (np.min(figures), np.median(figures), np.max(figures))
        print(
            f"   {criterion:15s} feasible {feasible} of {seeds}; figure {ends[0]:.2f} / {ends[1]:.2f} / {ends[2]:.2f}"
            f" (least, median, most); {np.median(seconds):.2f} s a seed, at most {np.max(seconds):.2f} s"
        )
    _beside_differences(model)


class Loop:
    """The route of the literature: a loop over the samples in Pinocchio and the singular values of the whole matrix."""

    def __init__(self, problem) -> None:
        self.problem, self.model, self.base = problem, problem.observation.model, problem.observation.base
        joints = self.model.robot.dof
        self.oracle = as_pinocchio(self.model.robot, np.zeros((joints, joints)))
        self.data = self.oracle.createData()
        inertial = self.base.independent[self.base.independent < self.model.inertial_count]
        order = np.argsort(to_pinocchio(np.arange(10)))
        self.columns = (10 * np.arange(joints)[:, None] + order).ravel()[inertial]

    def condition(self, x) -> float:
        """Return the condition number at free numbers."""
        motion, kept = self.problem.motion(x), len(self.columns)
        matrix = np.zeros((*motion.q.shape, self.base.count))
        for k in range(len(motion.q)):
            whole = pinocchio.computeJointTorqueRegressor(
                self.oracle, self.data, motion.q[k], motion.dq[k], motion.ddq[k]
            )
            matrix[k, :, :kept] = whole[:, self.columns]
        friction = self.model.friction_values(motion)
        for j in range(matrix.shape[1]):
            matrix[:, j, kept + 2 * j : kept + 2 * j + 2] = friction[:, j]
        return float(np.linalg.cond(matrix.reshape(-1, self.base.count)))

    def room(self, x):
        """Return what is left of each bound; the torques are those of our kernels, which favours this route."""
        free = self.problem.free(x) - self.problem.free(np.zeros_like(x))  # counted from the middle of the ranges
        shares = np.abs(self.problem.basis @ free.T).max(axis=1) / self.problem.limits.bounds()
        return 1.0 - GUARD - np.append(shares.ravel(), self.problem.torque_use(x))


def _beside_differences(model) -> None:
    """Print cost of a gradient and outcome of a search beside forward differences; both are judged alike."""
    robot = model.robot
    shape, criterion, noise = parametrise("fourier", 10.0, 5), CRITERIA.make("condition"), np.ones(robot.dof)
    observation = Observation(model, base_parameters(model))
    problem = DesignProblem(observation, shape, criterion, limits_of(robot), noise, model.nominal(), 200)
    dense, loop = replace(problem, samples=10 * problem.samples), Loop(problem)

    def judged(x) -> float:
        kept = shrunk(dense, x)
        return np.inf if kept is None else criterion.value(observation.triangle(dense.motion(kept), noise))

    x = feasible_start(problem, np.random.default_rng(0))
    if abs(loop.condition(x) / criterion.value(observation.triangle(problem.motion(x), noise)) - 1) > 1e-9:
        raise SystemExit("the two condition numbers differ")
    with threadpool_limits(1, user_api="blas"):
        ours = 1e3 * np.median([_seconds(lambda: problem.point(x, 4.0)) for _ in range(30)])
        theirs = 1e3 * np.median([_seconds(lambda: loop.condition(x)) for _ in range(30)]) * (problem.size + 1)
        print(
            f"   value, gradient, limits {ours:.2f} ms; differences over a loop {theirs:.0f} ms; {theirs / ours:.0f}x"
        )
        for seed in range(2):
            x = feasible_start(problem, np.random.default_rng(seed))
            began = time.perf_counter()
            best = min(judged(one) for one in candidates(problem, x, began + 60.0, lambda point: None))
            mine = time.perf_counter() - began
            began = time.perf_counter()
            limits = {"type": "ineq", "fun": loop.room}
            found = minimize(loop.condition, x, method="SLSQP", constraints=limits, options={"maxiter": 300})
            other = time.perf_counter() - began
            print(
                f"   condition number from the same start: ours {best:.2f} in {mine:.2f} s; differences "
                f"{judged(found.x):.2f} in {other:.1f} s ({found.nit} iterations); {other / mine:.0f}x"
            )


def _seconds(work) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def panda() -> None:
    file = Path(os.environ.get("DYNIDENT_DATA", "")) / "panda_gaz2019" / "robot.urdf"
    if not file.is_file():
        print("4. Panda: not run, because DYNIDENT_DATA names no folder with panda_gaz2019/robot.urdf")
        return
    robot = read_robot(file)
    joints = tuple(
        replace(joint, limits=replace(joint.limits, acceleration=acceleration, jerk=jerk))
        for joint, (acceleration, jerk) in zip(robot.joints, PANDA, strict=True)
    )
    model = DynamicModel(replace(robot, joints=joints), ("coulomb", "viscous", "offset"))
    print("4. Panda, the maker's limits with jerk and torque less a margin, 20 s, at rest at both ends, 4 starts")
    for criterion in ("condition", "unit_condition", "d_optimal"):
        started = time.perf_counter()
        plan = design_excitation(model, criterion=criterion, period=20.0, time_limit=25.0)
        seconds = time.perf_counter() - started
        worst = max(plan.rows, key=lambda row: row.used)
        print(
            f"   {criterion:15s} {plan.values[criterion]:8.2f}  feasible: {plan.feasible}  {seconds:5.1f} s  "
            f"most used: {100 * worst.used:.1f} % of {worst.quantity} of {worst.joint}"
        )


def main() -> None:
    sections = {"1": article_figures, "2": virtual_robot, "3": six_joints, "4": panda}
    for name in sys.argv[1:] or sections:
        sections[name]()


if __name__ == "__main__":
    main()
