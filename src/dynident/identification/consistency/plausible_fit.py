"""The consistent fit within bounds of plausible bodies, and among those within the noise the one nearest to nominal.

minimise    |A phi - y|^2 / 2 + v s^2 / r d(phi)      subject to the conditions and the bounds

A, y, s^2 and r rows as in :func:`~dynident.identification.consistency.consistent_fit.consistent_fit`; the distance to
the nominal pseudo-inertias P_i0 is the entropic one (Lee, Wensing and Park 2020, (17)),

    d = sum_i (tr Q_i - log det Q_i - 4),   Q_i = P_i0^-1 P_i.

Where no bodies are stated P_i0 is the uniform body that fills the geometry; the density of all of them is that of the
fit within the bounds alone. A link whose mass range is relaxed has the mass of that fit in P_i0.

The weight v is the largest with which the cost rises by the data's own noise at most,
    r (|A phi_v - y|^2 - |A phi_0 - y|^2) / s^2 <= f chi^2_0.95(b),

the joint 95 % region of the b base parameters (Seber and Wild 2003, (5.3)), f the least correlation factor of a joint's
residual. Correlation that comes of what the model lacks recurs in other logs, so the residual rises by :data:`PRICE` of
itself at most; f = 1, rows taken as independent, may always be used.

A nominal body that does not meet the bounds of its link is replaced by the nearest one of its mass that does; where it
is lighter than links are, an inertia that is a placeholder, by the uniform body of its mass.

A mass range or a size is contradicted where the cost without it is lower by more than a quantile of chi-square at 5 %
over all of them (Bonferroni), the cost of each joint over its correlation factor; with one degree of freedom for a mass
and ten, the parameters of a link, for a size. What the user states is named and kept. A size that the link's own
nominal body breaks is widened to hold that body where it is contradicted, and tested once more as it is then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import ContradictoryConstraints
from dynident.identification.consistency.conditions import Conditions, conditions_of
from dynident.identification.consistency.conic import solve_limited
from dynident.identification.consistency.consistent_fit import (
    GOOD,
    MISSED,
    Answer,
    ConsistentFit,
    checked,
    judged,
    lifted,
    pose_program,
    scale_of,
    solve_program,
)
from dynident.identification.consistency.program import Program, whitened_rows
from dynident.identification.estimate.plausibility import TOTAL_MASS, ContradictedBound, Plausibility
from dynident.identification.problem.prior import BodyPrior, Scale
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.covariance import correlation_of
from dynident.identification.residuals.quantiles import chi_square_quantile
from dynident.model.base_parameters import IDENTIFIABLE
from dynident.model.body_constraints import BodyConstraints, Constraints, ValueRange, box_quadrics
from dynident.model.inertia import PSEUDO_BASIS, Inertia
from dynident.model.plausible import is_too_light, outgrown, plausible_constraints, uniform_body, wider_bounds
from dynident.model.robot import Robot
from dynident.model.threads import one_blas_thread

#: Level of both rules; share of the residual that nearness to the nominal bodies may cost; least and largest weight,
#: share of the limit that a search of weights aims at, and its most solutions.
LEVEL, PRICE, LEAST, MOST, NEAR, TRIES = 0.95, 0.005, 1e-6, 1e6, 0.995, 12

#: A mass or a size within this share of its bound is at it.
_AT_BOUND = 1e-3


@dataclass(frozen=True)
class PlausibleFit:
    """A proven fit within plausible bounds.

    Attributes:
        fit: The fit.
        program: Its program, the pull included.
        facts: How it came about.
        limited: Arguments of ``solve_limited``: whose quadratic part is limited, from where, and its rise.
    """

    fit: ConsistentFit
    program: Program
    facts: Plausibility
    limited: tuple[Program, Array, float]


def plausible_fit(
    problem: Problem, weights: Array, pull: float, margin: float, settled: Plausibility | None = None
) -> PlausibleFit:
    """Return the plausible standard parameters that are nearest to the nominal ones within the noise of the data.

    Args:
        problem: The problem. Its rows are read again for correlation factors of the residual.
        weights: Of each joint, shape (n,), 1 / N m.
        pull: Of the prior in natural sizes; that of inertial parameters gives way to the pull to the nominal bodies.
        margin: Smallest eigenvalue of the scaled pseudo-inertia of each link.
        settled: Of the same problem, solved before: its relaxed bounds and weight are taken, not sought.

    Raises:
        ContradictoryConstraints: No robot meets the bounds; the message names those that clash.
        SolverFailed: No path reached a solution that passes the check of its own conditions.
    """
    model, base, reduced, scale = problem.model, problem.base, problem.reduced(weights), scale_of(problem)
    whole = plausible_constraints(model.robot, problem.constraints)
    contradicted = () if settled is None else settled.contradicted
    names, filling = list(whole.links), np.array([uniform_body(body).vector for body in whole.links.values()])
    bodies, is_stated, uniform = nominal_bodies(model.robot, filling, problem.prior)
    wider = wider_bounds(model.robot, whole, problem.constraints, problem.prior and bodies)
    bounds = _without(whole, [(one.name, one.bound) for one in contradicted if one.is_relaxed], wider)
    program, rows = pose_program(model, base, reduced, scale, pull, margin, constraints=bounds), max(reduced.rows, 1)

    def within(known: Constraints) -> Answer:
        return solve_program(replace(program, conditions=conditions_of(model, scale, margin, known)))

    with one_blas_thread():  # matrices this small are slower on several threads
        try:
            inner = solve_program(program, stated=settled is None and not problem.constraints.is_empty)
        except ContradictoryConstraints as clash:
            step = "drop or change one of them; bounds of the robot model give way to stated ones and to --bodies free"
            raise ContradictoryConstraints(clash.evidence, step) from clash
        setting = _Setting(problem, weights * np.sqrt(rows / max(reduced.rest, 1e-300)), scale, within, wider, rows)
        if settled is None:
            contradicted, bounds, inner = _contradicted(setting, bounds, inner)
            limit = cost_limit(setting.factors(inner), base.count, rows + cost_of(program, inner, rows))
        else:
            limit = settled.cost_limit
        rules = conditions_of(model, scale, margin, _with_masses(bounds, bodies))
        near, fitted = fitting_bodies(bodies, filling, rules, scale)
        if np.any(light := fitted & [is_too_light(Inertia.from_vector(body)) for body in bodies]):
            near = fitting_bodies(np.where(light[:, None], _as_heavy(filling, bodies), near), filling, rules, scale)[0]
        relaxed = np.isin(names, [one.name for one in contradicted if one.is_relaxed and one.bound == "mass"])
        bodies = near * mass_factors(near[:, 9], inner.candidate.phi * scale.parameters, is_stated, relaxed)
        pulled, place = replace(program, conditions=inner.program.conditions), inner.candidate.phi
        pulled = pull_program(pulled, bodies, filling, place, scale)
        if settled is None:
            answer, weight = largest_weight(pulled, inner, rows, limit)
        else:
            weight = settled.weight
            answer = solve_program(replace(pulled, weight=weight / rows)) if weight else inner
        moved = tuple(name for name, is_moved in zip(names, fitted, strict=True) if is_moved and name not in uniform)
        wide = tuple(link.name for link in model.robot.links if whole.links[link.name].reach and outgrown(link))
        rise = cost_of(program, answer, rows) - cost_of(program, inner, rows)
        seen = {name for name, verdict in zip(names, base.verdicts[9::10], strict=False) if verdict == IDENTIFIABLE}
        massless = tuple(name for name in uniform if name not in seen and whole.links[name].mass == ValueRange())
        facts = Plausibility(weight, rise, limit, contradicted, tuple(uniform), moved, wide, massless)
        return PlausibleFit(judged(answer, scale), answer.program, facts, (pulled, place, limit / rows))


def cost_limit(factors: Array, count: int, cost: float) -> float:
    """Return by how much the pull may raise a cost, in residual variances; correlation factors of joints, b = count."""
    region = chi_square_quantile(LEVEL, count)
    return max(region, min(float(np.min(factors)) * region, ((1.0 + PRICE) ** 2 - 1.0) * cost))


def largest_weight(pulled: Program, inner: Answer, rows: int, limit: float) -> tuple[Answer, float]:
    """Return the answer of the largest weight whose cost is at most the limit above the inner one, and that weight."""
    raw, weight = solve_limited(pulled, inner.candidate.phi, limit / rows)
    weight = min(rows * weight, MOST) if np.isfinite(weight) else 1.0
    program = replace(pulled, weight=weight / rows)
    found = checked(program, raw) if weight < MOST else None
    if found is not None and found[1].gap <= GOOD:
        return Answer(program, *found, "Clarabel with exponential cones"), weight
    best, aim, last, slope = (inner, 0.0), np.log(NEAR * limit), None, 1.0
    least = cost_of(pulled, inner, rows)
    for _ in range(TRIES):  # secants in logarithms, where the limited program has no good answer
        answer = solve_program(replace(pulled, weight=weight / rows))
        rise = max(cost_of(pulled, answer, rows) - least, 1e-9 * limit)
        if best[1] < weight and rise <= limit:
            best = answer, weight
        place = np.array([np.log(weight), np.log(rise) - aim])
        if abs(place[1]) <= -np.log(NEAR) or (weight == MOST and rise <= limit):
            break
        if last is not None and place[0] != last[0]:
            slope = float(np.clip((place[1] - last[1]) / (place[0] - last[0]), 0.1, 3.0))
        last, weight = place, float(np.clip(np.exp(place[0] - place[1] / slope), LEAST, MOST))
    return best


def cost_of(program: Program, answer: Answer, rows: int) -> float:
    """Return the squared residual of an answer in residual variances, less that of the free fit."""
    return rows * float(np.sum((program.data @ answer.candidate.phi - program.target) ** 2))


def pull_program(program: Program, bodies: Array, filling: Array, phi: Array, scale: Scale) -> Program:
    """Return a program with the entropic distance to bodies (l, 10) in place of the prior of inertial parameters.

    Args:
        program: The program within bounds.
        bodies: Meet the bounds.
        filling: Uniform bodies that fill the geometry, shape (l, 10); the search starts half way to them.
        phi: Its answer, shape (p,).
        scale: Natural sizes.
    """
    inertial = bodies.size
    scaled, uniform = (found.ravel() / scale.parameters[:inertial] for found in (bodies, _as_heavy(filling, bodies)))
    roots = np.linalg.cholesky(lifted(np.einsum("lk,kij->lij", scaled.reshape(-1, 10), PSEUDO_BASIS)))
    other = ~np.any(program.pull[:, :inertial], axis=1)
    return replace(
        program,
        pull=program.pull[other],
        pull_target=program.pull_target[other],
        whitening=np.linalg.inv(roots),
        start=np.append((scaled + uniform) / 2.0, np.maximum(phi[inertial:], 1e-3)),
    )


def mass_factors(masses: Array, theta: Array, is_stated: BoolArray, is_relaxed: BoolArray) -> Array:
    """Return what nominal masses (l,) are multiplied by, shape (l, 1): to the fit's mass or density; see the module."""
    found = theta[: 10 * len(masses)].reshape(-1, 10)[:, 9]
    density = found[~is_stated].sum() / max(masses[~is_stated].sum(), 1e-300)
    return np.where(is_relaxed, found / masses, np.where(is_stated, 1.0, density))[:, None]


