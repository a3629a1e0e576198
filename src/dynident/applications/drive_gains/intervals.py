"""Intervals of drive gains: the coloured covariance of the fit's linearised rows, carried to the gains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dynident.applications.drive_gains.gain_data import NULL, GainData, stacked, with_prior
from dynident.applications.drive_gains.methods import GainFit
from dynident.arrays import Array, BoolArray, IntArray
from dynident.identification.residuals.bands import Band, bands_of
from dynident.identification.residuals.coloured import Influence, uncertainty_of
from dynident.identification.residuals.quantiles import normal_quantile, student_quantile
from dynident.identification.residuals.stretches import stretches

#: Share of an unknown that may lie in what the rows do not determine before it counts as not determined.
OPEN = 1e-6


@dataclass(frozen=True)
class GainSpread:
    """How sure the gains are.

    Attributes:
        covariance: Of the relative errors of the gains, shape (G, G); rows and columns of open ones are zero.
        low: Lower end of each interval, shape (G,), in N m/A; -inf where there is none.
        high: Its upper end, shape (G,); inf where there is none.
        open: Which gains no row determines, whatever the noise, shape (G,).
        half: Half the relative interval of each gain, shape (G,).
        by_known: Part of the relative variance that is of what is known beforehand within a share, shape (G,).
    """

    covariance: Array
    low: Array
    high: Array
    open: BoolArray
    half: Array
    by_known: Array

    def share_for(self, half: float) -> Array:
        """Return by which factor a better knowledge beforehand makes each half interval so wide, (G,), to first order.

        NaN where the logs alone leave it wider.
        """
        variance = np.diag(self.covariance)
        told = ~self.open & (variance > 0) & (self.by_known > 0)
        found = np.full(len(told), np.nan)
        quantiles = self.half[told] / np.sqrt(variance[told])
        room = (half / quantiles) ** 2 - (variance - self.by_known)[told]
        found[told] = np.sqrt(np.where(room > 0, room, np.nan) / self.by_known[told])
        return found

    @property
    def deviations(self) -> Array:
        """Relative standard deviation of each gain, shape (G,); infinite where it is open."""
        return np.where(self.open, np.inf, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def spread_of(data: GainData, fit: GainFit, scale_share: float = 0.0, level: float = 0.95) -> GainSpread:
    """Return the intervals of fitted gains.

    Args:
        data: Reduced rows.
        fit: What a method found.
        scale_share: Relative standard deviation of what sets the scale (the payload's mass): all gains have it alike.
        level: Of confidence.
    """
    groups = len(data.groups)
    whole, open_ = _coordinates(data, fit)
    sure = np.flatnonzero(~open_)
    covariance, degrees, by_known = np.zeros((groups, groups)), np.full(groups, np.inf), np.zeros(groups)
    if len(sure):
        covariance[np.ix_(sure, sure)], degrees[sure], by_known[sure] = _covariance(data, fit, whole, sure)
    value = 1.0 / fit.gains if fit.rows.inverse else np.where(fit.gains == 0, 1e-100, fit.gains)
    covariance = covariance / value / value[:, None]  # relative errors of K and 1 / K differ by their sign alone
    noise = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * student_quantile(0.5 + 0.5 * level, degrees)
    half = np.hypot(noise, scale_share * normal_quantile(0.5 + 0.5 * level))
    if fit.rows.inverse:  # symmetric in 1 / K, and with an end in K only where it leaves out zero
        near, far = 1.0 / (1.0 + half), 1.0 / np.where(half < 1, 1.0 - half, 1.0)
    else:
        near, far = 1.0 - half, 1.0 + half
    ends = np.sort(np.stack([fit.gains * near, fit.gains * far]), axis=0)
    endless = open_ | (half >= 1 if fit.rows.inverse else False)
    shared = np.where(np.outer(~open_, ~open_), covariance + scale_share**2, 0.0)
    ends = np.where(endless, np.array([[-np.inf], [np.inf]]), ends)
    return GainSpread(shared, ends[0], ends[1], open_, half, by_known / value**2)


def _coordinates(data: GainData, fit: GainFit) -> tuple[Array, BoolArray]:
    """Return x = whole u (P, R) with the unit matrix as the Gram matrix of u, and which gains are left open."""
    groups = len(data.groups)
    slopes, _ = with_prior(data, *stacked(data, fit.rows, fit.weights), fit.z)
    norms = np.linalg.norm(slopes, axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    _, sizes, directions = np.linalg.svd(slopes / scale, full_matrices=True)
    rank = int(np.sum(sizes > NULL * sizes[0]))
    open_ = (np.sum(directions[rank:, :groups] ** 2, axis=0) > OPEN) | (norms[:groups] == 0)
    kept = directions[:rank].T
    if not np.any(fit.removed):
        return kept / scale[:, None] / sizes[:rank], open_
    gram = np.diag(sizes[:rank] ** 2) - kept.T @ (fit.removed / scale**2 * kept.T).T
    squares, turn = np.linalg.eigh(0.5 * (gram + gram.T))
    return kept @ turn / scale[:, None] / np.sqrt(np.maximum(squares, NULL**2 * squares[-1])), open_


def _covariance(data: GainData, fit: GainFit, whole: Array, sure: IntArray) -> tuple[Array, Array, Array]:
    """Return the covariance of some of the gains' coordinates, each variance's degrees of freedom and its known part.

    Args:
        data: Reduced rows.
        fit: What a method found.
        whole: See :func:`_coordinates`.
        sure: The G' coordinates, those of gains that are not open.
    """
    residual = np.concatenate(
        [rows.group_residuals(vectors) for rows, vectors in zip(data.rows, fit.rows.vectors, strict=True)]
    )
    groups, squares = len(data.groups), fit.weights**2
    spread = fit.weights * np.sqrt(np.sum(residual**2, axis=0) / np.maximum(data.counts, 1.0))
    meat = stacked(data, fit.rows, fit.weights * spread)[0] @ whole
    unit = np.eye(whole.shape[1])
    influence = Influence(squares[:, None, None] * unit, meat.T @ meat, np.eye(groups))
    asked = squares[:, None, None] * whole[sure]
    found = uncertainty_of(_bands(data, fit, whole), residual, influence, asked)
    known = np.flatnonzero(np.isfinite(data.unknowns.deviations))
    if not len(known):
        return found.covariance, found.degrees, np.zeros(len(sure))
    lever = whole[sure] @ (whole[groups + known] / data.unknowns.deviations[known][:, None]).T
    found = found.with_prior(lever @ lever.T)
    return found.covariance, found.degrees, np.sum(lever**2, axis=1)


def _bands(data: GainData, fit: GainFit, whole: Array) -> Iterator[Band]:
    """Yield the linearised rows of all runs by frequency, in the coordinates u of ``whole``."""
    start = 0
    for rows, maps in zip(data.rows, fit.rows.maps, strict=True):
        turned = maps @ whole
        for band in bands_of(stretches(rows), rows.columns, rows.size):
            linear = np.stack([band.rows[:, g] @ own for g, own in enumerate(turned)], axis=1)
            yield replace(band, samples=band.samples + start, rows=linear)
        start += len(rows.counting)
