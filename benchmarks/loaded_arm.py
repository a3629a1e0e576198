"""A six-joint arm with friction, a body at the tool of a robot, motions and noise, as several benchmarks take them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.signal

from dynident import DynamicModel, FourierSeries, Inertia, read_robot
from dynident.arrays import Array
from dynident.model.friction import Motion
from dynident.model.robot import Robot

#: Samples of noise before the first one, in which its start is forgotten.
PAST = 200


def six_joint_arm() -> tuple[DynamicModel, Array]:
    """Return an arm with Coulomb and viscous friction and an offset, and the values of its friction."""
    robot = read_robot("generic-6r")
    friction = np.tile([2.0, 3.0, 0.4], robot.dof) * np.repeat(np.linspace(1.5, 0.3, robot.dof), 3)
    return DynamicModel(robot, ("coulomb", "viscous", "offset")), friction  # type: ignore[arg-type]


def with_body(robot: Robot, body: Inertia) -> Robot:
    """Return a robot with a body, stated in the frame of its tool, on the link that carries the tool."""
    frame, links = robot.frames.get(robot.tool), list(robot.links)
    at = len(links) - 1 if frame is None else frame.link
    own = links[at].inertia
    assert own is not None
    carried = body if frame is None else body.moved(frame.rotation, frame.translation)
    links[at] = replace(links[at], inertia=own + carried)
    return replace(robot, links=tuple(links))


def random_motion(joints: int, seed: int, time: Array, period: float) -> Motion:
    """Return the samples of a Fourier series of five harmonics with random coefficients."""
    sine, cosine = 0.3 * np.random.default_rng(seed).normal(size=(2, joints, 5))
    return Motion(*FourierSeries(np.zeros(joints), sine, cosine, period).evaluate(time))


def first_order(generator: np.random.Generator, samples: int, joints: int, memory: float) -> Array:
    """Return noise (N, n) of unit variance that keeps ``memory`` of itself from sample to sample."""
    white = generator.normal(size=(samples + PAST, joints))
    return np.asarray(scipy.signal.lfilter([np.sqrt(1 - memory**2)], [1, -memory], white, axis=0))[PAST:]