def _as_heavy(bodies: Array, others: Array) -> Array:
    """Return bodies (l, 10) with the masses of others."""
    return bodies * (others[:, 9:] / bodies[:, 9:])


def nominal_bodies(robot: Robot, filling: Array, prior: BodyPrior | None) -> tuple[Array, BoolArray, list[str]]:
    """Return the bodies that the pull goes to (l, 10), whether the mass of each is stated (l,), and uniform links.

    A link without a possible inertia has the uniform body ``filling`` (l, 10), with its stated mass or density 1.
    """
    if prior is not None:
        return np.array(prior.theta)[: filling.size].reshape(-1, 10), np.ones(len(filling), bool), []
    masses = np.array([0.0 if link.inertia is None else link.inertia.mass for link in robot.links])
    uniform, bodies = [], []
    for link, mass, full in zip(robot.links, masses, filling, strict=True):
        own = link.inertia and link.inertia.solid()
        bodies.append(own.vector if own else full * (mass / full[9] if mass > 0 else 1.0))
        uniform += [] if own else [link.name]
    return np.array(bodies), masses > 0, uniform


def fitting_bodies(bodies: Array, filling: Array, rules: Conditions, scale: Scale) -> tuple[Array, BoolArray]:
    """Return the bodies nearest to others (l, 10) that meet the conditions, and which of them are not the same, (l,).

    Nearest in the constant pull-back metric at the uniform bodies ``filling`` (l, 10) of the same masses.
    """
    sizes = scale.parameters[: bodies.size].reshape(-1, 10)
    broken = rules.broken(np.append(bodies / sizes, np.ones(rules.size - bodies.size)), MISSED)
    if not np.any(broken):
        return bodies, broken
    links = np.flatnonzero(broken)
    own, uniform = (each[links] / sizes[links] for each in (bodies, _as_heavy(filling, bodies)))
    roots = np.linalg.cholesky(lifted(np.einsum("lk,kij->lij", uniform, PSEUDO_BASIS)))
    pull, none = whitened_rows(roots, own.size), np.zeros((0, own.size))
    aim, rules = pull @ own.ravel(), rules.part(links)
    found = solve_program(Program(none, np.zeros(0), pull, aim, 0.0, np.zeros((0, 4, 4)), rules, uniform.ravel()))
    nearest = found.candidate.phi
    moved = np.linalg.norm((pull @ nearest - aim).reshape(-1, 10), axis=1) > _AT_BOUND
    bodies = bodies.copy()
    bodies[links[moved]] = (nearest.reshape(-1, 10) * sizes[links])[moved]
    broken[links] = moved
    return bodies, broken


