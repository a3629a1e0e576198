"""The conditions on standard parameters as rows of a convex program, each with its words.

In scaled variables phi = theta / scale: zero @ phi + zero_offset = 0, sign @ phi + sign_offset >= 0, and for every link
i the scaled pseudo-inertia P_i(phi) - margin I >= 0 (Wensing, Kim and Slotine 2018, (12)). With D = diag(1/L, 1/L,
1/L, 1), P(phi) = D P(theta) D / m. Where a link has a minimum thickness r, P_i(phi) - (r/L)^2 phi_m diag(1, 1, 1, 0)
stands in place of P_i(phi): by the Schur complement the covariance of the density is at least r^2 in every direction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import compress

import numpy as np

from dynident.arrays import Array, BoolArray, IntArray
from dynident.identification.problem.prior import Scale
from dynident.model.body_constraints import AXES, BodyConstraints, BoundingBox, Constraints, box_quadrics, halfspaces
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import PSEUDO_BASIS

#: Clarabel's order of a symmetric 4 x 4 matrix: upper triangle by columns; entries off the diagonal times sqrt(2).
_ROWS, _COLUMNS = np.array([(i, j) for j in range(4) for i in range(j + 1)]).T
_SIZES = np.where(_ROWS == _COLUMNS, 1.0, np.sqrt(2.0))

#: The identity of a link's cone as a vector.
IDENTITY_VECTOR = np.where(_ROWS == _COLUMNS, 1.0, 0.0)


@dataclass(frozen=True)
class Conditions:
    """All conditions on the p scaled parameters phi.

    Attributes:
        zero: Rows of the equations, shape (z, p), of unit size each.
        zero_offset: Shape (z,).
        zero_words: What each equation says.
        sign: Rows of the inequalities, shape (k, p), of unit size each.
        sign_offset: Shape (k,).
        sign_words: What each inequality says.
        links: Names of the links, one pseudo-inertia each, the ten parameters of link i at 10 i.
        margin: Smallest eigenvalue of each scaled pseudo-inertia.
        sign_sizes: What a slack of 1 is worth, and its unit (empty where it has none that says much), per inequality.
        thickness: Minimum thickness of each link in units of its natural length; empty for none.
    """

    zero: Array
    zero_offset: Array
    zero_words: tuple[str, ...]
    sign: Array
    sign_offset: Array
    sign_words: tuple[str, ...]
    links: tuple[str, ...]
    margin: float
    sign_sizes: tuple[tuple[float, str], ...] = ()
    thickness: tuple[float, ...] = ()

    @cached_property
    def free(self) -> Array:
        """Directions that no equation forbids, orthonormal, shape (p, f)."""
        if not len(self.zero):
            return np.eye(self.size)
        _, values, directions = np.linalg.svd(self.zero)
        taken = np.count_nonzero(values > np.finfo(float).eps * max(self.zero.shape) * values[0])
        return directions[taken:].T

    @cached_property
    def bases(self) -> Array:
        """The ten matrices of each link's cone, shape (l, 10, 4, 4)."""
        bases = np.tile(PSEUDO_BASIS, (len(self.links), 1, 1, 1))
        for basis, thickness in zip(bases, self.thickness, strict=False):
            basis[9, :3, :3] -= thickness**2 * np.eye(3)
        return bases

    @property
    def size(self) -> int:
        """Number of scaled parameters, p."""
        return self.sign.shape[1]

    @property
    def cone_words(self) -> tuple[str, ...]:
        """What the condition of each link says."""
        words = ("a body of positive density", "a body of the minimum thickness")
        thickness = self.thickness or (0.0,) * len(self.links)
        return tuple(f"{name}: {words[value > 0]}" for name, value in zip(self.links, thickness, strict=True))

    def equations(self, phi: Array) -> Array:
        """Return what the equations miss, shape (z,)."""
        return self.zero @ phi + self.zero_offset

    def signs(self, phi: Array) -> Array:
        """Return the slack of the inequalities, shape (k,)."""
        return self.sign @ phi + self.sign_offset

    def pseudo(self, phi: Array) -> Array:
        """Return P_i(phi), less the part of the minimum thickness, - margin I, shape (l, 4, 4)."""
        tens = phi[: 10 * len(self.links)].reshape(-1, 10)
        return np.einsum("lk,lkij->lij", tens, self.bases) - self.margin * np.eye(4)

    def part(self, links: IntArray) -> Conditions:
        """Return the conditions that hold for the numbered links (k,) alone, on their 10 k parameters."""
        own = (10 * links[:, None] + np.arange(10)).ravel()
        zero, sign = (~np.any(np.delete(rows, own, axis=1), axis=1) for rows in (self.zero, self.sign))
        return Conditions(
            self.zero[zero][:, own],
            self.zero_offset[zero],
            tuple(compress(self.zero_words, zero)),
            self.sign[sign][:, own],
            self.sign_offset[sign],
            tuple(compress(self.sign_words, sign)),
            tuple(self.links[i] for i in links),
            self.margin,
            tuple(compress(self.sign_sizes, sign)),
            tuple(self.thickness[i] for i in links),
        )

    def broken(self, phi: Array, missed: float) -> BoolArray:
        """Return for which links phi misses a condition by more than ``missed``, in natural sizes, shape (l,)."""
        bad = np.vstack([self.zero[np.abs(self.equations(phi)) > missed], self.sign[self.signs(phi) < -missed]])
        touched = np.any(bad[:, : 10 * len(self.links)].reshape(len(bad), len(self.links), 10), axis=(0, 2))
        return touched | (np.linalg.eigvalsh(self.pseudo(phi))[:, 0] < -missed)

    def shortfall(self, phi: Array) -> float:
        """Return by how much phi breaks its worst condition, in natural sizes; 0 where it breaks none."""
        least = np.append(self.signs(phi), np.linalg.eigvalsh(self.pseudo(phi)))
        return max(-float(np.min(least, initial=0.0)), float(np.max(np.abs(self.equations(phi)), initial=0.0)))


