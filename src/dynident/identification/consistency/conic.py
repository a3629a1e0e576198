"""The first path of the consistent fit: Clarabel on the triangle as it is."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.identification.consistency.conditions import IDENTITY_VECTOR, Conditions, unstack_vectors, vector_rows
from dynident.identification.consistency.program import Multipliers, Program, whitened_rows
from dynident.model.lapack import lapack_of_scipy


@dataclass(frozen=True)
class ConicCandidate:
    """What a solver handed back, not yet checked.

    Attributes:
        phi: Scaled parameters, shape (p,).
        multipliers: Of the conditions.
        said: The solver's own verdict, for messages only.
        iterations: It took.
    """

    phi: Array
    multipliers: Multipliers
    said: str
    iterations: int


def solve_conic(program: Program) -> ConicCandidate:
    """Return Clarabel's answer with A kept as it is: e = A phi - y as equations, never A'A (Sousa and Cortesao 2014).

    The entropic prior becomes exponential cones: t <= log det Q where t <= log q_44 + log s_33 + log t_22 + log r with
    S, T and r at most the Schur complements of the last entries of Q, S and T: Q >= diag(S, 0), S >= diag(T, 0) and
    T >= diag(r, 0) (Boyd and Vandenberghe 2004, A.5.5).
    """
    size, rows = program.data.shape[1], len(program.data)
    linear, blocks, offsets, cones = _entropy_and_conditions(program, rows)
    quadratic = np.zeros((len(linear), len(linear)))
    quadratic[:size, :size] = np.triu(program.pull.T @ program.pull)
    quadratic[size : size + rows, size : size + rows] = np.eye(rows)
    linear[:size] -= program.pull.T @ program.pull_target
    residual = _widened(np.hstack([program.data, -np.eye(rows)]), len(linear))
    matrix, offset = np.vstack([residual, *blocks]), np.concatenate([program.target, *offsets])
    gap = 1e-8 / max(1.0, 4.0 * program.links * program.weight)  # of values without the constant part of the prior
    found = run_clarabel(quadratic, linear, matrix, offset, [_clarabel().ZeroConeT(rows), *cones], gap)
    duals = split_duals(program.conditions, np.array(found.z)[rows:])
    return ConicCandidate(np.array(found.x)[:size], duals, str(found.status), int(found.iterations))


def solve_limited(program: Program, place: Array, rise: float) -> tuple[ConicCandidate, float]:
    """Return Clarabel's answer nearest in the entropic distance with a quadratic part that is limited, and its weight.

    The quadratic part, twice that of f, is at most ``rise`` above that at ``place``: as a second-order cone over the
    differences from there. Its multiplier is the inverse of the weight with which the program has the same answer.
    """
    size, (limit, offset) = program.data.shape[1], _limit_rows(program, place, rise)
    linear, blocks, offsets, cones = _entropy_and_conditions(replace(program, weight=1.0), 0)
    found = run_clarabel(
        np.zeros((len(linear), len(linear))),
        linear,
        np.vstack([_widened(limit, len(linear)), *blocks]),
        np.concatenate([offset, *offsets]),
        [_clarabel().SecondOrderConeT(len(limit)), *cones],
        gap=1e-10,
    )
    duals = np.array(found.z)
    weight = rise / max(duals[0] + duals[len(limit) - 1], 1e-300)
    prices = split_duals(program.conditions, weight * duals[len(limit) :])
    return ConicCandidate(np.array(found.x)[:size], prices, str(found.status), int(found.iterations)), weight


def solve_ranges(program: Program, place: Array, rise: float) -> Array:
    """Return the least and the largest of each phi within conditions and the limit of :func:`solve_limited`, (p, 2).

    Each is the bound that the multipliers prove, wider by what their equations are missed by, times phi; infinite where
    nothing holds it, NaN where none is proven to 1e-4 of it.
    """
    (limit, offset), (inside, inside_offset, cones) = _limit_rows(program, place, rise), cone_rows(program.conditions)
    matrix, offsets, size = np.vstack([limit, inside]), np.append(offset, inside_offset), len(place)
    cones, ends = [_clarabel().SecondOrderConeT(len(limit)), *cones], np.full(2 * size, np.nan)
    for k, linear in enumerate(np.vstack([np.eye(size), -np.eye(size)])):
        found = run_clarabel(np.zeros((size, size)), linear, matrix, offsets, cones)
        phi, duals = np.array(found.x), np.array(found.z)
        value = -float(offsets @ duals) - float(np.abs(linear + matrix.T @ duals) @ np.abs(phi))
        if "DualInfeasible" in str(found.status):
            ends[k] = -np.inf
        elif max(program.conditions.shortfall(phi), 1e-2 * abs(linear @ phi - value)) < 1e-6 * max(1.0, abs(value)):
            ends[k] = value
    return np.column_stack([ends[:size], -ends[size:]])


def _limit_rows(program: Program, place: Array, rise: float) -> tuple[Array, Array]:
    """Return rows and offset of the second-order cone over phi that limits the quadratic part."""
    rows = np.vstack([program.data, program.pull]) / np.sqrt(rise)
    rest = rows @ place - np.concatenate([program.target, program.pull_target]) / np.sqrt(rise)
    slope = rest @ rows  # |d|^2 <= u = 1 - 2 slope d where |(d, (u - 1) / 2)| <= (u + 1) / 2
    limit = np.vstack([slope, -rows, slope])
    return limit, limit @ place + np.eye(1, len(limit))[0]


def _entropy_and_conditions(program: Program, rows: int) -> tuple[Array, list[Array], list[Array], list[Any]]:
    """Return the linear part of the entropic prior, and blocks, offsets and cones, over phi, ``rows`` and its own."""
    first = program.data.shape[1] + rows
    inside, offset, cones = cone_rows(program.conditions)
    linear = np.zeros(first + (14 * program.links if program.weight else 0))
    blocks, offsets = [_widened(inside, len(linear))], [offset]
    if program.weight:
        entropy, entropy_offset, entropy_cones = _entropy_rows(program, rows)
        blocks.append(entropy)
        offsets.append(entropy_offset)
        cones = [*cones, *entropy_cones]
        linear[: 10 * program.links] = program.weight * _trace_gradient(program)
        linear[first:].reshape(-1, 14)[:, 10:] = -program.weight
    return linear, blocks, offsets, cones


@dataclass(frozen=True)
class _Columns:
    """What Clarabel reads of a sparse matrix of SciPy: its entries other than 0, column by column."""

    data: Array
    indices: IntArray
    indptr: IntArray
    shape: tuple[int, ...]
    has_canonical_format: bool = True


def _columns(matrix: Array) -> _Columns:
    turned = np.ascontiguousarray(matrix.T)
    places = np.flatnonzero(turned != 0.0)
    ends = np.searchsorted(places, len(matrix) * np.arange(len(turned) + 1))
    return _Columns(turned.ravel()[places], places % max(len(matrix), 1), ends, matrix.shape)


def _widened(rows: Array, width: int) -> Array:
    """Return rows with zeros behind them, ``width`` columns in all."""
    return np.hstack([rows, np.zeros((len(rows), width - rows.shape[1]))])


def run_clarabel(
    quadratic: Array, linear: Array, matrix: Array, offset: Array, cones: list[Any], gap: float = 1e-8
) -> Any:
    """Return Clarabel's answer to min x'Px/2 + q'x with A x + s = b, s in the cones, to a gap; P upper triangular."""
    clarabel = _clarabel()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads, settings.tol_gap_rel, settings.tol_gap_abs = 1, gap, min(gap, settings.tol_gap_abs)
    return clarabel.DefaultSolver(_columns(quadratic), linear, _columns(matrix), offset, cones, settings).solve()