def _with_masses(bounds: Constraints, bodies: Array) -> Constraints:
    """Return the bounds of the links with the masses of bodies (l, 10) or the nearest in their ranges."""
    links = {}
    for (name, body), mass in zip(bounds.links.items(), bodies[:, 9].tolist(), strict=True):
        value = min(max(mass, body.mass.low), body.mass.high)
        links[name] = replace(body, mass=ValueRange(value, value))
    return Constraints(links)


@dataclass(frozen=True)
class _Setting:
    """A problem, weights over residual deviations (n,), natural sizes, answers within bounds, the free fit's cost."""

    problem: Problem
    weights: Array
    scale: Scale
    within: Callable[[Constraints], Answer]
    wider: Mapping[str, BodyConstraints]
    free: int

    def factors(self, answer: Answer) -> Array:
        """Return the correlation factor of each joint's residual, shape (n,)."""
        beta = self.problem.base.from_standard(answer.candidate.phi * self.scale.parameters)
        return correlation_of(self.problem, beta)

    def costs(self, answer: Answer) -> Array:
        """Return the weighted residual square of each joint in residual variances of the free fit, shape (n,)."""
        beta = self.problem.base.from_standard(answer.candidate.phi * self.scale.parameters)
        return self.weights**2 * self.problem.residual_squares(beta)

    def falls(self, bounds: Constraints, keys: Iterable[tuple[str, str]], inner: Answer) -> tuple[Array, Answer]:
        """Return by how much the cost of each joint (n,) is below that of an answer without bounds, and the answer."""
        answer = self.within(_without(bounds, keys, self.wider))
        return self.costs(inner) - self.costs(answer), answer