@dataclass(frozen=True)
class _Row:
    """One linear condition: values @ theta[first : first + len(values)] + offset >= 0, or = 0."""

    first: int
    values: Array
    offset: float
    words: str
    equation: bool = False
    unit: str = ""


def conditions_of(
    model: DynamicModel, scale: Scale, margin: float, constraints: Constraints | None = None
) -> Conditions:
    """Return the conditions of a model: every link possible, friction and rotors >= 0, and what is known beside.

    Args:
        model: Robot, drives and friction.
        scale: Natural sizes.
        margin: Smallest eigenvalue of each scaled pseudo-inertia.
        constraints: What is known about bodies beforehand.

    Raises:
        UnknownChoice: The constraints name a link or a parameter that is not there.
    """
    known = constraints or Constraints()
    known.check(model.robot, model.parameters)
    rows = [*_signs(model), *_stated(model, known)]
    zero, sign = (_scaled([row for row in rows if row.equation is kind], scale) for kind in (True, False))
    return Conditions(
        *zero[:3],
        *sign[:3],
        tuple(link.name for link in model.robot.links),
        margin,
        sign[3],
        tuple(
            float(known.links[link.name].thickness / length) if link.name in known.links else 0.0
            for link, length in zip(model.robot.links, scale.length, strict=True)
        ),
    )


def _scaled(rows: list[_Row], scale: Scale) -> tuple[Array, Array, tuple[str, ...], tuple[tuple[float, str], ...]]:
    """Return rows on phi of unit size, shape (k, p), their offsets (k,), their words, and sizes with units."""
    scaled = np.zeros((len(rows), len(scale.parameters)))
    for found, row in zip(scaled, rows, strict=True):
        found[row.first : row.first + len(row.values)] = row.values
    scaled *= scale.parameters
    sizes = np.max(np.abs(scaled), axis=1)
    words, units = tuple(row.words for row in rows), tuple(zip(sizes.tolist(), (row.unit for row in rows), strict=True))
    return scaled / sizes[:, None], np.array([row.offset for row in rows]) / sizes, words, units


def _signs(model: DynamicModel) -> Iterator[_Row]:
    for k, parameter in enumerate(model.parameters):
        if parameter.nonnegative:
            words = f"{parameter.name} >= {parameter.least:.4g}"
            yield _Row(k, np.ones(1), -parameter.least, words, unit=parameter.unit)


def _stated(model: DynamicModel, known: Constraints) -> Iterator[_Row]:
    for i, link in enumerate(model.robot.links):
        if link.name in known.links:
            for ten, offset, words, equation, unit in _link_rows(known.links[link.name]):
                yield _Row(10 * i, ten, offset, f"{link.name}: {words}", equation, unit)
    total = np.tile(np.eye(10)[9], len(model.robot.links))
    for sign, offset, words, equation in _range_rows(known.total_mass.low, known.total_mass.high, "total mass", "kg"):
        yield _Row(0, sign * total, offset, words, equation, "kg")
    for k, parameter in enumerate(model.parameters):
        if parameter.name in known.fixed:
            value = float(known.fixed[parameter.name])
            yield _Row(k, np.ones(1), -value, f"{parameter.name} = {value:g} {parameter.unit}", True)