def cone_rows(conditions: Conditions) -> tuple[Array, Array, list[Any]]:
    """Return (A, b, cones) with the conditions as A phi + s = b, s in the cones: equations, signs, links."""
    clarabel = _clarabel()
    size, links = conditions.size, len(conditions.links)
    blocks: list[Array] = [np.zeros((0, size))]
    cones: list[Any] = []
    if len(conditions.zero):
        blocks.append(-conditions.zero)
        cones.append(clarabel.ZeroConeT(len(conditions.zero)))
    if len(conditions.sign):
        blocks.append(-conditions.sign)
        cones.append(clarabel.NonnegativeConeT(len(conditions.sign)))
    if links:
        blocks.append(-vector_rows(conditions.bases, size))
        cones += [clarabel.PSDTriangleConeT(4)] * links
    offsets = [conditions.zero_offset, conditions.sign_offset, np.tile(-conditions.margin * IDENTITY_VECTOR, links)]
    return np.vstack(blocks), np.concatenate(offsets), cones


def sign_cone(count: int) -> Any:
    """Return Clarabel's cone of ``count`` inequalities."""
    return _clarabel().NonnegativeConeT(count)


def split_duals(conditions: Conditions, duals: Array) -> Multipliers:
    """Return the multipliers of the rows that :func:`cone_rows` made, the first ones."""
    ends = np.cumsum([len(conditions.zero), len(conditions.sign), 10 * len(conditions.links)])
    zero, sign, cones, _ = np.split(duals, ends)
    return Multipliers(zero, sign, unstack_vectors(cones.reshape(-1, 10)))


