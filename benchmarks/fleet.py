"""What does a fleet know that its robots alone do not? Shrunk, separate and pooled estimates against a known truth.

Fleets of the arm ``generic-scara`` with Coulomb and viscous friction (16 base parameters) are drawn
from the model of the method: inertial parameters differ by 1 %, friction by 20 % from robot to robot. A robot's log is
a Fourier motion of its own with white torque noise at 100 Hz; as least squares of such rows is normal with a known
covariance, estimates are drawn from it and no log is simulated. Errors of the torque are along a motion that no log
has, without noise, as a share of its torque; those of friction coefficients as a share of their values.

``accuracy``  by robots and seconds a robot: errors of separate, pooled and shrunk estimates, share of the 95 %
              intervals of the shrunk ones that hold the truth.
``alarms``    fleets in which all belong: share in which a robot is called out at the rate of 5 %.
``faults``    one robot in ten with one friction coefficient three times as large: share found, share named with the
              right parameter, and fleets in which another one is called out.
``logs``      a few fleets of simulated logs through ``identify`` and ``fleet``, estimates and torques as above.

Run: python -m benchmarks.fleet [fleets of each cell] [--logs N]
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from dynident import DynamicModel, FourierSeries, Log, Preprocessing, base_parameters, identify, read_robot
from dynident.applications.fleet import fleet_of, robot_of_estimate
from dynident.applications.fleet.fleet import screened
from dynident.applications.fleet.population import Member, population_of
from dynident.data.preprocessing import preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.friction import Motion
from dynident.model.reduction import reduce

RATE = 100.0
NOISE = np.array([3.0, 3.0, 9.0, 0.6])
GIVEN = Preprocessing(AsGiven(), rest="keep")
COUNTS, SECONDS = (2, 3, 5, 10, 20, 50), (2.0, 10.0, 60.0)
MOTIONS = 40
INERTIAL, FRICTION = 0.01, 0.2


class Type:
    """A type of robot, the information of some motions, and the triangle of a motion to test on."""

    def __init__(self):
        robot = read_robot("generic-scara")
        self.model = DynamicModel(robot, ("coulomb", "viscous"))
        self.base = base_parameters(self.model)
        self.regressor = RegressorStream(self.model, self.base)
        self.theta = np.concatenate([robot.nominal, np.tile([2.0, 3.0], robot.dof)])
        self.mean = self.base.from_standard(self.theta)
        self.friction = np.flatnonzero(self.base.independent >= self.model.inertial_count)
        self.test = self.triangle(999, 60.0, np.ones(4))
        self.size = np.sqrt(np.mean((self.test @ self.mean) ** 2))

    def robot(self, generator):
        """Return the standard parameters of a robot."""
        inertial = self.theta[: self.model.inertial_count].reshape(-1, 10)
        scaled = inertial * (1.0 + INERTIAL * generator.normal(size=(len(inertial), 1)))
        friction = self.theta[self.model.inertial_count :] * np.exp(FRICTION * generator.normal(size=8))
        return np.concatenate([scaled.ravel(), friction])

    def log(self, seed, seconds, theta=None):
        """Return a log without noise."""
        generator, joints = np.random.default_rng(seed), self.model.robot.dof
        scale = np.array([0.6, 0.6, 0.05, 0.8])[:, None]
        series = FourierSeries(np.zeros(joints), *(scale * generator.normal(size=(2, joints, 4)) / 2), 7.5)
        time = np.arange(int(seconds * RATE)) / RATE
        q, dq, ddq = series.evaluate(time)
        torque = self.model.torque(Motion(q, dq, ddq), self.theta if theta is None else theta)
        return Log(self.model.robot.joint_names, time, q, dq, ddq, torque)

    def triangle(self, seed, seconds, weights):
        """Return R of the weighted rows of a motion, shape (b, b)."""
        prepared = preprocess(self.log(seed, seconds), GIVEN)
        mask = np.ones((len(prepared.keep), self.model.robot.dof), bool)
        return reduce(self.regressor.triangles(prepared, mask), self.base.count, weights).r

    def torque_error(self, away):
        """Return the mean square error of the torque by that of parameters (N, b), a share of the torque's square."""
        return np.mean((away @ self.test.T) ** 2, axis=1) / self.size**2


class Draws:
    """Fleets whose logs have a length."""

    def __init__(self, kind, seconds):
        self.kind = kind
        self.roots = [kind.triangle(k, seconds, 1.0 / NOISE) for k in range(MOTIONS)]

    def fleet(self, generator, count, faults=0):
        """Return truth (N, b) and members; the first robots have a fault in one friction coefficient each, (f,)."""
        kind = self.kind
        theta = np.array([kind.robot(generator) for _ in range(count)])
        which = generator.integers(kind.model.inertial_count, len(kind.theta), faults)
        theta[np.arange(faults), which] *= 3.0
        truth = theta @ kind.base.matrix.T
        members = []
        for k, true in enumerate(truth):
            root = self.roots[generator.integers(MOTIONS)]
            members.append(Member(str(k), root.T @ root, root.T @ (root @ true + generator.normal(size=len(true)))))
        return truth, members, which


