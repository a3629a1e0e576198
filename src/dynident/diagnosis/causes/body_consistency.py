"""Whether links of positive mass density can have the base parameters of a log, but for its noise and model error.

Where the true parameters lie inside the conditions of consistent links, or at their edge, noise puts an unconstrained
fit outside, and the consistent one has a larger residual. How much larger noise alone makes it is found by a parametric
bootstrap on the QR factors (Efron and Tibshirani 1993, section 6.5): factors are drawn about the consistent fit, and
each draw is fitted again under the conditions. A draw has the covariance of rows that hang together, and as much more
as fits that leave out one block each scatter more (jackknife): errors of the model move these as well.

Friction may have any sign here: torque sensors behind the gears have none of it, and its sign is no condition of links.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.diagnosis.causes.held_out import BLOCKS
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.errors import SolverFailed
from dynident.identification.consistency.consistent_fit import Answer, pose_program, scaled_data, solve_program
from dynident.identification.consistency.program import Program
from dynident.identification.problem.prior import Scale, natural_scale
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.lapack import solve_upper
from dynident.model.reduction import Reduced, Triangle, reduce, triangle_of

#: Rise of the root mean square residual below which nothing is said; draws, and how many times the largest of them it
#: must be: an error of the model that is the same in all blocks scatters no fit.
RISE, DRAWS, BEYOND = 0.05, 99, 4.0


@dataclass(frozen=True)
class Inconsistency:
    """What consistent links cost.

    Attributes:
        rise: Rise of the root mean square residual, each joint weighed by its own, over the fit without conditions.
        chance: Largest rise among the draws.
        link: The link whose condition holds the fit most.
    """

    rise: float
    chance: float
    link: str


def inconsistency(fit: QuickFit) -> Inconsistency | None:
    """Return what consistent links cost where it is beyond chance; None where noise of this size may cost as much."""
    reduced = _reduced(fit)
    covariance_root = _covariance_root(fit, reduced)
    if covariance_root is None:
        return None
    scale = _scale(fit)
    try:
        program = _links_only(fit, pose_program(fit.model, fit.base, reduced, scale))
        answer = solve_program(program)
        rise = _rise(fit, reduced, scale, answer)
        if rise < RISE:
            return None
        beta = fit.base.from_standard(answer.candidate.phi * scale.parameters)
        generator, largest = np.random.default_rng(0), 0.0
        for _ in range(DRAWS):
            drawn = replace(reduced, z=reduced.r @ beta + covariance_root @ generator.standard_normal(len(beta)))
            data, target = scaled_data(fit.base, drawn, scale)
            own = replace(program, data=data, target=target)
            largest = max(largest, _rise(fit, drawn, scale, solve_program(own)))
            if BEYOND * largest >= rise:
                return None
    except SolverFailed:
        return None
    return Inconsistency(rise, largest, _held_most(answer))


def _reduced(fit: QuickFit) -> Reduced:
    """Return the rows of all joints, each weighed by its residual, as one triangle."""
    triangles = []
    for i, (own, factor) in enumerate(fit.triangles):
        target = factor[:, len(own) + i] - factor[:, -1]
        rows = int(fit.counts[i])
        triangles.append(Triangle(own, triangle_of(np.column_stack([factor[:, : len(own)], target])), rows))
    return reduce(triangles, fit.base.count, 1.0 / np.sqrt(fit.plain.variances))


def _covariance_root(fit: QuickFit, reduced: Reduced) -> Array | None:
    """Return L of the covariance L L' of R beta, shape (b, b); None where a direction is not determined."""
    products = fit.triangles.products
    independent = np.maximum(fit.independent_rows, 1.0)
    weights = fit.counts / independent / fit.plain.variances
    try:
        inner = np.linalg.cholesky(np.tensordot(weights, products.grams, 1))
        root = solve_upper(reduced.r, inner, transposed=True)
    except np.linalg.LinAlgError:
        return None
    scatter = _block_scatter(fit, reduced)
    if scatter is None or not np.all(np.isfinite(root)):
        return None
    return root * np.sqrt(max(1.0, scatter / float(np.sum(root**2))))


def _block_scatter(fit: QuickFit, reduced: Reduced) -> float | None:
    """Return the jackknife variance of R beta, summed over its directions; None where the other blocks do not tell."""
    weights = 1.0 / fit.plain.variances
    blocks = np.arange(len(fit.rows.torque)) * BLOCKS // max(len(fit.rows.torque), 1)
    whole = reduced.r.T @ reduced.r
    total = 0.0
    for block in range(BLOCKS):
        part = (blocks == block)[:, None] & fit.rows.masks
        gram, side = np.zeros_like(whole), np.zeros(len(whole))
        for i, (rows, own) in enumerate(zip(fit.rows.blocks, fit.rows.columns, strict=True)):
            kept = rows[part[:, i]]
            gram[np.ix_(own, own)] += weights[i] * (kept.T @ kept)
            side[own] += weights[i] * (kept.T @ fit.residual[part[:, i], i])
        try:
            moved = np.linalg.solve(whole - gram, -side)
        except np.linalg.LinAlgError:
            return None
        total += float(np.sum((reduced.r @ moved) ** 2))
    return total * (BLOCKS - 1) / BLOCKS


def _scale(fit: QuickFit) -> Scale:
    torque = np.sqrt(np.mean(fit.rows.torque**2, axis=0))
    acceleration = np.sqrt(np.mean(np.asarray(motion_of(fit.rows.prepared.kept).ddq) ** 2, axis=0))
    return natural_scale(fit.model, torque, acceleration)


def _links_only(fit: QuickFit, program: Program) -> Program:
    """Return the program without the conditions on the signs of friction."""
    is_friction = np.array([parameter.kind == "friction" for parameter in fit.model.parameters])
    rules = program.conditions
    kept: BoolArray = (rules.sign[:, is_friction] == 0.0).all(axis=1)
    words = tuple(word for word, keep in zip(rules.sign_words, kept, strict=True) if keep)
    sizes = tuple(size for size, keep in zip(rules.sign_sizes, kept, strict=False) if keep)
    signs = {"sign": rules.sign[kept], "sign_offset": rules.sign_offset[kept], "sign_words": words}
    return replace(program, conditions=replace(rules, **signs, sign_sizes=sizes))


def _rise(fit: QuickFit, reduced: Reduced, scale: Scale, answer: Answer) -> float:
    """Return the rise of the root mean square residual; of rows without noise the fit's floor stands in its place."""
    beta = fit.base.from_standard(answer.candidate.phi * scale.parameters)
    more = float(np.sum((reduced.r @ beta - reduced.z) ** 2))
    return float(np.sqrt(1.0 + more / max(reduced.rest, float(reduced.rows))) - 1.0)


def _held_most(answer: Answer) -> str:
    prices = np.einsum("lii->l", answer.candidate.multipliers.cones)
    return answer.program.conditions.links[int(np.argmax(prices))]