def _range_rows(low: float, high: float, what: str, unit: str) -> Iterator[tuple[float, float, str, bool]]:
    if low == high:
        yield 1.0, -low, f"{what} = {low:g} {unit}", True
        return
    if np.isfinite(low):
        yield 1.0, -low, f"{what} >= {low:g} {unit}", False
    if np.isfinite(high):
        yield -1.0, high, f"{what} <= {high:g} {unit}", False


def _link_rows(known: BodyConstraints) -> Iterator[tuple[Array, float, str, bool, str]]:
    """Yield (ten, offset, words, equation, unit) of a link: conditions ten @ (parameters of the link) + offset."""
    mass, moment = np.eye(10)[9], np.eye(10)[6:9]
    for sign, offset, words, equation in _range_rows(known.mass.low, known.mass.high, "mass", "kg"):
        yield sign * mass, offset, words, equation, "kg"
    if known.centre_box is not None:
        yield from ((*row, "") for row in _box_rows(known.centre_box, mass, moment))
    if known.centre_hull is not None:
        normals, limits, equations, values = halfspaces(known.centre_hull)
        for normal, limit in zip(normals, limits, strict=True):
            yield limit * mass - normal @ moment, 0.0, "centre of mass in the hull of its points", False, ""
        for normal, value in zip(equations, values, strict=True):
            words = "centre of mass in the plane or line of its points"
            yield normal @ moment - value * mass, 0.0, words, True, ""
    if known.body_ellipsoid is not None:
        yield _trace_row(known.body_ellipsoid.quadric), 0.0, "all matter in the ellipsoid", False, ""
        words = f"at equal density within {known.reach:g} times the ellipsoid"
        for row in _trace_row(known.body_ellipsoid.slabs(known.reach)) if known.reach else ():
            yield row, 0.0, words, False, ""
    for quadric in known.quadrics:
        yield _trace_row(quadric), 0.0, "all matter in its shapes", False, ""
    if known.body_box is not None:
        for axis, quadric in zip(AXES, box_quadrics(known.body_box), strict=True):
            yield _trace_row(quadric), 0.0, f"all matter in the box along {axis}", False, ""
    for axis, place in known.symmetry.items():
        k = AXES.index(axis)
        words = f"symmetric about the plane {axis} = {place:g} m"
        yield moment[k] - place * mass, 0.0, words, True, ""
        for other in {0, 1, 2} - {k}:  # the mirrored products vanish: int (x - place) y = 0
            quadric = np.zeros((4, 4))
            quadric[k, other] = quadric[other, k] = 0.5
            quadric[other, 3] = quadric[3, other] = -0.5 * place
            yield _trace_row(quadric), 0.0, words, True, ""


def _box_rows(box: BoundingBox, mass: Array, moment: Array) -> Iterator[tuple[Array, float, str, bool]]:
    for axis, row, low, high in zip(AXES, moment, box.lower, box.upper, strict=True):
        what = f"centre of mass {axis}"
        if low == high:
            yield row - low * mass, 0.0, f"{what} = {low:g} m", True
        else:
            yield row - low * mass, 0.0, f"{what} >= {low:g} m", False
            yield high * mass - row, 0.0, f"{what} <= {high:g} m", False


def _trace_row(quadric: Array) -> Array:
    """Return the ten numbers c with c @ (parameters of the link) = tr(P Q), of Q (..., 4, 4) shape (..., 10)."""
    return np.einsum("kij,...ij->...k", PSEUDO_BASIS, quadric)


def stack_vectors(matrices: Array) -> Array:
    """Return symmetric matrices (..., 4, 4) as vectors with the same inner product, shape (..., 10)."""
    return matrices[..., _ROWS, _COLUMNS] * _SIZES


def vector_rows(bases: Array, size: int) -> Array:
    """Return the rows of the vectors of sum_k phi_k B_k of links, bases (l, 10, 4, 4), shape (10 l, size)."""
    found, own = np.zeros((10 * len(bases), size)), np.arange(10 * len(bases)).reshape(-1, 10)
    found[own[:, :, None], own[:, None]] = stack_vectors(bases).transpose(0, 2, 1)
    return found


def unstack_vectors(vectors: Array) -> Array:
    """Return the inverse of :func:`stack_vectors`: (l, 10) to (l, 4, 4)."""
    matrices = np.zeros((len(vectors), 4, 4))
    matrices[:, _ROWS, _COLUMNS] = matrices[:, _COLUMNS, _ROWS] = vectors / _SIZES
    return matrices