def accuracy(draws, count, fleets, seed):
    """Return the errors of three kinds of estimates, root mean square over fleets."""
    generator, kind = np.random.default_rng(seed), draws.kind
    torques, parameters, inside = np.zeros(3), np.zeros(3), []
    for _ in range(fleets):
        truth, members, _ = draws.fleet(generator, count)
        own = np.array([np.linalg.solve(one.information, one.vector) for one in members])
        total = np.sum([one.information for one in members], axis=0)
        pooled = np.linalg.solve(total, np.sum([one.vector for one in members], axis=0))
        population = population_of(members)
        found = [population.member(one) for one in members]
        shrunk = np.array([beta for beta, _ in found])
        half = 1.96 * np.sqrt([np.diag(covariance) for _, covariance in found])
        for k, values in enumerate((own, np.tile(pooled, (count, 1)), shrunk)):
            torques[k] += kind.torque_error(values - truth).mean()
            parameters[k] += np.mean((values / truth - 1.0)[:, kind.friction] ** 2)
        inside.append(np.mean(np.abs(shrunk - truth) <= half))
    names = ("separate", "pooled", "shrunk")
    return {
        "torque": dict(zip(names, np.sqrt(torques / fleets).round(5).tolist(), strict=True)),
        "friction": dict(zip(names, np.sqrt(parameters / fleets).round(3).tolist(), strict=True)),
        "inside_95": round(float(np.mean(inside)), 4),
    }


def outliers(draws, count, fleets, faults, seed):
    """Return how often robots are called out."""
    generator, kind = np.random.default_rng(seed), draws.kind
    found = named = false = 0
    for _ in range(fleets):
        _, members, which = draws.fleet(generator, count, faults)
        screening = screened(members, 0.05)
        out = {int(name) for name in screening.out}
        hits = [k for k in out if k < faults]
        found += len(hits)
        named += sum(int(kind.base.independent[screening.distances[k].parameter]) == which[k] for k in hits)
        false += bool(out - set(range(faults)))
    if not faults:
        return {"called_out": false / fleets}
    return {"found": found / faults / fleets, "named": named / max(found, 1), "others_called_out": false / fleets}


def through_logs(kind, count, seconds, seed):
    """Return the torque errors of a fleet of noisy simulated logs: separate estimates and those of the fleet."""
    generator = np.random.default_rng(seed)
    robots, truth = [], []
    for k in range(count):
        theta = kind.robot(generator)
        log = kind.log(10_000 * seed + k, seconds, theta)
        noisy = Log(
            log.joints, log.time, log.q, log.dq, log.ddq, log.torque + NOISE * generator.normal(size=log.q.shape)
        )
        robots.append(robot_of_estimate(f"r{k}", identify(kind.model, [noisy], "consistent", GIVEN)))
        truth.append(kind.base.from_standard(theta))
    fleet = fleet_of(robots)
    errors = [
        kind.torque_error(np.array([one.beta for one in each]) - np.array(truth)).mean()
        for each in ([robot.own for robot in robots], fleet.estimates)
    ]
    return errors, len(fleet.screening.out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fleets", nargs="?", type=int, default=200)
    parser.add_argument("--logs", type=int, default=5, help="fleets of simulated logs")
    options = parser.parse_args()
    kind = Type()
    for seconds in SECONDS:
        draws = Draws(kind, seconds)
        for count in COUNTS:
            fleets = max(4, options.fleets * 10 // max(count, 10))
            told = {"robots": count, "seconds": seconds, "fleets": fleets}
            print(json.dumps({"accuracy": told | accuracy(draws, count, fleets, 1)}), flush=True)
    for seconds in (2.0, 10.0):
        draws = Draws(kind, seconds)
        for count in (5, 10):
            told = {"robots": count, "seconds": seconds, "fleets": options.fleets}
            print(json.dumps({"alarms": told | outliers(draws, count, options.fleets, 0, 2)}), flush=True)
            faults = max(1, count // 10)
            found = outliers(draws, count, max(4, options.fleets // 2), faults, 3)
            print(json.dumps({"faults": told | {"faults": faults} | found}), flush=True)
    if options.logs:
        found = [through_logs(kind, 10, 5.0, 1 + k) for k in range(options.logs)]
        separate, shrunk = np.sqrt(np.mean([errors for errors, _ in found], axis=0))
        told = {"robots": 10, "seconds": 5.0, "fleets": options.logs, "called_out": sum(out for _, out in found)}
        print(json.dumps({"logs": told | {"separate": float(separate), "shrunk": float(shrunk)}}), flush=True)


if __name__ == "__main__":
    main()
