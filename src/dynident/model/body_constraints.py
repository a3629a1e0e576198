"""What is known about bodies beforehand: masses, where the centre of mass can be, where matter can be, symmetry.

Every condition is linear in the ten parameters of a link, so that fits with it stay convex. A density that lives in
{x: q(x) >= 0} with q(x) = (x, 1)' Q (x, 1) has tr(P Q) >= 0 (Wensing, Kim and Slotine 2018, (15), for ellipsoids).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dynident.arrays import Array, frozen
from dynident.errors import BadOption, UnknownChoice
from dynident.model.parameters import Parameter
from dynident.model.robot import Robot

AXES = ("x", "y", "z")

#: Bodies of a fit: of positive density, within bounds from the robot model, or these but in a metric of the user's own.
BODIES = ("free", "plausible", "auto")

#: Towards faces, edges and corners of a cube, one of each opposite pair, and the least square of the cosine between any
#: direction and the nearest of them: that of the point as far from a face, an edge and a corner.
DIRECTIONS = np.array([v for v in np.ndindex(3, 3, 3) if v > (1, 1, 1)], dtype=float) - 1.0
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
NEAREST = 1.0 / (1.0 + (np.sqrt(2.0) - 1.0) ** 2 + (np.sqrt(3.0) - np.sqrt(2.0)) ** 2)


@dataclass(frozen=True)
class ValueRange:
    """From ``low`` to ``high``; equal bounds fix a value, an infinite one is none."""

    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        if not self.low <= self.high or self.low == np.inf or self.high == -np.inf:
            raise BadOption("range", (self.low, self.high), "the lower bound must not be above the upper one")


@dataclass(frozen=True)
class BoundingBox:
    """A box along the axes of the link frame.

    Attributes:
        lower: Lowest corner, shape (3,), in m.
        upper: Highest corner, shape (3,), in m.
    """

    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower", frozen(self.lower, (3,), "lower corner"))
        object.__setattr__(self, "upper", frozen(self.upper, (3,), "upper corner"))
        corners = (self.lower.tolist(), self.upper.tolist())
        if not (np.all(np.isfinite(corners)) and np.all(self.lower <= self.upper)):
            raise BadOption("box", corners, "the lower corner must not be above the upper one on any axis")


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid {x: |A^-1 R' (x - centre)| <= 1} in the link frame.

    Attributes:
        centre: Shape (3,), in m.
        semi_axes: Half lengths, the diagonal of A, shape (3,), in m.
        rotation: R, whose columns are the directions of the half lengths in the link frame, shape (3, 3).
    """

    centre: Array
    semi_axes: Array
    rotation: Array = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", frozen(self.centre, (3,), "centre"))
        object.__setattr__(self, "semi_axes", frozen(self.semi_axes, (3,), "semi-axes"))
        object.__setattr__(self, "rotation", frozen(self.rotation, (3, 3), "rotation"))
        if not np.all((self.semi_axes > 0) & np.isfinite(self.semi_axes)):
            raise BadOption("semi_axes", self.semi_axes.tolist(), "give three lengths above 0 in m")

    @property
    def quadric(self) -> Array:
        """Q with (x, 1)' Q (x, 1) = 1 - |A^-1 R' (x - centre)|^2, shape (4, 4)."""
        scaled = (np.asarray(self.rotation) / self.semi_axes) @ np.asarray(self.rotation).T
        form = scaled @ scaled
        matrix = np.zeros((4, 4))
        matrix[:3, :3] = -form
        matrix[:3, 3] = matrix[3, :3] = form @ self.centre
        matrix[3, 3] = 1.0 - self.centre @ form @ self.centre
        return matrix

    def slabs(self, reach: float) -> Array:
        """Return Q of 13 directions u with tr(P Q) = m (k - E z_u^2), z = A^-1 R' (x - centre), shape (13, 4, 4).

        A body of equal density reaches |E z_u| + sqrt(5 var z_u) <= sqrt(6 E z_u^2) half widths. Between any direction
        and the nearest of the 13 the square of the cosine is :data:`NEAREST` or more: with k = NEAREST reach^2 / 6 the
        body reaches at most ``reach`` in any.
        """
        along = (DIRECTIONS / self.semi_axes) @ np.asarray(self.rotation).T
        rows = np.column_stack([along, -along @ self.centre])
        matrices = -rows[:, :, None] * rows[:, None, :]
        matrices[:, 3, 3] += NEAREST * reach**2 / 6.0
        return matrices


