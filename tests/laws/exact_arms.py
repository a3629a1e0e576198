"""Arms of whole numbers, and the rank of their regressor without rounding.

All poses are rational: turns are quaternions of whole numbers, lengths hundredths. With cos and sin of the joints as
rational points of the circle, the torque is a rational function of the parameters, and it may be evaluated in the
numbers modulo a prime: the rank of random rows there is the rank over the rationals, but for a chance of about
rows / prime = 1e-6 (Schwartz 1980 and Zippel 1979), and it is never larger. The recursion is that of Newton and Euler
(Luh, Walker and Paul 1980), written for this test alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from hypothesis import strategies as st

from dynident.arrays import Array
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.robot import Link, Robot

PRIME = 2**31 - 1
KINDS: tuple[Literal["revolute", "prismatic"], ...] = ("revolute", "prismatic")

#: Quaternions of the right angles about the axes, and of none.
RIGHT = [(1, 0, 0, 0), (1, 1, 0, 0), (1, -1, 0, 0), (1, 0, 1, 0), (1, 0, 0, 1), (0, 1, 0, 0), (1, 1, 1, 1)]

Numbers = Any  # whole numbers modulo the prime, or floats: an array of int64 or of float64


def reduced(values: Numbers) -> Numbers:
    """Return whole numbers modulo the prime, and floats as they are."""
    return values % PRIME if values.dtype == np.int64 else values


def inverse(values: Numbers) -> Numbers:
    """Return 1 / values."""
    if values.dtype != np.int64:
        return 1.0 / values
    return np.array([pow(int(x), -1, PRIME) for x in values.ravel()], dtype=np.int64).reshape(values.shape)


def product(a: Numbers, b: Numbers) -> Numbers:
    """Return the matrix product of (..., i, j) and (..., j, k)."""
    return reduced(np.sum(reduced(a[..., :, :, None] * b[..., None, :, :]), axis=-2))


def applied(a: Numbers, v: Numbers) -> Numbers:
    """Return the matrix (..., i, j) times the vector (..., j)."""
    return product(a, v[..., None])[..., 0]


def cross(v: Numbers) -> Numbers:
    """Return the matrices S with S w = v x w, (..., 3, 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return reduced(np.stack([np.stack(row, -1) for row in ((o, -z, y), (z, o, -x), (-y, x, o))], -2))


def turn_of(quaternion: Numbers) -> Numbers:
    """Return the rotation of quaternions (..., 4) of any length, (..., 3, 3): R = I + 2 w S / |q|^2 + 2 S S / |q|^2."""
    w, v = quaternion[..., 0], quaternion[..., 1:]
    scale = inverse(reduced(np.sum(reduced(quaternion * quaternion), axis=-1)))
    across = cross(v)
    twice = reduced(2 * reduced(w[..., None, None] * across) + 2 * product(across, across))
    eye = np.eye(3).astype(quaternion.dtype)
    return reduced(eye + reduced(twice * scale[..., None, None]))


def moment_columns(v: Numbers) -> Numbers:
    """Return L with I v = L (Ixx, Ixy, Ixz, Iyy, Iyz, Izz), (..., 3, 6)."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack(row, -1) for row in ((x, y, z, o, o, o), (o, x, o, y, z, o), (o, o, x, o, y, z))], -2)


@dataclass(frozen=True)
class ExactArm:
    """A tree of joints, every number whole.

    Attributes:
        parents: Parent of each link, -1 for the base.
        kinds: Kind of each joint.
        turns: Quaternion (w, x, y, z) of each link in its parent, of any length.
        shifts: Position of each link in its parent in hundredths of a metre.
        axes: Axis of each joint in its link: 0 for x, 1 for y, 2 for z.
        gravity: Gravity in m/s^2.
    """

    parents: tuple[int, ...]
    kinds: tuple[Literal["revolute", "prismatic"], ...]
    turns: tuple[tuple[int, int, int, int], ...]
    shifts: tuple[tuple[int, int, int], ...]
    axes: tuple[int, ...]
    gravity: tuple[int, int, int] = (0, 0, -10)

    @property
    def robot(self) -> Robot:
        """The same arm in double precision, with a possible body on each link."""
        generator = np.random.default_rng(len(self.kinds))
        joints = [
            Joint(f"j{i + 1}", kind, self.parents[i], turn, np.array(self.shifts[i]) / 100, np.eye(3)[self.axes[i]])
            for i, (kind, turn) in enumerate(zip(self.kinds, turn_of(np.array(self.turns, dtype=float)), strict=True))
        ]
        bodies = [Inertia.from_log_cholesky(generator.uniform(-0.8, 0.8, 10)) for _ in joints]
        links = tuple(Link(f"l{i + 1}", body) for i, body in enumerate(bodies))
        return Robot("exact", links, tuple(joints), np.array(self.gravity, dtype=float))

    def rank(self, rotors: bool = False, seed: int = 0) -> int:
        """Return the exact number of base parameters, with the rotor inertia of each joint on request."""
        n = len(self.kinds)
        generator = np.random.default_rng(seed)
        samples = 10 * n + 5  # the rows of one joint alone may have to tell all parameters
        half, dq, ddq = generator.integers(1, PRIME, (3, samples, n))
        square = reduced(half * half)
        scale = inverse(reduced(1 + square))
        cos, sin = reduced(reduced(1 - square) * scale), reduced(reduced(2 * half) * scale)
        blocks = [self.regressor(half, cos, sin, dq, ddq)]
        if rotors:
            blocks.append(np.eye(n, dtype=np.int64) * ddq[:, :, None])
        columns = np.concatenate(blocks, axis=-1)
        return rank_modulo(columns.reshape(-1, columns.shape[-1]))

    def floating(self, motion: Motion) -> Array:
        """Return the regressor of :meth:`regressor` in double precision, (N, n, 10 n)."""
        q, dq, ddq = (np.asarray(values, dtype=float) for values in (motion.q, motion.dq, motion.ddq))
        return self.regressor(q, np.cos(q), np.sin(q), dq, ddq)

    def regressor(self, slide: Numbers, cos: Numbers, sin: Numbers, dq: Numbers, ddq: Numbers) -> Numbers:
        """Return the rows (N, n, 10 n) of states (N, n): positions of slides, cos and sin of turns, speeds."""
        kind = dq.dtype
        samples, n = dq.shape
        places = turn_of(reduced(np.array(self.turns, dtype=kind)))
        hundredth = inverse(np.array(100, dtype=kind))
        offsets = reduced(np.array(self.shifts, dtype=kind) * hundredth)
        zero = np.zeros((samples, 3), dtype=kind)
        base = (zero, zero, reduced(zero - np.array(self.gravity, dtype=kind)))
        found = np.zeros((samples, n, 10 * n), dtype=kind)
        poses, motions = [], []
        for i in range(n):
            axis = np.eye(3)[self.axes[i]].astype(kind)
            along, rate, push = (reduced(values[:, i, None] * axis) for values in (slide, dq, ddq))
            omega, alpha, a = motions[self.parents[i]] if self.parents[i] >= 0 else base
            turn, shift = np.broadcast_to(places[i], (samples, 3, 3)), np.broadcast_to(offsets[i], (samples, 3))
            if self.kinds[i] == "revolute":
                swing = cross(axis)
                rolled = reduced(
                    np.eye(3).astype(kind)
                    + reduced(sin[:, i, None, None] * swing)
                    + reduced(reduced(1 - cos[:, i, None, None]) * product(swing, swing))
                )
                turn = product(turn, rolled)
            else:
                shift = reduced(shift + applied(turn, along))
            back = np.swapaxes(turn, -1, -2)
            a = reduced(a + applied(cross(alpha), shift) + applied(cross(omega), applied(cross(omega), shift)))
            omega, alpha, a = applied(back, omega), applied(back, alpha), applied(back, a)
            if self.kinds[i] == "revolute":
                alpha = reduced(alpha + push + applied(cross(omega), rate))
                omega = reduced(omega + rate)
            else:
                a = reduced(a + push + 2 * applied(cross(omega), rate))
            poses.append((turn, shift))
            motions.append((omega, alpha, a))
            spin = cross(omega)
            force, moment = np.zeros((2, samples, 3, 10), dtype=kind)
            force[:, :, 6:9] = reduced(cross(alpha) + product(spin, spin))
            force[:, :, 9] = a
            moment[:, :, :6] = reduced(moment_columns(alpha) + product(spin, moment_columns(omega)))
            moment[:, :, 6:9] = reduced(-cross(a))
            j = i
            while j >= 0:
                found[:, j, 10 * i : 10 * i + 10] = (moment if self.kinds[j] == "revolute" else force)[:, self.axes[j]]
                turn, shift = poses[j]
                force = product(turn, force)
                moment = reduced(product(turn, moment) + product(cross(shift), force))
                j = self.parents[j]
        return found


def rank_modulo(rows: Numbers) -> int:
    """Return the rank of whole numbers (r, c) modulo the prime, by elimination."""
    rows, rank = reduced(rows).copy(), 0
    for column in range(rows.shape[1]):
        places = np.flatnonzero(rows[rank:, column])
        if not len(places):
            continue
        pivot = rank + int(places[0])
        rows[[rank, pivot]] = rows[[pivot, rank]]
        rows[rank] = reduced(rows[rank] * pow(int(rows[rank, column]), -1, PRIME))
        below = rows[rank + 1 :]
        below[:] = reduced(below - reduced(below[:, column, None] * rows[rank]))
        rank += 1
        if rank == len(rows):
            break
    return rank


def off(quaternion: tuple[int, int, int, int], by: tuple[int, int, int], size: int) -> tuple[int, int, int, int]:
    """Return the turn followed by a small one about ``by``, of 2 |by| / size rad."""
    w, x, y, z = quaternion
    a, (b, c, d) = size, by
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


def exact_arms(least: int = 2, most: int = 12, nearly: int = 0, tree: bool = True) -> st.SearchStrategy[ExactArm]:
    """Draw arms: chains and trees, slides, parallel, intersecting and skew axes, links of zero length, tilted gravity.

    Args:
        least: Fewest joints.
        most: Most joints.
        nearly: Where above 0, every turn is off by 2 / nearly rad about some axis.
        tree: Draw trees too.
    """
    small = st.integers(-9, 9)
    skewed = st.tuples(st.integers(1, 9), small, small, small)
    length = st.sampled_from([0, 0, 0, 13, 30, -45])

    @st.composite
    def draw_arm(draw: st.DrawFn) -> ExactArm:
        n = draw(st.integers(least, most))
        branches, slides, special = draw(st.booleans()) and tree, draw(st.booleans()), draw(st.booleans())
        turns = [draw(st.sampled_from(RIGHT) if special or draw(st.booleans()) else skewed) for _ in range(n)]
        if nearly:
            by = st.tuples(*[st.integers(-1, 1)] * 3)
            turns = [off(turn, draw(by), nearly) for turn in turns]
        return ExactArm(
            tuple(draw(st.integers(-1, i - 1)) if branches else i - 1 for i in range(n)),
            tuple(draw(st.sampled_from(KINDS)) if slides else "revolute" for _ in range(n)),
            tuple(turns),
            tuple((draw(length), draw(length), draw(length)) for _ in range(n)),
            tuple(2 if special else draw(st.integers(0, 2)) for _ in range(n)),
            draw(st.sampled_from([(0, 0, -10), (3, 1, -9), (0, -10, 0), (0, 0, 0)])),
        )

    return draw_arm()