def _contradicted(
    setting: _Setting, bounds: Constraints, inner: Answer
) -> tuple[tuple[ContradictedBound, ...], Constraints, Answer]:
    """Return the contradicted bounds, the bounds without those to relax, and the answer within them.

    Forward selection: the bound whose statistic is furthest above its limit goes first, while that is significant. One
    that no longer matters once others are gone comes back, as does a stated one once all are tested. Correlation is
    that of the residual so far: what bounds that are gone had left in it is no noise of the others. Sizes that the
    nominal body itself does not fit are tested before all others: a nominal mass is always in its range, so no range
    gives way for them.
    """
    start, stated, doubtful = bounds, _stated(setting.problem), [(name, "size") for name in setting.wider]
    others = [(name, "mass") for name in _ranges(bounds)]
    others += [(name, "wider size" if name in setting.wider else "size") for name in bounds.links]
    level = 1.0 - (1.0 - LEVEL) / len(doubtful + others)
    limits = {bound: chi_square_quantile(level, 1 if bound == "mass" else 10) for _, bound in doubtful + others}
    found: dict[tuple[str, str], ContradictedBound] = {}
    for group in (doubtful, others):
        while active := [key for key in _at_bound(setting, bounds, group, inner) if key not in found]:
            least = min(limits[bound] for _, bound in active)
            if np.sum(setting.costs(inner)) - setting.free <= least:  # nothing is cheaper than the free fit
                break
            falls, factors = setting.falls(bounds, active, inner), setting.factors(inner)
            large = [key for key in active if limits[key[1]] < np.sum(falls[0] / factors)]
            if not large:  # none matters alone where all together do not
                break
            each = {key: setting.falls(bounds, [key], inner) if active[1:] else falls for key in large}
            statistics = {key: float(np.sum(fall / factors)) for key, (fall, _) in each.items()}
            name, bound = key = max(large, key=lambda key: statistics[key] - limits[key[1]])
            if statistics[key] <= limits[bound]:
                break
            gain = 1.0 - float(np.sqrt(1.0 - np.sum(each[key][0]) / np.sum(setting.costs(inner))))
            is_relaxed = key not in stated or key in doubtful
            found[key] = ContradictedBound(name, bound, statistics[key], limits[bound], gain, is_relaxed)
            bounds, inner = _without(bounds, [key], setting.wider), each[key][1]
    for key in list(found)[:-1]:
        others = [other for other in found if other != key]
        falls, answer = setting.falls(start, others, inner)
        if -np.sum(falls / setting.factors(inner)) <= found[key].limit:
            bounds, inner = _without(start, others, setting.wider), answer
            del found[key]
    relaxed = [key for key, one in found.items() if one.is_relaxed]
    if len(relaxed) < len(found):
        bounds = _without(start, relaxed, setting.wider)
        inner = setting.within(bounds)
    return tuple(found.values()), bounds, inner


