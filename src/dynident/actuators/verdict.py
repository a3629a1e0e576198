"""How far the parameters of a servo are known: intervals that allow for autocorrelation, and what is known together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from dynident.actuators.output_error import ServoProblem, log_weights
from dynident.actuators.parameters import PARAMETERS, PLACE
from dynident.actuators.rollout import JointRecord
from dynident.arrays import Array, BoolArray

#: Confidence of the intervals.
LEVEL = 0.95

#: Length in s of the pieces of a log whose scores count as independent where there are few logs.
PIECE_S = 1.0

#: Fewest logs that count as the independent pieces by themselves.
_LOGS = 8

#: Squared singular values below this share of the largest, of columns at the scale of each parameter, are directions
#: that the logs do not see.
RANK = 1e-9

#: Correlation from which two parameters are known only together.
TOGETHER = 0.98

#: Equal readings in a row from which a joint counts as at rest.
REST_SAMPLES = 10

#: What is known but for the scale that all torques and inertias have in common.
AS_RATIO = "known as a ratio"

#: Half width from which a parameter counts as weak, as a share of its value.
WEAK = 0.25

#: Half width in rad up to which the zero of an encoder counts as identified where the bodies are found beside it.
ZERO = 0.02


@dataclass(frozen=True)
class Known:
    """How far one free parameter is known.

    Attributes:
        name: The parameter.
        value: Its value.
        half_width: Of the interval at LEVEL; infinite where the logs do not see it.
        label: identified, known as a ratio, weak, at its bound, or not separable.
        together: Parameter that it is known with only; empty for none.
        ratio: Half width where the scale that all torques and inertias have in common is held; None where the bodies
            are known and give it.
    """

    name: str
    value: float
    half_width: float
    label: str
    together: str = ""
    ratio: float | None = None

    def scaled(self, factor: float) -> Known:
        """Return the parameter in a unit that is smaller by a factor."""
        ratio = None if self.ratio is None else self.ratio * factor
        return replace(self, value=self.value * factor, half_width=self.half_width * factor, ratio=ratio)


@dataclass(frozen=True)
class Spread:
    """How the errors of one joint spread its free parameters.

    Attributes:
        covariance: Of the f free parameters; zero for those at a bound, shape (f, f).
        products: J' W J in units of each parameter's size, shape (f, f).
        inner: Which are not at a bound, shape (f,).
        seen: Which the logs see, shape (f,).
        pieces: Number of pieces of logs that count as independent.
        ratio: Covariance without the scale that all torques and inertias have in common, shape (f, f); None where the
            bodies are known.
    """

    covariance: Array
    products: Array
    inner: BoolArray
    seen: BoolArray
    pieces: int
    ratio: Array | None = None


def spread_of(problem: ServoProblem, parameters: Array) -> Spread:
    """Return how the errors of the roll-outs spread the free parameters.

    By the sandwich covariance of clustered scores: errors of one roll-out are correlated over its whole length, so
    pieces of it (whole logs where there are eight or more) are taken as the independent ones. Cameron and Miller, "A
    practitioner's guide to cluster-robust inference", Journal of Human Resources 50, 2015, equation (10).

    A joint that rests reads the same error of the encoder's step again wherever it comes to rest at the same reading:
    no piece is independent of it, so its variance, a twelfth of the squared step, is added reading by reading.

    Parameters that a direction without any effect moves by more than twice WEAK are not seen.
    """
    errors, slopes = problem.errors(parameters)
    weights = log_weights(problem, parameters) if len(errors) > 2 else np.ones(len(errors))
    lower, upper = problem.bounds()
    values = parameters[problem.places]
    scales = np.maximum(np.abs(values), np.where(lower < 0, 1.0, 0.1) * problem.scales())  # of a sign: may be near 0
    inner = (values > lower + 1e-4 * problem.scales()) & (values < upper - 1e-4 * problem.scales())
    bread = np.zeros((len(values), len(values)))
    scores: list[Array] = []
    squares = 0.0
    resting: dict[float, Array] = {}
    counts = pieces_of(problem.records)
    for record, error, slope, weight, pieces in zip(problem.records, errors, slopes, weights, counts, strict=True):
        own = slope * scales * weight / np.sqrt(len(error))
        residual = error * weight / np.sqrt(len(error))
        bread += own.T @ own
        squares += float(residual @ residual)
        scores += [own[a].T @ residual[a] for a in np.array_split(np.arange(len(error)), pieces)]
        rests = _rests(record.q[record.used])
        for reading in np.unique(rests[np.isfinite(rests)]).tolist():
            each = weight / np.sqrt(len(error)) * own[rests == reading].sum(axis=0)
            resting[reading] = resting.get(reading, 0.0) + each
    free = [int(k) for k in np.flatnonzero(inner)]
    covariance, seen = np.zeros_like(bread), np.zeros(len(values), dtype=bool)
    if free:
        core, count = bread[np.ix_(free, free)], len(scores)
        sizes, vectors = np.linalg.eigh(core)
        good = sizes > RANK * sizes[-1]
        loose = np.sqrt(squares / count / np.maximum(sizes, max(1e-6 * RANK * sizes[-1], 1e-300)))
        inverse = (vectors[:, good] / sizes[good]) @ vectors[:, good].T
        seen[free] = np.linalg.norm(vectors[:, ~good] * loose[~good], axis=1) <= 2.0 * WEAK
        meat = _squares(scores, free) * count / max(count - 1, 1)
        meat += encoder_step(problem.records) ** 2 / 12.0 * _squares(resting.values(), free)
        covariance[np.ix_(free, free)] = inverse @ meat @ inverse
    return Spread(covariance * np.outer(scales, scales), bread, inner, seen, len(scores))


def pieces_of(records: Sequence[JointRecord]) -> list[int]:
    """Return the number of pieces of each log that count as independent."""
    if len(records) >= _LOGS:
        return [1] * len(records)
    times = [record.samples[record.used, 0] for record in records]
    return [max(1, round((time[-1] - time[0]) / PIECE_S)) for time in times]


def known_parameters(problem: ServoProblem, parameters: Array, spread: Spread) -> tuple[Known, ...]:
    """Return how far each free parameter is known."""
    values = parameters[problem.places]
    free = [int(k) for k in np.flatnonzero(spread.inner)]
    factor = float(stdtrit(max(spread.pieces - 1, 1), 0.5 + LEVEL / 2.0))
    halves, ratios = (
        factor * np.sqrt(np.maximum(np.diag(own), 0.0))
        for own in (spread.covariance, spread.covariance if spread.ratio is None else spread.ratio)
    )
    found = []
    for k, (name, value, half) in enumerate(zip(problem.free, values.tolist(), halves.tolist(), strict=True)):
        ratio = None if spread.ratio is None else float(ratios[k])
        if not spread.inner[k]:
            found.append(Known(name, value, np.inf, "at its bound"))
        elif not spread.seen[k]:
            found.append(Known(name, value, np.inf, "not separable", _partner(problem.free, spread.products, k, free)))
        elif half < WEAK * abs(value) or (name == "angle_offset" and (ratio is None or half < ZERO)):
            found.append(Known(name, value, half, "identified", ratio=ratio))
        elif ratio is not None and ratio < WEAK * abs(value):
            found.append(Known(name, value, half, AS_RATIO, ratio=ratio))
        else:
            partner = _partner(problem.free, spread.covariance, k, free, TOGETHER)
            found.append(Known(name, value, half, "weak", partner, ratio))
    return tuple(found)


def _squares(scores: Iterable[Array], free: Sequence[int]) -> Array:
    """Return the sum of s s' over scores (f,), of the free parameters alone."""
    return sum((np.outer(one[free], one[free]) for one in scores), np.zeros((len(free), len(free))))


