"""Compiled distances between capsules, and from capsules to boxes and half-spaces, along many postures of a robot.

Tables: ``links`` and ``reals`` of generic.pack(chain); ``ends`` (m, 6) the two ends of each capsule in the frame of its
link, ``radii`` (m,), ``bodies`` (m,) the link that carries it, l for the base; ``boxes`` (k, 15) rotation, centre and
half edges in the base frame; ``planes`` (h, 4) unit normal and offset; ``tests`` (t, 3) kind, capsule, and the capsule,
box or plane that it is tested against; ``starts`` (c + 1,) the first test of each pair: the smallest one counts.

Sources: two segments, Ericson 2005, section 5.1.9; a segment and a box: the squared distance is convex along the
segment, its derivative piecewise linear; how deep a segment is in a box: the nearest facet of their Minkowski sum, a
zonotope (Gottschalk, Lin and Manocha 1996 for its fifteen, here six, directions).
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.model.chain import PRISMATIC
from dynident.model.kernels.generic import WORK, place, rotate, turn_back
from dynident.model.kernels.jit import compiled, inlined

#: Kinds of tests: capsule against capsule, box or half-space; capsule inside a box.
CAPSULE, BOX, PLANE, INSIDE = 0, 1, 2, 3

#: Below this distance, in m, a segment counts as in a box, and two segments as crossing.
TOUCHING = 1e-11

#: Squared sine of the angle of two segments below which their ends are tried as well.
NEARLY_PARALLEL = 1e-6

#: links, reals, ends, radii, bodies, boxes, planes, tests and starts; see the head of the file.
Scene: TypeAlias = tuple[IntArray, Array, Array, Array, IntArray, Array, Array, IntArray, IntArray]

#: What a test gives: signed distance, places on the two segments (0 start, 1 end), normal towards the first.
Contact = tuple[float, float, float, float, float, float]


@inlined
def clamp(x: float) -> float:
    """Return x cut to 0..1."""
    return min(max(x, 0.0), 1.0)


@inlined
def square_between(points: Array, i: int, j: int, s: float, t: float) -> float:
    """Return the squared distance of the points at s and t of two segments."""
    total = 0.0
    for k in range(3):
        along = points[i, k] + s * (points[i, 3 + k] - points[i, k])
        along -= points[j, k] + t * (points[j, 3 + k] - points[j, k])
        total += along * along
    return total


@inlined
def nearest_places(points: Array, i: int, j: int) -> tuple[float, float]:
    """Return where two segments come nearest to each other (Ericson 2005, 5.1.9)."""
    a = e = b = c = f = 0.0
    for k in range(3):
        u, v = points[i, 3 + k] - points[i, k], points[j, 3 + k] - points[j, k]
        r = points[i, k] - points[j, k]
        a, e, b, c, f = a + u * u, e + v * v, b + u * v, c + u * r, f + v * r
    if a == 0.0 or e == 0.0:
        s = 0.0 if a == 0.0 else clamp(-c / a)
        return s, 0.0 if e == 0.0 else clamp(f / e)
    determinant = a * e - b * b
    s = clamp((b * f - c * e) / determinant) if determinant > 0.0 else 0.0
    t = (b * s + f) / e
    if t < 0.0:
        s, t = clamp(-c / a), 0.0
    elif t > 1.0:
        s, t = clamp((b - c) / a), 1.0
    if determinant > NEARLY_PARALLEL * a * e:
        return s, t
    least = square_between(points, i, j, s, t)
    for k in range(4):
        end = float(k % 2)
        x = end if k < 2 else clamp((b * end - c) / a)
        y = clamp((b * end + f) / e) if k < 2 else end
        square = square_between(points, i, j, x, y)
        if square < least:
            s, t, least = x, y, square
    return s, t


@inlined
def between_capsules(points: Array, radii: Array, i: int, j: int) -> Contact:
    """Return the contact of two capsules."""
    s, t = nearest_places(points, i, j)
    x = points[i, 0] + s * (points[i, 3] - points[i, 0]) - points[j, 0] - t * (points[j, 3] - points[j, 0])
    y = points[i, 1] + s * (points[i, 4] - points[i, 1]) - points[j, 1] - t * (points[j, 4] - points[j, 1])
    z = points[i, 2] + s * (points[i, 5] - points[i, 2]) - points[j, 2] - t * (points[j, 5] - points[j, 2])
    apart = math.sqrt(x * x + y * y + z * z)
    if apart < TOUCHING:
        return -radii[i] - radii[j], s, t, 0.0, 0.0, 0.0  # the segments cross: no direction is better than another
    return apart - radii[i] - radii[j], s, t, x / apart, y / apart, z / apart


@inlined
def outside(x: float, half: float) -> float:
    """Return how far a coordinate is beyond an interval (-half, half), with its sign."""
    return x - half if x > half else (x + half if x < -half else 0.0)


@inlined
def slope(p: tuple[float, float, float], u: tuple[float, float, float], boxes: Array, j: int, s: float) -> float:
    """Return half the derivative by s of the squared distance of p + s u from a box, in its frame."""
    return (
        u[0] * outside(p[0] + s * u[0], boxes[j, 12])
        + u[1] * outside(p[1] + s * u[1], boxes[j, 13])
        + u[2] * outside(p[2] + s * u[2], boxes[j, 14])
    )


@inlined
def kink(p: float, u: float, half: float, side: float) -> float:
    """Return where p + s u crosses a face, or -1 where it never does."""
    return (side * half - p) / u if u != 0.0 else -1.0


@inlined
def narrowed(
    p: tuple[float, float, float],
    u: tuple[float, float, float],
    boxes: Array,
    j: int,
    at: float,
    low: float,
    high: float,
) -> tuple[float, float]:
    """Return the interval of s around the least distance after a look at one kink of the derivative."""
    if low < at < high:
        if slope(p, u, boxes, j, at) <= 0.0:
            return at, high
        return low, at
    return low, high


@inlined
def place_nearest_to_box(p: tuple[float, float, float], u: tuple[float, float, float], boxes: Array, j: int) -> float:
    """Return s in 0..1 where p + s u is nearest to a box, in its frame."""
    if slope(p, u, boxes, j, 0.0) >= 0.0:
        return 0.0
    if slope(p, u, boxes, j, 1.0) <= 0.0:
        return 1.0
    low, high = 0.0, 1.0
    for side in (-1.0, 1.0):
        low, high = narrowed(p, u, boxes, j, kink(p[0], u[0], boxes[j, 12], side), low, high)
        low, high = narrowed(p, u, boxes, j, kink(p[1], u[1], boxes[j, 13], side), low, high)
        low, high = narrowed(p, u, boxes, j, kink(p[2], u[2], boxes[j, 14], side), low, high)
    first, last = slope(p, u, boxes, j, low), slope(p, u, boxes, j, high)  # linear in between
    return low - first * (high - low) / (last - first) if last > first else low


@inlined
def depth_in_box(
    p: tuple[float, float, float], u: tuple[float, float, float], half: tuple[float, float, float]
) -> Contact:
    """Return the contact of a segment p + s u that cuts a box: the least shift that takes it out, in its frame."""
    least, place_on, nx, ny, nz = math.inf, 0.0, 0.0, 0.0, 0.0
    for k in range(3):  # out of a face
        centre = p[k] + 0.5 * u[k]
        overlap = half[k] + 0.5 * abs(u[k]) - abs(centre)
        if overlap < least:
            sign = 1.0 if centre >= 0.0 else -1.0
            least, place_on = overlap, 0.0 if sign * u[k] > 0.0 else 1.0
            nx, ny, nz = sign * (k == 0), sign * (k == 1), sign * (k == 2)
    length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    for k in range(3):  # over an edge along axis k: the normal is square to it and to the segment
        a, b = (k + 1) % 3, (k + 2) % 3
        flat = math.sqrt(u[a] * u[a] + u[b] * u[b])
        if flat <= 1e-9 * length or flat == 0.0:
            continue
        ma, mb = u[b] / flat, -u[a] / flat
        ca, cb = p[a] + 0.5 * u[a], p[b] + 0.5 * u[b]
        sign = 1.0 if ma * ca + mb * cb >= 0.0 else -1.0
        ma, mb = sign * ma, sign * mb
        overlap = half[a] * abs(ma) + half[b] * abs(mb) - (ma * ca + mb * cb)
        if overlap < least:
            ea = half[a] if ma >= 0.0 else -half[a]
            eb = half[b] if mb >= 0.0 else -half[b]
            least = overlap
            place_on = clamp(0.5 + ((ea - ca) * u[a] + (eb - cb) * u[b]) / (flat * flat))
            nx = ma * (a == 0) + mb * (b == 0)
            ny = ma * (a == 1) + mb * (b == 1)
            nz = ma * (a == 2) + mb * (b == 2)
    return -least, place_on, 0.0, nx, ny, nz


@inlined
def in_frame(boxes: Array, j: int, points: Array, i: int, at: int) -> tuple[float, float, float]:
    """Return an end of a segment in the frame of a box."""
    x, y, z = points[i, at] - boxes[j, 9], points[i, at + 1] - boxes[j, 10], points[i, at + 2] - boxes[j, 11]
    return turn_back(boxes, j, x, y, z)


@inlined
def from_box(points: Array, radii: Array, boxes: Array, i: int, j: int) -> Contact:
    """Return the contact of a capsule and a box."""
    p, e = in_frame(boxes, j, points, i, 0), in_frame(boxes, j, points, i, 3)
    u = (e[0] - p[0], e[1] - p[1], e[2] - p[2])
    s = place_nearest_to_box(p, u, boxes, j)
    x = outside(p[0] + s * u[0], boxes[j, 12])
    y = outside(p[1] + s * u[1], boxes[j, 13])
    z = outside(p[2] + s * u[2], boxes[j, 14])
    apart = math.sqrt(x * x + y * y + z * z)
    if apart > TOUCHING:
        nx, ny, nz = rotate(boxes, j, x / apart, y / apart, z / apart)
        return apart - radii[i], s, 0.0, nx, ny, nz
    inside, s, _, x, y, z = depth_in_box(p, u, (boxes[j, 12], boxes[j, 13], boxes[j, 14]))
    nx, ny, nz = rotate(boxes, j, x, y, z)
    return inside - radii[i], s, 0.0, nx, ny, nz


@inlined
def within_box(points: Array, radii: Array, boxes: Array, i: int, j: int) -> Contact:
    """Return how far a capsule is from leaving a box: the distance of its nearest end from the nearest face."""
    least, s, nx, ny, nz = math.inf, 0.0, 0.0, 0.0, 0.0
    for end in range(2):
        p = in_frame(boxes, j, points, i, 3 * end)
        for k in range(3):
            spare = boxes[j, 12 + k] - abs(p[k])
            if spare < least:
                sign = -1.0 if p[k] >= 0.0 else 1.0
                least, s = spare, float(end)
                nx, ny, nz = sign * (k == 0), sign * (k == 1), sign * (k == 2)
    nx, ny, nz = rotate(boxes, j, nx, ny, nz)
    return least - radii[i], s, 0.0, nx, ny, nz


@inlined
def from_plane(points: Array, radii: Array, planes: Array, i: int, j: int) -> Contact:
    """Return the contact of a capsule and a half-space: normal . x >= offset is free."""
    nx, ny, nz = planes[j, 0], planes[j, 1], planes[j, 2]
    first = nx * points[i, 0] + ny * points[i, 1] + nz * points[i, 2]
    last = nx * points[i, 3] + ny * points[i, 4] + nz * points[i, 5]
    return min(first, last) - planes[j, 3] - radii[i], 0.0 if first <= last else 1.0, 0.0, nx, ny, nz


@inlined
def contact(points: Array, radii: Array, boxes: Array, planes: Array, kind: int, i: int, j: int) -> Contact:
    """Return the contact of one test."""
    if kind == CAPSULE:
        return between_capsules(points, radii, i, j)
    if kind == BOX:
        return from_box(points, radii, boxes, i, j)
    if kind == PLANE:
        return from_plane(points, radii, planes, i, j)
    return within_box(points, radii, boxes, i, j)


@inlined
def pose(
    links: IntArray, reals: Array, ends: Array, bodies: IntArray, q: Array, work: Array, world: Array, points: Array
) -> None:
    """Write the poses of the links in the base frame (l + 1, 12), the base last, and the ends of the capsules there."""
    base = len(links)
    for i in range(base):
        parent = base if links[i, 0] < 0 else links[i, 0]
        place(links, reals, i, q, work)
        for k in range(3):
            x, y, z = rotate(world, parent, work[i, k], work[i, 3 + k], work[i, 6 + k])
            world[i, k], world[i, 3 + k], world[i, 6 + k] = x, y, z
        x, y, z = rotate(world, parent, work[i, 9], work[i, 10], work[i, 11])
        world[i, 9], world[i, 10], world[i, 11] = (x + world[parent, 9], y + world[parent, 10], z + world[parent, 11])
    for c in range(len(ends)):
        body = bodies[c]
        for at in (0, 3):
            x, y, z = rotate(world, body, ends[c, at], ends[c, at + 1], ends[c, at + 2])
            points[c, at], points[c, at + 1] = x + world[body, 9], y + world[body, 10]
            points[c, at + 2] = z + world[body, 11]


@inlined
def base_pose(world: Array) -> None:
    """Write the pose of the base, the identity, into the last row."""
    base = len(world) - 1
    for k in range(12):
        world[base, k] = 0.0
    world[base, 0] = world[base, 4] = world[base, 8] = 1.0


@inlined
def add_slope(
    scene: Scene,
    world: Array,
    points: Array,
    place_on: tuple[int, float],
    normal: tuple[float, float, float],
    sign: float,
    out: Array,
) -> None:
    """Add the derivative by q of sign * normal . x for the point x at (capsule, share), out (n,)."""
    links, reals, bodies = scene[0], scene[1], scene[4]
    i, s = place_on
    px = points[i, 0] + s * (points[i, 3] - points[i, 0])
    py = points[i, 1] + s * (points[i, 4] - points[i, 1])
    pz = points[i, 2] + s * (points[i, 5] - points[i, 2])
    body = bodies[i]
    if body == len(links):
        return
    while body >= 0:
        ax, ay, az = rotate(world, body, reals[body, 12], reals[body, 13], reals[body, 14])
        if links[body, 1] != PRISMATIC:
            rx, ry, rz = px - world[body, 9], py - world[body, 10], pz - world[body, 11]
            ax, ay, az = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        out[links[body, 2]] += sign * reals[body, 15] * (ax * normal[0] + ay * normal[1] + az * normal[2])
        body = links[body, 0]


@compiled
def distances(scene: Scene, q: Array, out: Array) -> None:
    """Write the signed distances of the pairs, out (N, c)."""
    links, reals, ends, radii, bodies, boxes, planes, tests, starts = scene
    work, world = np.empty((len(links) + 1, WORK)), np.empty((len(links) + 1, 12))
    points = np.empty((len(ends), 6))
    base_pose(world)
    for s in range(len(q)):
        pose(links, reals, ends, bodies, q[s], work, world, points)
        for pair in range(len(starts) - 1):
            least = math.inf
            for t in range(starts[pair], starts[pair + 1]):
                found = contact(points, radii, boxes, planes, tests[t, 0], tests[t, 1], tests[t, 2])
                if not found[0] >= least:  # a distance that is no number stays one
                    least = found[0]
            out[s, pair] = least


@compiled
def gradient(scene: Scene, q: Array, pairs: IntArray, out: Array) -> None:
    """Write the derivative by q of the distance of one pair a sample, out (S, n)."""
    links, reals, ends, radii, bodies, boxes, planes, tests, starts = scene
    work, world = np.empty((len(links) + 1, WORK)), np.empty((len(links) + 1, 12))
    points = np.empty((len(ends), 6))
    base_pose(world)
    out[:, :] = 0.0
    for s in range(len(q)):
        pose(links, reals, ends, bodies, q[s], work, world, points)
        chosen, least = starts[pairs[s]], math.inf
        for t in range(starts[pairs[s]], starts[pairs[s] + 1]):
            found = contact(points, radii, boxes, planes, tests[t, 0], tests[t, 1], tests[t, 2])
            if found[0] < least:
                chosen, least = t, found[0]
        kind, i, j = int(tests[chosen, 0]), int(tests[chosen, 1]), int(tests[chosen, 2])
        _, first, second, nx, ny, nz = contact(points, radii, boxes, planes, kind, i, j)
        add_slope(scene, world, points, (i, first), (nx, ny, nz), 1.0, out[s])
        if kind == CAPSULE:
            add_slope(scene, world, points, (j, second), (nx, ny, nz), -1.0, out[s])
