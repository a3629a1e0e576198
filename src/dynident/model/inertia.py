"""Inertia of one link: (m, h, I) <-> 10-vector <-> pseudo-inertia <-> log-Cholesky; physical or not, and why.

All inertias are about the origin of the link frame, in its axes. Source of the pseudo-inertia and of the condition
P > 0: Wensing, Kim and Slotine 2018, (6)-(12); of the log-Cholesky form: Rucker and Wensing 2022, (12).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen

#: The order of the ten, equation (5) of the article.
TEN = ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "mx", "my", "mz", "m")

#: What moments of a flat body, rounded to four digits, may miss the triangle inequality by, as a share of the largest.
ROUNDED = 1e-3

_ROWS = np.array([0, 0, 0, 1, 1, 2])
_COLUMNS = np.array([0, 1, 2, 1, 2, 2])


def _pseudo_basis() -> Array:
    """Return the (10, 4, 4) matrices B_k with P = sum_k theta_k B_k (Wensing, Kim and Slotine 2018, (9))."""
    basis = np.zeros((10, 4, 4))
    for k, (i, j) in enumerate(zip(_ROWS, _COLUMNS, strict=True)):
        if i == j:  # Sigma = tr(I) / 2 - I
            basis[k, :3, :3] = 0.5 * np.eye(3)
            basis[k, i, i] -= 1.0
        else:
            basis[k, i, j] = basis[k, j, i] = -1.0
    for axis in range(3):
        basis[6 + axis, axis, 3] = basis[6 + axis, 3, axis] = 1.0
    basis[9, 3, 3] = 1.0
    basis.setflags(write=False)
    return basis


#: P = sum_k theta_k PSEUDO_BASIS[k] for the ten parameters theta of one link.
PSEUDO_BASIS = _pseudo_basis()


def skew(vector: npt.ArrayLike) -> Array:
    """Return the 3 x 3 matrix S with S w = vector x w."""
    x, y, z = np.asarray(vector, dtype=float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


@dataclass(frozen=True)
class Inertia:
    """Mass, first moment and rotational inertia of a link about its frame's origin.

    Attributes:
        mass: m, in kg.
        first_moment: h = m c with the centre of mass c, shape (3,), in kg m.
        rotational: I about the frame's origin, shape (3, 3), in kg m^2.
    """

    mass: float
    first_moment: Array
    rotational: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", float(self.mass))
        object.__setattr__(self, "first_moment", frozen(self.first_moment, (3,), "first moment"))
        rotational = np.array(self.rotational, dtype=float)
        object.__setattr__(self, "rotational", frozen((rotational + rotational.T) / 2, (3, 3), "rotational inertia"))

    @classmethod
    def from_centre_of_mass(cls, mass: float, centre: npt.ArrayLike, inertia: npt.ArrayLike) -> Inertia:
        """Build from the mass, the centre of mass (3,) and the inertia (3, 3) about it (parallel axis theorem)."""
        cross = skew(centre)
        return cls(mass, mass * np.asarray(centre, dtype=float), np.asarray(inertia) + mass * cross @ cross.T)

    @classmethod
    def from_vector(cls, theta: npt.ArrayLike) -> Inertia:
        """Build from the ten parameters in the order of :data:`TEN`."""
        ten = np.asarray(theta, dtype=float)
        if ten.shape != (10,):
            raise ValueError(f"ten parameters expected, got shape {ten.shape}")
        rotational = np.zeros((3, 3))
        rotational[_ROWS, _COLUMNS] = rotational[_COLUMNS, _ROWS] = ten[:6]
        return cls(float(ten[9]), ten[6:9], rotational)

    @classmethod
    def from_pseudo(cls, pseudo: npt.ArrayLike) -> Inertia:
        """Build from the 4 x 4 pseudo-inertia P."""
        matrix = np.asarray(pseudo, dtype=float)
        sigma = matrix[:3, :3]
        return cls(float(matrix[3, 3]), matrix[:3, 3], np.trace(sigma) * np.eye(3) - sigma)

    @classmethod
    def from_log_cholesky(cls, eta: npt.ArrayLike) -> Inertia:
        """Build from (alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3); every eta gives a possible body.

        P = U U' with U = e^alpha [[e^d1, s12, s13, t1], [0, e^d2, s23, t2], [0, 0, e^d3, t3], [0, 0, 0, 1]]
        (Rucker and Wensing 2022, (12)).
        """
        alpha, d1, d2, d3, s12, s23, s13, t1, t2, t3 = np.asarray(eta, dtype=float)
        upper = np.array([[np.exp(d1), s12, s13, t1], [0, np.exp(d2), s23, t2], [0, 0, np.exp(d3), t3], [0, 0, 0, 1.0]])
        upper *= np.exp(alpha)
        return cls.from_pseudo(upper @ upper.T)

    @property
    def vector(self) -> Array:
        """The ten parameters in the order of :data:`TEN`, shape (10,)."""
        return np.concatenate([self.rotational[_ROWS, _COLUMNS], self.first_moment, [self.mass]])

    @property
    def pseudo(self) -> Array:
        """The pseudo-inertia P = [[tr(I)/2 - I, h], [h', m]], shape (4, 4)."""
        matrix = np.empty((4, 4))
        matrix[:3, :3] = 0.5 * np.trace(self.rotational) * np.eye(3) - self.rotational
        matrix[:3, 3] = matrix[3, :3] = self.first_moment
        matrix[3, 3] = self.mass
        return matrix

    @property
    def log_cholesky(self) -> Array:
        """The inverse of :meth:`from_log_cholesky`, shape (10,).

        Raises:
            ValueError: The inertia is not strictly consistent.
        """
        if not self.is_consistent():
            raise ValueError("only a strictly consistent inertia has a log-Cholesky form")
        flipped = np.linalg.cholesky(self.pseudo[::-1, ::-1])[::-1, ::-1]  # P = U U' with U upper triangular
        alpha = np.log(flipped[3, 3])
        u = flipped / flipped[3, 3]
        return np.array([alpha, *np.log(np.diag(u)[:3]), u[0, 1], u[1, 2], u[0, 2], u[0, 3], u[1, 3], u[2, 3]])

    @property
    def centre_of_mass(self) -> Array:
        """The centre of mass c = h / m, shape (3,), in m; zero for a massless link."""
        return self.first_moment / self.mass if self.mass != 0 else np.zeros(3)

    @property
    def about_centre(self) -> Array:
        """The rotational inertia about the centre of mass, in link axes, shape (3, 3), in kg m^2."""
        cross = skew(self.centre_of_mass)
        return self.rotational - self.mass * cross @ cross.T

    def moved(self, rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Inertia:
        """Return the same body seen from a frame in which this frame is placed at (rotation, translation)."""
        transform = np.eye(4)
        transform[:3, :3], transform[:3, 3] = rotation, translation
        return Inertia.from_pseudo(transform @ self.pseudo @ transform.T)

    def __add__(self, other: Inertia) -> Inertia:
        """Join two bodies that are described in the same frame."""
        return Inertia(
            self.mass + other.mass, self.first_moment + other.first_moment, self.rotational + other.rotational
        )

    def is_consistent(self, margin: float = 0.0) -> bool:
        """Say whether a body of positive density can have this inertia: P > 0.

        Args:
            margin: How far inside: the smallest eigenvalue of P must exceed ``margin`` times its trace.
        """
        if not np.all(np.isfinite(self.vector)):
            return False
        return bool(np.linalg.eigvalsh(self.pseudo)[0] > margin * max(np.trace(self.pseudo), 0.0))

    def solid(self) -> Inertia | None:
        """Return a strictly consistent body: this one, or a flat one made thicker; None where there is none."""
        if self.defect():
            return None
        if self.is_consistent():
            return self
        thick = 10.0 * ROUNDED * np.trace(self.about_centre) * np.eye(3)
        found = Inertia(self.mass, self.first_moment, self.rotational + thick)
        return found if found.is_consistent() else None

    def defect(self) -> str:
        """Return why no body can have this inertia, in words; empty where one can: flat ones and points can."""
        if not np.all(np.isfinite(self.vector)):
            return "a value is not a number"
        if self.mass <= 0:
            return f"the mass is {self.mass:.4g} kg"
        principal = np.linalg.eigvalsh(self.about_centre)
        room = ROUNDED * abs(principal[2]) + 1e-12 * abs(np.trace(self.rotational))
        if principal[0] < -room:
            return f"a principal moment of inertia is {principal[0]:.4g} kg m^2"
        if principal[2] > principal[0] + principal[1] + room:
            values = ", ".join(f"{moment:.4g}" for moment in principal)
            return f"the principal moments {values} kg m^2 break the triangle inequality"
        return ""


def impossible_parts(bodies: Mapping[str, Inertia | None]) -> str:
    """Return which of bodies no body can be, and why, in words; one without mass and inertia is none."""
    whys = {name: body.defect() for name, body in bodies.items() if body is not None and body.vector.any()}
    return "; ".join(f"{name}: {why}" for name, why in whys.items() if why)
