"""Motions for one position servo: commands and torque-enable over time, before any limit is looked at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from dynident.arrays import Array, BoolArray

#: Frequencies of a chirp in Hz: its lowest, and its highest at most.
CHIRP_HZ: Final = (0.2, 3.0)

#: Samples per period that the highest frequency of a chirp has at least.
_PER_PERIOD = 12.0

#: Levels of the steps, as shares of their amplitude.
_LEVELS = (0.0, 0.3, -0.3, 0.6, -0.6, 1.0, -1.0, 0.0)

#: Levels of short releases, as shares of their amplitude.
_RELEASES = (1.0, 0.5, 0.0, -0.5, -1.0)

#: Speed of the slow ramps in rad/s or m/s, at most.
_SLOW = 0.3

#: Lift before a release and hold at its end, in s.
_LIFT_S, _HOLD_S = 1.0, 0.3

#: Share of the speed limit that commanded speeds keep; the envelope of a chirp adds to its own speed.
_OF_SPEED = 0.9


@dataclass(frozen=True)
class ServoMotion:
    """Commands of one joint; the other joints stay where they are.

    Attributes:
        kind: chirp, steps, ramps or release.
        words: What it does, with its figures.
        time: Shape (N,), in s.
        command: Commanded positions, shape (N,), in rad or m.
        enabled: Whether the drive is on, shape (N,).
    """

    kind: str
    words: str
    time: Array
    command: Array
    enabled: BoolArray

    @property
    def has_off(self) -> bool:
        """Whether the drive is off somewhere."""
        return not bool(self.enabled.all())


@dataclass(frozen=True)
class MotionFrame:
    """What the motions of a joint are made within.

    Attributes:
        centre: Position that they go about, in rad or m.
        reach: Distance from it to the nearer end of the range, in rad or m.
        speed: Largest speed, in rad/s or m/s.
        rate: Commands a second.
        seconds: Length of a motion.
        most: Largest amplitudes in rad or m, by kind.
        carries_weight: Whether its weight moves the joint where the drive is off.
    """

    centre: float
    reach: float
    speed: float
    rate: float
    seconds: float
    most: dict[str, float]
    carries_weight: bool

    @property
    def time(self) -> Array:
        """Times of the commands, shape (N,), in s."""
        return np.arange(round(self.seconds * self.rate) + 1) / self.rate

    def amplitude(self, kind: str, share: float) -> float:
        """Return the amplitude of a kind at a share of the largest possible one."""
        return share * min(self.reach, self.most[kind])

    def scaled(self, kind: str, share: float) -> ServoMotion:
        """Return the motion of a kind at a share of its largest amplitude."""
        return _MAKERS[kind](self, self.amplitude(kind, share))


def _chirp(frame: MotionFrame, size: float) -> ServoMotion:
    """Return a sine whose frequency rises evenly; where the speed would pass its limit the amplitude falls."""
    time = frame.time
    low, high = CHIRP_HZ[0], min(CHIRP_HZ[1], frame.rate / _PER_PERIOD)
    frequency = low + (high - low) * time / frame.seconds
    phase = 2.0 * np.pi * (low + 0.5 * (high - low) * time / frame.seconds) * time
    envelope = np.minimum(size, _OF_SPEED * frame.speed / (2.0 * np.pi * frequency))
    ends = np.minimum(1.0, np.minimum(time, frame.seconds - time) / 0.5)
    words = f"{low:g} to {high:.3g} Hz, amplitude {size:.3g} down to {envelope[-1]:.3g}"
    return _always_on("chirp", words, time, frame.centre + ends * envelope * np.sin(phase))


def _steps(frame: MotionFrame, size: float) -> ServoMotion:
    """Return steps that grow, to both sides."""
    time = frame.time
    place = np.minimum((time / frame.seconds * len(_LEVELS)).astype(int), len(_LEVELS) - 1)
    return _always_on(
        "steps", f"up to {2.0 * size:.3g} from side to side", time, frame.centre + size * np.array(_LEVELS)[place]
    )


def _ramps(frame: MotionFrame, size: float) -> ServoMotion:
    """Return slow ramps in both directions."""
    time = frame.time
    size, speed = _whole_periods(frame, size, min(_SLOW, 0.5 * frame.speed))
    return _always_on("ramps", f"{speed:.3g} a second", time, frame.centre + _triangle(time, size, speed))


def _always_on(kind: str, words: str, time: Array, command: Array) -> ServoMotion:
    return ServoMotion(kind, words, time, command, np.ones(len(time), dtype=bool))


def _whole_periods(frame: MotionFrame, size: float, speed: float) -> tuple[float, float]:
    """Return amplitude and speed of a triangle wave, at most as large, that ends where it begins."""
    size = min(size, speed * frame.seconds / 4.0)
    periods = int(speed * frame.seconds / (4.0 * size) + 1e-9)
    return size, 4.0 * size * periods / frame.seconds


def _triangle(time: Array, size: float, speed: float) -> Array:
    """Return a triangle wave that starts at 0, shape (N,)."""
    return 2.0 * size / np.pi * np.arcsin(np.sin(0.5 * np.pi * speed / size * time))


def _release(frame: MotionFrame, size: float) -> ServoMotion:
    """Return lifts to both sides with the drive off afterwards; without weight, the drive off at speed instead."""
    if not frame.carries_weight:
        return _coast(frame, size)
    time, half = frame.time, 0.5 * frame.seconds
    within = np.minimum(time, frame.seconds - 1e-9) % half
    lift = max(_LIFT_S, size / (_OF_SPEED * frame.speed))
    off = within >= lift + _HOLD_S
    command = np.where(off, 0.0, np.where(time < half, 1.0, -1.0) * size * np.minimum(within / lift, 1.0))
    words = f"lift by {size:.3g} to each side, off for {half - lift - _HOLD_S:.3g} s"
    return ServoMotion("release", words, time, frame.centre + command, ~off)


def caught_release(frame: MotionFrame, share: float, seconds: float) -> ServoMotion:
    """Return short releases at levels on both sides: the drive is on again before the joint falls far.

    Args:
        frame: What the motion is made within.
        share: Share of the largest possible amplitude.
        seconds: Longest time with the drive off.
    """
    time, size = frame.time, frame.amplitude("release", share)
    cycle = max(2.0 * seconds + size / (_OF_SPEED * frame.speed), 0.75)
    count = max(int(frame.seconds / cycle), 1)
    place = np.minimum(np.floor(time / frame.seconds * count + 1e-9), count - 1.0)
    within = time - place * frame.seconds / count
    off = (within >= frame.seconds / count - 1.5 * seconds) & (within < frame.seconds / count - 0.5 * seconds)
    levels = size * np.array(_RELEASES)[(place % len(_RELEASES)).astype(int)]
    levels[-1] = 0.0
    words = f"off for {seconds:.3g} s at levels up to {size:.3g}, {count} times"
    return ServoMotion("release", words, time, frame.centre + levels, ~off)


def _coast(frame: MotionFrame, size: float) -> ServoMotion:
    time = frame.time
    size, speed = _whole_periods(frame, size, min(_OF_SPEED * frame.speed, 4.0 * size / 1.5))
    phase = speed * time / size  # 4 a period; through the middle at 0, 2, 4, ...
    off = (phase % 2.0 < 0.5) & (phase >= 2.0) & (phase < phase[-1] - 1e-6)
    words = f"off for {0.5 * size / speed:.3g} s at {speed:.3g} a second, {int(phase[-1] / 2)} times"
    return ServoMotion("release", words, time, frame.centre + _triangle(time, size, speed), ~off)


_MAKERS: Final[dict[str, Callable[[MotionFrame, float], ServoMotion]]] = {
    "chirp": _chirp,
    "steps": _steps,
    "ramps": _ramps,
    "release": _release,
}

#: Kinds of motions, in the order of a record.
KINDS: Final = tuple(_MAKERS)

#: Largest amplitudes of a joint that turns, in rad, by kind.
MOST_TURN: Final = {"chirp": 0.8, "steps": 1.2, "ramps": 0.6, "release": 1.2}
