"""Small arms with torque noise of any kind: white, coloured, correlated between joints, with gross errors."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.identification.problem.problem import Problem, make_problem
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot

GIVEN = Preprocessing(AsGiven(), rest="keep")

MakeLog = Callable[..., Log]


class Bench:
    """A model with its truth and one exact log; ``problem(noise)`` adds noise to the torque and reduces."""

    def __init__(
        self, robot: Robot, exact_log: MakeLog, samples: int = 400, friction: tuple[str, ...] = ("coulomb", "viscous")
    ) -> None:
        self.model = DynamicModel(robot, tuple(FRICTION.make(name) for name in friction))
        assert robot.nominal is not None
        tail = np.linspace(0.5, 1.5, len(self.model.parameters) - self.model.inertial_count)
        self.theta = np.append(robot.nominal, tail)
        self.base = base_parameters(self.model)
        self.truth = self.base.from_standard(self.theta)
        self.log = exact_log(self.model, self.theta, samples=samples)
        self.size = np.std(np.asarray(self.log.torque), axis=0)

    def problem(self, noise: Array, cuts: tuple[int, ...] = ()) -> Problem:
        """Return the problem of the torque plus noise (N, n), the log cut into several at some samples."""
        log = replace(self.log, torque=np.asarray(self.log.torque) + noise)
        edges = [0, *cuts, log.samples]
        parts = [log.rows(slice(a, b), f"part {a}") for a, b in itertools.pairwise(edges)]
        return make_problem(self.model, self.base, [preprocess(part, GIVEN) for part in parts])

    def filtered(self, noise: Array, cutoff_hz: float) -> Problem:
        """Return the problem whose torque is that of the model plus noise (N, n), both low-passed, of all rows."""
        prepared = preprocess(self.log, Preprocessing(Butterworth(cutoff_hz), rest="keep"))
        exact = RegressorStream(self.model, self.base).predict(prepared.log, self.truth)
        torque = prepared.smooth((exact + noise).T).T
        log = replace(prepared.log, torque=torque, raw_torque=exact + noise)
        return make_problem(self.model, self.base, [replace(prepared, log=log)])

    def white(self, seed: int, share: float = 0.02) -> Array:
        """Return white noise of a share of each joint's torque, shape (N, n)."""
        return share * self.size * np.random.default_rng(seed).normal(size=(self.log.samples, len(self.size)))

    def coloured(self, seed: int, pole: float, share: float = 0.02) -> Array:
        """Return first-order coloured noise of the same size, shape (N, n)."""
        white = self.white(seed, share) * np.sqrt(1 - pole**2)
        white[0] /= np.sqrt(1 - pole**2)
        for t in range(1, len(white)):
            white[t] += pole * white[t - 1]
        return white

    def gross(self, seed: int, rows: float = 0.05, size: float = 2.0, share: float = 0.02) -> Array:
        """Return white noise with gross errors, all of one sign, on a share of the rows of each joint, shape (N, n)."""
        generator = np.random.default_rng(1000 + seed)
        hit = generator.random((self.log.samples, len(self.size))) < rows
        return self.white(seed, share) + np.where(hit, size * self.size * generator.uniform(0.5, 1.5, hit.shape), 0.0)
