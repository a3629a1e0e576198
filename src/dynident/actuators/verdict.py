"""How far the parameters of a servo are known: intervals that allow for autocorrelation, and what is known together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh
from scipy.special import ndtr, ndtri, stdtrit

from dynident.actuators.output_error import ServoProblem, log_weights
from dynident.actuators.rollout import JointRecord, encoder_step
from dynident.arrays import Array, BoolArray

#: Confidence of the intervals.
LEVEL = 0.95

#: Half width of an interval over the standard deviation of a normal distribution.
NORMAL = float(ndtri(0.5 + LEVEL / 2.0))

#: Length in s of the pieces of a log whose scores count as independent where there are few logs.
PIECE_S = 1.0

#: Fewest logs that count as the independent pieces by themselves.
_LOGS = 8

#: Squared singular values below this share of the largest, of columns at the scale of each parameter, are directions
#: that the logs do not see.
RANK = 1e-9

#: Roll-outs that the covariance by the encoder is averaged over, and times that they are drawn, each within the last.
DRAWS, _PASSES = 8, 2

#: Places of the encoder's step that its errors are looked at, and halvings that find a quantile of them.
_PLACES, _HALVINGS = 32, 30

#: Correlation from which two parameters are known only together.
TOGETHER = 0.98

#: Harmonics of the error of an encoder over its step; those above them, a fourteenth of its variance, count as white.
_HARMONICS = np.arange(1, 9)

#: Least step of an encoder in rad.
_LEAST_STEP = 1e-9

#: What is known but for the scale that all torques and inertias have in common.
AS_RATIO = "known as a ratio"

#: Half width from which a parameter counts as weak, as a share of its value.
WEAK = 0.25

#: Half width in rad up to which the zero of an encoder counts as identified, and where the bodies are found beside it.
ZERO, ZERO_BESIDE = 0.1, 0.02


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
            are known and give it. Of a joint without weight the torque at full duty is held.
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
        own: Variances by the errors of the joint alone, shape (f,).
        factors: Half width of the interval over the standard deviation by these errors, shape (f,).
        ratio: Covariance without the scale that all torques and inertias have in common, shape (f, f); None where the
            bodies are known.
    """

    covariance: Array
    products: Array
    inner: BoolArray
    seen: BoolArray
    pieces: int
    own: Array
    factors: Array
    ratio: Array | None = None

    def half_widths(self, covariance: Array) -> Array:
        """Return half widths of the intervals by a covariance that holds other errors too, shape (f,).

        They are no narrower than by the errors of the joint alone: what other joints take from these stands on
        derivatives of small changes.
        """
        more = np.maximum(np.diag(covariance) - self.own, 0.0)
        return np.sqrt(self.own * self.factors**2 + more * NORMAL**2)

    def half_width_of_sum(self, places: Sequence[int]) -> float:
        """Return the half width of a sum of free parameters; infinite where all are at bounds."""
        among = self.inner & np.isin(np.arange(len(self.inner)), places)
        variance = float(among @ self.covariance @ among)
        return float(self.factors[among].max() * np.sqrt(max(variance, 0.0))) if among.any() else np.inf


