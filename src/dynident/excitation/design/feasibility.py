"""Free numbers that keep all bounds: random start points by construction, and iterates shrunk until they do.

Every motion is a posture (its constant) and amplitudes about it. A posture that stands clear and can be held keeps all
bounds at rest; so some motion about it, small enough, keeps them as well, and shrinking never moves the posture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import InfeasibleTrajectory
from dynident.excitation.design.bounds import Bound, BoundLabel, Grid
from dynident.excitation.design.design_problem import GUARD, DesignProblem
from dynident.excitation.design.limits import DISTANCE_SCALE

#: Share of its bounds that each joint uses at a start point.
START_USE = 0.8

#: Postures that are drawn at a time, and how far from the middle of its range a joint may stand: early and late draws.
POSTURES, NEAR, FAR = 64, 0.5, 0.95

#: A start whose amplitudes were shrunk less than this is taken at once; after so many draws, the best one so far.
ROOMY, PATIENCE = 0.4, 8

#: How often amplitudes are halved before a posture is given up, and shares of the amplitudes that shrinking tries.
_HALVINGS = 12
_SHARES = (0.998, 0.99, 0.97, 0.92, 0.8, 0.6, 0.3)


def feasible_start(problem: DesignProblem, generator: np.random.Generator, attempts: int = 40) -> Array:
    """Return random free numbers (n m,) that keep all bounds on the grid.

    A posture is drawn that stands clear and can be held, then amplitudes that are scaled to use 80 % of the bounds on
    position to jerk, then all of them are shrunk together until torque, its rate and the clearances are kept too. Where
    that leaves little of them, a few more postures are tried and the roomiest is taken.

    Args:
        problem: The problem.
        generator: Of the postures and amplitudes.
        attempts: Draws of 64 postures at most.

    Raises:
        InfeasibleTrajectory: No posture keeps the bounds, or no motion about those that do; names the worst bound.
    """
    tally = _Tally.empty(problem)
    best, largest, last = None, 0.0, None
    for attempt in range(attempts):
        postures = _postures(problem, generator, NEAR if 2 * attempt < attempts else FAR)
        amplitudes = generator.normal(size=(problem.joints, problem.parametrisation.count))
        shares = posture_shares(problem, postures)
        tally = tally.with_shares(shares)
        worst = shares.max(axis=0, initial=0.0)
        chosen = int(np.argmax(worst <= START_USE)) if np.any(worst <= START_USE) else int(np.argmin(worst))
        if worst[chosen] > 1.0 - GUARD:
            continue
        x = _about(problem, postures[chosen], amplitudes)
        share, uses = _kept_share(problem, x, largest)
        last = uses if last is None or uses.max(initial=0.0) < last.max(initial=0.0) else last
        if share > largest:
            best, largest = _scaled(problem, x, share), share
        if best is not None and (largest >= ROOMY or attempt + 1 >= PATIENCE):
            return best
    if best is not None:
        return best
    raise _infeasible(problem, tally, last)


def shrunk(dense: DesignProblem, x: Array) -> Array | None:
    """Return ``x`` with its amplitudes shrunk about the posture until all bounds are kept; None where that fails.

    The posture is the mean of the motion over time. Where the robot cannot stand in it, the motion is shrunk about the
    one of its own samples that has most room.

    Position to jerk are kept at every time, joint by joint: the trajectory gives their range between samples too. The
    torque and its rate keep :data:`GUARD` free on the grid; clearances are kept between the samples as well.

    Args:
        dense: The problem on a fine grid.
        x: Scaled free numbers, shape (n m,).
    """
    free = dense.free(x)
    found = dense.parametrisation.extremes(free, dense.samples)
    found[:, 0] -= free[:, 0]
    scale = _room(dense, free[:, 0], found, 1.0)
    if np.any(scale <= 0):
        return None
    x = _scaled(dense, x, np.minimum(1.0, scale * (1.0 - 1e-12)))
    if _is_kept(dense, x):
        return x
    middle = _middle(dense, x)
    if middle is None:
        return None

    def is_kept(share: float) -> bool:
        return _is_kept(dense, _scaled(dense, x, share, middle))

    bad = 1.0
    for share in _SHARES:
        if is_kept(share):
            return _scaled(dense, x, _bisected(is_kept, share, bad), middle)
        bad = share
    return None


def model_uses(problem: DesignProblem, x: Array) -> Array:
    """Return the share of each row of torque, torque rate and clearance that the worst sample uses, (c,), as labelled.

    Args:
        problem: The problem.
        x: Scaled free numbers, shape (n m,).
    """
    grid = problem.grid(x)
    found: list[Array] = [np.zeros(0)]
    found += [bound.shares(grid).max(axis=1) for bound in problem.bounds[1:]]
    return np.concatenate(found)


def posture_shares(problem: DesignProblem, postures: Array) -> Array:
    """Return the share of each bound that a robot at rest can break, in postures (B, n), shape (c, B)."""
    signals = np.zeros((4, *postures.shape))
    signals[0] = postures
    grid = Grid(signals, problem.observation, 1.0)
    found = [bound.shares(grid) for bound in problem.bounds if bound.of_posture]
    return np.concatenate(found) if found else np.zeros((0, len(postures)))


def _postures(problem: DesignProblem, generator: np.random.Generator, share: float) -> Array:
    """Return random postures within a share of the ranges, (POSTURES, n); a joint without one may make half a turn."""
    limits = problem.limits
    reach = np.where(np.isfinite(limits.reach), limits.reach, np.where(limits.revolute, np.pi, 0.0))
    return limits.centre + reach * generator.uniform(-share, share, (POSTURES, problem.joints))


def _about(problem: DesignProblem, posture: Array, amplitudes: Array) -> Array:
    """Return scaled free numbers of a motion about a posture (n,) that uses 80 % of the bounds on position to jerk."""
    x = amplitudes.copy()
    x[:, 0] = 0.0
    signals = problem.basis @ (x * problem.unit[:, None]).T
    extremes = np.stack([signals.min(axis=1), signals.max(axis=1)])
    x *= _room(problem, posture, extremes, START_USE)[:, None]
    x[:, 0] = (posture - problem.limits.centre) / problem.unit
    return x.ravel()


def _room(problem: DesignProblem, posture: Array, extremes: Array, use: float) -> Array:
    """Return by how much the amplitudes of each joint may be multiplied to use a share of the bounds, shape (n,).

    Args:
        problem: The problem.
        posture: Shape (n,).
        extremes: Lowest and highest q (from the posture), dq, ddq and jerk, shape (2, 4, n).
        use: The share; a posture beyond it may go half way to the end of the range.
    """
    bounds, away = problem.limits.bounds(), posture - problem.limits.centre
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(np.isfinite(bounds[0]), np.abs(away) / bounds[0], 0.0)
        top = np.maximum(use, 0.5 * (1.0 + share)) * bounds[0]
        room = np.stack([np.r_[(top + away)[None], use * bounds[1:]], np.r_[(top - away)[None], use * bounds[1:]]])
        size = np.stack([-extremes[0], extremes[1]])
        scale = np.where(size > 0, room / size, np.inf)
    return scale.min(axis=(0, 1))


def _kept_share(problem: DesignProblem, x: Array, least: float) -> tuple[float, Array]:
    """Return the share of the amplitudes that is kept, 0 for none above ``least``, and what the last one tried uses."""

    def is_kept(share: float) -> bool:
        return bool(model_uses(problem, _scaled(problem, x, share)).max(initial=0.0) <= 1.0 - GUARD)

    share = 1.0
    uses = model_uses(problem, x)
    for _ in range(_HALVINGS):
        if uses.max(initial=0.0) <= 1.0 - GUARD:
            return share if share == 1.0 else _bisected(is_kept, share, 2.0 * share), uses
        share *= 0.5
        if 2.0 * share <= least:
            break
        uses = model_uses(problem, _scaled(problem, x, share))
    return 0.0, uses


def _middle(problem: DesignProblem, x: Array) -> Array | None:
    """Return a posture (n,) to shrink a motion about, in scaled free numbers; None where there is none."""
    own = x.reshape(problem.joints, -1)[:, 0]
    samples = problem.motion(x).q
    places = np.vstack([problem.free(x)[:, 0], samples])
    worst = posture_shares(problem, places).max(axis=0, initial=0.0)
    if worst[0] <= 1.0 - GUARD:
        return own
    roomiest = int(np.argmin(worst))
    return None if worst[roomiest] > 1.0 - GUARD else (places[roomiest] - problem.limits.centre) / problem.unit


def _scaled(problem: DesignProblem, x: Array, scale: Array | float, middle: Array | None = None) -> Array:
    """Return free numbers shrunk by one share or one for each joint (n,), about the posture or another one (n,)."""
    found = x.reshape(problem.joints, -1).copy()
    if middle is not None:
        found[:, 0] = middle + np.asarray(scale) * (found[:, 0] - middle)
    found[:, 1:] *= np.reshape(scale, (-1, 1))
    return found.ravel()


def _is_kept(problem: DesignProblem, x: Array) -> bool:
    """Return whether torque, its rate, tool speed and, at every time, the clearances are kept."""
    if model_uses(problem, x).max(initial=0.0) > 1.0 - GUARD:
        return False
    certain = [_certain_uses(problem, x, bound) for bound in problem.bounds if bound.between_samples]
    return all(uses.max(initial=0.0) <= 1.0 - GUARD for uses in certain)


def _bisected(is_kept: Callable[[float], bool], kept: float, bad: float) -> float:
    """Return the larger of two shares of the amplitudes, one kept and one not, after a few bisections."""
    for _ in range(4):
        share = 0.5 * (kept + bad)
        kept, bad = (share, bad) if is_kept(share) else (kept, share)
    return kept


def _certain_uses(problem: DesignProblem, x: Array, bound: Bound) -> Array:
    """Return the share of each row of a bound that is used at any time of a period."""
    free, shape = problem.free(x), problem.parametrisation
    accelerations = np.abs(shape.extremes(free, problem.samples)[:, 2]).max(axis=0)

    def positions(time: Array) -> tuple[Array, Array]:
        basis = shape.basis(time)
        return basis[0] @ free.T, basis[1] @ free.T

    time = np.append(problem.time, shape.period)
    return bound.certain_shares(positions, time, accelerations, GUARD)


@dataclass(frozen=True)
class _Tally:
    """What the postures that were tried say: per bound its least share, and how often it was broken."""

    labels: tuple[BoundLabel, ...]
    least: Array
    broken: Array
    tried: int

    @classmethod
    def empty(cls, problem: DesignProblem) -> _Tally:
        labels = tuple(label for bound in problem.bounds if bound.of_posture for label in bound.labels)
        return cls(labels, np.full(len(labels), np.inf), np.zeros(len(labels)), 0)

    def with_shares(self, shares: Array) -> _Tally:
        least = np.minimum(self.least, shares.min(axis=1))
        broken = self.broken + np.sum(shares > 1.0 - GUARD, axis=1)
        return _Tally(self.labels, least, broken, self.tried + shares.shape[1])


def _infeasible(problem: DesignProblem, tally: _Tally, uses: Array | None) -> InfeasibleTrajectory:
    """Return the error that names the worst bound."""
    if uses is not None:
        labels = [label for bound in problem.bounds[1:] for label in bound.labels]
        label, least = labels[int(np.argmax(uses))], float(uses.max())
        evidence = f"a posture keeps all limits, but even the smallest motion about it uses {least:.3g} times this one"
    else:
        worst = int(np.argmax(tally.least)) if np.any(tally.least > 1.0 - GUARD) else int(np.argmax(tally.broken))
        label, least = tally.labels[worst], float(tally.least[worst])
        if least <= 1.0 - GUARD:
            often = 100 * tally.broken[worst] / tally.tried
            evidence = f"none of {tally.tried} postures keeps all of them at once; {often:.0f} % break this one"
        elif label.quantity == "clearance":
            short = 1e3 * DISTANCE_SCALE * (least - 1.0)
            evidence = f"in every one of {tally.tried} postures it is {short:.3g} mm or more too small"
        else:
            evidence = f"every one of {tally.tried} postures needs at least {least:.3g} times what is allowed"
    step = "check masses and effort limits, or give a smaller torque margin"
    if label.quantity == "clearance":
        step = "check the shapes, the obstacles and the mounting, or require less clearance"
    return InfeasibleTrajectory(f"the {label.text}", evidence, step)
