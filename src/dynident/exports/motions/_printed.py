"""Numbers as text, read back in SI units, and the proof that the printed samples are those of the plan."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.errors import FileError, SolverFailed
from dynident.excitation.design.limits import TOLERANCE
from dynident.excitation.design.plan import samples_text
from dynident.exports.base import Proof
from dynident.exports.motions._motion import DrivenMotion

#: Largest relative error of a number with twelve digits.
DIGITS_12 = 5e-12

#: Largest error in s that printed times may have: ROS counts nanoseconds.
CLOCK = 1e-9


@dataclass(frozen=True)
class Printed:
    """Samples as they stand in a file, read back from their text and turned into SI units.

    Attributes:
        time: Times in s, shape (M,).
        signals: q alone, or q, dq, ddq; shape (1, M, n) or (3, M, n), in rad or m and their derivatives.
        round_off: Largest error that the printed digits may make, shape (1, n) or (3, n).
        engine: What has read them back.
    """

    time: Array
    signals: Array
    round_off: Array
    engine: str = "dynident"


@dataclass(frozen=True)
class Decimals:
    """How the values of n joints are printed.

    Attributes:
        scale: Printed unit for each SI unit, shape (n,): 180 / pi for degrees, 1000 for mm.
        places: Digits after the point.
    """

    scale: Array
    places: int

    @property
    def round_off(self) -> Array:
        """Largest error in SI units that the digits make, shape (n,)."""
        return 0.5 * 10.0**-self.places / self.scale

    def texts(self, values: Array) -> list[list[str]]:
        """Return the values (M, n) as text, row by row; zero has no sign.

        Raises:
            SolverFailed: A value is not finite.
        """
        if not np.all(np.isfinite(values)):
            raise SolverFailed("the export", "a sample is not a finite number", "design the motion again")
        rounded = np.round(values * self.scale, self.places) + 0.0
        return [[f"{value:.{self.places}f}" for value in row] for row in rounded.tolist()]

    def read(self, texts: Sequence[Sequence[str]]) -> Array:
        """Return printed values in SI units, shape (M, n)."""
        return np.array([[float(text) for text in row] for row in texts]) / self.scale


def table(time: Array, signals: Array, scale: Array) -> tuple[bytes, Printed]:
    """Return the bytes of a table and what is printed in it.

    Args:
        time: Times (N,) in s.
        signals: q, dq, ddq (3, N, n) in SI units.
        scale: Printed unit for each SI unit, shape (n,).
    """
    text = samples_text(time, list(signals * scale + 0.0))
    found = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, ndmin=2)
    joints = signals.shape[2]
    read = found[:, 1:].reshape(len(found), 3, joints).transpose(1, 0, 2) / scale
    return text.encode("ascii"), Printed(found[:, 0], read, DIGITS_12 * np.abs(signals).max(axis=1))


def check_printed(motion: DrivenMotion, printed: Printed, what: str, path: Path) -> Proof:
    """Return how far printed positions are from the motion; ``what`` is compared, in words.

    Refused are samples that are not those of the motion, pass a bound or do not start and end at rest.

    Raises:
        FileError: One of these, by more than the printed digits explain.
    """
    step = "report it with the plan: nothing was written"
    if not (np.all(np.isfinite(printed.time)) and np.all(np.isfinite(printed.signals))):
        raise FileError(path, "a printed sample is not a finite number", step)
    all_four = np.stack([*motion.motion.evaluate(printed.time), motion.motion.jerk(printed.time)])
    exact, slopes = all_four[: len(printed.signals)], np.abs(all_four[1:]).max(axis=1, keepdims=True)
    rounding = TOLERANCE * np.maximum(1.0, np.abs(exact).max(axis=1, keepdims=True))
    room = 1.001 * printed.round_off[:, None, :] + rounding + CLOCK * slopes[: len(exact)]
    if np.any(np.abs(printed.signals - exact) > room):
        raise FileError(path, "the printed samples are not those of the plan", step)
    limits = motion.plan.limits
    bounds = limits.bounds()[: len(printed.signals), None, :] * (1 + TOLERANCE)
    away = np.abs(printed.signals)
    away[0] = np.abs(printed.signals[0] - limits.centre)
    if np.any(away > bounds + room):
        raise FileError(path, "a printed sample passes a bound of the plan", step)
    ends = np.stack(motion.motion.evaluate([0.0, motion.motion.duration]))[1:]
    still = 1e-6 * np.maximum(1.0, np.abs(exact).max())
    if np.any(np.abs(ends) > still) or np.any(np.abs(printed.signals[1:, [0, -1]]) > 0):
        raise FileError(path, "the motion does not start and end at rest", "design the motion again")
    away, size = (np.abs(q).max(axis=0) for q in (printed.signals[0] - exact[0], exact[0]))
    size = np.maximum(size, TOLERANCE)
    relative, allowed = float((away / size).max()), float((room[0].max(axis=0) / size).max())
    return Proof(printed.engine, what, len(printed.time), float(away.max()), relative, "", allowed)
