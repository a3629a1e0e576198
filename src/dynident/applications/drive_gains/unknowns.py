"""What is known and what is not about the base parameters behind currents: beta of run s = known_s + map_s z.

Runs share bodies and rotors; each has friction of its own, which changes with temperature and load. A payload adds its
ten parameters to the link that carries it (Gautier and Briot 2014); a description taken for true leaves friction and
rotors, and errors of its bodies where they are trusted to a share only.

Rows are linear in gravity, so a lean of the base is two columns of the fit, the torque of the bodies by a turn of
gravity about two axes across it; the direction is found by Gauss-Newton steps. All links then carry weight about every
axis, so that the base parameters are those of a base in no special direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.applications.drive_gains.payload import CarriedBody
from dynident.arrays import Array
from dynident.case.evidence.torques import body_errors
from dynident.data.preprocessing import Prepared
from dynident.diagnosis.causes.bodies_in_motion import lean_torques, leaned
from dynident.errors import BadOption
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel

TEN = 10
LEAST = 1e-9


@dataclass(frozen=True)
class Unknowns:
    """The unknowns z beside the gains.

    Attributes:
        maps: By run, shape (b, Z).
        known: By run, shape (b,).
        bodies: By run: the part of beta that sets the scale when z has its value (payload, description), as a map of
            z and a known part, shape (b, Z) and (b,); zero maps where nothing known acts in that run.
        deviations: Standard deviation of what is known of z about zero, shape (Z,); infinite where nothing is.
        names: Of z.
        scale: Place in z of the relative error that all bodies have alike; None where they have none.
    """

    maps: tuple[Array, ...]
    known: tuple[Array, ...]
    bodies: tuple[tuple[Array, Array], ...]
    deviations: Array
    names: tuple[str, ...]
    scale: int | None = None

    @property
    def count(self) -> int:
        """Z."""
        return len(self.names)

    def beta(self, run: int, z: Array) -> Array:
        """Return the base parameters of a run, shape (b,)."""
        plain = self.known[run] + self.maps[run] @ z
        return plain if self.scale is None else plain + z[self.scale] * self._plain_bodies(run, z)

    def slopes(self, run: int, z: Array) -> Array:
        """Return the derivatives of the base parameters of a run with respect to z, shape (b, Z)."""
        if self.scale is None:
            return self.maps[run]
        found = self.maps[run] + z[self.scale] * self.bodies[run][0]
        found[:, self.scale] = self._plain_bodies(run, z)
        return found

    def scale_bodies(self, run: int, z: Array) -> Array:
        """Return the base parameters of the bodies that set the scale in a run, shape (b,)."""
        return self._plain_bodies(run, z) * (1.0 if self.scale is None else 1.0 + z[self.scale])

    def _plain_bodies(self, run: int, z: Array) -> Array:
        turn, known = self.bodies[run]
        return known + turn @ z


def unknowns_with_payload(model: DynamicModel, base: BaseParameters, payload: CarriedBody) -> Unknowns:
    """Return the unknowns of a run without the payload and one with it: bodies, friction of each, the rest of it."""
    friction = np.flatnonzero(base.is_friction)
    shared = np.setdiff1d(np.arange(base.count), friction)
    link, known, free, words = payload.parameters(model.robot)
    carried = base.matrix[:, 10 * link : 10 * link + 10]
    unit = np.eye(base.count)
    nothing = np.zeros((base.count, len(friction)))
    hidden = np.zeros((base.count, free.shape[1]))
    empty = np.hstack([unit[:, shared], unit[:, friction], nothing, hidden])
    loaded = np.hstack([unit[:, shared], nothing, unit[:, friction], carried @ free])
    of_load = np.hstack([np.zeros((base.count, len(shared) + 2 * len(friction))), carried @ free])
    names = (
        *(base.names[k] for k in shared),
        *(f"{base.names[k]}, {run}" for run in ("without payload", "with payload") for k in friction),
        *(f"{word} of the payload" for word in words),
    )
    zero = np.zeros(base.count)
    return Unknowns(
        maps=(empty, loaded),
        known=(zero, carried @ known),
        bodies=((np.zeros_like(empty), zero), (of_load, carried @ known)),
        deviations=np.full(len(names), np.inf),
        names=names,
    )


def unknowns_with_prior(model: DynamicModel, base: BaseParameters, theta: Array, share: float) -> Unknowns:
    """Return the unknowns of one run of an arm whose bodies are known: friction, rotors and errors of the bodies.

    Errors of single bodies are shares of them, whatever the scale of all: else all bodies could shrink to nothing, and
    with them the gains, where that leaves room for errors.

    Args:
        model: Robot, drives and friction.
        base: Its base parameters.
        theta: Inertial standard parameters, shape (10 l,) or longer.
        share: Relative standard deviation of each link and of each of its parameters (:func:`body_errors`); 0 takes
            them for exact.

    Raises:
        BadOption: A share below 0 or of one half and more.
    """
    if not 0 <= share < 0.5:
        raise BadOption("prior_share", share, "give the share to which masses are trusted, such as 0.05")
    count = model.inertial_count
    inertial = np.asarray(theta, dtype=float)[:count]
    own = base.matrix[:, count:]
    names = [parameter.name for parameter in model.parameters[count:]]
    known = base.matrix[:, :count] @ inertial
    none = np.zeros((base.count, 0)), np.zeros(0)
    errors, deviations = _errors(base.matrix[:, :count], inertial, known) if share else none
    bodies = np.hstack([np.zeros_like(own), errors])
    return Unknowns(
        maps=(np.hstack([own, errors]),),
        known=(known,),
        bodies=((bodies, known),),
        deviations=np.concatenate([np.full(len(names), np.inf), share * deviations]),
        names=(*names, *(f"error {k} of the bodies" for k in range(len(deviations)))),
        scale=len(names) if share else None,
    )


def _errors(mixing: Array, inertial: Array, known: Array) -> tuple[Array, Array]:
    """Return independent errors of the base parameters, shape (b, e), and their standard deviations for a share of 1.

    Each link is off by a factor, and each of its parameters by an error of its own, all of one relative std. The first
    column, of zeros, stands for the error of the scale, whose variance is 1 / (known' C^-1 known) for errors of
    covariance C; the others leave the scale as it is: known' C^-1 e = 0.
    """
    bodies = inertial.reshape(-1, TEN)
    whole = np.stack([mixing[:, TEN * k : TEN * (k + 1)] @ body for k, body in enumerate(bodies)], axis=1)
    directions, sizes, _ = np.linalg.svd(np.hstack([whole, mixing * body_errors(bodies)]), full_matrices=False)
    kept = sizes > LEAST * sizes[0]
    errors = directions[:, kept] * sizes[kept]
    scale = (directions[:, kept].T @ known) / sizes[kept]
    others = np.linalg.svd(scale[None, :])[2][1:].T
    found = np.hstack([np.zeros((len(errors), 1)), errors @ others])
    return found, np.append(1.0 / np.linalg.norm(scale), np.ones(others.shape[1]))


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
