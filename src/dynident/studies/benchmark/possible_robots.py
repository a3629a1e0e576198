"""Robots that could exist: random ones, ones near a given one, and a robot that says nothing of its masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, NotConsistent
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.model.plausible import consistency_defects
from dynident.model.robot import Robot

#: Density in kg/m^3 of the bodies that are invented, between which it is drawn: motors, castings and hollow space.
DENSITY = (1000.0, 2500.0)

#: Radius of an invented link as a share of its length, and the least of each in m.
SLENDERNESS, LEAST_RADIUS, LEAST_LENGTH = (0.15, 0.3), 0.03, 0.08

#: Friction of an invented drive at work, as a share of what the drive can give: of terms that cannot turn their sign,
#: and of those that can.
FRICTION_SHARE, OFFSET_SHARE = 0.04, 0.005

#: A term whose mean at work is below this share of its peak, such as one of low speeds alone, is measured by its peak.
SELDOM = 0.3


def described_truth(model: DynamicModel, seed: int = 0) -> Array:
    """Return the parameters of the robot model, shape (p,); friction that it does not state is invented.

    Raises:
        NotConsistent: The robot model states no inertias, or impossible ones.
    """
    theta = model.nominal()
    step = "take a random physically consistent robot (--truth random), or an estimate (--truth FILE)"
    if theta is None:
        raise NotConsistent(f"robot '{model.robot.name}'", "its model states no inertias", step)
    for link, why in consistency_defects(model.robot.links).items():
        raise NotConsistent(f"link '{link}'", why, step)
    return _with_friction(model, theta, seed)


def random_truth(model: DynamicModel, seed: int, share: float = 0.3) -> Array:
    """Return parameters (p,) of a random robot that could exist, the same for the same seed.

    Bodies that the robot model states are changed as :func:`near` does; others are invented: a cylinder from joint to
    joint of random density and thickness, turned and shifted a little.

    Args:
        model: Robot and friction.
        seed: Of the draw.
        share: Relative standard deviation of masses that are described.
    """
    robot = model.robot
    bodies = [
        (link.inertia and link.inertia.solid()) or _invented(robot, k, np.random.default_rng([seed, k]))
        for k, link in enumerate(robot.links)
    ]
    full = replace(
        model,
        robot=replace(
            robot, links=tuple(replace(link, inertia=body) for link, body in zip(robot.links, bodies, strict=True))
        ),
    )
    theta = full.nominal()
    assert theta is not None  # every link has a body now
    return near(model, _with_friction(full, theta, seed), seed, share)


def near(model: DynamicModel, theta: Array, seed: int, share: float) -> Array:
    """Return parameters (p,) near others: of possible bodies, friction that keeps its sign; the same for a seed.

    A pseudo-inertia P becomes A P A' with A = 1 + E, the entries of E normal with half the share, which moves masses,
    lengths and moments by about the share and leaves possible bodies possible (Wensing, Kim and Slotine 2018: A is an
    affine deformation of the body).

    Args:
        model: What the parameters are of.
        theta: Shape (p,).
        seed: Of the draw.
        share: Relative standard deviation of a mass, from 0 to less than 1.

    Raises:
        BadOption: A share that cannot be.
    """
    if not 0 <= share < 1:
        raise BadOption("share", share, "give a relative deviation from 0 to less than 1, such as 0.15")
    generator = np.random.default_rng([seed, len(theta)])
    found = np.array(theta, dtype=float)
    for start in range(0, model.inertial_count, 10):
        own = slice(start, start + 10)
        change = np.eye(4) + 0.5 * share * generator.normal(size=(4, 4))
        found[own] = Inertia.from_pseudo(change @ Inertia.from_vector(found[own]).pseudo @ change.T).vector
    tail = found[model.inertial_count :]
    found[model.inertial_count :] = tail * np.exp(share * generator.normal(size=len(tail)))
    return found


def told(model: DynamicModel, theta: Array | None) -> DynamicModel:
    """Return the model whose description states the bodies and the simple friction of theta (p,); None: no bodies.

    It is what an estimator may know: a guess of the parameters, or none.
    """
    robot = model.robot
    if theta is None:
        links = tuple(replace(link, inertia=None) for link in robot.links)
        joints = tuple(replace(joint, damping=None, friction=None) for joint in robot.joints)
        return replace(model, robot=replace(robot, links=links, joints=joints))
    bodies = [Inertia.from_vector(theta[k : k + 10]) for k in range(0, model.inertial_count, 10)]
    links = tuple(replace(link, inertia=body) for link, body in zip(robot.links, bodies, strict=True))
    values = {(p.owner, p.symbol): float(v) for p, v in zip(model.parameters, theta, strict=True)}
    joints = tuple(
        replace(joint, damping=values.get((joint.name, "Fv")), friction=values.get((joint.name, "Fc")))
        for joint in robot.joints
    )
    return replace(model, robot=replace(robot, links=links, joints=joints))


def _with_friction(model: DynamicModel, theta: Array, seed: int) -> Array:
    """Return theta with invented values in place of friction and rotor inertias that are zero, shape (p,)."""
    missing = np.flatnonzero(theta[model.inertial_count :] == 0)
    if not len(missing):
        return theta
    generator = np.random.default_rng([seed, 7])
    motion = _typical_motion(model)
    strength = np.abs(model.torque(motion, theta)).max(axis=0)
    efforts = np.array([joint.limits.effort for joint in model.robot.active])
    strength = np.where(np.isfinite(efforts) & (efforts > 0), efforts, strength)
    values = model.friction_values(motion)
    sizes, peaks = np.sqrt(np.mean(values**2, axis=0)), np.max(np.abs(values), axis=0)
    sizes = np.where(sizes < SELDOM * peaks, peaks, sizes)
    drive, column = model.terms
    found = theta.copy()
    for k in missing:
        size = sizes[drive[k], column[k]]
        parameter = model.parameters[model.inertial_count + k]
        share = FRICTION_SHARE * generator.uniform(0.5, 1.5)
        if not parameter.nonnegative:
            share = OFFSET_SHARE * generator.normal()
        found[model.inertial_count + k] = share * strength[drive[k]] / size if size > 0 else 0.0
    return found


def _typical_motion(model: DynamicModel) -> Motion:
    """Return random states at the speeds that the robot may have, half of the limit."""
    motion = model.random_motion(200)
    limits = np.array([joint.limits.velocity for joint in model.robot.active])
    return replace(motion, dq=motion.dq * np.where(np.isfinite(limits), limits / 6.0, 1.0))


def _invented(robot: Robot, link: int, generator: np.random.Generator) -> Inertia:
    """Return a cylinder from the link's joint to those of its children (or its tool), moved and turned a little."""
    ends = [np.asarray(joint.translation) for joint in robot.joints if joint.parent == link]
    ends += [np.asarray(frame.translation) for frame in robot.frames.values() if frame.link == link]
    reach = max(ends, key=lambda end: float(np.linalg.norm(end)), default=np.zeros(3))
    length = float(np.linalg.norm(reach))
    axis = reach / length if length > LEAST_LENGTH else np.asarray(robot.joints[link].axis)
    length = max(length, LEAST_LENGTH)
    radius = max(LEAST_RADIUS, length * generator.uniform(*SLENDERNESS))
    mass = generator.uniform(*DENSITY) * np.pi * radius**2 * length
    along, across = 0.5 * mass * radius**2, mass * (3 * radius**2 + length**2) / 12
    inertia = across * np.eye(3) + (along - across) * np.outer(axis, axis)
    centre = 0.5 * length * axis + 0.1 * length * generator.normal(size=3)
    return Inertia.from_centre_of_mass(mass, centre, inertia)
