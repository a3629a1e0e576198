"""A base that leans: gravity in a direction of its own beside the gains, and whether the stated one contradicts it.

Rows are linear in gravity, so a lean of the base is two columns of the fit, the torque of the bodies by a turn of
gravity about two axes across it; the direction is found by Gauss-Newton steps. All links then carry weight about every
axis, so that the base parameters are those of a base in no special direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.applications.drive_gains.unknowns import Unknowns
from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.diagnosis.causes.bodies_in_motion import lean_torques, leaned
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel

#: Turns of the base, in rad, after which no axis of an arm is along gravity.
ODD = (0.3, 0.4)

#: A direction is found when a step turns it by less, in rad; steps at most.
FOUND, STEPS = 1e-3, 12

#: A first step that turns it by less, in rad, is of a base that stands as stated.
UPRIGHT = 0.01

#: Names of the angles.
LEAN = ("first angle of the lean", "second angle of the lean")


def under(model: DynamicModel, gravity: Array) -> DynamicModel:
    """Return a model whose base stands otherwise, gravity (3,) in m/s^2."""
    return replace(model, robot=model.robot.with_gravity(gravity))


def base_in_any_direction(model: DynamicModel) -> BaseParameters:
    """Return the base parameters of the arm on a base in no special direction."""
    return base_parameters(under(model, leaned(np.asarray(model.robot.gravity), np.array(ODD))))


def with_lean(unknowns: Unknowns) -> Unknowns:
    """Return the unknowns with two angles of a lean beside them, whose columns stand behind those of beta."""

    def wider(matrix: Array, corner: float = 0.0) -> Array:
        found = np.pad(matrix, ((0, 2), (0, 2)))
        found[-2:, -2:] = corner * np.eye(2)
        return found

    return replace(
        unknowns,
        maps=tuple(wider(each, 1.0) for each in unknowns.maps),
        known=tuple(np.pad(each, (0, 2)) for each in unknowns.known),
        bodies=tuple((wider(turn), np.pad(known, (0, 2))) for turn, known in unknowns.bodies),
        deviations=np.append(unknowns.deviations, [np.inf, np.inf]),
        names=(*unknowns.names, *LEAN),
    )


def pulls(model: DynamicModel, base: BaseParameters, beta: Array, logs: Sequence[Prepared]) -> tuple[Array, ...]:
    """Return the filtered torque at the joints by each small angle of a lean, per radian, by log, shape (N, n, 2).

    Args:
        model: With the gravity that the base is turned from.
        base: See :func:`base_in_any_direction`.
        beta: Shape (b,).
        logs: Preprocessed logs.
    """
    regressor, found = RegressorStream(model, base), []
    for log in logs:
        torque = np.moveaxis(lean_torques(regressor, log.log, beta), 0, -1)
        count, joints, _ = torque.shape
        smooth = log.smooth(torque.reshape(count, -1).T).T[log.keep]
        found.append(smooth.reshape(-1, joints, 2))
    return tuple(found)
