"""Excitation design: the article's trajectory against designs under its own ranges, and designs of 6R and 7R arms.

One section a figure: (1) condition numbers on joints 1-3 of the ER-16, (2) relative standard deviations on the virtual
ER-16, (3) 66 free numbers of a 6R from 20 seeds, with floor and self-collision, (4) the same beside finite differences
over a Pinocchio loop, in seconds of the processor, one thread, (5) the Panda under the maker's limits, jerk included
(needs the robot under the folder that DYNIDENT_DATA names), (6) one run designed after another, (7) processes.
Run: python -m benchmarks.excitation [1 2 3 4 5 6 7]
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

from benchmarks.speed.designs import Loop
from dynident import DynamicModel, FourierSeries, base_parameters, identify, read_robot, simulate
from dynident.excitation.collision.clearance import clearance_of
from dynident.excitation.collision.workspace import HalfSpace, Workspace
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.design_problem import GUARD, DesignProblem
from dynident.excitation.design.excitation import design_excitation
from dynident.excitation.design.feasibility import feasible_start, shrunk
from dynident.excitation.design.finishing import FINER
from dynident.excitation.design.limits import MotionLimits, limits_of
from dynident.excitation.design.observation import Observation
from dynident.excitation.design.options import DesignKnowledge, SearchOptions, SpaceLimits, TrajectoryOptions
from dynident.excitation.design.parametrisation import parametrise
from dynident.excitation.design.prior import Prior, deviations_of
from dynident.excitation.design.start import Trail, candidates
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.simulation.virtual_robot import Noise
from dynident.studies import er16_article as article

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
        plan = design_excitation(
            model,
            limits,
            criterion,
            trajectory=TrajectoryOptions(period=article.PERIOD),
            search=SearchOptions(starts=8),
        )
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
    plan = design_excitation(
        model,
        limits,
        "d_optimal",
        trajectory=TrajectoryOptions(period=article.PERIOD),
        search=SearchOptions(starts=8),
        knowledge=DesignKnowledge(noise=noise),
    )
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


def cell():
    """Return a 6R that stands on a floor: its model and the distances that it must keep."""
    robot = read_robot("generic-6r")
    room = Workspace(
        {"floor": HalfSpace([0.0, 0.0, 1.0], 0.0)}, ignore=(("wrist_1_body", "flange"),), joint_radius=0.06
    )
    return DynamicModel(robot, ("coulomb", "viscous")), clearance_of(robot, room)


def six_joints(seeds: int = 20) -> None:
    model, clearance = cell()
    name = model.robot.name
    design_excitation(
        model,
        criterion="condition",
        trajectory=TrajectoryOptions(kind="fourier"),
        search=SearchOptions(starts=1, time_limit=0.01),
    )  # compiles
    print(f"3. {name}, 66 free numbers, 10 s, position to torque rate, one start a seed")
    for criterion in ("condition", "unit_condition", "d_optimal"):
        for distances in (None, clearance):
            figures, seconds, feasible = [], [], 0
            for seed in range(seeds):
                started = time.perf_counter()
                plan = design_excitation(
                    model,
                    criterion=criterion,
                    trajectory=TrajectoryOptions(kind="fourier"),
                    search=SearchOptions(starts=1, seed=seed),
                    space=SpaceLimits(clearance=distances),
                )
                seconds.append(time.perf_counter() - started)
                figures.append(plan.values[criterion])
                feasible += plan.feasible
            ends = (np.min(figures), np.median(figures), np.max(figures))
            pairs = f"{len(distances.names)} clearances" if distances else "no clearance"
            print(
                f"   {criterion:15s} {pairs:13s} feasible {feasible} of {seeds}; {ends[0]:.2f} / {ends[1]:.2f} / "
                f"{ends[2]:.2f} (least, median, most); {np.median(seconds):.2f} s a seed, {max(seconds):.2f} at most"
            )


def room_of(problem, x):
    """Return what is left of each bound, highest and lowest apart; from our kernels, which favours that route."""
    grid = problem.grid(x)
    return 1.0 - GUARD - np.concatenate([bound.shares(grid).max(axis=1) for bound in problem.bounds])


def beside_differences(seeds: int = 2) -> None:
    """Print cost of a gradient and outcome of a search beside forward differences; both are judged alike."""
    model, clearance = cell()
    print(
        "4. the same problem, position to torque rate and clearance, beside forward differences over a Pinocchio loop"
    )
    with threadpool_limits(1, user_api="blas"):
        for name in ("condition", "d_optimal"):
            _one_criterion(model, clearance, name, seeds)


def _one_criterion(model, clearance, name, seeds) -> None:
    shape, criterion = parametrise("fourier", 10.0, 5), CRITERIA.make(name)
    efforts = np.array([joint.limits.effort for joint in model.robot.active])
    noise = 0.01 * efforts if criterion.weighted else np.ones(model.robot.dof)
    observation = Observation(model, base_parameters(model))
    problem = DesignProblem(
        observation, shape, criterion, limits_of(model.robot), noise, model.nominal(), 200, clearance=clearance
    )
    dense, loop = replace(problem, samples=FINER * problem.samples), Loop(pinocchio, problem)
    sign = -1.0 if criterion.larger_is_better else 1.0

    def judged(x) -> float:
        kept = shrunk(dense, x)
        return np.inf if kept is None else sign * dense.figure(dense.motion(kept))

    x = feasible_start(problem, np.random.default_rng(0))
    if abs(loop.cost(x) - sign * problem.figure(problem.motion(x))) > 1e-5 * abs(loop.cost(x)):
        raise SystemExit("the two figures differ")
    parts = (lambda: problem.point(x, 4.0)), (lambda: loop.cost(x)), (lambda: room_of(problem, x))
    ours, cost, room = (1e3 * np.median([_cpu(work) for _ in range(30)]) for work in parts)
    theirs = (cost + room) * (problem.size + 1)
    print(f"   {name}: value, gradients, bounds {ours:.2f} ms; differences {theirs:.0f} ms; {theirs / ours:.0f}x")
    for seed in range(seeds):
        x = feasible_start(problem, np.random.default_rng(seed))
        began = time.process_time()
        limits = {"type": "ineq", "fun": lambda at: room_of(problem, at)}
        found = minimize(loop.cost, x, method="SLSQP", constraints=limits, options={"maxiter": 300})
        other, goal = time.process_time() - began, judged(found.x)
        seen: list = []
        began = time.process_time()
        trail = Trail(np.inf, lambda at, point: seen.append((time.process_time() - began, at, point)))  # noqa: B023
        ends = list(candidates(problem, x, trail))
        mine, best = time.process_time() - began, min(map(judged, ends))
        reached = _reached(seen, judged, goal)
        print(
            f"   seed {seed}: ours {sign * best:.2f} in {mine:.2f} s; differences {sign * goal:.2f} in {other:.1f} s "
            f"({found.nit} iterations): {other / mine:.0f}x; as good after {reached:.2f} s: {other / reached:.0f}x"
        )


def _reached(seen, judged, goal) -> float:
    """Return when an iterate that nearly keeps its bounds was first as good as the goal; infinite if never."""
    best = np.inf
    for moment, x, point in seen:
        if point.used.max() <= 1.002 and point.objective < best - 1e-3:
            best = point.objective
            if judged(x) <= goal:
                return moment
    return min((moment for moment, x, _ in seen[::-1][:5] if judged(x) <= goal), default=np.inf)


def _cpu(work) -> float:
    started = time.process_time()
    work()
    return time.process_time() - started


def panda() -> None:
    file = Path(os.environ.get("DYNIDENT_DATA", "")) / "panda_gaz2019" / "robot.urdf"
    if not file.is_file():
        print("5. Panda: not run, because DYNIDENT_DATA names no folder with panda_gaz2019/robot.urdf")
        return
    robot = read_robot(file)
    joints = tuple(
        replace(joint, limits=replace(joint.limits, acceleration=acceleration, jerk=jerk))
        for joint, (acceleration, jerk) in zip(robot.joints, PANDA, strict=True)
    )
    model = DynamicModel(replace(robot, joints=joints), ("coulomb", "viscous", "offset"))
    print("5. Panda, the maker's limits with jerk and torque less a margin, 20 s, at rest at both ends, 4 starts")
    for criterion in ("condition", "unit_condition", "d_optimal"):
        started = time.perf_counter()
        plan = design_excitation(
            model,
            criterion=criterion,
            trajectory=TrajectoryOptions(period=20.0),
            search=SearchOptions(time_limit=25.0, jobs=None),
        )
        seconds = time.perf_counter() - started
        worst = max(plan.rows, key=lambda row: row.used)
        print(
            f"   {criterion:15s} {plan.values[criterion]:8.2f}  feasible: {plan.feasible}  {seconds:5.1f} s  "
            f"most used: {100 * worst.used:.1f} % of {worst.quantity} of {worst.joint}"
        )


def one_after_another() -> None:
    model, clearance = cell()
    base = base_parameters(model)
    print("6. 6R, 10 s: standard deviations after two runs, the second designed after the first, over the first twice")
    for criterion in ("d_optimal", "bayesian_d", "a_optimal"):
        first = design_excitation(
            model, criterion=criterion, search=SearchOptions(starts=4), space=SpaceLimits(clearance=clearance)
        )
        known = first.settings["outlook"]
        motion = Motion(*first.trajectory.evaluate(np.arange(2000) * first.trajectory.period / 2000))
        triangle = Observation(model, base).triangle(motion, np.array(first.settings["noise"]))
        information = known["effective_sample_size"] * triangle.T @ triangle
        earlier = Prior(information, None, "run 1")
        second = design_excitation(
            model,
            criterion=criterion,
            search=SearchOptions(starts=4, seed=1),
            space=SpaceLimits(clearance=clearance),
            knowledge=DesignKnowledge(earlier=earlier),
        )
        after = np.array([item["std_after"] for item in second.settings["outlook"]["parameters"]])
        ratios = after / deviations_of(2 * information)
        sizes = np.maximum(np.abs(base.from_standard(model.nominal())), 1e-12)
        stated = sizes > 1e-9
        worst = (after / sizes)[stated].max() / (deviations_of(2 * information) / sizes)[stated].max()
        print(f"   {criterion:12s} largest relative one {worst:.2f}, mean of all {np.exp(np.mean(np.log(ratios))):.2f}")


def processes() -> None:
    model, clearance = cell()
    print("7. 6R with clearance, condition number, in this process and in two")
    for starts in (4, 16):
        seconds = []
        for jobs in (1, 2):
            started = time.perf_counter()
            design_excitation(
                model,
                criterion="condition",
                trajectory=TrajectoryOptions(kind="fourier"),
                search=SearchOptions(starts=starts, jobs=jobs),
                space=SpaceLimits(clearance=clearance),
            )
            seconds.append(time.perf_counter() - started)
        print(f"   {starts} starts: {seconds[0]:.1f} s and {seconds[1]:.1f} s, {seconds[0] / seconds[1]:.2f}x")


def main() -> None:
    works = (article_figures, virtual_robot, six_joints, beside_differences, panda, one_after_another, processes)
    sections = {str(k): work for k, work in enumerate(works, 1)}
    for name in sys.argv[1:] or sections:
        sections[name]()


if __name__ == "__main__":
    main()