def _trace_gradient(program: Program) -> Array:
    """Return the gradient of sum_i tr Q_i over the inertial parameters, shape (10 l,)."""
    rows = whitened_rows(np.linalg.inv(program.whitening), program.data.shape[1])
    identity = np.tile(IDENTITY_VECTOR, program.links)
    return (identity @ rows)[: 10 * program.links]


def _entropy_rows(program: Program, rows: int) -> tuple[Array, Array, list[Any]]:
    """Return the cones that bound the log det of each whitened pseudo-inertia, over phi, e and S, T, r, u of each."""
    clarabel = _clarabel()
    size, links = program.data.shape[1], program.links
    link, own = np.arange(links)[:, None], np.arange(14)
    parts = np.zeros((links, 24, size + rows + 14 * links))  # Q, S, T, r and u
    parts[:, :10, :size] = whitened_rows(np.linalg.inv(program.whitening), size).reshape(links, 10, size)
    parts[link, 10 + own, size + rows + 14 * link + own] = 1.0
    found = np.zeros((links, 31, parts.shape[2]))
    found[:, :19] = parts[:, :19]
    found[:, [0, 1, 2, 3, 4, 5, 10, 11, 12, 16]] -= parts[:, 10:20]
    found[:, 19::3], found[:, 21::3] = parts[:, 20:], parts[:, [9, 15, 18, 19]]  # exponential cones: exp(u) <= pivot
    offset = np.zeros((links, 31))
    offset[:, 20::3] = 1.0
    cones = [clarabel.PSDTriangleConeT(4), clarabel.PSDTriangleConeT(3), clarabel.PSDTriangleConeT(2)]
    cones += [clarabel.ExponentialConeT()] * 4
    return -found.reshape(31 * links, -1), offset.ravel(), cones * links


@cache
def _clarabel() -> Any:
    """Return Clarabel, a compiled module without type stubs, with its LAPACK.

    It looks for that in SciPy at its first solve.
    """
    clarabel = importlib.import_module("clarabel")
    with lapack_of_scipy():
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        cones, size, point = [clarabel.PSDTriangleConeT(4)], len(IDENTITY_VECTOR), IDENTITY_VECTOR
        flat, turned = _columns(np.zeros((size, size))), _columns(-np.eye(size))
        least = clarabel.DefaultSolver(flat, point, turned, -point, cones, settings)
        least.solve()
    return clarabel
