"""Figure of friction: what the model says over what was measured less the rest of the model."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.results.figures.chart import Across, Cloud, Line, Plot, chart
from dynident.results.text import label, pretty_unit

#: Even speeds of a curve, and as many near zero.
POINTS = 241


def friction_chart(
    drive: str, unit: str, speed_unit: str, speed: Array, torque: Array, curve: tuple[Array, Array]
) -> str:
    """Return the friction curve of a drive over the measured torque less the rigid-body part.

    Args:
        drive: Name of the joint.
        unit: N m or N.
        speed_unit: rad/s or m/s.
        speed: Speed of the drive in each row, shape (N,).
        torque: Measured torque less the rigid-body part, shape (N,).
        curve: Speeds (K,) and friction (K,) of the model.
    """
    marks = (Cloud("measured less rigid body", speed, torque, 1), Line("friction model", *curve, 2, 2.0))
    plot = Plot(f"friction [{pretty_unit(unit)}]", marks, 170.0)
    reach = float(np.max(np.abs(curve[1]), initial=0.0))
    said = f"Friction of {label(drive)} over speed: the model reaches {reach:.3g} {pretty_unit(unit)}."
    return chart(label(drive), said, Across(f"speed [{speed_unit}]", pad=0.02), [plot])


def speed_grid(speed: Array) -> Array:
    """Return speeds over the range of ``speed`` (N,), denser around zero where friction turns, shape (K,)."""
    if not len(speed):
        return np.zeros(0)
    low, high = float(np.min(speed)), float(np.max(speed))
    even = np.linspace(low, high, POINTS)
    near = 0.1 * max(abs(low), abs(high)) * np.linspace(-1, 1, POINTS) ** 3
    return np.unique(np.concatenate([even, near[(near >= low) & (near <= high)]]))
