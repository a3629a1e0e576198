"""Tails and quantiles of the normal, Student's and the chi square distribution, to nine digits.

``scipy.special`` has them too, but loads for longer than most commands work. Tails are the incomplete beta and gamma
functions by their series and continued fractions (DLMF 8.7.1, 8.9.2 and 8.17.22, in Lentz's way), quantiles Newton's
method on them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array

#: Terms at most of a series or fraction, and the change below which it has settled.
_TERMS, _SETTLED = 1_000_000, 1e-15

#: A step of Newton's method below this share is the last: what it leaves is about its square.
_NEAR = 1e-9

#: Degrees of freedom above which Student's t is told from the normal by its first term alone.
_MANY = 1e7


def student_quantile(probability: npt.ArrayLike, degrees: npt.ArrayLike) -> Array:
    """Return the quantile of Student's t; infinite degrees of freedom are the normal distribution."""
    return _each(_student_quantile, probability, degrees)


def student_share(value: npt.ArrayLike, degrees: npt.ArrayLike) -> Array:
    """Return the probability that a variable of Student's t is below a value."""
    return _each(_student_share, value, degrees)


def normal_quantile(probability: npt.ArrayLike) -> Array:
    """Return the quantile of the standard normal distribution."""
    return _each(_normal_quantile, probability)


def normal_share(value: npt.ArrayLike) -> Array:
    """Return the probability that a standard normal variable is below a value."""
    return _each(_normal_share, value)


def chi_square_tail(value: npt.ArrayLike, degrees: npt.ArrayLike) -> Array:
    """Return the probability that chi square is above a value; not a number without a degree of freedom."""
    return _each(_chi_square_tail, value, degrees)


def chi_square_quantile(probability: float, degrees: float) -> float:
    """Return the quantile of chi square."""

    def tail(value: float) -> tuple[float, float]:
        return _chi_square_tail(value, degrees), -_gamma_factor(degrees / 2.0, value / 2.0) / value

    apart = 2.0 / (9.0 * degrees)
    start = degrees * max(1.0 - apart + _normal_quantile(probability) * math.sqrt(apart), 0.01) ** 3
    return _root(tail, 1.0 - probability, start, 0.0)


def _each(function: Callable[..., float], *given: npt.ArrayLike) -> Array:
    with np.errstate(invalid="ignore"):
        return np.asarray(np.frompyfunc(function, len(given), 1)(*given), dtype=np.float64)


def _normal_share(value: float) -> float:
    return 0.5 * math.erfc(-value / math.sqrt(2.0))


def _normal_quantile(probability: float) -> float:
    if 0.0 < probability < 1.0:
        return NormalDist().inv_cdf(probability)
    return {0.0: -math.inf, 1.0: math.inf}.get(float(probability), math.nan)


def _student_share(value: float, degrees: float) -> float:
    if not degrees > 0 or math.isnan(value):
        return math.nan
    if degrees > _MANY:  # Abramowitz and Stegun 26.7.8
        return _normal_share(value * (1.0 - 0.25 / degrees) / math.sqrt(1.0 + value**2 / (2.0 * degrees)))
    square = value**2 / degrees
    if not math.isfinite(square):
        return float(value > 0)
    tail = 0.5 * _beta_share(degrees / 2.0, square)
    return tail if value < 0 else 1.0 - tail


def _student_quantile(probability: float, degrees: float) -> float:
    if not degrees > 0 or not 0.0 < probability < 1.0:
        return {0.0: -math.inf, 1.0: math.inf}.get(float(probability), math.nan) if degrees > 0 else math.nan
    if probability == 0.5:
        return 0.0
    normal = abs(_normal_quantile(probability))
    if math.isinf(degrees):
        return math.copysign(normal, probability - 0.5)

    def tail(value: float) -> tuple[float, float]:
        power = -0.5 * (degrees + 1.0) * math.log1p(value**2 / degrees)
        density = math.exp(power - _log_half_beta(degrees / 2.0)) / math.sqrt(degrees)
        return _student_share(-value, degrees), -density

    start = normal * (1.0 + (normal**2 + 1.0) / (4.0 * degrees))
    return math.copysign(_root(tail, min(probability, 1.0 - probability), start, 0.0), probability - 0.5)


