"""Power spectra of a log's signals: what the motion excites, and the white floor that its positions stand on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing._zero_phase import low_passed

#: Length of a segment of Welch's average in s, and samples of it at most.
SEGMENT_S, SEGMENT_SAMPLES = 10.0, 1 << 14

#: Part of the band below half the sampling rate in which positions are taken for noise alone.
NOISE_BAND = (0.5, 0.95)

#: Share of the power of the velocities that the excited band holds.
EXCITED = 0.99

#: Share of the power of positions within their band, and the highest excited frequency in terms of it: steps of
#: positions that are held have velocities at all frequencies.
WITHIN, HIGHEST = 0.999, 10.0

#: How far the power of the acceleration rises below its valley before it is that of the motion.
MOTION = 10.0

#: Deviation of rounding to the steps of positions, over that of their noise, up to which they are believed.
ROUNDED = 3.0

#: Bands an octave in which a spectrum is averaged.
PER_OCTAVE = 3


@dataclass(frozen=True)
class Spectra:
    """One-sided power spectra of a log on a uniform grid, averaged in bands of a third of an octave.

    Attributes:
        hertz: Middles of the bands, ascending, shape (F,).
        position: Power of the positions, shape (F, n), in rad^2/Hz (or m^2/Hz).
        torque: Power of the torques, shape (F, n), in (N m)^2/Hz; None where the log has none.
        floor: White floor of the positions, shape (n,), in rad^2/Hz.
        rate: Samples a second.
    """

    hertz: Array
    position: Array
    torque: Array | None
    floor: Array
    rate: float

    @property
    def deviation(self) -> Array:
        """Standard deviation of the white noise of a position sample, shape (n,), in rad or m."""
        return np.sqrt(self.floor * self.rate / 2)

    @property
    def valley_hz(self) -> Array:
        """Where the power of the acceleration is least between the motion and the noise above it, shape (n,).

        It is looked for from above: the power of noise falls towards it, that of the motion rises beyond it.
        """
        power = self.position * self.hertz[:, None] ** 4
        found = np.empty(power.shape[1])
        for joint, column in enumerate(power.T):
            least = np.minimum.accumulate(column[::-1])[::-1]
            risen = np.flatnonzero(column > MOTION * least)
            above = risen[-1] + 1 if len(risen) else 0
            found[joint] = self.hertz[above + int(np.argmin(column[above:]))]
        return found

    @property
    def excited_hz(self) -> Array:
        """Frequency below which nearly all power of each joint's velocity up to its valley lies, shape (n,)."""
        width = np.gradient(self.hertz) if len(self.hertz) > 1 else np.ones(1)
        inside = self.hertz[:, None] <= self.valley_hz
        position = np.where(inside, self.position * width[:, None], 0.0)
        velocity = position * self.hertz[:, None] ** 2
        found = [
            self.hertz[np.argmax(np.cumsum(power, axis=0) >= share * power.sum(axis=0), axis=0)]
            for power, share in ((velocity, EXCITED), (position, WITHIN))
        ]
        return np.minimum(found[0], HIGHEST * found[1])


def spectra_of(log: Log) -> Spectra:
    """Return the spectra of a uniformly sampled log (Welch 1967)."""
    hertz, position = in_bands(*power_spectrum(log.q, log.rate))
    torque = None if log.torque is None else in_bands(*power_spectrum(log.torque, log.rate))[1]
    return Spectra(hertz, position, torque, noise_floor(log.q, log.rate), log.rate)


def power_spectrum(signal: Array, rate: float) -> tuple[Array, Array]:
    """Return frequencies (F,) in Hz, from above 0 to below half the rate, and the one-sided power of a signal (F, n).

    The signal is differenced twice first and the power divided by what that does to it, so that the slow motion, many
    orders stronger than the noise, does not leak over it.
    """
    jerky = np.diff(signal, 2, axis=0)
    length = min(len(jerky), max(16, int(SEGMENT_S * rate)), SEGMENT_SAMPLES)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    starts = range(0, len(jerky) - length + 1, length - length // 2)
    power = np.zeros((length // 2 + 1, jerky.shape[1]))
    for start in starts:
        power += np.abs(np.fft.rfft(jerky[start : start + length] * window[:, None], axis=0)) ** 2
    power *= 2.0 / (len(starts) * rate * np.sum(window**2))
    hertz = np.fft.rfftfreq(length, 1.0 / rate)
    gain = (2.0 * np.sin(np.pi * hertz / rate)) ** 4
    return hertz[1:-1], power[1:-1] / gain[1:-1, None]


def in_bands(hertz: Array, power: Array) -> tuple[Array, Array]:
    """Return the middles (B,) of bands of a third of an octave and the mean of a power (F, n) in each, (B, n)."""
    number = np.floor(PER_OCTAVE * np.log2(hertz / hertz[0]) + 1e-9).astype(int)
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(np.append(starts, len(hertz)))
    return np.add.reduceat(hertz, starts) / counts, np.add.reduceat(power, starts, axis=0) / counts[:, None]


def noise_floor(signal: Array, rate: float) -> Array:
    """Return the one-sided power of the white noise of a signal (N, n), shape (n,), its unit squared per Hz.

    The median over the upper half of the frequencies, where an arm does not move, so that single resonances and
    harmonics do not count; of the power in bands of thirty, whose median is next to its mean.
    """
    hertz, power = power_spectrum(signal, rate)
    high = (hertz >= NOISE_BAND[0] * rate / 2) & (hertz <= NOISE_BAND[1] * rate / 2)
    kept = power[high] if high.any() else power
    bands = max(1, len(kept) // 30)
    return np.median([part.mean(axis=0) for part in np.array_split(kept, bands)], axis=0)


def like_noise(log: Log, steps: Array, generator: np.random.Generator) -> Array:
    """Return noise as the positions of a uniform log have, shape (N, n).

    It is white, of the power above the motion. Of positions with steps, shape (n,), 0 for none, it is what rounding to
    them adds to the motion: errors of the frequency of the steps, of which little passes a filter but at slow motion.
    """
    spectra = spectra_of(log)
    white, rounding = spectra.deviation, steps / 12**0.5
    rounded = (steps > 0) & (rounding < ROUNDED * white)
    rest = np.sqrt(np.maximum(white**2 - np.where(rounded, rounding, 0.0) ** 2, 0.0))
    noise, step = rest * generator.normal(size=log.q.shape), np.where(rounded, steps, 1.0)
    if not np.any(rounded):
        return noise
    motion = low_passed(log.q, 4, min(spectra.valley_hz.max(), 0.4 * log.rate), log.rate)
    motion = motion + step * generator.uniform(-0.5, 0.5, len(step))
    return np.where(rounded, step * np.round((motion + noise) / step) - motion, noise)
