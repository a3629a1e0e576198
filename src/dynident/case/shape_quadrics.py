"""Quadrics about the shapes of a link where one ellipsoid is too coarse: an L of two boxes is half empty in it.

Matter in the union of ellipsoids E_k = {x: q_k(x) >= 0}, one about each shape, has the pseudo-inertia P = sum_k J_k of
bodies J_k >= 0 with tr(J_k Q_k) >= 0 (Wensing, Kim and Slotine 2018, (15), for each). By duality P is such a sum where
tr(P Y) >= 0 for every Y with Y - l_k Q_k >= 0, l_k >= 0: then (x, 1)' Y (x, 1) >= 0 in every E_k (S-lemma: Boyd and
Vandenberghe 2004, B.2). A few such Y exclude what is not in the shapes: bodies stay linear conditions of ten numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.identification.consistency.conditions import Conditions, stack_vectors, unstack_vectors
from dynident.identification.consistency.conic import cone_rows, run_clarabel, split_duals
from dynident.model.body_constraints import BodyConstraints
from dynident.model.inertia import PSEUDO_BASIS
from dynident.model.plausible import bounding_ellipsoids, shape_clouds, uniform_body
from dynident.model.robot import Link
from dynident.model.shapes import Capsule, Sphere

#: One ellipsoid is too coarse where those about each shape have this share of its volume or less.
COARSE = 0.5

#: Ellipsoids about 26 points of a ball, or of each end of a capsule, hold all of it where they are longer by this.
ROUND = 1.05

#: Most quadrics of a link, and points along each axis of the grid in which they are sought.
MOST, GRID = 8, 15

_GRID = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, GRID)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)

_SPREADS = np.multiply.outer([0.0, 0.05, 0.15], np.diag([1.0, 1.0, 1.0, 0.0]))


def with_quadrics(link: Link) -> Link:
    """Return a link with quadrics where an ellipsoid about its shapes is too coarse and its nominal body meets them."""
    is_round = any(isinstance(shape, Sphere | Capsule) for shape in (*link.shapes, *link.visuals))
    found = shape_quadrics(shape_clouds(link), ROUND if is_round else 1.0)
    body = link.inertia and link.inertia.solid()
    meets = body is None or all(np.sum(body.pseudo * quadric) >= 0.0 for quadric in found)
    return replace(link, quadrics=found if meets else ())


def shape_quadrics(clouds: Sequence[Array], spare: float = 1.0) -> tuple[Array, ...]:
    """Return Q (4, 4), in 1 / m^2, 1 / m and 1, with (x, 1)' Q (x, 1) >= 0 in ellipsoids about each of clouds (k, 3).

    Each excludes the body deepest in what is empty so far: a point, or one of some size. There is none where one
    ellipsoid about all is not too coarse. Semi-axes are longer by ``spare`` than clouds ask for.
    """
    if len(clouds) < 2:
        return ()
    whole, *parts = bounding_ellipsoids([np.concatenate(clouds), *clouds])
    parts = [replace(part, semi_axes=spare * part.semi_axes) for part in parts]
    if sum(np.prod(part.semi_axes) for part in parts) > COARSE * np.prod(whole.semi_axes):
        return ()
    place = np.eye(4)  # from the unit ball to the ellipsoid about all
    place[:3, :3], place[:3, 3] = np.asarray(whole.rotation) * whole.semi_axes, whole.centre
    inverse, forms = np.linalg.inv(place), np.array([place.T @ part.quadric @ place for part in parts])
    points = np.column_stack([_GRID, np.ones(len(_GRID))])[np.sum(_GRID**2, axis=1) < 1.0]
    bodies = (points[:, :, None] * points[:, None] + _SPREADS[:, None]).reshape(-1, 4, 4)
    depth = -np.max(np.tensordot(bodies, forms, ((1, 2), (1, 2))), axis=1)
    full = np.sum([uniform_body(BodyConstraints(body_ellipsoid=part)).pseudo for part in parts], axis=0)
    found: list[Array] = []
    while len(found) < MOST and np.max(depth) > 0.0:
        deepest = int(np.argmax(depth))
        form = separating(forms, bodies[deepest], inverse @ full @ inverse.T)
        depth[np.tensordot(bodies, form) < 0.0] = depth[deepest] = 0.0
        found.append(inverse.T @ form @ inverse)
    return tuple(found)


def separating(forms: Array, body: Array, inside: Array) -> Array:
    """Return Y, >= 0 in ellipsoids of forms (k, 4, 4), with the least tr(body Y) of those with tr(inside Y) = 1.

    Args:
        forms: Q_k of ellipsoids in or about the unit ball.
        body: A pseudo-inertia, shape (4, 4).
        inside: One of matter in the ellipsoids.
    """
    count = len(forms)
    vectors = stack_vectors(PSEUDO_BASIS).T  # of ten parameters
    zero = np.column_stack([*[vectors] * count, -stack_vectors(inside)])  # sum_k J_k = body + t inside, least t
    sign = np.zeros((count, 10 * count + 1))
    for k, form in enumerate(forms):
        sign[k, 10 * k : 10 * k + 10] = np.einsum("kij,ij->k", PSEUDO_BASIS, form)
    names = ("",) * count
    rules = Conditions(zero, -stack_vectors(body), ("",) * 10, sign, np.zeros(count), names, names, 0.0)
    found = run_clarabel(np.zeros((10 * count + 1,) * 2), np.eye(10 * count + 1)[-1], *cone_rows(rules))
    prices = split_duals(rules, np.array(found.z))
    form = unstack_vectors(-prices.zero[None])[0]
    form /= np.sum(form * inside)
    left = [np.linalg.eigvalsh(form - price * each)[0] for price, each in zip(prices.sign, forms, strict=True)]
    return form - min(*left, 0.0) * np.eye(4)  # proven, whatever the solver says
