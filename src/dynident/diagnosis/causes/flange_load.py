"""A load at the flange: first moments and mass, with moments of inertia that go with them.

A body of mass m with the centre of mass c has the first moments h = m c and, about the origin of the last link, at
least the moments of inertia of a point, A(h) / m with A(h) = |h|^2 1 - h h'. Left out, they make the mass of a load
that stands off the flange too small; as six unknowns of their own they would take in much else. So they follow mass and
first moments, in straight lines about the values of the fit before (Gauss-Newton). What the body adds by its own size
has a normal prior: none, with a standard deviation of m times the square of a radius of gyration.
"""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.quick_fit import QuickFit

#: Columns of a body, and of them those that are told: first moments and mass.
TEN, TOLD = 10, 4

#: Standard deviation of a moment of inertia in kg m^2 that is none.
LEAST = 1e-9

#: Distance in m of a centre of mass beyond which the moments of inertia of a point are not believed, and radius of
#: gyration in m of a load about its own centre of mass.
FAR, GYRATION = 1.0, 0.1

_ROWS, _COLUMNS = np.triu_indices(3)


def ends(fit: QuickFit) -> dict[str, int]:
    """Return the links that may carry a load, the ends of branches, by the last joint that moves each.

    A robot of one such joint has its last link alone, and no name.
    """
    robot, found = fit.model.robot, dict[str, int]()
    for link in robot.tips:
        names = (robot.joints[place].name for place in robot.carriers(link))
        moving = next((name for name in names if name in robot.joint_names), "")
        if moving:
            found[moving] = link
    return found if len(found) > 1 else {"": len(robot.links) - 1}


def load_columns(fit: QuickFit, link: int) -> Array:
    """Return the torque of a body at a link, filtered: first moments, mass, moments of inertia (10, N, n)."""
    places = TEN * link + np.array([*range(TEN - TOLD, TEN), *range(TEN - TOLD)])
    shares, rows = fit.base.matrix[:, places], fit.rows  # a standard column is so many of those of the base parameters
    return np.stack([(block @ shares[own]).T for block, own in zip(rows.blocks, rows.columns, strict=True)], axis=2)


def carried(values: Array) -> Array:
    """Return what the ten parameters are per unit of first moments, mass and own moments of inertia, shape (10, 10).

    The moments of inertia of a point are taken as A(h) / (m^2 + |h|^2 / FAR^2)^(1/2), with the sign of the mass: those
    of A(h) / m but where the mass is about none, and its place too far to be believed.

    Args:
        values: First moments in kg m and mass in kg about which they are straight lines, shape (4,) or more.
    """
    first, mass = values[:3], float(values[3])
    squared = float(first @ first)
    size = float(np.hypot(mass, np.sqrt(squared) / FAR)) * (1.0 if mass >= 0.0 else -1.0)
    found = np.eye(TEN)
    if not size:
        return found
    about = squared * np.eye(3) - np.outer(first, first)
    for k, unit in enumerate(np.eye(3)):
        slope = 2 * first[k] * np.eye(3) - np.outer(unit, first) - np.outer(first, unit)
        found[TOLD:, k] = (slope / size - first[k] / FAR**2 / size**3 * about)[_ROWS, _COLUMNS]
    found[TOLD:, 3] = (-mass / size**3 * about)[_ROWS, _COLUMNS]
    return found


def own_inertia(values: Array) -> float:
    """Return the standard deviation of each moment of inertia about the load's own centre of mass, in kg m^2."""
    return max(abs(float(values[3])) * GYRATION**2, LEAST)
