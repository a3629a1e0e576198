"""The dynamics of a chain written over scalars that may be traced: what the generated kernels compute.

The same quantities as generic.py, but for one robot whose constants are known, so that zeros and ones of its geometry
vanish from the program. Source: Newton-Euler in link frames, Luh, Walker and Paul 1980; the regressor by columns,
Atkeson, An and Hollerbach 1986, (8)-(10), with the joint axes carried to the links; composite bodies, Walker and Orin
1982. Slots of the outputs: row-major positions in the result of one sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.trace import Number, Scalar, Trace, cosine, sine
from dynident.model.robot import PRISMATIC, Chain

Vector: TypeAlias = tuple[Number, Number, Number]
Matrix: TypeAlias = tuple[Vector, Vector, Vector]

NOTHING: Vector = (0.0, 0.0, 0.0)

#: Directions this close to 0, 0.5 or 1 are meant to be: 1.57079632679 rad is a right angle (its cosine is 5e-12).
NEAR = 1e-11


def snapped(chain: Chain) -> Chain:
    """Return the chain without the rounding of its robot model.

    Entries of rotations, axes and of gravity's direction within 1e-11 of 0, 0.5 or 1 (either sign) become that number,
    and translations below 1e-11 of the longest become 0. The dynamics change by a few 1e-11 relative at most, while
    the generated program loses the terms that a description with eleven digits did not mean.
    """
    reach = float(np.abs(chain.translation).max(initial=0.0)) or 1.0
    weight = float(np.linalg.norm(chain.gravity)) or 1.0
    return replace(
        chain,
        rotation=_rounded(chain.rotation),
        axis=_rounded(chain.axis),
        translation=np.where(np.abs(chain.translation) < NEAR * reach, 0.0, chain.translation),
        gravity=np.where(np.abs(chain.gravity) < NEAR * weight, 0.0, chain.gravity),
    )


def _rounded(values: Array) -> Array:
    nearest = np.round(2.0 * values) / 2.0
    return np.where(np.abs(values - nearest) < NEAR, nearest + 0.0, values)


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def scaled(factor: Number, a: Vector) -> Vector:
    """Return factor times a."""
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Vector, b: Vector) -> Number:
    """Return a' b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def times(matrix: Matrix, a: Vector) -> Vector:
    """Return the matrix times a."""
    return dot(matrix[0], a), dot(matrix[1], a), dot(matrix[2], a)