def spread_of(problem: ServoProblem, parameters: Array, draws: int = 0, beside: Array | None = None) -> Spread:
    """Return how the errors of the roll-outs spread the free parameters.

    By a sandwich covariance of two parts.

    The encoder: a reading is off by a sawtooth of the position, and a joint that moves slowly or comes back to rest
    where it was before repeats the same error. With the roll-out's positions q the errors of two samples have the
    covariance sum_k D^2 / (2 pi^2 k^2) cos(2 pi k (q_i - q_j) / D) for a step D whose place is not known (Sripad and
    Snyder, "A necessary and sufficient condition for quantization errors to be uniform and white", IEEE Transactions on
    Acoustics, Speech, and Signal Processing 25, 1977).

    The best roll-out has two places of rest a whole number of steps apart, as their readings are, so their errors would
    be equal: the covariance is averaged over roll-outs drawn within it, and within what errors of other joints do.

    All else: scores clustered by pieces of the logs (whole logs where there are eight or more), as errors of one
    roll-out are correlated over its whole length (Cameron and Miller, "A practitioner's guide to cluster-robust
    inference", Journal of Human Resources 50, 2015, equation (10)). They contain the encoder's errors within a piece:
    what they are larger than these by is added, in each direction where that is more than chance (the largest
    eigenvalue of a covariance of S samples of f numbers, Marchenko and Pastur 1967).

    Parameters that a direction without any effect moves by more than twice WEAK are not seen.

    Args:
        problem: Roll-outs and free parameters.
        parameters: Where they ended, shape (COUNT,).
        draws: Roll-outs that the encoder's part is averaged over; 0: that of the answer alone.
        beside: Covariance of the free parameters by the errors of other joints, within which they are drawn too,
            shape (f, f); None for none.
    """
    errors, slopes = problem.errors(parameters)
    weights = log_weights(problem, parameters) if len(errors) > 2 else np.ones(len(errors))
    lower, upper = problem.bounds()
    values = parameters[problem.places]
    scales = np.maximum(np.abs(values), np.where(lower < 0, 1.0, 0.1) * problem.scales())  # of a sign: may be near 0
    damping = np.isin(problem.free, ("viscous", "back_emf"))  # one of them may be next to nothing beside the other
    scales[damping] = scales[damping].max(initial=0.0)
    inner = (values > lower + 1e-4 * problem.scales()) & (values < upper - 1e-4 * problem.scales())
    sizes = [weight / np.sqrt(len(error)) for weight, error in zip(weights, errors, strict=True)]
    rows = [size * scales * slope for size, slope in zip(sizes, slopes, strict=True)]
    bread = sum((own.T @ own for own in rows), np.zeros((len(values), len(values))))
    square = sum(float(size**2 * error @ error) for size, error in zip(sizes, errors, strict=True))
    count = sum(pieces_of(problem.records))
    free = [int(k) for k in np.flatnonzero(inner)]
    covariance, seen, factors = np.zeros_like(bread), np.zeros(len(values), dtype=bool), np.full(len(values), NORMAL)
    if free:
        powers, vectors = np.linalg.eigh(bread[np.ix_(free, free)])
        good = powers > RANK * powers[-1]
        loose = np.sqrt(square / count / np.maximum(powers, max(1e-6 * RANK * powers[-1], 1e-300)))
        seen[free] = np.linalg.norm(vectors[:, ~good] * loose[~good], axis=1) <= 2.0 * WEAK
        unit = vectors[:, good] / np.sqrt(powers[good])
        scores = [own[:, free] @ unit for own in rows]
        into = (vectors[:, good] * np.sqrt(powers[good])).T / scales[free]
        more = 0.0 if beside is None else into @ beside[np.ix_(free, free)] @ into.T
        found = score_covariance(problem.records, errors, scores, sizes, draws, more)
        covariance[np.ix_(free, free)] = unit @ found.covariance @ unit.T
        factors[free] = found.factors(unit, count)
    covariance *= np.outer(scales, scales)
    return Spread(covariance, bread, inner, seen, count, np.diag(covariance), factors)


@dataclass(frozen=True)
class Scores:
    """The sum of all scores, derivatives of the errors times the errors, of f numbers.

    Attributes:
        encoder: Values that errors of the encoder may give it, shape (s, f).
        rest: Covariance of what else it holds, shape (f, f).
        clustered: The part of that which is estimated from the pieces of the logs, shape (f, f).
    """

    encoder: Array
    rest: Array
    clustered: Array

    @property
    def covariance(self) -> Array:
        """Its covariance, shape (f, f)."""
        return np.asarray(self.encoder.T @ self.encoder / len(self.encoder) + self.rest)

    def factors(self, into: Array, pieces: int) -> Array:
        """Return half widths at LEVEL over standard deviations of numbers ``into @ score``, shape (p,).

        Errors of an encoder's step are bounded, so few of them are spread less far than a normal distribution. What
        pieces estimate has the degrees of freedom of Satterthwaite, "An approximate distribution of estimates of
        variance components", Biometrics Bulletin 2, 1946.

        Args:
            into: Shape (p, f).
            pieces: Number of pieces of logs that count as independent.
        """
        values = self.encoder @ into.T
        normal, clustered = (np.einsum("pf,fg,pg->p", into, own, into) for own in (self.rest, self.clustered))
        size = np.sqrt(np.maximum(np.mean(values**2, axis=0) + normal, 1e-300))
        values, normal = values / size, np.sqrt(np.maximum(normal, 1e-12)) / size
        low, high = np.zeros(len(into)), np.full(len(into), 3.0 * NORMAL)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            inside = np.mean(ndtr((middle - values) / normal) - ndtr((-middle - values) / normal), axis=0)
            low, high = np.where(inside < LEVEL, middle, low), np.where(inside < LEVEL, high, middle)
        freedom = max(pieces - 1, 1) / np.maximum(clustered / size**2, 1e-3) ** 2
        return np.asarray(high * stdtrit(freedom, 0.5 + LEVEL / 2.0) / NORMAL)


