"""Parameters of virtual robots: those of the bodies, and the same friction at all joints."""

from __future__ import annotations

import numpy as np


def with_friction(model, values):
    """Return theta with the same friction coefficients at every joint."""
    nominal = model.robot.nominal
    assert nominal is not None
    return np.concatenate([nominal, np.tile(values, model.robot.dof)])
