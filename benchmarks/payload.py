"""Does the 95 % interval of a payload's mass hold the truth in 95 of 100 runs? A Monte Carlo over the torque noise.

A six-joint arm with Coulomb and viscous friction and an offset is identified by weighted least squares from one motion
of 12 s, and follows another with 2.6 kg at its tool. The torque noise of both is new in each run: white, or of first
order with 0.9 from sample to sample at 100 Hz; one twentieth of each joint's torque. Rows pass the default 5 Hz filter.
Kinds: ``motion`` (friction is a tenth higher with the payload), ``same`` (friction is the same, and taken to be so),
``poses`` (12 postures of 1.2 s; what friction holds at each is uniform within its Coulomb friction), ``gains`` (as
``motion``, currents whose drive gains are off by 5 % each (standard deviation), the same in both runs). Printed: share
of intervals that hold the true mass, centre and inertia, error and median half width of the mass, and the share of runs
whose possible body is within the noise; after every 100 runs those so far, which a benchmark that is stopped keeps.
Run: python -m benchmarks.payload [runs] [kind, ...]
     python -m benchmarks.payload real: the UR10e's run with a load, of DYNIDENT_DATA (identifies the robot first)
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.loaded_arm import first_order, random_motion, six_joint_arm, with_body
from dynident import DynamicModel, Inertia, Log, identify, preprocess, read_case
from dynident.applications.payload import BeforeRun, identify_payload
from dynident.arrays import Array
from dynident.identification.problem.problem import make_problem
from dynident.identification.residuals.coloured import spectral_uncertainty
from dynident.identification.residuals.covariance import residual_factors
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.friction import Motion
from dynident.model.reduction import least_squares

RATE, SECONDS, SHARE, MEMORY = 100.0, 12.0, 0.05, 0.9
MASS, CENTRE, BODY = 2.6, np.array([0.05, 0.1, 0.04]), np.diag([0.02, 0.015, 0.012])
KINDS = ("motion", "same", "poses", "gains")
GAIN_ERROR = 0.05
HOLDS, HOLD_SECONDS = 12, 1.2
PART = 100


class Bench:
    """An arm and its noise-free logs without and with the payload."""

    def __init__(self, kind):
        self.kind = kind
        self.gains: float | Array = 1.0
        self.model, self.friction = six_joint_arm()
        robot, friction = self.model.robot, self.friction
        carrying = with_body(robot, Inertia.from_centre_of_mass(MASS, CENTRE, BODY))
        heavy = DynamicModel(carrying, self.model.friction)
        assert robot.nominal is not None and heavy.robot.nominal is not None
        warm = 1.1 if kind in ("motion", "gains") else 1.0
        self.empty = self.motion(self.model, np.concatenate([robot.nominal, friction]), 1)
        theta = np.concatenate([heavy.robot.nominal, friction * warm])
        self.loaded = self.postures(heavy, theta) if kind == "poses" else self.motion(heavy, theta, 2)
        self.first = identify(self.model, [self.noisy(self.empty, np.random.default_rng(0), 0.0)], "wls")

    @staticmethod
    def motion(model, theta, seed):
        time = np.arange(int(SECONDS * RATE)) / RATE
        motion = random_motion(model.robot.dof, seed, time, 6.0)
        return Log(model.robot.joint_names, time, motion.q, motion.dq, torque=model.torque(motion, theta))

    @staticmethod
    def postures(model, theta):
        """Return stands; what friction holds at each is drawn anew by :meth:`noisy`."""
        held = np.random.default_rng(3).uniform(-1.2, 1.2, size=(HOLDS, model.robot.dof))
        each = int(HOLD_SECONDS * RATE)
        moves = [np.linspace(a, b, 40, endpoint=False) for a, b in zip(held, [*held[1:], held[-1] + 0.1], strict=True)]
        q = np.concatenate(
            [part for a, move in zip(held, moves, strict=True) for part in (np.tile(a, (each, 1)), move)]
        )
        time = np.arange(len(q)) / RATE
        dq = np.gradient(q, 1 / RATE, axis=0)
        torque = model.torque(Motion(q, np.zeros_like(q), np.zeros_like(q)), theta)
        return Log(model.robot.joint_names, time, q, dq, torque=torque)

    def noisy(self, log, generator, memory):
        """Return a log with noise, and with the gains of its drives."""
        noise = first_order(generator, log.samples, log.q.shape[1], memory)
        torque = log.torque + SHARE * np.sqrt(np.mean(log.torque**2, axis=0)) * noise
        if self.kind == "poses" and log is self.loaded:
            each = int(HOLD_SECONDS * RATE) + 40
            stand = np.repeat(generator.uniform(-1, 1, size=(HOLDS, log.q.shape[1])), each, axis=0)[: log.samples]
            torque = torque + stand * self.friction[::3]  # a joint that stands is held anywhere within its friction
        torque = torque * self.gains
        return replace(log, torque=torque, current=torque / 10.0 if self.kind == "gains" else None)

    def robot(self, generator, memory):
        """Return the estimate of a run: weighted least squares and its coloured covariance, the rest of the first."""
        prepared = preprocess(self.noisy(self.empty, generator, memory), self.first.preprocessing)
        problem = make_problem(self.model, self.first.base, [prepared])
        weights = np.ones(self.model.robot.dof)
        beta = least_squares(problem.reduced(weights)).beta
        for _ in range(2):
            weights = 1.0 / problem.joint_deviations(beta)
            beta = least_squares(problem.reduced(weights)).beta
        passes = RowPasses(problem)
        sure = spectral_uncertainty(problem, weights, beta, passes)
        spread, factors = problem.joint_deviations(beta), residual_factors(passes, beta)
        facts = {"joint_deviations": spread, "correlation_factors": factors, "degrees": sure.degrees}
        return replace(self.first, beta=beta, covariance=sure.covariance, **facts)


def figures(kind, memory, runs):
    """Return the figures of one kind of run and one kind of noise."""
    bench, generator = Bench(kind), np.random.default_rng(11)
    share = {"motion": 1.0, "same": 0.0, "poses": 1.0, "gains": 1.0}[kind]
    truth = {"m": MASS, **dict(zip(("cx", "cy", "cz"), CENTRE, strict=True))}
    body = Inertia.from_centre_of_mass(MASS, CENTRE, BODY)
    truth |= dict(zip(("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"), body.vector[:6], strict=True))
    inside: dict[str, list[bool]] = {name: [] for name in truth}
    halves, errors, near, rows = list[float](), list[float](), list[bool](), ""
    for done in range(1, runs + 1):
        if kind == "gains":
            bench.gains = 1.0 + GAIN_ERROR * generator.normal(size=bench.model.robot.dof)
        estimate = bench.robot(generator, memory)
        found = identify_payload(
            estimate, [bench.noisy(bench.loaded, generator, memory)], known=BeforeRun(friction_share=share)
        )
        for one in (*found.parameters, *found.centre):
            if one.name in truth and np.isfinite(one.half_width):
                inside[one.name].append(abs(one.value - truth[one.name]) <= one.half_width)
        halves.append(found.mass.half_width)
        errors.append(found.mass.value - MASS)
        near.append(found.distance < 3.3)
        rows = found.rows
        if done % PART == 0 and done < runs:
            told = {"kind": kind, "memory": memory, "runs": done, "rows": rows}
            print(json.dumps(told | shares(inside, halves, errors, near)), flush=True)
    return {"kind": kind, "memory": memory, "runs": runs, "rows": rows, **shares(inside, halves, errors, near)}


def shares(inside, halves, errors, near):
    """Return what the runs so far say: how many intervals hold the truth, and the size of the mass's."""
    return {
        "held": {name: round(float(np.mean(hits)), 3) for name, hits in inside.items() if hits},
        "mass_error_std": round(float(np.std(errors)), 4),
        "mass_half_width": round(float(np.median(halves)), 4),
        "possible_within_noise": round(float(np.mean(near)), 3),
    }


def real():
    """Print what the UR10e's run with a load says: gains as far as joints disagree, exact, known to 5 %."""
    case = read_case(Path(__file__).parents[1] / "examples/cases/ur10e.yaml")
    estimate = identify(case.model, [case.read(name) for name in case.train], "consistent", case.preprocessing)
    log = case.read(Path(os.environ["DYNIDENT_DATA"]) / "ur10e_mamedov/ident_20_01_13_load_2600.csv")
    for deviation in (None, 0.0, 0.05):
        found = identify_payload(estimate, [log], known=BeforeRun(gain_deviation=deviation))
        shown = {one.name: [round(one.value, 4), round(one.half_width, 4)] for one in (found.mass, *found.centre)}
        print(json.dumps({"gain_deviation": deviation, **shown, "inertia": found.inertia_known}), flush=True)


def main() -> None:
    if sys.argv[1:] == ["real"]:
        real()
        return
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    for kind in sys.argv[2:] or KINDS:
        for memory in (0.0, MEMORY):
            print(json.dumps(figures(kind, memory, runs)), flush=True)


if __name__ == "__main__":
    main()