def _rests(q: Array) -> Array:
    """Return the reading of each sample that is one of REST_SAMPLES equal ones in a row, else nan, shape (N,)."""
    readings = np.round(q, 9)
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(readings)) + 1, [len(q)]])
    lengths = np.diff(cuts)
    return np.where(np.repeat(lengths, lengths) >= REST_SAMPLES, readings, np.nan)


def encoder_step(records: Sequence[JointRecord]) -> float:
    """Return the median distance of neighbouring readings, in rad; of a joint that rests it is the encoder's step."""
    levels = np.unique(np.round(np.concatenate([record.q[record.used] for record in records]), 9))
    return float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0


def _partner(names: Sequence[str], matrix: Array, k: int, free: Sequence[int], least: float = 0.0) -> str:
    """Return the parameter that is most correlated with one, by a matrix of products (f, f); empty below a limit."""
    sizes = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    others = [j for j in free if j != k]
    if not others:
        return ""
    strength = [abs(matrix[k, j]) / (sizes[k] * sizes[j]) for j in others]
    best = int(np.argmax(strength))
    return names[others[best]] if strength[best] >= least else ""


#: What separates parameters that the logs do not tell apart.
EXPERIMENTS = {
    "gain_ratio": "command steps large enough that the torque saturates, or state error_gain and kp of the drive",
    "full_torque": "command steps large enough that the torque saturates, or state error_gain and kp of the drive",
    "back_emf": "lift the joint, switch the torque off and let it swing, and log torque_enable",
    "viscous": "lift the joint, switch the torque off and let it swing, and log torque_enable",
    "armature": "faster motions (chirps up to a few Hz), or a second payload of other mass",
    "load_motor": "hold and move a second, heavier payload",
    "load_external": "hold and move a second, heavier payload",
    "coulomb": "slow ramps in both directions",
    "delay": "steps or a fast chirp of the command",
    "angle_offset": "a known payload too: the zero of the encoder and the direction of a centre of mass look alike",
    "slew_limit": "large steps of the command",
}

#: What separates all torques of a joint from its armature, where no weight and no known inertia does.
SCALE = (
    "only their ratios are known: no weight sets the scale of the torques; record a known payload off the axis too "
    "(servo: payloads)"
)


def lacks_scale(labels: Mapping[str, str]) -> bool:
    """Return whether torque and armature are not separable, by the labels of the parameters: the scale is missing."""
    return all(labels.get(name) == "not separable" for name in ("full_torque", "armature"))


def unit_of(name: str) -> str:
    """Return the unit of a parameter."""
    return PARAMETERS[PLACE[name]].unit