def _ranges(bounds: Constraints) -> dict[str, ValueRange]:
    """Return the mass ranges by the names of links, and of the total."""
    found = {name: body.mass for name, body in bounds.links.items()} | {TOTAL_MASS: bounds.total_mass}
    return {name: range for name, range in found.items() if range != ValueRange()}


def _stated(problem: Problem) -> set[tuple[str, str]]:
    """Return the masses and sizes that the user states: they are kept."""
    found, links = {(name, "mass") for name in _ranges(problem.constraints)}, problem.constraints.links.items()
    sized = [name for name, body in links if body.body_ellipsoid is not None or body.body_box is not None]
    return found | {(name, bound) for name in sized for bound in ("size", "wider size")}


def _without(bounds: Constraints, keys: Iterable[tuple[str, str]], wider: Mapping[str, BodyConstraints]) -> Constraints:
    """Return the bounds without these; a size in ``wider`` is that of there first, with its thickness."""
    links, total = dict(bounds.links), bounds.total_mass
    for name, bound in keys:
        if name == TOTAL_MASS:
            total = ValueRange()
        elif bound == "mass":
            links[name] = replace(links[name], mass=ValueRange())
        elif bound == "size" and name in wider:
            size, thickness = wider[name].body_ellipsoid, wider[name].thickness
            links[name] = replace(links[name], body_ellipsoid=size, thickness=thickness, quadrics=())
        else:
            links[name] = replace(links[name], body_ellipsoid=None, body_box=None, reach=0.0, quadrics=())
    return replace(bounds, links=links, total_mass=total)


def _at_bound(
    setting: _Setting, bounds: Constraints, tested: Iterable[tuple[str, str]], answer: Answer
) -> list[tuple[str, str]]:
    """Return the bounds among those tested at which an answer lies."""
    model = setting.problem.model
    theta = (answer.candidate.phi * setting.scale.parameters)[: model.inertial_count].reshape(-1, 10)
    bodies = {link.name: body for link, body in zip(model.robot.links, theta, strict=True)}
    masses = {name: float(body[9]) for name, body in bodies.items()}
    masses[TOTAL_MASS] = sum(masses.values())
    ranges, found = _ranges(bounds), []
    for name, bound in tested:
        if bound == "mass":
            own = ranges.get(name, ValueRange())
            is_at = not own.low * (1.0 + _AT_BOUND) < masses[name] < own.high * (1.0 - _AT_BOUND)
        else:
            is_at = _room(bounds.links[name], bodies[name]) < _AT_BOUND * masses[name]
        if is_at or (bound == "size" and name in setting.wider):
            found.append((name, bound))
    return found


def _room(known: BodyConstraints, body: Array) -> float:
    """Return the least of tr(P Q) over the conditions of a link's size; infinite where it has none."""
    space, box = known.body_ellipsoid, known.body_box
    quadrics = [space.quadric[None], *([space.slabs(known.reach)] if known.reach else [])] if space else []
    quadrics += [*([box_quadrics(box)] if box else []), *(quadric[None] for quadric in known.quadrics)]
    return min((float(np.min(np.einsum("kij,lij,k->l", PSEUDO_BASIS, one, body))) for one in quadrics), default=np.inf)