@dataclass(frozen=True)
class BodyConstraints:
    """What is known about one link, in its own frame; nothing by default.

    Attributes:
        mass: Range of the mass, in kg.
        centre_box: Box that holds the centre of mass.
        centre_hull: Points whose convex hull holds the centre of mass, shape (k, 3), in m.
        body_box: Box that holds all matter: its second moments and centre are those of a density in the box.
        body_ellipsoid: Ellipsoid that holds all matter.
        symmetry: Planes of symmetry: position in m of the plane along each axis that it is normal to.
        thickness: Least root mean square distance of the matter from any plane through the centre of mass, in m.
        reach: How far a body of equal density with these moments may reach, in half widths of the ellipsoid; 0: any.
        filled: Ellipsoid that a uniform body of the link fills where that is less than ``body_ellipsoid``.
        quadrics: Q with (x, 1)' Q (x, 1) >= 0 wherever matter can be, shape (4, 4) each.
    """

    mass: ValueRange = field(default_factory=ValueRange)
    centre_box: BoundingBox | None = None
    centre_hull: Array | None = None
    body_box: BoundingBox | None = None
    body_ellipsoid: Ellipsoid | None = None
    symmetry: Mapping[str, float] = field(default_factory=dict)
    thickness: float = 0.0
    reach: float = 0.0
    quadrics: tuple[Array, ...] = ()
    filled: Ellipsoid | None = None

    def __post_init__(self) -> None:
        if not self.mass.high > 0:
            raise BadOption("mass", self.mass.high, "a mass is above 0 kg")
        if not 0 <= self.thickness < np.inf:
            raise BadOption("thickness", self.thickness, "give a length of 0 or more in m")
        for axis in self.symmetry:
            if axis not in AXES:
                raise UnknownChoice("axis", axis, AXES)
        if self.centre_hull is not None:
            hull = frozen(self.centre_hull, (None, 3), "points of the hull")
            if not len(hull) or not np.all(np.isfinite(hull)):
                raise BadOption("hull", hull.tolist(), "give one or more points of three finite numbers")
            object.__setattr__(self, "centre_hull", hull)


@dataclass(frozen=True)
class Constraints:
    """What is known about a robot beforehand, beside P_i > 0 and the signs of friction; nothing by default.

    Attributes:
        links: By the name of the link.
        total_mass: Range of the mass of all moving links together, in kg.
        fixed: Values of single standard parameters by their names, such as ``Ia[joint2]``, in SI units.
    """

    links: Mapping[str, BodyConstraints] = field(default_factory=dict)
    total_mass: ValueRange = field(default_factory=ValueRange)
    fixed: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_empty(self) -> bool:
        """Whether nothing is stated."""
        return not (self.links or self.fixed) and self.total_mass == ValueRange()

    def check(self, robot: Robot, parameters: Sequence[Parameter] | None = None) -> None:
        """Refuse names that the robot, or the list of standard parameters, does not have.

        Raises:
            UnknownChoice: No such link or parameter, with the nearest that there is.
        """
        names = [link.name for link in robot.links]
        for name in self.links:
            if name not in names:
                raise UnknownChoice("moving link", name, names)
        known = [parameter.name for parameter in parameters or ()]
        for name in self.fixed if parameters is not None else ():
            if name not in known:
                raise UnknownChoice("standard parameter", name, known)


def halfspaces(points: Array) -> tuple[Array, Array, Array, Array]:
    """Return (N, d, E, e) with the convex hull of points (k, 3) as {x: N x <= d, E x = e}, N and E of unit rows.

    Points in a plane, on a line or in one place give equations E beside the inequalities.
    """
    corners = np.asarray(points, dtype=float)
    middle = corners.mean(axis=0)
    _, sizes, directions = np.linalg.svd(corners - middle, full_matrices=True)
    sizes = np.append(sizes, np.zeros(max(0, 3 - len(sizes))))
    extent = float(np.max(np.abs(corners), initial=1e-12))
    rank = int(np.sum(sizes > 1e-6 * extent))
    equations = directions[rank:]
    inside = directions[:rank]
    flat = (corners - middle) @ inside.T
    if rank == 0:
        normals, limits = np.zeros((0, 3)), np.zeros(0)
    elif rank == 1:
        normals, limits = np.vstack([inside, -inside]), np.array([flat.max(), -flat.min()])
    else:
        from scipy.spatial import ConvexHull  # loads slowly

        facets = ConvexHull(flat).equations
        normals, limits = facets[:, :-1] @ inside, -facets[:, -1]
    return normals, limits + normals @ middle, equations, equations @ middle


def box_quadrics(box: BoundingBox) -> Array:
    """Return Q of each slab of a box, q(x) = (upper - x)(x - lower) per axis, shape (3, 4, 4)."""
    matrices = np.zeros((3, 4, 4))
    for axis, (low, high) in enumerate(zip(box.lower, box.upper, strict=True)):
        matrices[axis, axis, axis] = -1.0
        matrices[axis, axis, 3] = matrices[axis, 3, axis] = (low + high) / 2
        matrices[axis, 3, 3] = -low * high
    return matrices
