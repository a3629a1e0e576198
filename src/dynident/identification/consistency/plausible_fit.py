"""The consistent fit within bounds of plausible bodies, and among those within the noise the one nearest to nominal.

minimise    |A phi - y|^2 / 2 + v s^2 / (2 r) d(phi)^2      subject to the conditions and the bounds

A, y, s^2 and r rows as in :func:`~dynident.identification.consistency.consistent_fit.consistent_fit`; the distance is
that of the constant pull-back metric at the nominal pseudo-inertias (Lee and Park 2018, (16)),

    d^2 = sum_i |P_i0^-1/2 (P_i - P_i0) P_i0^-1/2|^2,

a quadratic. Where no bodies are stated P_i0 = rho U_i, U_i the uniform body of density 1 that fills the geometry, and
the density rho is the best one: d^2 = |X|^2 - <X, I>^2 / |I|^2 over all links with X_i = U_i^-1/2 P_i U_i^-1/2.

The weight v is the largest for which the cost rises by no more than the data's own noise,

    r (|A phi_v - y|^2 - |A phi_0 - y|^2) / s^2 <= chi^2_0.95(b),

the joint 95 % region of the b base parameters with rows taken as independent (Seber and Wild 2003, (5.3)). Correlated
residuals would widen the region by their correlation factor: counted so, the rule stays on the side of the data.

A mass range is contradicted where the cost without it is lower by more than the quantile of chi-square with one degree
of freedom at 5 % over all ranges (Bonferroni), the cost of each joint over its correlation factor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.identification.consistency.conditions import conditions_of
from dynident.identification.consistency.consistent_fit import (
    Answer,
    ConsistentFit,
    judged,
    lifted,
    pose_program,
    scale_of,
    solve_program,
)
from dynident.identification.consistency.program import Program, whitened_rows
from dynident.identification.estimate.plausibility import TOTAL_MASS, ContradictedMass, Plausibility
from dynident.identification.problem.prior import BodyPrior, Scale
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.covariance import correlation_of
from dynident.identification.residuals.quantiles import chi_square_quantile
from dynident.model.body_constraints import Constraints, ValueRange
from dynident.model.inertia import PSEUDO_BASIS
from dynident.model.plausible import plausible_constraints, uniform_body
from dynident.model.robot import Robot
from dynident.model.threads import one_blas_thread

#: Level of both rules; least and largest weight; share of the cost limit that is enough.
LEVEL, LEAST, MOST, ENOUGH = 0.95, 1e-6, 1e6, 0.5

#: A mass within this share of its bound is at it.
_AT_BOUND = 1e-3


@dataclass(frozen=True)
class PlausibleFit:
    """A proven fit within plausible bounds.

    Attributes:
        fit: The fit.
        program: Its program, the pull included.
        facts: How it came about.
    """

    fit: ConsistentFit
    program: Program
    facts: Plausibility


def plausible_fit(problem: Problem, weights: Array, pull: float, margin: float) -> PlausibleFit:
    """Return the plausible standard parameters that are nearest to the nominal ones within the noise of the data.

    Args:
        problem: The problem. Its rows are read again only where a mass range costs much, for correlation factors.
        weights: Of each joint, shape (n,), 1 / N m.
        pull: Of the prior in natural sizes, which stays beside the pull to the nominal bodies.
        margin: Smallest eigenvalue of the scaled pseudo-inertia of each link.

    Raises:
        ContradictoryConstraints: No robot meets the bounds; the message names those that clash.
        SolverFailed: No path reached a solution that passes the check of its own conditions.
    """
    model, base, reduced, scale = problem.model, problem.base, problem.reduced(weights), scale_of(problem)
    bounds = plausible_constraints(model.robot, problem.constraints)
    program = pose_program(model, base, reduced, scale, pull, margin, constraints=bounds)
    rows = max(reduced.rows, 1)

    def within(known: Constraints) -> Answer:
        return solve_program(replace(program, conditions=conditions_of(model, scale, margin, known)))

    def cost(answer: Answer) -> float:
        return rows * float(np.sum((program.data @ answer.candidate.phi - program.target) ** 2))

    with one_blas_thread():  # matrices this small are slower on several threads
        inner = solve_program(program, stated=True)
        setting = _Setting(problem, weights * np.sqrt(rows / max(reduced.rest, 1e-300)), scale, within)
        contradicted, bounds, inner = _contradicted(setting, bounds, inner)
        dropped = {mass.name for mass in contradicted if mass.is_relaxed}
        bodies, is_stated, uniform = nominal_bodies(model.robot, bounds, problem.prior)
        held = np.array([link.name not in dropped for link in model.robot.links])
        matrix, aim = pull_rows(scale, bodies, is_stated, held)
        limit, least, answers = chi_square_quantile(LEVEL, base.count), cost(inner), {0.0: inner}

        def rise(weight: float) -> float:
            share = np.sqrt(weight / rows)
            pulled, target = np.vstack([program.pull, share * matrix]), np.append(program.pull_target, share * aim)
            rules = inner.program.conditions
            answers[weight] = solve_program(replace(program, pull=pulled, pull_target=target, conditions=rules))
            return cost(answers[weight]) - least

        weight, cost_rise = largest_weight(rise, limit)
        fit = judged(answers[weight], scale)
    facts = Plausibility(weight, cost_rise, limit, contradicted, tuple(uniform))
    return PlausibleFit(fit, answers[weight].program, facts)


def largest_weight(rise: Callable[[float], float], limit: float) -> tuple[float, float]:
    """Return about the largest weight whose rise is at most the limit, and its rise; (0, 0) where the least is above.

    The rise grows with the weight: interpolated in logarithms until it is between :data:`ENOUGH` and 1 of the limit.
    """
    low, high, aim = (0.0, 0.0), (np.inf, np.inf), np.sqrt(ENOUGH) * limit
    weight = 1.0
    while high[0] > 1.05 * low[0]:
        value = rise(weight)
        if value <= limit:
            low = (weight, value)
            if value >= ENOUGH * limit or weight >= MOST:
                break
        else:
            high = (weight, value)
            if weight <= LEAST:
                break
        if low[0] > 0 and np.isfinite(high[0]):
            ends = np.log([max(low[1], 1e-3 * limit), high[1]])
            share = float(np.clip((np.log(aim) - ends[0]) / (ends[1] - ends[0]), 0.1, 0.9))
            weight = low[0] * (high[0] / low[0]) ** share
        else:
            step = float(np.clip((aim / max(value, 1e-3 * limit)) ** 1.5, 0.01, 100.0))
            weight = float(np.clip(weight * step, LEAST, MOST))
    return low


def pull_rows(scale: Scale, nominal: Array, is_stated: BoolArray, held: BoolArray) -> tuple[Array, Array]:
    """Return B and c with |B phi - c| the distance to the nominal bodies; see the module.

    Args:
        scale: Natural sizes.
        nominal: Inertial parameters of the nominal bodies, shape (l, 10).
        is_stated: Whether the mass of each is stated; else their common density is free, shape (l,).
        held: Which links have a part in the distance, shape (l,).
    """
    size = len(scale.parameters)
    bodies = np.append(nominal.ravel() / scale.parameters[: nominal.size], np.zeros(size - nominal.size))
    roots = np.linalg.cholesky(lifted(np.einsum("lk,kij->lij", bodies[: nominal.size].reshape(-1, 10), PSEUDO_BASIS)))
    matrix = whitened_rows(roots, size)
    aim = matrix @ bodies
    free = np.repeat(held & ~is_stated, 10)
    unit = np.where(free, aim, 0.0) / max(np.sqrt(np.sum(aim[free] ** 2)), 1e-300)
    matrix, aim = matrix - np.outer(unit, unit @ matrix), np.where(free, 0.0, aim)
    return matrix[np.repeat(held, 10)], aim[np.repeat(held, 10)]


def nominal_bodies(robot: Robot, bounds: Constraints, prior: BodyPrior | None) -> tuple[Array, BoolArray, list[str]]:
    """Return the bodies that the pull goes to, whether the mass of each is stated, and the links of uniform bodies.

    A link without a possible inertia has the uniform body that fills its geometry, with its stated mass or density 1.

    Returns:
        Shapes (l, 10) and (l,), and names.
    """
    links = robot.links
    if prior is not None:
        return np.array(prior.theta)[: 10 * len(links)].reshape(-1, 10), np.ones(len(links), bool), []
    masses = np.array([0.0 if link.inertia is None else link.inertia.mass for link in links])
    uniform = [link.name for link in links if link.inertia is None or not link.inertia.is_consistent()]
    bodies = []
    for link, mass in zip(links, masses, strict=True):
        filling = uniform_body(bounds.links[link.name]).vector
        own = filling if link.inertia is None else link.inertia.vector
        bodies.append(own if link.name not in uniform else filling * (mass / filling[9] if mass > 0 else 1.0))
    return np.array(bodies), masses > 0, uniform


@dataclass(frozen=True)
class _Setting:
    """A problem with weights over residual deviations (n,), natural sizes, and the answer of its program in bounds."""

    problem: Problem
    weights: Array
    scale: Scale
    within: Callable[[Constraints], Answer]

    def costs(self, answer: Answer) -> Array:
        """Return the weighted residual square of each joint in residual variances of the free fit, shape (n,)."""
        beta = self.problem.base.from_standard(answer.candidate.phi * self.scale.parameters)
        return self.weights**2 * self.problem.residual_squares(beta)


def _contradicted(
    setting: _Setting, bounds: Constraints, inner: Answer
) -> tuple[tuple[ContradictedMass, ...], Constraints, Answer]:
    """Return the contradicted mass ranges, the bounds without those to relax, and the answer within them.

    Forward selection: the range without which the statistic is lowest goes first, while that is significant.
    """
    problem, ranges = setting.problem, _ranges(bounds)
    stated = _ranges(problem.constraints)
    active = _at_bound(setting, ranges, inner)
    if not active:
        return (), bounds, inner
    limit = chi_square_quantile(1.0 - (1.0 - LEVEL) / len(ranges), 1)
    falls = setting.costs(inner) - setting.costs(setting.within(_without(bounds, ranges)))
    if np.sum(falls) <= limit:  # correlation factors, 1 at least, make it less
        return (), bounds, inner
    factors = correlation_of(problem, problem.base.from_standard(inner.candidate.phi * setting.scale.parameters))
    if np.sum(falls / factors) <= limit:
        return (), bounds, inner
    found: list[ContradictedMass] = []
    while active:
        answers = {name: setting.within(_without(bounds, [name])) for name in active}
        each = {name: setting.costs(inner) - setting.costs(answer) for name, answer in answers.items()}
        name = max(active, key=lambda name: float(np.sum(each[name] / factors)))
        statistic, fall = float(np.sum(each[name] / factors)), float(np.sum(each[name]))
        if statistic <= limit:
            break
        gain = 1.0 - float(np.sqrt(1.0 - fall / np.sum(setting.costs(inner))))
        found.append(ContradictedMass(name, statistic, limit, gain, name not in stated))
        if name not in stated:
            bounds, inner = _without(bounds, [name]), answers[name]
        done = {mass.name for mass in found}
        active = [name for name in _at_bound(setting, _ranges(bounds), inner) if name not in done]
    return tuple(found), bounds, inner


def _ranges(bounds: Constraints) -> dict[str, ValueRange]:
    """Return the mass ranges by the names of links, and of the total."""
    found = {name: body.mass for name, body in bounds.links.items()} | {TOTAL_MASS: bounds.total_mass}
    return {name: range for name, range in found.items() if range != ValueRange()}


def _without(bounds: Constraints, names: Iterable[str]) -> Constraints:
    """Return the bounds without the mass ranges of these names."""
    links = {k: replace(body, mass=ValueRange()) if k in names else body for k, body in bounds.links.items()}
    return replace(bounds, links=links, total_mass=ValueRange() if TOTAL_MASS in names else bounds.total_mass)


def _at_bound(setting: _Setting, ranges: Mapping[str, ValueRange], answer: Answer) -> list[str]:
    """Return the names of the ranges at whose ends an answer lies."""
    theta = answer.candidate.phi * setting.scale.parameters
    model = setting.problem.model
    masses = dict(zip((link.name for link in model.robot.links), theta[9 : model.inertial_count : 10], strict=True))
    masses[TOTAL_MASS] = sum(masses.values())
    low = {name: range.low * (1.0 + _AT_BOUND) for name, range in ranges.items()}
    high = {name: range.high * (1.0 - _AT_BOUND) for name, range in ranges.items()}
    return [name for name in ranges if not low[name] < masses[name] < high[name]]