def transposed(matrix: Matrix) -> Matrix:
    """Return the transpose."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    return (a, d, g), (b, e, h), (c, f, i)


@dataclass(frozen=True)
class LinkMotion:
    """What the links do, each in its own frame.

    Attributes:
        velocity: Angular velocity per link.
        acceleration: Angular acceleration per link.
        linear: Acceleration of the origin less gravity per link.
    """

    velocity: tuple[Vector, ...]
    acceleration: tuple[Vector, ...]
    linear: tuple[Vector, ...]


class TracedChain:
    """A chain whose joint positions are traced; its methods write one quantity each.

    The arrays of the caller are named ``q``, ``dq``, ``ddq`` (entry: joint), ``theta`` (entry: parameter) and, where
    it is read, ``gravity`` (entry: axis).

    Attributes:
        trace: Where the operations are kept.
        chain: The chain, its rounding removed by :func:`snapped`.
        theta: Inertial parameters that become constants of the program, shape (10 l,); None where they are an input.
        reads: Array that takes the place of ``dq`` or ``ddq``; ``""`` for zeros; or array of gravity, which is
            a constant of the program without one. With none for dq, dq for ddq and no gravity the torque is the
            generalised momentum, M dq.
    """

    def __init__(self, chain: Chain, theta: Array | None = None, reads: Mapping[str, str] | None = None) -> None:
        self.trace, self.chain, self.theta = Trace(), snapped(chain), theta
        self.reads = dict(reads or {})
        self.axes = [_vector(axis) for axis in self.chain.axis]
        self.poses = [self._pose(i) for i in range(chain.links)]

    def _pose(self, i: int) -> tuple[Matrix, Vector]:
        """Return rotation and translation of link i in its parent (Rodrigues' formula)."""
        chain = self.chain
        turn, shift = chain.rotation[i], chain.translation[i]
        position = self._joint(i, "q") + float(chain.offset[i])
        if chain.kind[i] == PRISMATIC:
            return _matrix(turn), add(_vector(shift), scaled(position, _vector(_rounded(turn @ chain.axis[i]))))
        axis = chain.axis[i]
        along = np.outer(turn @ axis, axis)
        about = np.cross(turn, axis)  # rows of R times skew(axis)
        fixed, with_cosine, with_sine = _rounded(along), _rounded(turn - along), _rounded(about)
        c, s = cosine(position), sine(position)
        rows = [
            [float(fixed[r, k]) + float(with_cosine[r, k]) * c + float(with_sine[r, k]) * s for k in range(3)]
            for r in range(3)
        ]
        return _matrix(rows), _vector(shift)

    def _joint(self, i: int, name: str) -> Number:
        array = self.reads.get(name, name)
        return float(self.chain.multiplier[i]) * self.trace.input(array, int(self.chain.joint[i])) if array else 0.0

    def _lift(self) -> Vector:
        """Return the acceleration of the base less gravity."""
        if "gravity" not in self.reads:
            return _vector(0.0 - self.chain.gravity)
        x, y, z = (-self.trace.input(self.reads["gravity"], axis) for axis in range(3))
        return x, y, z

    def ancestors(self, i: int) -> list[int]:
        """Return link i and the links that carry it, tip first."""
        found = [i]
        while self.chain.parent[found[-1]] >= 0:
            found.append(int(self.chain.parent[found[-1]]))
        return found

    def motion(self) -> LinkMotion:
        """Return velocities and accelerations of all links."""
        base = (NOTHING, NOTHING, self._lift())
        found: list[tuple[Vector, Vector, Vector]] = []
        for i, (axis, (rotation, shift)) in enumerate(zip(self.axes, self.poses, strict=True)):
            parent = int(self.chain.parent[i])
            spin, swing, push = found[parent] if parent >= 0 else base
            back = transposed(rotation)
            push = times(back, add(push, add(cross(spin, cross(spin, shift)), cross(swing, shift))))
            spin, swing = times(back, spin), times(back, swing)
            speed, rate = scaled(self._joint(i, "dq"), axis), scaled(self._joint(i, "ddq"), axis)
            if self.chain.kind[i] == PRISMATIC:
                push = add(push, add(rate, scaled(2.0, cross(spin, speed))))
            else:
                swing = add(swing, add(rate, cross(spin, speed)))
                spin = add(spin, speed)
            found.append((spin, swing, push))
        return LinkMotion(*(tuple(link[k] for link in found) for k in range(3)))

    def unit_twist(self, i: int) -> tuple[Vector, Vector]:
        """Return direction of turning and velocity of the origin for a unit speed of link i's joint, in its frame."""
        return (NOTHING, self.axes[i]) if self.chain.kind[i] == PRISMATIC else (self.axes[i], NOTHING)

    def twists(self) -> list[dict[int, tuple[Vector, Vector]]]:
        """Return per link the unit twists of its own joint and of those that carry it, in its frame, by link."""
        found: list[dict[int, tuple[Vector, Vector]]] = []
        for i, (rotation, shift) in enumerate(self.poses):
            back = transposed(rotation)
            parent = int(self.chain.parent[i])
            carried = found[parent] if parent >= 0 else {}
            found.append(
                {
                    k: (times(back, turn), times(back, add(slide, cross(turn, shift))))
                    for k, (turn, slide) in carried.items()
                }
            )
            found[i][i] = self.unit_twist(i)
        return found

    def regressor(self, columns: Iterable[int]) -> dict[int, Number]:
        """Return entries of the regressor: chosen columns of the 10 l; slot joint * 10 l + column."""
        wanted: dict[int, list[int]] = {}
        for column in columns:
            wanted.setdefault(int(column) // 10, []).append(int(column) % 10)
        motion, twists = self.motion(), self.twists()
        found: dict[int, Number] = {}
        for i, parameters in wanted.items():
            wrenches = unit_wrenches(motion.velocity[i], motion.acceleration[i], motion.linear[i])
            for k, (turn, slide) in twists[i].items():
                factor = float(self.chain.multiplier[k])
                for parameter in parameters:
                    force, moment = wrenches[parameter]
                    slot = (int(self.chain.joint[k]) * self.chain.links + i) * 10 + parameter
                    found[slot] = found.get(slot, 0.0) + factor * (dot(turn, moment) + dot(slide, force))
        return found

    def torque(self) -> dict[int, Number]:
        """Return the inverse dynamics for the parameters ``theta``; slot: joint."""
        motion, links = self.motion(), self.chain.links
        forces, moments = [], []
        for i in range(links):
            force, moment = self._wrench(i, motion)
            forces.append(force)
            moments.append(moment)
        found: dict[int, Number] = {}
        for i in reversed(range(links)):
            turn, slide = self.unit_twist(i)
            effort = float(self.chain.multiplier[i]) * (dot(turn, moments[i]) + dot(slide, forces[i]))
            joint, parent = int(self.chain.joint[i]), int(self.chain.parent[i])
            found[joint] = found.get(joint, 0.0) + effort
            if parent >= 0:
                rotation, shift = self.poses[i]
                force = times(rotation, forces[i])
                forces[parent] = add(forces[parent], force)
                moments[parent] = add(moments[parent], add(times(rotation, moments[i]), cross(shift, force)))
        return found

    def _parameters(self, i: int) -> tuple[Matrix, Vector, Number]:
        """Return inertia, first moment and mass of link i."""
        numbers = range(10 * i, 10 * i + 10)
        ten = [self.trace.input("theta", k) if self.theta is None else float(self.theta[k]) for k in numbers]
        xx, xy, xz, yy, yz, zz, hx, hy, hz, mass = ten
        return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), (hx, hy, hz), mass

    def _wrench(self, i: int, motion: LinkMotion) -> tuple[Vector, Vector]:
        """Return force and moment about its origin that move link i."""
        inertia, first, mass = self._parameters(i)
        spin, swing, push = motion.velocity[i], motion.acceleration[i], motion.linear[i]
        force = add(scaled(mass, push), add(cross(swing, first), cross(spin, cross(spin, first))))
        turned = add(times(inertia, swing), cross(spin, times(inertia, spin)))
        return force, add(turned, cross(first, push))

    def mass(self) -> dict[int, Number]:
        """Return the mass matrix for the parameters ``theta``; slot: row * n + column."""
        links = self.chain.links
        bodies = [self._parameters(i) for i in range(links)]
        found: dict[int, Number] = {}
        for i in reversed(range(links)):
            parent = int(self.chain.parent[i])
            if parent >= 0:
                bodies[parent] = _joined(bodies[parent], bodies[i], *self.poses[i])
            inertia, first, mass = bodies[i]
            turn, slide = self.unit_twist(i)
            force = add(scaled(mass, slide), cross(turn, first))
            moment = add(times(inertia, turn), cross(first, slide))
            for k in self.ancestors(i):
                turn, slide = self.unit_twist(k)
                factor = float(self.chain.multiplier[i] * self.chain.multiplier[k])
                value = factor * (dot(turn, moment) + dot(slide, force))
                row, column = int(self.chain.joint[i]), int(self.chain.joint[k])
                for slot in [row * self.chain.joints + column, column * self.chain.joints + row][: 1 + (k != i)]:
                    found[slot] = found.get(slot, 0.0) + value
                rotation, shift = self.poses[k]
                force = times(rotation, force)
                moment = add(times(rotation, moment), cross(shift, force))
        return found

    def frames(self) -> dict[int, Number]:
        """Return the poses of the links in the base; slot 12 i + k: rotation (9, row-major), then translation (3)."""
        poses: list[tuple[Matrix, Vector]] = []
        found: dict[int, Number] = {}
        for i, own in enumerate(self.poses):
            parent = int(self.chain.parent[i])
            poses.append(_placed(poses[parent], own) if parent >= 0 else own)
            rotation, shift = poses[i]
            for k, value in enumerate((*rotation[0], *rotation[1], *rotation[2], *shift)):
                found[12 * i + k] = value
        return found


def unit_wrenches(spin: Vector, swing: Vector, push: Vector) -> list[tuple[Vector, Vector]]:
    """Return force and moment for each of the ten unit parameters, in their order.

    Args:
        spin: Angular velocity w of the link.
        swing: Its angular acceleration e.
        push: Acceleration of its origin less gravity, a.
    """
    (wx, wy, wz), (ex, ey, ez), (ax, ay, az) = spin, swing, push
    xx, yy, zz, xy, xz, yz = wx * wx, wy * wy, wz * wz, wx * wy, wx * wz, wy * wz
    moments: list[Vector] = [  # I e + w x I w
        (ex, xz, -xy),
        (ey - xz, ex + yz, xx - yy),
        (ez + xy, zz - xx, ex - yz),
        (-yz, ey, xy),
        (yy - zz, ez - xy, ey + xz),
        (yz, -xz, ez),
    ]
    found: list[tuple[Vector, Vector]] = [(NOTHING, moment) for moment in moments]
    found.append(((-(yy + zz), xy + ez, xz - ey), (0.0, -az, ay)))  # e x h + w x (w x h), h x a
    found.append(((xy - ez, -(xx + zz), yz + ex), (az, 0.0, -ax)))
    found.append(((xz + ey, yz - ex, -(xx + yy)), (-ay, ax, 0.0)))
    found.append((push, NOTHING))
    return found


def _joined(
    own: tuple[Matrix, Vector, Number], child: tuple[Matrix, Vector, Number], rotation: Matrix, shift: Vector
) -> tuple[Matrix, Vector, Number]:
    """Return the parameters of a body with a child that stands at (rotation, shift) in its frame."""
    inertia, first, mass = child
    first = times(rotation, first)
    half = [times(rotation, row) for row in inertia]  # rows of I R'
    rows = [times(rotation, column) for column in transposed((half[0], half[1], half[2]))]  # columns of R I R'
    moved = add(first, scaled(mass, shift))
    # r -> R r + p adds |p + .|^2 terms: h p' + p h' + m p p', with the trace on the diagonal
    products = [[first[r] * shift[k] + shift[r] * moved[k] for k in range(3)] for r in range(3)]
    trace = products[0][0] + products[1][1] + products[2][2]
    total = [
        [own[0][r][k] + (rows[r][k] - products[r][k] + (trace if r == k else 0.0)) for k in range(3)] for r in range(3)
    ]
    for r, k in ((1, 0), (2, 0), (2, 1)):
        total[r][k] = total[k][r]
    return _matrix(total), add(own[1], moved), own[2] + mass


def _placed(parent: tuple[Matrix, Vector], own: tuple[Matrix, Vector]) -> tuple[Matrix, Vector]:
    """Return the pose in the base of a frame given in its parent's, which is placed in the base."""
    turn, place = parent
    x, y, z = (times(turn, column) for column in transposed(own[0]))
    return transposed((x, y, z)), add(place, times(turn, own[1]))


def _vector(values: Iterable[float]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _matrix(rows: Iterable[Iterable[Number]]) -> Matrix:
    (a, b, c), (d, e, f), (g, h, i) = ([v if isinstance(v, Scalar) else float(v) for v in row] for row in rows)
    return (a, b, c), (d, e, f), (g, h, i)
