"""Does a tracker follow friction that drifts, how soon does it see a load, and how often is it wrong?

A six-joint arm with Coulomb and viscous friction is identified from 60 s of noisy motion (Fourier motions of 10 s,
torque noise of first order with 0.9 from sample to sample at 200 Hz). Then, with the command line's defaults:

``update``   time of one sample of the triangle, 6 rows of 54 columns: fading rows, and a window of 1000 samples.
``drift``    friction that falls by 30 % with a time constant of 60 s, runs of 120 s: error of the friction coefficients
             of tracker and estimate, and share of the 95 % intervals that hold the truth from 10 s on.
``clean``    runs in which nothing changes: events, beside what was asked for at most.
``load``     a body taken up in the middle of a run of 30 s: share that is seen as a load within 5 s, median and largest
             delay until the first threshold is passed, error of the mass over its stated deviation.
``friction`` Coulomb friction of one joint that doubles at once: share named with the right joint.

Run: python -m benchmarks.online [runs of each kind] [--figure FILE.svg]
"""

from __future__ import annotations

import argparse
import json
import os
import time as clock
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.signal

from dynident import DynamicModel, FourierSeries, Inertia, Log, Preprocessing, identify, read_robot
from dynident.applications.tracking import Pace, thresholds_of, tracked
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.identification.recursive import RecursiveLeastSquares
from dynident.model.friction import Motion

RATE, MEMORY = 200.0, 0.9
TORQUE_NOISE = np.array([3.0, 3.0, 2.0, 0.5, 0.5, 0.3])
HOW = Preprocessing(Butterworth(5.0), rate_hz=50.0)
MASSES = (0.25, 0.5, 1.0, 3.0)
FALL, WARM = 0.3, 60.0


class Cell:
    """An arm whose truth is known, and its noisy logs."""

    def __init__(self):
        robot = read_robot("generic-6r")
        self.model = DynamicModel(robot, ("coulomb", "viscous"))
        self.friction = np.repeat(np.linspace(1.5, 0.3, robot.dof), 2) * np.tile([8.0, 12.0], robot.dof)
        self.theta = np.concatenate([robot.nominal, self.friction])

    def log(self, seconds, seed, other=None, change=0.0):
        """Return a run of random motions of 10 s; from ``change`` on with the parameters ``other``, (p,) or (N, p)."""
        generator, joints = np.random.default_rng(seed), self.model.robot.dof
        time = np.arange(int(seconds * RATE)) / RATE
        series = FourierSeries(np.zeros(joints), *(0.3 * generator.normal(size=(2, joints, 5))), 30.0)
        q, dq, ddq = series.evaluate(3.0 * time)
        motion = Motion(q, 3.0 * dq, 9.0 * ddq)
        torque = self.model.torque(motion, self.theta)
        if other is not None and other.ndim == 1:
            torque = np.where((time >= change)[:, None], self.model.torque(motion, other), torque)
        elif other is not None:  # friction alone differs from sample to sample
            cold = self.model.torque(motion, np.concatenate([0.0 * self.model.robot.nominal, self.friction]))
            torque = torque + cold * (other - 1.0)
        noise = scipy.signal.lfilter(
            [np.sqrt(1 - MEMORY**2)], [1, -MEMORY], generator.normal(size=torque.shape), axis=0
        )
        return Log(self.model.robot.joint_names, time, q, motion.dq, motion.ddq, torque + TORQUE_NOISE * noise)

    def loaded(self, mass):
        """Return the parameters with a body on the last link."""
        body = Inertia.from_centre_of_mass(mass, [0.03, 0.02, 0.08], mass * 0.04**2 * np.eye(3))
        theta = self.theta.copy()
        theta[self.model.inertial_count - 10 : self.model.inertial_count] += body.vector
        return theta


def update_time():
    """Return microseconds a sample of 6 rows and 54 columns."""
    generator, size = np.random.default_rng(0), 54
    matrix = generator.normal(size=(4000, 6, size))
    for joint in range(6):
        matrix[:, joint, : 7 * joint] = 0.0
    torque = generator.normal(size=(4000, 6))
    found = {}
    for name, options in (("fading", {"forgetting": 0.999}), ("window", {"window": 1000})):
        state, taken = RecursiveLeastSquares(size, **options), []
        for one, right in zip(matrix, torque, strict=True):
            started = clock.perf_counter_ns()
            state.update(one, right)
            taken.append(clock.perf_counter_ns() - started)
        found[name] = round(float(np.median(taken[1500:])) / 1e3, 1)
    return {"microseconds": found, "load": os.getloadavg()[0]}


def drift(cell, estimate, runs):
    """Return how friction that falls while the robot runs is followed, and the last run."""
    base, friction = estimate.base, np.flatnonzero(estimate.base.independent >= cell.model.inertial_count)
    errors, static, inside, log, found = [], [], [], None, None
    for run in range(runs):
        time = np.arange(int(120 * RATE)) / RATE
        share = 1.0 - FALL * (1.0 - np.exp(-time / WARM))
        log = cell.log(120.0, 2000 + run, share[:, None])
        found = tracked(estimate, log, Pace())
        late = found.time > 10.0
        left = 1.0 - FALL * (1.0 - np.exp(-found.time[late] / WARM))
        truth = base.from_standard(cell.theta)[friction] * left[:, None]
        away = found.beta[late][:, friction] - truth
        errors.append(np.mean((away / truth) ** 2))
        static.append(np.mean((estimate.beta[friction] / truth - 1.0) ** 2))
        inside.append(np.mean(np.abs(away) <= found.half_widths()[late][:, friction]))
    figures = {
        "tracked": float(np.sqrt(np.mean(errors))),
        "static": float(np.sqrt(np.mean(static))),
        "inside_95": float(np.mean(inside)),
    }
    return figures, found


