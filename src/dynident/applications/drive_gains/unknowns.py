"""What is known and what is not about the base parameters behind currents: beta of run s = known_s + map_s z.

Runs share bodies and rotors; each has friction of its own, which changes with temperature and load. A payload adds its
ten parameters to the link that carries it (Gautier and Briot 2014); a description taken for true leaves friction and
rotors, and errors of its bodies where they are trusted to a share only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.applications.drive_gains.payload import CarriedBody
from dynident.arrays import Array
from dynident.case.evidence.torques import body_errors
from dynident.errors import BadOption
from dynident.model.base_parameters import BaseParameters
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
