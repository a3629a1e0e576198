"""Models of small arms with friction by name, their truth, and robots whose model states no inertias."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Link, Robot


def model_of(robot: Robot, *friction: str) -> DynamicModel:
    """Return the model of a robot with friction parts by name."""
    return DynamicModel(robot, tuple(FRICTION.make(name) for name in friction))


def theta_of(model: DynamicModel, scale: float = 1.0) -> Array:
    """Return the inertias of the robot model and friction from 0.2 to 1 times a scale, shape (p,)."""
    assert model.robot.nominal is not None
    count = len(model.parameters) - model.inertial_count
    return np.append(model.robot.nominal, scale * np.linspace(0.2, 1.0, count))


def without_inertias(robot: Robot) -> Robot:
    """Return the robot without the inertias of its robot model."""
    return replace(robot, links=tuple(Link(link.name) for link in robot.links))
