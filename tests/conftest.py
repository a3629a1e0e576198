"""Small arms made of values alone, and logs of motions that are known exactly.

Property tests draw the same examples in every run; ``pytest --hypothesis-profile=explore`` draws new ones.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
from hypothesis import settings
from threadpoolctl import threadpool_limits

from dynident.arrays import Array
from dynident.cli.main import one_blas_thread_unless_stated
from dynident.data.log import Log
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, Mimic, rotation_about
from dynident.model.robot import Link, Robot

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")

X, Y, Z = np.eye(3)


@pytest.fixture(scope="session", autouse=True)
def _one_blas_thread() -> Iterator[None]:
    """Have BLAS work on one thread, as under the command line: here, and in processes that tests start."""
    assert scipy.linalg  # its BLAS, and NumPy's, must be loaded to be limited
    one_blas_thread_unless_stated(os.environ)
    with threadpool_limits(1, "blas"):
        yield


def _body(mass: float, centre: list[float], size: float) -> Inertia:
    """Return a body whose principal axes are turned away from its frame."""
    turn = rotation_about(np.array([1.0, 2.0, 2.0]) / 3.0, 0.4)
    principal = mass * size**2 * np.diag([0.6, 0.8, 1.0])
    return Inertia.from_centre_of_mass(mass, centre, turn @ principal @ turn.T)


def _robot(name: str, joints: list[Joint], bodies: list[Inertia], gravity: Array = -9.81 * Z) -> Robot:
    links = tuple(Link(f"link{i + 1}", body) for i, body in enumerate(bodies))
    return Robot(name, links, tuple(joints), gravity)


def _revolute(number: int, translation: list[float], rotation: Array | None = None, axis: Array = Z) -> Joint:
    turn = np.eye(3) if rotation is None else rotation
    return Joint(f"joint{number}", "revolute", number - 2, turn, np.array(translation), axis)


@pytest.fixture(scope="session")
def pendulum() -> Robot:
    """One revolute joint about z; gravity along -y."""
    return _robot("pendulum", [_revolute(1, [0, 0, 0])], [_body(2.0, [0.3, 0.05, 0.1], 0.1)], -9.81 * Y)


@pytest.fixture(scope="session")
def planar_2r() -> Robot:
    """Two parallel joints about z, links of 0.5 m and 0.4 m; gravity along -y."""
    joints = [_revolute(1, [0, 0, 0]), _revolute(2, [0.5, 0, 0])]
    bodies = [_body(3.0, [0.22, 0.03, 0.01], 0.15), _body(2.0, [0.18, -0.02, 0.02], 0.12)]
    return _robot("planar-2r", joints, bodies, -9.81 * Y)


@pytest.fixture(scope="session")
def planar_3r(planar_2r: Robot) -> Robot:
    """Three parallel joints about z; gravity along -y."""
    joints = [*planar_2r.joints, _revolute(3, [0.4, 0, 0])]
    bodies = [link.inertia for link in planar_2r.links if link.inertia] + [_body(0.9, [0.1, 0.02, 0.0], 0.08)]
    return _robot("planar-3r", joints, bodies, -9.81 * Y)


@pytest.fixture(scope="session")
def spatial_3r() -> Robot:
    """A vertical first axis, then two horizontal parallel ones, as the first three joints of an industrial arm."""
    upright = rotation_about(X, np.pi / 2)
    joints = [_revolute(1, [0, 0, 0.3]), _revolute(2, [0.1, 0, 0.2], upright), _revolute(3, [0.5, 0, 0])]
    bodies = [
        _body(8.0, [0.02, 0.01, 0.1], 0.15),
        _body(5.0, [0.25, 0.02, 0.03], 0.2),
        _body(3.0, [0.2, 0.04, -0.02], 0.15),
    ]
    return _robot("spatial-3r", joints, bodies)


@pytest.fixture(scope="session")
def sliding_arm() -> Robot:
    """Revolute, prismatic, revolute, in general position."""
    slide = Joint(
        "joint2", "prismatic", 0, rotation_about(Y, 0.7), np.array([0.1, 0.2, 0.3]), np.array([1.0, 0.0, 1.0])
    )
    joints = [_revolute(1, [0, 0, 0.2]), slide, _revolute(3, [0.2, 0.1, 0], rotation_about(X, -1.1), Y)]
    bodies = [_body(4.0, [0.1, 0.05, 0.0], 0.15), _body(3.0, [0.0, 0.1, 0.05], 0.12), _body(1.5, [0.08, 0.0, 0.1], 0.1)]
    return _robot("sliding-arm", joints, bodies)


@pytest.fixture(scope="session")
def scara() -> Robot:
    """Four vertical axes, the third one slides: gravity acts on the slide alone."""
    slide = Joint("joint3", "prismatic", 1, np.eye(3), np.array([0.3, 0.0, 0.0]), Z)
    joints = [_revolute(1, [0, 0, 0.4]), _revolute(2, [0.35, 0, 0]), slide, _revolute(4, [0, 0, -0.1])]
    bodies = [
        _body(6.0, [0.18, 0.02, 0.0], 0.15),
        _body(4.0, [0.12, 0.03, 0.05], 0.12),
        _body(1.0, [0.01, 0.02, -0.05], 0.05),
        _body(0.6, [0.03, 0.0, -0.02], 0.04),
    ]
    return _robot("scara", joints, bodies)


@pytest.fixture(scope="session")
def mimic_arm(planar_3r: Robot) -> Robot:
    """The planar 3R whose third joint follows the second one: q3 = -0.5 q2 + 0.3."""
    third = replace(planar_3r.joints[2], mimic=Mimic("joint2", -0.5, 0.3))
    return replace(planar_3r, name="mimic-arm", joints=(*planar_3r.joints[:2], third), coupling=None)


@pytest.fixture(scope="session")
def coupled_arm(spatial_3r: Robot) -> Robot:
    """The spatial 3R whose third motor also turns with joint 2, with rotors that are known."""
    drives = {f"joint{i}": Drive(gear_ratio=r, rotor_inertia=2e-5) for i, r in ((1, 100.0), (2, -120.0), (3, 80.0))}
    return spatial_3r.with_drives(drives, [[1, 0, 0], [0, 1, 0], [0, 0.7, 1]])


@pytest.fixture(scope="session")
def random_tree() -> Callable[..., Robot]:
    """Make a tree of ``links`` links in general position, revolute and prismatic, every link a possible body."""

    def make(seed: int, links: int = 4) -> Robot:
        generator = np.random.default_rng(seed)
        joints, bodies = [], []
        for i in range(links):
            axis, angle = generator.normal(size=3), generator.uniform(-np.pi, np.pi)
            joints.append(
                Joint(
                    f"joint{i + 1}",
                    "prismatic" if generator.random() < 0.3 else "revolute",
                    int(generator.integers(-1, i)) if i else -1,
                    rotation_about(axis / np.linalg.norm(axis), angle),
                    generator.uniform(-0.5, 0.5, 3),
                    generator.normal(size=3),
                )
            )
            bodies.append(Inertia.from_log_cholesky(generator.uniform(-0.8, 0.8, 10)))
        return _robot(f"tree-{seed}", joints, bodies, generator.normal(size=3) * 6.0)

    return make


@pytest.fixture(scope="session")
def scaled() -> Callable[..., Robot]:
    """Make the same robot in other units: all masses and lengths times a factor, gravity with the lengths."""

    def make(robot: Robot, mass: float, length: float, gravity: float | None = None) -> Robot:
        size = np.r_[np.full(6, mass * length**2), np.full(3, mass * length), mass]
        links = tuple(
            replace(link, inertia=None if link.inertia is None else Inertia.from_vector(link.inertia.vector * size))
            for link in robot.links
        )
        joints = tuple(replace(joint, translation=joint.translation * length) for joint in robot.joints)
        field = robot.gravity * (length if gravity is None else gravity)
        return replace(robot, links=links, joints=joints, gravity=field)

    return make


@pytest.fixture(scope="session")
def exact_motion() -> Callable[..., Motion]:
    """Make a smooth motion of all joints and its exact derivatives: five sines a joint, never at rest together."""

    def make(joints: int, time: Array, size: float = 1.0, seed: int = 0) -> Motion:
        generator = np.random.default_rng(seed)
        pulsation = 2 * np.pi * 0.2 * np.arange(1, 6)
        height = size * generator.uniform(-1, 1, (joints, 5)) / np.arange(1, 6)
        phase = np.asarray(time)[:, None, None] * pulsation + generator.uniform(-np.pi, np.pi, (joints, 5))
        q = np.sum(height * np.sin(phase), axis=-1)
        dq = np.sum(height * pulsation * np.cos(phase), axis=-1)
        return Motion(q, dq, -np.sum(height * pulsation**2 * np.sin(phase), axis=-1))

    return make


@pytest.fixture(scope="session")
def exact_log(exact_motion: Callable[..., Motion]) -> Callable[..., Log]:
    """Make a log with exact derivatives, the model's torque, and white noise of a standard deviation per joint."""

    def make(
        model: DynamicModel,
        theta: Array,
        noise: Array | float = 0.0,
        seed: int = 0,
        samples: int = 400,
        rate: float = 50.0,
        size: float = 1.0,
    ) -> Log:
        time = np.arange(samples) / rate
        motion = exact_motion(model.robot.dof, time, size, seed=11)
        torque = model.torque(motion, theta)
        torque = torque + noise * np.random.default_rng(seed).normal(size=torque.shape)
        return Log(model.robot.joint_names, time, motion.q, motion.dq, motion.ddq, torque)

    return make
