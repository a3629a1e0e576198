"""Laws of the dynamics on arms of 2 to 12 joints of any geometry; no number is compared with the library alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exact_arms import ExactArm, exact_arms
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.applications.identifiability import structure
from dynident.arrays import Array
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.model.joint import rotation_about
from dynident.model.kernels import batched
from dynident.model.robot import Robot

DRIVES = ("viscous", "offset", "rotor_inertia")
SEEDS = st.integers(0, 10**6)


def model_of(robot: Robot, *friction: str) -> DynamicModel:
    return DynamicModel(robot, friction)  # type: ignore[arg-type]


def drawn_theta(model: DynamicModel, seed: int) -> Array:
    """Return possible bodies and drawn drives, shape (p,)."""
    generator = np.random.default_rng(seed)
    bodies = [Inertia.from_log_cholesky(generator.uniform(-0.7, 0.7, 10)).vector for _ in model.robot.links]
    return np.concatenate([*bodies, generator.uniform(0.1, 1.0, len(model.parameters) - model.inertial_count)])


def drawn_turn(generator: np.random.Generator) -> Array:
    axis = generator.normal(size=3)
    return rotation_about(axis / np.linalg.norm(axis), generator.uniform(-3, 3))


def torque(robot: Robot, theta: Array, q: Array, dq: Array, ddq: Array) -> Array:
    return batched.inverse_dynamics(robot.chain, theta, q, dq, ddq)


def close(found: Array, expected: Array, share: float = 1e-9) -> None:
    assert np.abs(found - expected).max(initial=0.0) <= share * (np.abs(expected).max(initial=0.0) + 1e-3)


def check_linearity(arm: ExactArm, seed: int) -> None:
    """tau = Y theta; sums and multiples of parameters give sums and multiples of torques."""
    model = model_of(arm.robot, *DRIVES)
    motion = model.random_motion(5, seed)
    one, other = drawn_theta(model, seed), drawn_theta(model, seed + 1)
    close(model.torque(motion, one), model.regressor(motion) @ one)
    mixed = 2.5 * model.torque(motion, one) - 0.5 * model.torque(motion, other)
    close(model.torque(motion, 2.5 * one - 0.5 * other), mixed)


def check_energy(arm: ExactArm, seed: int) -> None:
    """M is symmetric and definite, dM/dt - 2C is skew, gravity is the slope of the potential, power the rate of energy.

    C(q, u) v is made of torques alone, by polarisation: 2 C(q, u) v = c(u + v) - c(u) - c(v) with c(u) = C(q, u) u.
    dM/dt is a difference of mass matrices, the potential one of poses: neither knows of the other.
    """
    robot, n = arm.robot, len(arm.kinds)
    theta = drawn_theta(model_of(robot), seed)
    generator = np.random.default_rng(seed)
    q, dq, ddq = generator.uniform(-1, 1, (1, n)), generator.normal(size=(1, n)), generator.normal(size=(1, n))
    zero = np.zeros_like(q)
    mass = batched.mass_matrix(robot.chain, theta, q)[0]
    close(mass, mass.T, 1e-12)
    assert np.linalg.eigvalsh(mass)[0] > 0
    still = robot.with_gravity([0.0, 0.0, 0.0])

    def centrifugal(speed: Array) -> Array:
        return torque(still, theta, q, speed, zero)[0]

    step = 1e-5
    coriolis = np.stack([centrifugal(dq + v) - centrifugal(dq) - centrifugal(v[None]) for v in np.eye(n)], axis=1) / 2
    above, below = (batched.mass_matrix(robot.chain, theta, q + sign * step * dq)[0] for sign in (1, -1))
    rate = (above - below) / (2 * step)
    left = rate - 2 * coriolis
    assert np.abs(left + left.T).max() <= 1e-7 * (np.abs(mass).max() + np.abs(coriolis).max())
    close(coriolis @ dq[0], centrifugal(dq))

    def potential(at: Array) -> Array:
        turns, places = batched.link_poses(robot.chain, at)
        tens = theta.reshape(-1, 10)
        moments = np.einsum("slij,lj->sli", turns, tens[:, 6:9]) + tens[:, 9, None] * places
        return -np.sum(moments, axis=1) @ robot.gravity

    at = np.concatenate([q + step * np.eye(n), q - step * np.eye(n)])
    heights = potential(at)
    weight = torque(robot, theta, q, zero, zero)[0]
    close(weight, (heights[:n] - heights[n:]) / (2 * step), 1e-7)
    power = float(dq[0] @ torque(robot, theta, q, dq, ddq)[0])
    expected = dq[0] @ mass @ ddq[0] + 0.5 * dq[0] @ rate @ dq[0] + dq[0] @ weight
    assert power == pytest.approx(float(expected), rel=1e-6, abs=1e-6 * float(np.abs(mass).max() * (dq @ dq.T).max()))


def check_forward(arm: ExactArm, seed: int) -> None:
    """The mass matrix undoes inverse dynamics."""
    robot = arm.robot
    theta, motion = drawn_theta(model_of(robot), seed), model_of(robot).random_motion(3, seed)
    effort = torque(robot, theta, motion.q, motion.dq, motion.ddq)
    mass = batched.mass_matrix(robot.chain, theta, motion.q)
    bias = torque(robot, theta, motion.q, motion.dq, np.zeros_like(motion.ddq))
    close(np.linalg.solve(mass, (effort - bias)[:, :, None])[:, :, 0], motion.ddq, 1e-7)


def check_frames(arm: ExactArm, seed: int) -> None:
    """Nothing depends on how frames are laid: not on that of the base, and not on those of the links."""
    robot, generator = arm.robot, np.random.default_rng(seed)
    theta, motion = drawn_theta(model_of(robot), seed), model_of(robot).random_motion(4, seed)
    expected = torque(robot, theta, motion.q, motion.dq, motion.ddq)
    turn, shift = drawn_turn(generator), generator.uniform(-1, 1, 3)
    joints = tuple(
        joint if joint.parent >= 0
        else replace(joint, rotation=turn @ joint.rotation, translation=turn @ joint.translation + shift)
        for joint in robot.joints
    )  # fmt: skip
    moved = replace(robot, joints=joints).with_gravity(turn @ robot.gravity)
    close(torque(moved, theta, motion.q, motion.dq, motion.ddq), expected)

    # A link's frame may turn in any way, and move along a joint's axis, or anywhere where the joint slides.
    turns = [drawn_turn(generator) for _ in robot.joints]
    shifts = [
        generator.uniform(-1, 1) * joint.axis if joint.kind == "revolute" else generator.uniform(-1, 1, 3)
        for joint in robot.joints
    ]
    laid = []
    for joint, own, by in zip(robot.joints, turns, shifts, strict=True):
        rotation, place = joint.rotation @ own, joint.translation + joint.rotation @ by
        if joint.parent >= 0:
            back, origin = turns[joint.parent].T, shifts[joint.parent]
            rotation, place = back @ rotation, back @ (place - origin)
        laid.append(replace(joint, rotation=rotation, translation=place, axis=own.T @ joint.axis))
    bodies = [
        Inertia.from_vector(ten).moved(own.T, -own.T @ by).vector
        for ten, own, by in zip(theta.reshape(-1, 10), turns, shifts, strict=True)
    ]
    other = torque(replace(robot, joints=tuple(laid)), np.concatenate(bodies), motion.q, motion.dq, motion.ddq)
    close(other, expected)


def check_order(arm: ExactArm, seed: int) -> None:
    """Links of a tree may be numbered in any way that puts parents first: torques go with their joints."""
    robot, generator = arm.robot, np.random.default_rng(seed)
    order: list[int] = []
    while len(order) < len(robot.joints):
        free = [i for i, j in enumerate(robot.joints) if i not in order and (j.parent < 0 or j.parent in order)]
        order.append(int(generator.choice(free)))
    joints = tuple(
        replace(robot.joints[i], parent=-1 if robot.joints[i].parent < 0 else order.index(robot.joints[i].parent))
        for i in order
    )
    other = replace(robot, links=tuple(robot.links[i] for i in order), joints=joints, coupling=None)
    one, again = model_of(robot, *DRIVES), model_of(other, *DRIVES)
    theta, motion = drawn_theta(one, seed), one.random_motion(4, seed)
    places = {parameter.name: k for k, parameter in enumerate(one.parameters)}
    mixed = theta[[places[parameter.name] for parameter in again.parameters]]
    states = Motion(*(np.asarray(each)[:, order] for each in (motion.q, motion.dq, motion.ddq)))
    close(again.torque(states, mixed), one.torque(motion, theta)[:, order])
    assert base_parameters(again).count == base_parameters(one).count


def check_units(arm: ExactArm, seed: int) -> None:
    """Other units of mass, length and time: torques change by theirs, m l^2 / t^2, forces by m l / t^2."""
    robot, (mass, length, time) = arm.robot, np.random.default_rng(seed).uniform(0.1, 10, 3)
    theta, motion = drawn_theta(model_of(robot), seed), model_of(robot).random_motion(4, seed)
    joints = tuple(replace(joint, translation=joint.translation * length) for joint in robot.joints)
    other = replace(robot, joints=joints).with_gravity(robot.gravity * length / time**2)
    unit = np.tile(np.r_[np.full(6, length**2), np.full(3, length), 1.0] * mass, len(robot.links))
    slides = np.array([joint.kind == "prismatic" for joint in robot.joints])
    arm_length = np.where(slides, length, 1.0)
    states = (motion.q * arm_length, motion.dq * arm_length / time, motion.ddq * arm_length / time**2)
    size = mass * length**2 / time**2 / arm_length
    close(torque(other, theta * unit, *states) / size, torque(robot, theta, motion.q, motion.dq, motion.ddq))


def check_base(arm: ExactArm, seed: int) -> None:
    """Parameters with equal base parameters give equal torques, and others give others."""
    model = model_of(arm.robot, *DRIVES)
    base, hidden = base_parameters(model), structure(model).null_space
    theta, motion = drawn_theta(model, seed), model.random_motion(40, seed + 3)
    generator = np.random.default_rng(seed)
    changed = theta + hidden @ generator.normal(size=hidden.shape[1])
    size = np.abs(base.matrix) @ np.abs(changed)
    assert np.all(np.abs(base.from_standard(changed) - base.from_standard(theta)) <= 1e-8 * size)
    close(model.torque(motion, changed), model.torque(motion, theta), 1e-8)
    shown = base.from_standard(theta)
    k = int(generator.integers(base.count))
    shown[k] += 1.0
    away = model.torque(motion, base.to_standard(shown)) - model.torque(motion, theta)
    assert np.abs(away).max() > 1e-6 and base.neglected == 0


def check_parallel_axes(arm: ExactArm, seed: int) -> None:
    """A link and a point fixed to it are one body: by its frame (Huygens, Steiner), and as a link on a locked joint."""
    robot, generator = arm.robot, np.random.default_rng(seed)
    theta = drawn_theta(model_of(robot), seed)
    place, mass = generator.uniform(-1, 1, 3), float(generator.uniform(0.1, 3))
    point = Inertia.from_centre_of_mass(mass, place, np.zeros((3, 3)))
    cross = mass * (place @ place * np.eye(3) - np.outer(place, place))
    np.testing.assert_allclose(point.rotational, cross, atol=1e-12)
    joined = theta.copy()
    joined[:10] += point.vector
    motion = model_of(robot).random_motion(3, seed)
    states = motion.q, motion.dq, motion.ddq
    turns, places = batched.link_poses(robot.chain, motion.q)
    only = np.zeros_like(theta)
    only[:10] = point.vector
    close(torque(robot, joined, *states) - torque(robot, theta, *states), torque(robot, only, *states), 1e-8)
    zero = np.zeros_like(motion.q)
    heights = -(np.einsum("sij,j->si", turns[:, 0], place) + places[:, 0]) @ robot.gravity * mass
    step = 1e-6 * np.eye(len(robot.joints))[0]
    turned, moved = batched.link_poses(robot.chain, motion.q + step)
    above = -(np.einsum("sij,j->si", turned[:, 0], place) + moved[:, 0]) @ robot.gravity * mass
    assert np.abs(torque(robot, only, motion.q, zero, zero)[:, 0] - (above - heights) / 1e-6).max() < 1e-3


LAWS = {
    "linearity": check_linearity,
    "energy": check_energy,
    "forward": check_forward,
    "frames": check_frames,
    "order": check_order,
    "units": check_units,
    "base": check_base,
    "parallel_axes": check_parallel_axes,
}


@pytest.mark.parametrize("law", LAWS)
@settings(max_examples=8)
@given(arm=exact_arms(2, 6), seed=SEEDS)
def test_it_holds(law: str, arm: ExactArm, seed: int) -> None:
    LAWS[law](arm, seed)


@pytest.mark.battery
@pytest.mark.parametrize("law", LAWS)
@settings(max_examples=150)
@given(arm=exact_arms(2, 12), seed=SEEDS)
def test_it_holds_for_many(law: str, arm: ExactArm, seed: int) -> None:
    LAWS[law](arm, seed)