def score_covariance(
    records: Sequence[JointRecord],
    errors: Sequence[Array],
    slopes: Sequence[Array],
    sizes: Sequence[float],
    draws: int = 0,
    beside: Array | float = 0.0,
) -> Scores:
    """Return how the sum of all scores is spread: of derivatives of the errors times the errors.

    Args:
        records: The joint in the logs.
        errors: In rad, log by log, each (N,).
        slopes: Derivatives times the weight of each log, each (N, f); of all logs together with orthonormal columns.
        sizes: Weight of each log.
        draws: Roll-outs within the covariance itself that it is averaged over; 0: that of the answer alone.
        beside: Covariance of other errors, within which they are drawn too, shape (f, f).
    """
    scores: list[Array] = []
    waves: list[Array] = []
    white, step = np.zeros((slopes[0].shape[1],) * 2), max(encoder_step(records), _LEAST_STEP)
    places = [(record.q[record.used] + error) / step for record, error in zip(records, errors, strict=True)]
    scaled = [size * step * own for own, size in zip(slopes, sizes, strict=True)]
    parts = zip(errors, slopes, places, scaled, sizes, pieces_of(records), strict=True)
    for error, own, place, turned, size, pieces in parts:
        phases = _encoder_waves(place)
        white += (1.0 / 12.0 - np.sum(0.5 / (np.pi * _HARMONICS) ** 2)) * (turned.T @ turned)
        for part in np.array_split(np.arange(len(error)), pieces):
            scores.append(size * (error[part] @ own[part]))
            waves.append(phases[:, part] @ turned[part])
    encoder, pieces = [np.sum(waves, axis=0)], np.concatenate(waves)
    within, count, free = (pieces.conj().T @ pieces).real + white, len(scores), len(white)
    if draws:
        moves = [own / (size * step) for own, size in zip(slopes, sizes, strict=True)]
        encoder = _drawn(places, moves, scaled, within, white, draws, beside)
    powers, vectors = eigh(np.transpose(scores) @ scores * count / max(count - 1, 1), within)
    more = np.where(powers > (1.0 + np.sqrt(free / count)) ** 2, powers - 1.0, 0.0)
    clustered = np.asarray((within @ vectors * more) @ (within @ vectors).T)
    turns = np.exp(2j * np.pi * _HARMONICS * (np.arange(_PLACES)[:, None] + 0.5) / _PLACES)
    values = np.concatenate([np.sqrt(2.0) * (turns @ wave).imag for wave in encoder])
    return Scores(values, white + clustered, clustered)


def _drawn(
    places: Sequence[Array],
    moves: Sequence[Array],
    slopes: Sequence[Array],
    first: Array,
    white: Array,
    draws: int,
    beside: Array | float,
) -> list[Array]:
    """Return the harmonics of the scores by the encoder, each (h, f), of roll-outs within the covariance of these.

    Args:
        places: Positions of the roll-out in steps of the encoder, log by log, each (N,).
        moves: Their derivatives by the directions of the scores, each (N, f).
        slopes: What the errors in steps are multiplied by in the scores, each (N, f).
        first: Covariance that they are drawn in at first, where errors of different pieces do not correlate, (f, f).
        white: Part of the high harmonics, which all roll-outs share, (f, f).
        draws: Number of roll-outs.
        beside: Covariance of other errors, shape (f, f).
    """
    random, covariance, found = np.random.default_rng(0), first, list[Array]()
    powers, vectors = np.linalg.eigh(beside + np.zeros_like(first))
    others = (vectors * np.maximum(powers, 0.0)) @ vectors.T  # what other joints add, not what they take
    for _ in range(_PASSES):
        root, found = np.linalg.cholesky(covariance + others), []
        for _ in range(draws):
            moved = root @ random.standard_normal(len(white))
            parts = zip(places, moves, slopes, strict=True)
            found.append(np.sum([_encoder_waves(place + move @ moved) @ own for place, move, own in parts], axis=0))
        covariance = np.mean([(wave.conj().T @ wave).real for wave in found], axis=0) + white
    return found


