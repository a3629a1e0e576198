"""Design problems of small arms for the tests of bounds and feasibility, with distances in closed form."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.limits import limits_of
from dynident.excitation.design.observation import Observation, TorqueUncertainty
from dynident.excitation.design.parametrisation import parametrise
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.joint import JointLimits
from dynident.model.robot import Robot

LIMITS = JointLimits(-2.0, 1.5, 2.0, 8.0, 60.0, 150.0, 900.0)


@dataclass(frozen=True)
class TipWalls:
    """Tip of the first two links of a planar arm (0.5 m and 0.4 m) beside walls: distance = offset - normal . tip."""

    normals: Array = field(default_factory=lambda: np.array([[1.0, 0.0], [0.6, 0.8], [0.0, -1.0]]))
    offsets: Array = field(default_factory=lambda: np.array([0.8, 0.75, 0.6]))
    required: Array = field(default_factory=lambda: np.array([0.05, 0.02, 0.1]))
    names: tuple[str, ...] = ("tip | wall", "tip | beam", "tip | floor")

    def distances(self, q: Array) -> Array:
        first, both = q[:, 0], q[:, 0] + q[:, 1]
        tip = np.stack([0.5 * np.cos(first) + 0.4 * np.cos(both), 0.5 * np.sin(first) + 0.4 * np.sin(both)], axis=1)
        return self.offsets - tip @ self.normals.T

    def gradient(self, q: Array, pair: npt.ArrayLike) -> Array:
        first, both = q[:, 0], q[:, 0] + q[:, 1]
        outer = np.stack([-0.4 * np.sin(both), 0.4 * np.cos(both)], axis=1)
        inner = np.stack([-0.5 * np.sin(first), 0.5 * np.cos(first)], axis=1) + outer
        normals = self.normals[np.asarray(pair)]
        found = np.zeros((len(q), q.shape[1]))
        found[:, 0], found[:, 1] = -np.sum(normals * inner, axis=1), -np.sum(normals * outer, axis=1)
        return found

    def speed_bound(self) -> Array:
        return np.tile([0.9, 0.4], (len(self.names), 1))


def model_of(robot: Robot, limits: JointLimits = LIMITS) -> DynamicModel:
    joints = tuple(replace(joint, limits=limits) for joint in robot.joints)
    return DynamicModel(replace(robot, joints=joints), ("coulomb", "viscous", "offset"))  # type: ignore[arg-type]


def problem_of(
    model: DynamicModel, kind: str = "rest_fourier", samples: int = 90, sigmas: float | None = None, **given: Any
) -> DesignProblem:
    """Return a problem of 6 s and 4 harmonics; with ``sigmas`` every parameter is uncertain by 10 %."""
    theta = model.nominal()
    assert theta is not None
    theta[model.inertial_count :: 3] = 2.0  # dry friction
    observation = Observation(model, base_parameters(model))
    if sigmas is not None:
        given["uncertainty"] = TorqueUncertainty.of_shares(observation.base, theta, 0.1, sigmas)
    noise = np.linspace(0.5, 2.0, model.robot.dof)
    limits = given.pop("limits", limits_of(model.robot))
    criterion = CRITERIA.make("d_optimal")
    return DesignProblem(observation, parametrise(kind, 6.0, 4), criterion, limits, noise, theta, samples, **given)
