"""The excitation problem that rows share, and the literature's route to its criterion: a loop over Pinocchio."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.speed.arms import as_pinocchio, pinocchio_columns, ur10
from dynident.arrays import Array
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.design_problem import DesignProblem
from dynident.excitation.design.limits import MotionLimits
from dynident.excitation.design.observation import Observation
from dynident.excitation.design.parametrisation import parametrise
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion

PERIOD, HARMONICS, SAMPLES = 10.0, 5, 200
POSITION, ACCELERATION = 2.9, 10.0
VELOCITY = (2.16, 2.16, 3.15, 3.2, 3.2, 3.2)


def ur10_design() -> DesignProblem:
    """Return the condition number (SI columns) of 48 base columns of a UR10 within limits to q, dq and ddq."""
    model = DynamicModel(ur10(), ("coulomb", "viscous"))
    dof = model.robot.dof
    low, none = np.full(dof, -POSITION), np.full(dof, np.inf)
    names, turning = model.robot.joint_names, (True,) * dof
    bounds = (low, -low, np.array(VELOCITY), np.full(dof, ACCELERATION), none, none)
    limits, shape = MotionLimits(names, turning, *bounds), parametrise("fourier", PERIOD, HARMONICS)
    observation, criterion = Observation(model, base_parameters(model)), CRITERIA.make("condition")
    return DesignProblem(observation, shape, criterion, limits, np.ones(dof), None, SAMPLES)


class Loop:
    """The criterion as the literature computes it: sample by sample, then the singular values of the whole matrix."""

    def __init__(self, pinocchio: Any, problem: DesignProblem) -> None:
        self.pinocchio, self.problem = pinocchio, problem
        self.model, self.base = problem.observation.model, problem.observation.base
        self.oracle = as_pinocchio(self.model.robot)
        self.data = self.oracle.createData()
        self.columns = pinocchio_columns(self.base.independent[self.base.independent < self.model.inertial_count])

    def matrix(self, motion: Motion) -> Array:
        """Return the base observation matrix of a motion, shape (N, n, b)."""
        kept, each = len(self.columns), self.model.coefficients_per_joint
        matrix = np.zeros((*motion.q.shape, self.base.count))
        regressor, oracle, data = self.pinocchio.computeJointTorqueRegressor, self.oracle, self.data
        for k in range(len(motion.q)):
            matrix[k, :, :kept] = regressor(oracle, data, motion.q[k], motion.dq[k], motion.ddq[k])[:, self.columns]
        friction = self.model.friction_values(motion)
        for j in range(matrix.shape[1]):
            matrix[:, j, kept + each * j : kept + each * (j + 1)] = friction[:, j]
        return matrix

    def cost(self, x: Array) -> float:
        """Return the condition number, or minus log det of the information, at free numbers."""
        matrix = self.matrix(self.problem.motion(x))
        if not self.problem.criterion.weighted:
            return float(np.linalg.cond(matrix.reshape(-1, self.base.count)))
        weighted = (matrix / self.problem.noise[:, None]).reshape(-1, self.base.count)
        return -float(np.linalg.slogdet(weighted.T @ weighted / len(matrix))[1])
