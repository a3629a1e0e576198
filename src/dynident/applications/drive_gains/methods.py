"""Methods that find drive gains from currents: structured and plain total least squares, weighted and plain ones.

``structured`` takes the currents, and only them, for noisy: min over K, z of sum_g N_g log sum (i - a_g (W beta +
known))^2, a = 1 / K. That is maximum likelihood for normal noise of one size per drive, and total least squares with
the structure of the problem (De Moor 1993). ``tls`` is the total least squares of Gautier and Briot (2014, joint by
joint weighted): every column of [diag(i), -W, -W_payload] is taken to be noisy alike. ``wls`` and ``ols`` take the
known torque for the measurement and the currents for exact columns: gains come out too small where currents are noisy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.applications.drive_gains.gain_data import (
    NULL,
    GainData,
    Linearised,
    current_rows,
    group_squares,
    solved,
    stacked,
    torque_rows,
    with_prior,
)
from dynident.arrays import Array
from dynident.errors import BadOption, SolverFailed, UnknownChoice

METHODS = ("structured", "tls", "wls", "ols")

#: Steps of the structured fit, and renewals of weights of the linear ones.
STEPS, RENEWALS = 100, 5

#: Rows of a group below which its gain is not asked for.
FEWEST = 20

#: How often a step that makes the fit worse is halved.
HALVINGS = 20

#: A step changes an inverse gain by this share at most.
LONGEST = 0.5

#: A gain below this share of the one that a fit starts from is on its way to nothing, and stays there.
LOST = 1e-3

#: Values over that of the linear fit, inverse as well, at which a gain that went to nothing is begun again.
AGAIN = (-1.0, 0.25)

#: The fit has converged when the logarithm of its likelihood changes by less, twice; one is a standard deviation.
CONVERGED = 1e-6


@dataclass(frozen=True)
class GainFit:
    """What a method found.

    Attributes:
        gains: K, shape (G,), in N m/A.
        z: The other unknowns, shape (Z,).
        weights: Weight of each group's rows, shape (G,), over their unit.
        rows: The rows about the solution.
        removed: What total least squares takes off each diagonal of the Gram matrix as error, shape (P,); 0 elsewhere.
        iterations: Steps taken.
    """

    gains: Array
    z: Array
    weights: Array
    rows: Linearised
    removed: Array
    iterations: int


def fit_gains(data: GainData, method: str, factors: Array | None = None) -> GainFit:
    """Return the gains of one method.

    Args:
        data: Reduced rows.
        method: One of :data:`METHODS`.
        factors: How many rows of each group are worth one, shape (G,); weighs rows against what is known of z.

    Raises:
        UnknownChoice: No such method.
        BadOption: Nothing known asks a torque of any joint.
        SolverFailed: No convergence, or a solution of total least squares that is none.
    """
    if method not in METHODS:
        raise UnknownChoice("method for drive gains", method, METHODS)
    thin = np.ones(len(data.groups)) if factors is None else 1.0 / np.sqrt(factors)
    if method == "ols":
        return _linear(data, thin, 0)
    if method == "structured":  # renewed weights can shrink a weakly driven gain to nothing, plain ones do not
        return _structured(data, _linear(data, thin, 0), thin)
    weighted = _linear(data, thin, RENEWALS)
    return weighted if method == "wls" else _total(data, weighted)


def _deviations(data: GainData, rows: Linearised, floor: Array) -> Array:
    """Return the residual standard deviation of each group, shape (G,).

    At least a millionth of ``floor`` and of the largest: a group whose gain is nothing has a residual of rounding.
    """
    counts = np.maximum(data.counts, 1.0)
    share = 1.0 - min((len(data.groups) + data.unknowns.count) / counts.sum(), 0.9)
    found = np.sqrt(group_squares(data, rows) / counts / share)
    found = np.maximum(found, np.maximum(1e-6 * np.maximum(floor, found.max(initial=0.0)), 1e-100))
    return np.where(data.counts >= FEWEST, found, np.inf)  # a group of a few rows has no say


def _current_size(data: GainData) -> Array:
    return np.sqrt(data.current_squares / np.maximum(data.counts, 1.0))


def _linear(data: GainData, thin: Array, renewals: int) -> GainFit:
    """Return (weighted) least squares with the known torque as the measurement.

    What is known of z stays at zero: with all bodies shrunk to nothing, gains of zero would fit without an error.
    """
    groups, count = len(data.groups), data.unknowns.count
    free = np.concatenate([np.ones(groups, bool), np.isinf(data.unknowns.deviations)])
    used = weights = thin
    x = np.zeros(groups + count)
    start = torque_rows(data, x[:groups], x[groups:])
    gains, z, rows = x[:groups], x[groups:], start
    for _ in range(renewals + 1):
        slopes, target = stacked(data, start, weights)
        if not np.any(np.abs(target) > 1e-12):
            step = "state its centre and inertia as well, or log motions in which it has weight"
            raise BadOption("payload", "of which nothing known asks a torque of any joint", step)
        x[free] = solved(slopes[:, free], target)
        gains, z = x[:groups].copy(), x[groups:].copy()
        rows = torque_rows(data, gains, z)
        used = weights
        weights = thin / _deviations(data, rows, np.abs(gains) * _current_size(data))
    return GainFit(gains, z, used, rows, np.zeros(groups + count), renewals + 1)


def _structured(data: GainData, start: GainFit, thin: Array) -> GainFit:
    """Return the most likely gains where only currents are noisy, by Gauss-Newton steps from a linear fit.

    A gain that the linear fit has far too small, or with the other sign, may go to nothing, where the likelihood has a
    maximum of its own: it is begun again at other values.
    """
    inverse = 1.0 / np.where(start.gains == 0, 1.0, start.gains)
    least = np.abs(inverse) / LOST
    here, steps = _climbed(data, _likely(data, inverse, start.z, thin), thin, least)
    for group in np.flatnonzero(np.abs(here.inverse) > least):
        for factor in AGAIN:
            other = np.where(np.arange(len(inverse)) == group, factor * inverse, here.inverse)
            point = _likely(data, other, _others(data, other, start.z, here.weights), thin)
            try:
                there, more = _climbed(data, point, thin, least)
            except SolverFailed:
                continue
            here, steps = (there if there.loss < here.loss - CONVERGED else here), steps + more
    none = np.zeros(len(inverse) + data.unknowns.count)
    return GainFit(1.0 / here.inverse, here.z, here.weights, here.rows, none, steps)


def _climbed(data: GainData, here: _StructuredPoint, thin: Array, least: Array) -> tuple[_StructuredPoint, int]:
    """Return the maximum of the likelihood that steps from a point lead to, and their number."""
    groups, calm = len(data.groups), 0
    for step in range(1, STEPS + 1):
        slopes, residuals = with_prior(data, *stacked(data, here.rows, here.weights), here.z)
        slopes[:, :groups][:, np.abs(here.inverse) > least] = 0.0
        change = solved(slopes, residuals)[:groups]
        size = min(1.0, LONGEST / max(float(np.max(np.abs(change / here.inverse))), 1e-300))
        there = here
        for _ in range(HALVINGS):
            inverse = here.inverse + size * change
            there = _likely(data, inverse, _others(data, inverse, here.z, here.weights), thin)
            if there.loss <= here.loss:
                break
            size *= 0.5
        calm = calm + 1 if here.loss - there.loss < CONVERGED else 0
        here = there if there.loss <= here.loss else here
        if calm == 2:
            return here, step
    evidence = f"no convergence within {STEPS} steps"
    step_next = "check gravity, units, signs and order of the columns; or record a motion that loads every joint more"
    raise SolverFailed("structured total least squares for drive gains", evidence, step_next)


@dataclass(frozen=True)
class _StructuredPoint:
    """Where the structured fit stands: unknowns, the rows about them, weights, and what is to be made small."""

    inverse: Array
    z: Array
    rows: Linearised
    weights: Array
    loss: float


def _likely(data: GainData, inverse: Array, z: Array, thin: Array) -> _StructuredPoint:
    """Return a place with its negative logarithm of the likelihood, deviations at their best."""
    rows = current_rows(data, inverse, z)
    weights = thin / _deviations(data, rows, _current_size(data))
    known = np.isfinite(data.unknowns.deviations)
    said = weights > 0
    loss = -np.sum((data.counts * thin**2)[said] * np.log(weights[said]))
    loss += 0.5 * np.sum((z[known] / data.unknowns.deviations[known]) ** 2)
    return _StructuredPoint(inverse, z, rows, weights, float(loss))


def _others(data: GainData, inverse: Array, z: Array, weights: Array) -> Array:
    """Return the best z for fixed inverse gains."""
    slopes, residuals = with_prior(data, *stacked(data, current_rows(data, inverse, z), weights), z)
    return z + solved(slopes[:, len(inverse) :], residuals)


def _total(data: GainData, weighted: GainFit) -> GainFit:
    """Return total least squares with rows weighted joint by joint, columns of unit norm."""
    groups, count = len(data.groups), data.unknowns.count
    start = torque_rows(data, np.zeros(groups), np.zeros(count))
    slopes, target = stacked(data, start, weighted.weights)
    norms, size = np.linalg.norm(slopes, axis=0), float(np.linalg.norm(target))
    live = norms > 0
    scaled = np.column_stack([slopes[:, live] / norms[live], target / size])
    values, vectors = np.linalg.svd(scaled)[1:]
    own = float(np.linalg.svd(scaled[:, :-1], compute_uv=False)[-1])
    if not (own > NULL * values[0] and values[-1] < 0.999 * own):
        raise SolverFailed(
            "total least squares for drive gains",
            f"a combination of columns is as small ({own:.2g} of their norm) as the residual ({values[-1]:.2g})",
            "use the method 'structured', which takes only the currents for noisy, or excite all joints more",
        )
    x = np.zeros(groups + count)
    x[live] = -vectors[-1, :-1] / vectors[-1, -1] / norms[live] * size
    rows = torque_rows(data, x[:groups], x[groups:])
    removed = (values[-1] * norms) ** 2
    return GainFit(x[:groups], x[groups:], weighted.weights, rows, removed, 1)
