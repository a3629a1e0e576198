"""The first and the second path of the consistent fit: Clarabel, on the triangle as it is and in whitened variables."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse

from dynident.arrays import Array
from dynident.estimation.consistency.conditions import IDENTITY_VECTOR, ROOT2, VECTOR_BASIS, Conditions, unstack_vectors
from dynident.estimation.consistency.program import Multipliers, Program, whitened_rows
from dynident.model.reduction import triangle_of


@dataclass(frozen=True)
class Candidate:
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


def solve_conic(program: Program) -> Candidate:
    """Return Clarabel's answer with A kept as it is: e = A phi - y as equations, never A'A (Sousa and Cortesao 2014).

    The entropic prior becomes exponential cones: t <= log det Q where [[Q, Z], [Z', diag(Z)]] >= 0 with Z lower
    triangular and t <= sum log Z_jj (Nesterov and Nemirovski 1994, section 6.4.3).
    """
    clarabel = _clarabel()
    size, rows = program.data.shape[1], len(program.data)
    logs = 14 * program.links if program.weight else 0
    gram = program.pull.T @ program.pull
    quadratic = scipy.sparse.block_diag(
        [scipy.sparse.csc_matrix(np.triu(gram)), scipy.sparse.identity(rows), scipy.sparse.csc_matrix((logs, logs))],
        format="csc",
    )
    linear = np.concatenate([-program.pull.T @ program.pull_target, np.zeros(rows + logs)])
    residuals = scipy.sparse.hstack([scipy.sparse.csc_matrix(program.data), -scipy.sparse.identity(rows)])
    blocks, offsets, cones = [residuals], [program.target], [clarabel.ZeroConeT(rows)]
    inside, inside_offset, inside_cones = cone_rows(program.conditions)
    blocks.append(scipy.sparse.hstack([inside, scipy.sparse.csc_matrix((inside.shape[0], rows))]))
    offsets.append(inside_offset)
    cones += inside_cones
    if logs:
        blocks = [
            scipy.sparse.hstack([block, scipy.sparse.csc_matrix((len(offset), logs))])
            for block, offset in zip(blocks, offsets, strict=True)
        ]
        entropy, entropy_offset, entropy_cones = _entropy_rows(program, rows)
        blocks.append(entropy)
        offsets.append(entropy_offset)
        cones += entropy_cones
        linear[: 10 * program.links] += program.weight * _trace_gradient(program)
        for link in range(program.links):
            linear[size + rows + 14 * link + 10 : size + rows + 14 * link + 14] = -program.weight
    found = run_clarabel(quadratic, linear, scipy.sparse.vstack(blocks, format="csc"), np.concatenate(offsets), cones)
    duals = np.array(found.z)[rows : rows + inside.shape[0]]
    return Candidate(
        np.array(found.x)[:size], split_duals(program.conditions, duals), str(found.status), int(found.iterations)
    )


def solve_whitened(program: Program) -> Candidate:
    """Return Clarabel's answer in variables in which the Hessian at the prior is the identity: phi = free + J^-1 v.

    The quadratic part only; another scaling of the same problem, for where the first stalls.
    """
    size = program.data.shape[1]
    stacked = np.vstack([program.data, program.pull])
    full = np.column_stack([stacked, np.concatenate([program.target, program.pull_target])])
    factor = triangle_of(full)
    root, aim = factor[:size, :size], factor[:size, size]
    free = scipy.linalg.solve_triangular(root, aim)  # the optimum without conditions; v counts from there
    inside, offset, cones = cone_rows(program.conditions)
    turned = scipy.linalg.solve_triangular(root, inside.toarray().T, trans=1).T
    unit = scipy.sparse.identity(size, format="csc")
    found = run_clarabel(unit, np.zeros(size), scipy.sparse.csc_matrix(turned), offset - inside @ free, cones)
    phi = free + scipy.linalg.solve_triangular(root, np.array(found.x))
    duals = split_duals(program.conditions, np.array(found.z))
    return Candidate(phi, duals, str(found.status), int(found.iterations))


def run_clarabel(quadratic: Any, linear: Array, matrix: Any, offset: Array, cones: list[Any]) -> Any:
    """Return Clarabel's answer to min x'Px/2 + q'x with A x + s = b, s in the cones; P upper triangular."""
    clarabel = _clarabel()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    return clarabel.DefaultSolver(quadratic, linear, matrix, offset, cones, settings).solve()


def cone_rows(conditions: Conditions) -> tuple[Any, Array, list[Any]]:
    """Return (A, b, cones) with the conditions as A phi + s = b, s in the cones: equations, signs, links."""
    clarabel = _clarabel()
    size, links = conditions.size, len(conditions.links)
    blocks: list[Any] = []
    cones: list[Any] = []
    if len(conditions.zero):
        blocks.append(scipy.sparse.csc_matrix(-conditions.zero))
        cones.append(clarabel.ZeroConeT(len(conditions.zero)))
    if len(conditions.sign):
        blocks.append(scipy.sparse.csc_matrix(-conditions.sign))
        cones.append(clarabel.NonnegativeConeT(len(conditions.sign)))
    if links:
        bodies = scipy.sparse.kron(scipy.sparse.identity(links), scipy.sparse.csc_matrix(-VECTOR_BASIS))
        blocks.append(scipy.sparse.hstack([bodies, scipy.sparse.csc_matrix((10 * links, size - 10 * links))]))
        cones += [clarabel.PSDTriangleConeT(4)] * links
    offsets = [conditions.zero_offset, conditions.sign_offset, np.tile(-conditions.margin * IDENTITY_VECTOR, links)]
    matrix = scipy.sparse.vstack(blocks, format="csc") if blocks else scipy.sparse.csc_matrix((0, size))
    return matrix, np.concatenate(offsets), cones


def equation_cone(count: int) -> Any:
    """Return Clarabel's cone of ``count`` equations."""
    return _clarabel().ZeroConeT(count)


def sign_cone(count: int) -> Any:
    """Return Clarabel's cone of ``count`` inequalities."""
    return _clarabel().NonnegativeConeT(count)


def split_duals(conditions: Conditions, duals: Array) -> Multipliers:
    """Return the multipliers of the rows that :func:`cone_rows` made."""
    zero, sign, cones = np.split(duals, np.cumsum([len(conditions.zero), len(conditions.sign)]))
    return Multipliers(zero, sign, unstack_vectors(cones.reshape(-1, 10)))


def _trace_gradient(program: Program) -> Array:
    """Return the gradient of sum_i tr Q_i over the inertial parameters, shape (10 l,)."""
    rows = whitened_rows(np.linalg.inv(program.whitening), program.data.shape[1])
    identity = np.tile(IDENTITY_VECTOR, program.links)
    return (identity @ rows)[: 10 * program.links]


def _entropy_rows(program: Program, rows: int) -> tuple[Any, Array, list[Any]]:
    """Return the cones that bound the log det of each whitened pseudo-inertia, over (phi, e, Z and u of each link)."""
    clarabel = _clarabel()
    size, links = program.data.shape[1], program.links
    whitened = whitened_rows(np.linalg.inv(program.whitening), size)
    upper8 = [(i, j) for j in range(8) for i in range(j + 1)]
    lower4 = [(i, j) for j in range(4) for i in range(j, 4)]
    positions = {(i, j): k for k, (i, j) in enumerate((i, j) for j in range(4) for i in range(j + 1))}
    blocks, offsets, cones = [], [], []
    for link in range(links):
        first = size + rows + 14 * link
        block = np.zeros((36 + 12, size + rows + 14 * links))
        for k, (i, j) in enumerate(upper8):
            factor = 1.0 if i == j else ROOT2
            if j < 4:  # Q, whose rows carry the sqrt(2) already
                block[k, :size] = -whitened[10 * link + positions[i, j]]
            elif i < 4 and (i, j - 4) in lower4:  # Z
                block[k, first + lower4.index((i, j - 4))] = -factor
            elif i == j:  # diag(Z)
                block[k, first + lower4.index((i - 4, i - 4))] = -1.0
        for d in range(4):  # (u, 1, Z_dd) in the exponential cone: exp(u) <= Z_dd
            block[36 + 3 * d, first + 10 + d] = -1.0
            block[36 + 3 * d + 2, first + lower4.index((d, d))] = -1.0
        offset = np.zeros(48)
        offset[37::3] = 1.0
        blocks.append(scipy.sparse.csc_matrix(block))
        offsets.append(offset)
        cones += [clarabel.PSDTriangleConeT(8), *[clarabel.ExponentialConeT()] * 4]
    return scipy.sparse.vstack(blocks), np.concatenate(offsets), cones


def _clarabel() -> Any:
    return importlib.import_module("clarabel")  # a compiled module without type stubs
