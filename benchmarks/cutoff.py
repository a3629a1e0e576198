"""The chosen cut-off against a scan of cut-offs, and filters side by side, on virtual robots and on real logs.

Virtual: two arms in closed loop for 20 s, six kinds of noise; printed are the chosen cut-offs of the seeds, the best
of a scan by the mean squared error of the predicted torque over the seeds, and the ratio of that error at the chosen
ones to the least of the scan (median and largest); the same with parameters scaled by the norms of their columns. Real:
the held-out error, judged with the filter of the case file, at the chosen cut-off and the least of a scan. Filters: the
root mean square error of the parameters so scaled on a virtual arm, and the held-out error on a real one.
Run: python -m benchmarks.cutoff virtual|real|filters [seeds]
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident import FILTERS, DynamicModel, FourierSeries, read_case, read_robot, simulate
from dynident.api.case_logs import read_data
from dynident.data.preprocessing import default_preprocessing, preprocess
from dynident.errors import DynidentError
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.wls import WLS
from dynident.identification.selection.cutoff.candidates import Bench
from dynident.identification.selection.cutoff.choice import choose_cutoff
from dynident.identification.selection.friction.load import agrees, with_load
from dynident.identification.validate import validate_prepared
from dynident.model.base_parameters import base_parameters
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.simulation.virtual_robot import Noise, Timing

CASES = ("panda", "tx40", "lwr4", "tiago", "ur10e")
PERIOD, HALF_TICK = 10.0, -0.0005  # a row that falls on a tick of the controller has the torque that begins there

NOISES = (
    ("encoder 1e-5 rad", Noise(position=1e-5, torque=0.01), 0.0, 500.0),
    ("encoder 1e-4 rad", Noise(position=1e-4, torque=0.01), 0.0, 500.0),
    ("steps of 1e-3 rad", Noise(torque=0.01), 1e-3, 500.0),
    ("torque 10 %", Noise(torque=0.1), 0.0, 500.0),
    ("encoder 3e-5 rad at 100 Hz", Noise(position=3e-5, torque=0.01), 0.0, 100.0),
    ("steps of 2e-4 rad, torque 3 %", Noise(torque=0.03), 2e-4, 500.0),
)


class Arm:
    """A virtual arm, its motion and its truth."""

    def __init__(self, name: str, seed: int = 0) -> None:
        self.model = DynamicModel(read_robot(name), (Coulomb(0.02), Viscous()))
        self.theta = np.asarray(self.model.nominal())
        self.base = base_parameters(self.model)
        self.truth = self.base.from_standard(self.theta)
        joints = self.model.robot.dof
        reach = np.array([0.5, 0.5, 0.03, 0.6]) if "scara" in name else np.full(joints, 0.4)
        middle = np.array([0.0, 0.3, 0.08, 0.0]) if "scara" in name else np.tile([0.0, 0.4], joints)[:joints]
        draw = np.random.default_rng(seed).uniform(-1, 1, (2, joints, 5)) * reach[:, None] / np.arange(1, 6)
        self.path = FourierSeries(middle, *draw, period=PERIOD)
        self.size = np.asarray(simulate(self.model, self.theta, self.path, timing=Timing(rate=100.0)).truth.torque).std(
            axis=0
        )

    def log(self, noise: Noise, step: float, rate: float, seed: int):
        noise = replace(noise, torque=np.asarray(noise.torque) * self.size)
        noise, timing = replace(noise, resolution=step), Timing(duration=2 * PERIOD, rate=rate)
        return simulate(self.model, self.theta, self.path, noise=noise, timing=timing, seed=seed).log


def virtual(seeds: int) -> None:
    how = replace(default_preprocessing(), delay_s=HALF_TICK)
    for name in ("generic-scara", "generic-6r"):
        arm = Arm(name)
        for label, noise, step, rate in NOISES:
            chosen, errors, metric = [], {}, None
            for seed in range(seeds):
                log = arm.log(noise, step, rate, seed)
                chosen.append(choose_cutoff(arm.model, [log], how).hertz)
                bench = Bench(arm.model, arm.base, (log,), (HALF_TICK,), how, (np.zeros(arm.model.robot.dof),))
                for hertz in 2.0 ** np.arange(0, 6, 0.5):
                    if hertz < 0.2 * rate:
                        rows = bench.rows(float(hertz))
                        errors.setdefault(float(hertz), []).append(rows.fit[0] - arm.truth)
                        if abs(np.log2(hertz / chosen[0])) <= 0.25 or metric is None:
                            metric = rows.reduced.r.T @ rows.reduced.r
            grid = np.array(sorted(errors))
            told = [f"{name:14}{label:31}chosen {sorted(chosen)}"]
            for what, gram in (("torque", metric), ("parameters", np.diag(np.diag(metric)))):
                mean = np.array([np.mean([d @ gram @ d for d in errors[hertz]]) for hertz in grid])
                at = np.exp(np.interp(np.log(chosen), np.log(grid), np.log(mean))) / mean.min()
                told.append(f"{what}: best {grid[mean.argmin()]:.3g} Hz, ratio {np.median(at):.2f} to {at.max():.2f}")
            print("; ".join(told), flush=True)


def held_out(case, data, how, judge) -> float:
    """Return the held-out error of weighted least squares, judged with another preparation."""
    problem = build_problem(case.model, data.train, how)
    solution = WLS().solve(problem)
    for _ in range(8):
        if agrees(problem, solution.beta):
            break
        problem = with_load(problem, solution.beta)
        solution = WLS().solve(problem)
    judge = replace(problem.preprocessing, filter=judge.filter, rate_hz=judge.rate_hz, rows_per_period=None)
    logs = [preprocess(log.ordered(case.robot.joint_names), judge) for log in data.test]
    return validate_prepared(problem.model, problem.base, logs, solution.beta).total_relative_error


def real() -> None:
    for name in CASES:
        case = read_case(Path(__file__).parents[1] / "examples" / "cases" / f"{name}.yaml")
        data = read_data(case)
        stated = case.preprocessing
        at = replace(stated, rate_hz=None, rows_per_period=8.0)
        logs = [log.ordered(case.robot.joint_names) for log in data.train]
        started = time.process_time()
        choice = choose_cutoff(case.model, logs, replace(at, filter=FILTERS.make("butterworth")))
        spent = time.process_time() - started
        grid = stated.filter.bandwidth() * 2.0 ** np.arange(-3, 3.1, 0.5)
        errors = {}
        for hertz in (choice.hertz, *grid[grid < 0.2 * logs[0].rate]):
            how = replace(at, filter=FILTERS.make("butterworth", {"cutoff_hz": float(hertz)}))
            try:
                errors[float(hertz)] = held_out(case, data, how, stated)
            except DynidentError:
                continue
        best = min(errors, key=lambda hertz: errors[hertz])
        print(
            f"{name:7} stated {stated.filter.bandwidth():g} Hz; chosen {choice.hertz:g} Hz "
            f"({choice.low:.3g} to {choice.high:.3g}), held-out {100 * errors[choice.hertz]:.3g} %; "
            f"best {best:.3g} Hz, {100 * errors[best]:.3g} %; {spent:.1f} s",
            flush=True,
        )


def filters(seeds: int) -> None:
    options = {
        "butterworth": {},
        "kalman_smoother": {"cutoff_hz": 5.0},
        "smoothing_spline": {"cutoff_hz": 5.0},
        "five_point": {},
        "fourier_fit": {"period_s": PERIOD, "harmonics": 5},
    }
    arm = Arm("generic-6r")
    norms = np.ones(1)
    for label, noise, step, rate in NOISES[:3]:
        for name, values in options.items():
            errors, started = [], time.process_time()
            for seed in range(seeds):
                log = arm.log(noise, step, rate, seed)
                how = replace(default_preprocessing(), filter=FILTERS.make(name, values), delay_s=HALF_TICK)
                problem = build_problem(arm.model, [log], how)
                if name == "butterworth":
                    norms = np.sqrt(np.sum(problem.reduced().r ** 2, axis=0))
                error = norms * (WLS().solve(problem).beta - arm.truth)
                errors.append(np.linalg.norm(error) / np.linalg.norm(norms * arm.truth))
            spent = (time.process_time() - started) / seeds
            print(f"virtual 6R {label:20}{name:18}{100 * np.sqrt(np.mean(np.square(errors))):8.3f} %  {spent:.1f} s")
    case = read_case(Path(__file__).parents[1] / "examples" / "cases" / "panda.yaml")
    data = read_data(case)
    for name, values in options.items():
        if name == "fourier_fit":
            continue
        how = replace(case.preprocessing, filter=FILTERS.make(name, values), rate_hz=None, rows_per_period=8.0)
        print(f"panda {name:18} held-out {100 * held_out(case, data, how, case.preprocessing):.3f} %", flush=True)


if __name__ == "__main__":
    what, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 5
    {"virtual": lambda: virtual(count), "real": real, "filters": lambda: filters(count)}[what]()
