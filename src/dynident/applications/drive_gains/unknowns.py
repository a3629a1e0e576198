"""What is known and what is not about the base parameters behind currents: beta of run s = known_s + map_s z.

Runs share bodies and rotors; each has friction of its own, which changes with temperature and load. A payload adds its
ten parameters to the link that carries it (Gautier and Briot 2014); a description taken for true leaves friction and
rotors, and one factor for each link where its masses are trusted to a share only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.applications.drive_gains.payload import CarriedBody
from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel


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
    """

    maps: tuple[Array, ...]
    known: tuple[Array, ...]
    bodies: tuple[tuple[Array, Array], ...]
    deviations: Array
    names: tuple[str, ...]

    @property
    def count(self) -> int:
        """Z."""
        return len(self.names)

    def beta(self, run: int, z: Array) -> Array:
        """Return the base parameters of a run, shape (b,)."""
        return self.known[run] + self.maps[run] @ z

    def scale_bodies(self, run: int, z: Array) -> Array:
        """Return the base parameters of the bodies that set the scale in a run, shape (b,)."""
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
    """Return the unknowns of one run of an arm whose bodies are known: friction, rotors, a factor for each link.

    Args:
        model: Robot, drives and friction.
        base: Its base parameters.
        theta: Inertial standard parameters, shape (10 l,) or longer.
        share: Standard deviation of the factor of each link's ten parameters, about 1; 0 takes them for exact.

    Raises:
        BadOption: A share below 0 or of one half and more.
    """
    if not 0 <= share < 0.5:
        raise BadOption("prior_share", share, "give the share to which masses are trusted, such as 0.05")
    count = model.inertial_count
    inertial = np.asarray(theta, dtype=float)[:count]
    own = base.matrix[:, count:]
    names = [parameter.name for parameter in model.parameters[count:]]
    links = range(len(model.robot.links)) if share else range(0)
    factors = [base.matrix[:, 10 * k : 10 * k + 10] @ inertial[10 * k : 10 * k + 10] for k in links]
    scale = np.column_stack(factors) if factors else np.zeros((base.count, 0))
    known = base.matrix[:, :count] @ inertial
    return Unknowns(
        maps=(np.hstack([own, scale]),),
        known=(known,),
        bodies=((np.hstack([np.zeros_like(own), scale]), known),),
        deviations=np.concatenate([np.full(len(names), np.inf), np.full(len(factors), share)]),
        names=(*names, *(f"factor of {model.robot.links[k].name}" for k in links)),
    )
