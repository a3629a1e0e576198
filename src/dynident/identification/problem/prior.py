"""Natural sizes of standard parameters, and the prior to which what the data leave open settles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import NotConsistent, UnknownChoice
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia

#: How tightly the prior holds: its standard deviation is 1 / sqrt(PULL) natural sizes, ten of them.
PULL = 0.01


@dataclass(frozen=True)
class BodyPrior:
    """Standard parameters known beforehand, from a CAD model or an earlier estimate.

    Attributes:
        theta: Values, shape (p,); every link a possible body. Inertial parameters and rotor inertias are used.
        names: Their names, such as ``Izz[link1]``; p of them.
        source: Where they come from, in words.

    Raises:
        NotConsistent: A link is no possible body.
    """

    theta: Array
    names: tuple[str, ...]
    source: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "theta", frozen(self.theta, (len(self.names),), "prior"))

    def for_model(self, model: DynamicModel) -> BodyPrior:
        """Return the prior in the order of a model's parameters; 0 for friction and rotors that it does not have.

        Raises:
            UnknownChoice: A link of the model is missing.
            NotConsistent: A link is no possible body.
        """
        values = dict(zip(self.names, self.theta.tolist(), strict=True))
        links = [name[2:-1] for name in self.names if name.startswith("m[")]
        for link in model.robot.links:
            if link.name not in links:
                raise UnknownChoice(f"link in the prior ({self.source})", link.name, links)
        theta = np.array([values.get(parameter.name, 0.0) for parameter in model.parameters])
        for i, link in enumerate(model.robot.links):
            body = Inertia.from_vector(theta[10 * i : 10 * i + 10])
            if not (solid := body.solid()):
                why = body.defect() or "the pseudo-inertia is not positive definite"
                step = "give a prior whose links are physically consistent, or leave it out"
                raise NotConsistent(f"{link.name} of the prior ({self.source})", why, step)
            theta[10 * i : 10 * i + 10] = solid.vector
        return BodyPrior(theta, tuple(parameter.name for parameter in model.parameters), self.source)


@dataclass(frozen=True)
class Scale:
    """Natural size of each standard parameter, so that regularisers and margins mean the same for every robot.

    Attributes:
        mass: Of each link, shape (l,), in kg.
        length: Of each link, shape (l,), in m.
        parameters: Of each standard parameter, shape (p,).
        prior: Standard parameters that nothing in the data contradicts, shape (p,).
        source: Where the prior comes from, in words.
    """

    mass: Array
    length: Array
    parameters: Array
    prior: Array
    source: str


def natural_scale(model: DynamicModel, torque: Array, acceleration: Array, prior: BodyPrior | None = None) -> Scale:
    """Return the scale from a given prior, else from the robot model's inertias where all are possible, else from data.

    Without a usable description each link is a ball as long as its lever arms, and heavy enough that all together
    explain the largest joint torque.

    Args:
        model: Robot, drives and friction.
        torque: Root mean square torque of each joint, shape (n,).
        acceleration: Root mean square acceleration of each joint, shape (n,).
        prior: Standard parameters known beforehand, in place of the robot model's.
    """
    robot = model.robot
    length = link_lengths(model)
    given = None if prior is None else np.asarray(prior.theta)[: model.inertial_count].reshape(-1, 10)
    stated = [link.inertia for link in robot.links] if given is None else [Inertia.from_vector(ten) for ten in given]
    known = [solid for body in stated if body is not None and (solid := body.solid())]
    tail = np.zeros(len(model.parameters) - model.inertial_count)
    if len(known) == len(robot.links):
        mass = np.array([inertia.mass for inertia in known])
        length = np.array([np.sqrt(np.trace(inertia.pseudo[:3, :3]) / inertia.mass) for inertia in known])
        source = "the robot model's inertias" if prior is None else prior.source
        if prior is not None:
            tail = np.array(prior.theta)[model.inertial_count :]
    else:
        reach = float(np.sum(length))
        lever = np.array([reach if joint.kind == "revolute" else 1.0 for joint in robot.active])
        pull = lever * (np.linalg.norm(robot.gravity) + acceleration * lever)
        total = float(np.max(torque / np.maximum(pull, 1e-12)))
        mass = np.full(len(robot.links), max(total, 1e-6) * 2.0 / len(robot.links))
        known = [Inertia(m, np.zeros(3), 0.4 * m * s**2 * np.eye(3)) for m, s in zip(mass, length, strict=True)]
        source = "balls that explain the size of the torques"
    sizes = parameter_sizes(model, mass, length, torque)
    return Scale(mass, length, sizes, np.concatenate([*(body.vector for body in known), tail]), source)


def parameter_sizes(model: DynamicModel, mass: Array, length: Array, torque: Array) -> Array:
    """Return the natural size of each standard parameter: a rotor counts as the largest link, friction as torque.

    Args:
        model: Robot, drives and friction.
        mass: Of each link, shape (l,), in kg.
        length: Of each link, shape (l,), in m.
        torque: Of each joint, shape (n,), in N m or N.
    """
    links = [np.r_[np.full(6, m * s**2), np.full(3, m * s), m] for m, s in zip(mass, length, strict=True)]
    rotor = {
        joint.name: float(np.max(mass * length**2) if joint.kind == "revolute" else np.max(mass))
        for joint in model.robot.active
    }
    largest = float(np.max(torque, initial=0.0))
    own = np.maximum(torque, 1e-3 * largest) if largest > 0 else np.ones(model.robot.dof)
    joint = dict(zip(model.robot.joint_names, own.tolist(), strict=True))
    tail = [(rotor if p.kind == "rotor" else joint)[p.owner] for p in model.parameters[model.inertial_count :]]
    return np.concatenate([*links, tail])


def link_lengths(model: DynamicModel) -> Array:
    """Return the lever arm of each link, shape (l,): to its farthest child or its own offset, at least mean / 3."""
    joints = model.robot.joints
    arms = np.zeros(len(joints))
    for i, joint in enumerate(joints):
        away = float(np.linalg.norm(joint.translation))
        arms[i] = max(arms[i], away / 2)
        if joint.parent >= 0:
            arms[joint.parent] = max(arms[joint.parent], away)
    typical = float(np.mean(arms)) or 0.1
    return np.maximum(arms, typical / 3)


def prior_products(base: BaseParameters, scale: Scale) -> Array:
    """Return [I, beta0]' P [I, beta0] of a prior of bodies alone that is one natural size wide, shape (b + 1, b + 1).

    Free bodies do not stand for those of an estimate, which are held near the robot model's: what is left of the torque
    for friction is another one where the rows do not tell them. P is the inverse of the covariance of base parameters.
    """
    factor = base.matrix * scale.parameters
    size = np.sqrt(np.sum(factor**2, axis=1))
    precision = np.linalg.inv(factor @ factor.T / np.outer(size, size)) / np.outer(size, size)
    known = np.column_stack([np.eye(base.count), base.from_standard(scale.prior)])
    return known.T @ precision @ known
