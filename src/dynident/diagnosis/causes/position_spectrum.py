"""Periodic torque over the positions of drives: the spectrum of a residual over the position, not over time.

Cogging and eccentric gears go with the position: k cycles a turn are a line in the spectrum of the residual over it,
wherever the motion goes. A row counts by what the filter leaves of k cycles at its speed (frequency k |dq| / 2 pi), and
rows are summed in cells of the position and classes of the speed, so that one Fourier transform of each class has all
cycles at once. A line is one whose power is beyond chance over that of its neighbours, all cycles of all drives counted
(Fisher 1929), and that has the same size and phase in both directions of travel, as friction has not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.diagnosis.causes.held_out import judged
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.identification.problem.regressor_stream import motion_of

#: Name of the cause.
RIPPLE = "torque ripple"

#: Chance that a residual without ripple has a line, all cycles of all drives counted.
CHANCE = 1e-4

#: Cells of the position, classes of the speed in each direction, and samples of the filter's response.
CELLS, CLASSES, SAMPLES = 2048, 8, 1024

#: Fewest cycles a turn of a hinge, below which weight and inertia follow the position as well, and in the range.
FEWEST, FEWEST_IN_RANGE = 3.0, 2.0

#: Share of the rows that the filter leaves there at least, by power.
SEEN = 0.05

#: Cycles at half a line's width on each side from which the power of its neighbours counts, and up to which.
NEAR, FAR = 3, 25

#: Independent powers behind the median of the neighbours: two cycles a line's width.
FREEDOM = float(FAR - NEAR)

#: Power over that of its neighbours from which a line is looked at.
LOOK = 8.0

#: Difference of both directions, over their sum, up to which they have the same ripple.
ALIKE = 0.5

#: Half-widths of a line within which the likeliest cycles are looked for, and how many are tried.
SIDE, TRIED = 3.0, 49

#: Deviations of the cycles up to which a whole number is meant.
WHOLE = 2.0


@dataclass(frozen=True)
class PositionLine:
    """A periodic torque of a drive: a line in the spectrum over its position.

    Attributes:
        drive: Its number.
        cycles: Cycles a turn of its joint (2 pi m of a slide).
        std: Standard deviation of them.
    """

    drive: int
    cycles: float
    std: float

    @property
    def stated(self) -> float:
        """The cycles as they are stated: the one whole number that they may be, else two digits of their deviation."""
        whole = float(round(self.cycles))
        off, far = abs(self.cycles - whole), WHOLE * self.std
        digits = 1 - int(np.floor(np.log10(max(self.std, 1e-6))))
        return whole if off < far < 1.0 - off else round(self.cycles, max(0, digits))

    def columns(self, q: Array) -> tuple[Array, Array]:
        """Return sine and cosine at positions of its drive (N,), shape (N,) each."""
        return np.sin(self.stated * q), np.cos(self.stated * q)


def ripples(fit: QuickFit) -> tuple[PositionLine, ...]:
    """Return the strongest ripple of each drive whose residual has one."""
    coupling, motion = np.asarray(fit.model.robot.coupling), motion_of(fit.rows.prepared.kept)
    q, speed, residual = motion.q @ coupling.T, motion.dq @ coupling.T, fit.residual @ np.linalg.inv(coupling)
    masks = (fit.rows.masks.astype(float) @ (coupling.T != 0.0)) >= np.count_nonzero(coupling, axis=1)
    left, hinges = _FilterGain.of_fit(fit), [joint.kind == "revolute" for joint in fit.model.robot.active]
    spectra = {
        int(i): _Spectrum.of_rows(left, *(each[masks[:, i], i] for each in (q, speed, residual)))
        for i in np.flatnonzero(judged(masks))
    }
    looks, found = sum(len(one.cycles) // 2 for one in spectra.values()), list[PositionLine]()
    for i, spectrum in spectra.items():
        fewest = max(FEWEST * hinges[i], 2.0 * np.pi * FEWEST_IN_RANGE / float(spectrum.rows[0].max()))
        line = spectrum.strongest(fewest)
        if line is None:
            continue
        likely, after = _fits(fit, i, masks[:, i], spectrum.about(line), residual[:, i])
        noise = spectrum.with_residual(after).noise[line]
        if looks * (1.0 + float(likely.max() / noise) / FREEDOM) ** -FREEDOM < CHANCE:
            cycles, std = _top(spectrum.about(line), likely / noise)
            found += [PositionLine(i, cycles, std)] if cycles > fewest else []
    return tuple(found)


@dataclass(frozen=True)
class _FilterGain:
    """What a filter leaves of the sizes of frequencies.

    Attributes:
        hz: Frequencies in Hz, ascending, shape (f,).
        gains: The same, shape (f,).
    """

    hz: Array
    gains: Array

    @classmethod
    def of_fit(cls, fit: QuickFit) -> _FilterGain:
        """Return that of the filter of a fit."""
        pulse = np.zeros((1, SAMPLES))
        pulse[0, SAMPLES // 2] = 1.0
        response = np.abs(np.fft.rfft(fit.rows.prepared.smooth(pulse)[0]))
        return cls(np.fft.rfftfreq(SAMPLES, 1.0 / fit.rows.prepared.log.rate), response)

    def __call__(self, cycles: Array, speed: Array) -> Array:
        """Return it of cycles a turn (k,) at speeds (N,) in rad/s, shape (N, k); none beyond half the rate."""
        return np.interp(np.outer(np.abs(speed), cycles) / (2.0 * np.pi), self.hz, self.gains, right=0.0)


@dataclass(frozen=True)
class _Spectrum:
    """Spectrum of a drive's residual over its position.

    Attributes:
        left: What the filter leaves.
        rows: Position from its smallest on, speed and residual, shape (3, N).
        cycles: Cycles a turn, half a line's width apart, shape (k,).
        sums: Sum of the residual times what the filter leaves of exp(-i cycles q), by direction, shape (2, k).
        sizes: Half the sum of the squares of what the filter leaves, by direction, shape (2, k).
    """

    left: _FilterGain
    rows: Array
    cycles: Array
    sums: Array
    sizes: Array

    @classmethod
    def of_rows(cls, left: _FilterGain, q: Array, speed: Array, residual: Array) -> _Spectrum:
        """Return the spectrum of rows, shape (N,) each."""
        q, fast = q - q.min(), np.abs(speed)
        span = max(float(q.max()), 1e-9)
        cycles = np.pi / span * np.arange(CELLS // 2)
        edges = np.quantile(fast, np.linspace(0.0, 1.0, CLASSES + 1)[1:-1])
        kinds = np.searchsorted(edges, fast) + CLASSES * (speed > 0.0)
        cells = np.minimum((q / span * CELLS).astype(int), CELLS - 1)
        of_cells = np.bincount(kinds * CELLS + cells, residual, 2 * CLASSES * CELLS).reshape(-1, CELLS)
        counts = np.bincount(kinds, minlength=2 * CLASSES)
        mean = np.sqrt(np.bincount(kinds, fast**2, 2 * CLASSES) / np.maximum(counts, 1))
        gains = left(cycles, mean)
        sums, sizes = gains * np.fft.rfft(of_cells, 2 * CELLS)[:, : len(cycles)], 0.5 * gains**2 * counts[:, None]
        by_direction = [each.reshape(2, CLASSES, -1).sum(axis=1) for each in (sums, sizes)]
        return cls(left, np.stack([q, speed, residual]), cycles, *by_direction)

    @cached_property
    def power(self) -> Array:
        """Power of the residual at each of the cycles, shape (k,)."""
        return np.abs(self.sums.sum(axis=0)) ** 2 / np.maximum(self.sizes.sum(axis=0), 1e-300)

    @cached_property
    def noise(self) -> Array:
        """Mean power of the neighbours of each of the cycles by the medians of both sides, the larger, shape (k,)."""
        wide = np.pad(self.power, FAR, mode="symmetric")
        sides = np.median(np.lib.stride_tricks.sliding_window_view(wide, FAR - NEAR), axis=1)
        return np.maximum(np.maximum(sides[: len(self.power)], sides[FAR + NEAR + 1 :]) / np.log(2.0), 1e-300)

    def with_residual(self, residual: Array) -> _Spectrum:
        """Return the spectrum of another residual (N,): a line covers its neighbours where it is most of all."""
        return _Spectrum.of_rows(self.left, self.rows[0], self.rows[1], residual)

    def about(self, line: int) -> Array:
        """Return cycles about a line, in equal steps, by its number."""
        return self.cycles[line] + self.cycles[1] * np.linspace(-SIDE, SIDE, TRIED)

    def strongest(self, fewest: float) -> int | None:
        """Return the number of the line that stands out most, alike in both directions; None where none does.

        Lines of fewer cycles than ``fewest`` do not count.
        """
        size = self.sizes.sum(axis=0)
        seen = (size > 0.5 * SEEN * self.rows.shape[1]) & (self.cycles >= fewest)
        ratio = np.where(seen, self.power / self.noise, 0.0)
        best = int(np.argmax(ratio))
        either = self.sums[:, best] / np.maximum(self.sizes[:, best], 1e-300)
        is_alike = abs(either[1] - either[0]) < ALIKE * abs(either[0] + either[1])
        return best if ratio[best] > LOOK and is_alike else None


def _fits(fit: QuickFit, drive: int, mask: BoolArray, cycles: Array, residual: Array) -> tuple[Array, Array]:
    """Return the squares that ripples take off a residual, shape (k,), and what the best one leaves, shape (n,).

    Args:
        fit: The fit, whose columns at the drive's joint explain a part of a ripple.
        drive: Number of the drive.
        mask: The n rows that count, shape (N,).
        cycles: Cycles a turn, shape (k,).
        residual: That of the drive, shape (N,).
    """
    prepared, coupling = fit.rows.prepared, np.asarray(fit.model.robot.coupling)
    angles = np.outer(cycles, np.asarray(prepared.log.q) @ coupling[drive])
    waves = prepared.smooth(np.concatenate([np.sin(angles), np.cos(angles)]))[:, prepared.keep][:, mask].T
    basis, left = np.linalg.qr(fit.rows.blocks[drive][mask])[0], residual[mask]
    waves, left = (each - basis @ (basis.T @ each) for each in (waves, left))
    pairs = np.stack(np.split(waves, 2, axis=1), axis=1)
    sides = np.einsum("nik,n->ki", pairs, left)
    sizes = np.einsum("kij,kj->ki", np.linalg.pinv(np.einsum("nik,njk->kij", pairs, pairs), hermitian=True), sides)
    squares = np.sum(sizes * sides, axis=1)
    best = int(np.argmax(squares))
    return squares, left - pairs[:, :, best] @ sizes[best]


def _top(cycles: Array, likely: Array) -> tuple[float, float]:
    """Return where the logarithm of a likelihood (k,) is highest, and the standard deviation by its bend there."""
    top = int(np.clip(np.argmax(likely), 1, len(cycles) - 2))
    before, at, after = likely[top - 1 : top + 2]
    bend, step = min(float(before - 2.0 * at + after), -1e-9), float(cycles[1] - cycles[0])
    away = float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))
    return float(cycles[top]) + step * away, step / float(np.sqrt(-bend))
