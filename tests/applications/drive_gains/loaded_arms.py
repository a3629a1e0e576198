"""Arms with drive gains that are known, and logs of their currents without and with a payload."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.inertia import Inertia
from dynident.model.robot import Robot

GIVEN = Preprocessing(AsGiven(), rest="keep")

MASS = 2.5
CENTRE = np.array([0.08, 0.05, -0.06])
BODY = np.diag([0.02, 0.015, 0.012])


@dataclass(frozen=True)
class LoadedArm:
    """A robot, its friction, its gains, and what it does."""

    robot: Robot
    gains: Array
    friction: tuple[str, ...] = ("coulomb", "viscous", "offset")
    rate: float = 50.0
    seconds: float = 12.0

    @property
    def model(self) -> DynamicModel:
        return DynamicModel(self.robot, tuple(FRICTION.make(name) for name in self.friction))

    def loaded(self) -> Robot:
        """Return the robot with the payload in the frame of its last link."""
        *links, last = self.robot.links
        assert last.inertia is not None
        body = last.inertia + Inertia.from_centre_of_mass(MASS, CENTRE, BODY)
        return replace(self.robot, links=(*links, replace(last, inertia=body)))

    def theta(self, robot: Robot, warm: float = 1.0) -> Array:
        model = self.model
        assert robot.nominal is not None
        tail = np.linspace(0.4, 1.6, len(model.parameters) - model.inertial_count)
        return np.concatenate([robot.nominal, warm * tail])

    def log(self, payload: bool, noise: float = 0.0, seed: int = 0, warm: float = 1.0) -> Log:
        """Return a log of currents; ``noise`` is a share of each drive's root mean square current."""
        robot = self.loaded() if payload else self.robot
        model = replace(self.model, robot=robot)
        generator = np.random.default_rng(40 + payload)
        sine, cosine = 0.35 * generator.normal(size=(2, robot.dof, 5))
        time = np.arange(int(self.seconds * self.rate)) / self.rate
        q, dq, ddq = FourierSeries(np.zeros(robot.dof), sine, cosine, 6.0).evaluate(time)
        torque = model.torque(Motion(q, dq, ddq), self.theta(robot, warm))
        current = torque @ np.linalg.inv(np.asarray(robot.coupling)) / self.gains
        size = np.sqrt(np.mean(current**2, axis=0))
        white = np.random.default_rng(seed + 1000 * payload).normal(size=current.shape)
        return Log(robot.joint_names, time, q, dq, ddq, current=current + noise * size * white)