def unchanged(cell, estimate, thresholds, runs):
    """Return how often a change is seen where there is none, and how often the intervals hold what does not change."""
    truth, found, inside = estimate.base.from_standard(cell.theta), 0, []
    for run in range(runs):
        one = tracked(estimate, cell.log(120.0, 1000 + run), Pace(), thresholds)
        found += len(one.events)
        inside.append(np.mean((np.abs(one.beta - truth) <= one.half_widths())[one.time > 10.0]))
    hours = runs * 120.0 / 3600.0
    return {
        "hours": round(hours, 2),
        "asked_at_most": round(hours, 2),
        "events": found,
        "inside_95": float(np.mean(inside)),
    }


def events(cell, estimate, thresholds, runs, other=None):
    """Return the events of runs of 30 s in which the parameters change in the middle."""
    logs = (cell.log(30.0, 3000 + run, other, 15.0) for run in range(runs))
    return [tracked(estimate, log, Pace(), thresholds).events for log in logs]


def loads(cell, estimate, thresholds, runs):
    """Yield what is seen of bodies that are taken up."""
    for mass in MASSES:
        found = events(cell, estimate, thresholds, runs, cell.loaded(mass))
        hits = [[e for e in each if 14.5 <= e.time <= 20.0] for each in found]
        right = [each[0] for each in hits if each and each[0].change.kind == "load"]
        masses = [(e.mass[0] - mass) / e.mass[1] for e in right if e.mass]
        yield {
            "mass": mass,
            "seen": sum(map(bool, hits)) / runs,
            "named": len(right) / runs,
            "median_delay_s": float(np.median([e.time - 15.0 for e in right])) if right else None,
            "largest_delay_s": max((e.time - 15.0 for e in right), default=None),
            "mass_rms_of_std": float(np.sqrt(np.mean(np.square(masses)))) if masses else None,
            "mass_median": float(np.median([e.mass[0] for e in right if e.mass])) if masses else None,
        }


def doubled(cell, estimate, thresholds, runs):
    """Yield what is seen of Coulomb friction that doubles, joint by joint."""
    for joint, name in enumerate(cell.model.robot.joint_names):
        other = cell.theta.copy()
        other[cell.model.inertial_count + 2 * joint] *= 2.0
        found = events(cell, estimate, thresholds, runs, other)
        hits = [[e for e in each if 14.5 <= e.time <= 20.0] for each in found]
        named = [bool(each) and (each[0].change.kind, each[0].change.owner) == ("friction", name) for each in hits]
        yield {"joint": name, "seen": sum(map(bool, hits)) / runs, "named": sum(named) / runs}


def draw(path, cell, estimate, found):
    """Write Coulomb friction of the first and the last joint over time with its interval, truth dashed."""
    from dynident.results.figures.chart import Across, Line, Plot, ShadedBand, chart
    from dynident.results.figures.files import figure_file

    plots, half = [], found.half_widths()
    truth = estimate.base.from_standard(cell.theta)
    joints = cell.model.robot.joint_names
    for name in (f"Fc[{joints[0]}]", f"Fc[{joints[-1]}]"):
        k = estimate.base.names.index(name)
        low, high = found.beta[:, k] - half[:, k], found.beta[:, k] + half[:, k]
        left = 1.0 - FALL * (1.0 - np.exp(-found.time / WARM))
        marks = (
            ShadedBand("95 % interval", found.time, high, 1, low=low),
            Line("tracked", found.time, found.beta[:, k], 1),
            Line("truth", found.time, truth[k] * left, 2, dashed=True),
        )
        plots.append(Plot(f"{name} [N·m]", marks))
    title, told = (
        "Friction that falls by 30 %",
        "Coulomb friction of two joints over time, with its interval and the truth.",
    )
    drawing = chart(title, told, Across("time [s]"), plots)
    Path(path).write_bytes(figure_file(drawing, title, told, Path(path).suffix[1:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="?", type=int, default=40)
    parser.add_argument("--figure", metavar="FILE", help="draw the last run with drifting friction (SVG)")
    options = parser.parse_args()
    cell = Cell()
    print(json.dumps({"update": update_time()}), flush=True)
    estimate = identify(cell.model, [cell.log(60.0, 1)], "wls", HOW)
    estimate = replace(estimate, envelope=None)
    figures, last = drift(cell, estimate, max(1, options.runs // 4))
    print(json.dumps({"drift": figures}), flush=True)
    if options.figure:
        draw(options.figure, cell, estimate, last)
    thresholds = thresholds_of(estimate, [cell.log(60.0, 1), cell.log(60.0, 2)], Pace(), 1.0)
    print(json.dumps({"clean": unchanged(cell, estimate, thresholds, options.runs)}), flush=True)
    for one in loads(cell, estimate, thresholds, options.runs):
        print(json.dumps({"load": one}), flush=True)
    for one in doubled(cell, estimate, thresholds, max(1, options.runs // 2)):
        print(json.dumps({"friction": one}), flush=True)


if __name__ == "__main__":
    main()
