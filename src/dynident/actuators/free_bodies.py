"""Bodies that were found beside the drives of an arm, as an answer holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.model.inertia import TEN, Inertia
from dynident.model.robot import Robot

#: Standard deviation of mass and second moments of each link of a robot model, and of all links together, as a share.
DEVIATION = 0.3

#: Half width of an interval at 95 % in standard deviations.
NORMAL_95 = 1.96


@dataclass(frozen=True)
class FreeBodies:
    """Bodies that were found beside the drives.

    Attributes:
        names: Of the l links.
        nominal: Standard parameters that they were pulled to, shape (l, 10).
        theta: What was found, shape (l, 10).
        deviations: Standard deviations, shape (l, 10).
        labels: What each parameter stands on, as of ``consistency.labels``; l times ten.
        scale: Standard deviation of the scale that bodies and torques have in common, as a share of it.
        is_scaled: Whether the logs determine that scale, which takes a payload; else it is that of the robot model.
        bounds: Bounds of a mass or of the total mass that the bodies ended at, in words.
    """

    names: tuple[str, ...]
    nominal: Array
    theta: Array
    deviations: Array
    labels: tuple[tuple[str, ...], ...]
    scale: float
    is_scaled: bool
    bounds: tuple[str, ...] = ()


def with_bodies(robot: Robot, theta: Array) -> Robot:
    """Return a robot with other inertial parameters, shape (l, 10)."""
    links = [replace(link, inertia=Inertia.from_vector(own)) for link, own in zip(robot.links, theta, strict=True)]
    return replace(robot, links=tuple(links))


def bodies_data(bodies: FreeBodies) -> dict[str, Any]:
    """Return bodies as plain data."""
    links = {}
    for name, *own in zip(bodies.names, bodies.theta, bodies.nominal, bodies.deviations, bodies.labels, strict=True):
        links[name] = {
            symbol: {"value": value, "nominal": nominal, "standard_deviation": deviation, "label": label}
            for symbol, value, nominal, deviation, label in zip(TEN, *own, strict=True)
        }
    found = {"links": links, "scale_deviation": bodies.scale, "scale_from_logs": bodies.is_scaled}
    return {**found, "at_bounds": list(bodies.bounds)}


def read_bodies(data: Mapping[str, Any]) -> FreeBodies:
    """Return bodies from plain data.

    Raises:
        KeyError: Something is missing.
    """
    links = data["links"]
    value, nominal, deviation = (
        np.array([[float(own[symbol][key]) for symbol in TEN] for own in links.values()])
        for key in ("value", "nominal", "standard_deviation")
    )
    labels = tuple(tuple(str(own[symbol]["label"]) for symbol in TEN) for own in links.values())
    scale, is_scaled = float(data["scale_deviation"]), bool(data["scale_from_logs"])
    bounds = tuple(map(str, data.get("at_bounds", ())))
    return FreeBodies(tuple(links), nominal, value, deviation, labels, scale, is_scaled, bounds)