def _chi_square_tail(value: float, degrees: float) -> float:
    if not degrees > 0 or math.isnan(value):
        return math.nan
    half, argument = degrees / 2.0, value / 2.0
    if argument <= 0 or math.isinf(argument):
        return float(argument <= 0)
    factor = _gamma_factor(half, argument)
    if argument > half + 1.0:
        steps = ((n * (half - n), argument + 2.0 * n + 1.0 - half) for n in range(1, _TERMS))
        return factor / _fraction(argument + 1.0 - half, steps)
    term = total = 1.0 / half
    for n in range(1, _TERMS):
        term *= argument / (half + n)
        total += term
        if term < _SETTLED * total:
            break
    return max(1.0 - factor * total, 0.0)


def _gamma_factor(a: float, x: float) -> float:
    """Return x^a e^-x / Gamma(a), by Stirling's series where the logarithms of large numbers would cancel."""
    if a < 100.0:
        return math.exp(a * math.log(x) - x - math.lgamma(a))
    apart = (x - a) / a
    power = a * (math.log1p(apart) - apart) if apart < 1.0 else a * (math.log(x / a) - apart)
    return math.sqrt(a / (2.0 * math.pi)) * math.exp(power - 1.0 / (12.0 * a) + 1.0 / (360.0 * a**3))


def _beta_share(a: float, square: float) -> float:
    """Return the regularised incomplete beta function I_x(a, 1/2) with x = 1 / (1 + square)."""
    x, rest = 1.0 / (1.0 + square), square / (1.0 + square)
    if square == 0:
        return 1.0
    factor = math.exp(-a * math.log1p(square) + 0.5 * math.log(rest) - _log_half_beta(a))
    if x < (a + 1.0) / (a + 2.5):
        return factor / (a * _fraction(1.0, _beta_steps(a, 0.5, x)))
    return 1.0 - factor / (0.5 * _fraction(1.0, _beta_steps(0.5, a, rest)))


def _beta_steps(a: float, b: float, x: float) -> Iterator[tuple[float, float]]:
    for m in range(_TERMS):
        yield -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)), 1.0
        n = m + 1
        yield n * (b - n) * x / ((a + 2.0 * n - 1.0) * (a + 2.0 * n)), 1.0


def _log_half_beta(a: float) -> float:
    """Return the logarithm of the beta function B(a, 1/2)."""
    if a < 100.0:
        return math.lgamma(a) + 0.5 * math.log(math.pi) - math.lgamma(a + 0.5)
    return 0.5 * math.log(math.pi / a) + 1.0 / (8.0 * a) - 1.0 / (192.0 * a**3) + 1.0 / (640.0 * a**5)


def _fraction(first: float, steps: Iterator[tuple[float, float]]) -> float:
    """Return first + n_1 / (d_1 + n_2 / (d_2 + ...)) of steps (n, d)."""
    least = 1e-300
    found = over = first or least
    under = 0.0
    for numerator, denominator in steps:
        under = 1.0 / ((denominator + numerator * under) or least)
        over = (denominator + numerator / over) or least
        found *= over * under
        if abs(over * under - 1.0) < _SETTLED:
            break
    return found


def _root(tail: Callable[[float], tuple[float, float]], wanted: float, start: float, low: float) -> float:
    """Return where a falling tail has a value: Newton's method on its logarithm, halving where that leaves the bracket.

    Args:
        tail: Returns the tail and its derivative.
        wanted: Its value, above 0.
        start: Where to begin, above ``low``.
        low: Where the tail is larger.
    """
    high, value = math.inf, start
    for _ in range(200):
        found, slope = tail(value)
        low, high = (value, high) if found > wanted else (low, value)
        step = found * math.log(found / wanted) / slope if found > 0 and slope < 0 else math.nan
        after = value - step
        if not low <= after <= high:
            after = 0.5 * (low + high) if math.isfinite(high) else 2.0 * value
        elif abs(step) <= _NEAR * abs(after):
            return after
        value = after
    return value