def _encoder_waves(positions: Array) -> Array:
    """Return the harmonics of the encoder's error at positions in steps of it (N,), shape (h, N), complex.

    The covariance of two errors, in squared steps, is the real part of one times the conjugate of the other.
    """
    first = np.exp(2j * np.pi * positions)
    return np.cumprod(np.tile(first, (len(_HARMONICS), 1)), axis=0) / (np.sqrt(2.0) * np.pi * _HARMONICS[:, None])


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
    halves = spread.half_widths(spread.covariance)
    ratios = halves if spread.ratio is None else spread.half_widths(spread.ratio)
    found = []
    for k, (name, value, half) in enumerate(zip(problem.free, values.tolist(), halves.tolist(), strict=True)):
        ratio = None if spread.ratio is None else float(ratios[k])
        if not spread.inner[k]:
            found.append(Known(name, value, np.inf, "at its bound"))
        elif not spread.seen[k]:
            found.append(Known(name, value, np.inf, "not separable", _partner(problem.free, spread.products, k, free)))
        elif half < WEAK * abs(value) or (name == "angle_offset" and half < (ZERO if ratio is None else ZERO_BESIDE)):
            found.append(Known(name, value, half, "identified", ratio=ratio))
        elif ratio is not None and ratio < WEAK * abs(value):
            found.append(Known(name, value, half, AS_RATIO, ratio=ratio))
        else:
            partner = _partner(problem.free, spread.covariance, k, free, TOGETHER)
            found.append(Known(name, value, half, "weak", partner, ratio))
    return tuple(found)


def _partner(names: Sequence[str], matrix: Array, k: int, free: Sequence[int], least: float = 0.0) -> str:
    """Return the parameter that is most correlated with one, by a matrix of products (f, f); empty below a limit."""
    sizes = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    others = [j for j in free if j != k]
    if not others:
        return ""
    strength = [abs(matrix[k, j]) / (sizes[k] * sizes[j]) for j in others]
    best = int(np.argmax(strength))
    return names[others[best]] if strength[best] >= least else ""


#: What separates viscous friction from back-EMF better, where the logs have free swings.
MORE_SWINGS = "more free swings with the torque off, from higher up, and so faster ones"

_SWING = (
    "lift the joint, switch the torque off and let it swing (at speed where no weight moves it), and log torque_enable"
)

#: What separates parameters that the logs do not separate.
EXPERIMENTS = {
    "gain_ratio": "command steps large enough that the torque saturates, or state error_gain and kp of the drive",
    "full_torque": "command steps large enough that the torque saturates, or state error_gain and kp of the drive",
    "back_emf": _SWING,
    "viscous": _SWING,
    "armature": "faster motions (chirps up to a few Hz), or a second payload of other mass",
    "load_motor": "hold and move a second, heavier payload",
    "load_external": "hold and move a second, heavier payload",
    "coulomb": "slow ramps in both directions",
    "delay": "steps or a fast chirp of the command",
    "angle_offset": "a known payload too: the zero of the encoder and the direction of a centre of mass look alike",
    "slew_limit": "large steps of the command",
}

#: What gives all torques of a joint their scale, and what separates them from its armature where no weight and no
#: known inertia does, or too little.
_SCALE_STEP = "record a known payload off the axis too (servo: payloads), or state a known torque (servo: full_torque)"
SCALE = f"only their ratios are known: no weight sets the scale of the torques; {_SCALE_STEP}"
LITTLE_WEIGHT = f"their ratio is known better, as little weight sets the scale of the torques; {_SCALE_STEP}"


def lacks_scale(labels: Mapping[str, str]) -> bool:
    """Return whether the scale is missing: torque and armature are not separable, by labels, and the delay is known."""
    unknown = [labels.get(name) in ("not separable", AS_RATIO) for name in ("full_torque", "armature", "delay")]
    return unknown == [True, True, False] and labels["full_torque"] == "not separable"
