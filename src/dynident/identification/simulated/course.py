"""What a simulated robot follows over a log: options of the closed loop, the reference, and where it starts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import scipy.linalg

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.errors import BadOption, LogMismatch, SolverFailed
from dynident.identification.problem.commanded_motion import commanded_motion, spline_derivatives
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.plugins import bounded
from dynident.simulation.plant import Plant

#: Rows at which the mass matrix is looked at.
LOOKS = 200

#: Rows, and seconds, of measured positions behind the state at the start.
START_ROWS, START_S = 8, 0.1

#: Places of the reference in an explicit step.
HALVES = np.array([0.0, 0.5])

_CHOICES = {
    "feedforward": ("auto", "none", "gravity", "computed", "measured"),
    "reference": ("auto", "commanded", "measured"),
}

#: Powers 0 to 5 of the place between two rows, for each end's value, slope and curvature: quintic Hermite.
_HERMITE = np.array(
    [
        [1, 0, 0, -10, 15, -6],
        [0, 1, 0, -6, 8, -3],
        [0, 0, 0.5, -1.5, 1.5, -0.5],
        [0, 0, 0, 10, -15, 6],
        [0, 0, 0, -4, 7, -3],
        [0, 0, 0, 0.5, -1, 0.5],
    ]
)


@dataclass(frozen=True)
class LoopOptions:
    """Options of the simulated closed loop.

    Where the controller is not stated a virtual one stands in: the torque of the current model along the reference is
    fed forward, and joint loops of ``bandwidth_hz`` hold the simulated robot on it. The reference is then the measured
    motion, so that simulated states follow the measured ones whatever the parameters.

    Attributes:
        kp: Stiffness of the controller at each joint in N m/rad or N/m; None where it is not known.
        kd: Damping of the controller at each joint in N m s/rad or N s/m; None where it is not known.
        control_hz: Ticks a second of a controller that holds its torque between them; None for one that acts all the
            time.
        feedforward: Torque added to the feedback: ``none``, ``gravity`` or ``computed`` of the current model along the
            reference, or ``measured``, that of the log; ``auto`` is ``none`` where gains are stated.
        bandwidth_hz: Natural frequency of the virtual controller's joint loops in Hz.
        reference: Motion to follow: ``commanded`` (``q_ref`` of the log) or ``measured``; ``auto`` takes the commanded
            one where the log has it and the gains are stated.
        reference_hz: Cut-off in Hz of a zero-phase filter of the measured reference; None leaves it as it was prepared.
    """

    allows_for_noise: ClassVar[bool] = True

    kp: tuple[float, ...] | None = None
    kd: tuple[float, ...] | None = None
    control_hz: float | None = bounded(None, least=1e-3, most=1e5)
    feedforward: Literal["auto", "none", "gravity", "computed", "measured"] = "auto"
    bandwidth_hz: float = bounded(8.0, least=1e-3, most=1e5)
    reference: Literal["auto", "commanded", "measured"] = "auto"
    reference_hz: float | None = bounded(None, least=1e-3, most=1e5)

    def check(self) -> None:
        """Refuse values that cannot be.

        Raises:
            BadOption: A value out of range, an unknown word, or one of the two gains without the other.
        """
        for name in ("control_hz", "bandwidth_hz", "reference_hz"):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise BadOption(name, value, "give a frequency in Hz above 0")
        for name, words in _CHOICES.items():
            if getattr(self, name) not in words:
                raise BadOption(name, getattr(self, name), f"choose one of: {', '.join(words)}")
        for name, other in (("kp", "kd"), ("kd", "kp")):
            gains = getattr(self, name)
            if gains is None and getattr(self, other) is not None:
                raise BadOption(name, None, f"state it with {other}, one number for each joint")
            if gains is not None and not all(0 <= gain < np.inf for gain in gains):
                raise BadOption(name, gains, "give numbers, 0 or more, one for each joint")


@dataclass(frozen=True)
class Course:
    """What a simulated robot follows over one log.

    Attributes:
        log: The preprocessed log.
        reference: q, dq and ddq to follow at its rows, shape (3, N, n).
        torque: Measured torque, its first and its second derivative, shape (3, N, n); None where it is not fed forward.
        start: q and dq at the first row, shape (2, n).
        rate: Samples a second.
    """

    log: Prepared
    reference: Array
    torque: Array | None
    start: Array
    rate: float

    def between(self, rows: slice, steps: int, places: Array) -> tuple[Motion, Array | None]:
        """Return the reference and the torque fed at ``places`` of each step of ``rows``, (k steps rows + 1, n) each.

        Args:
            rows: Samples of the log.
            steps: Steps from one row to the next.
            places: Shares of a step, from 0 to below 1, shape (k,); the end of the last step comes by itself.
        """
        place = np.add.outer(np.arange(steps), places).ravel() / steps
        q, dq, ddq = (_hermite(self.reference, rows, place, self.rate, order) for order in range(3))
        fed = None if self.torque is None else _hermite(self.torque, rows, place, self.rate, 0)
        return Motion(q, dq, ddq, temperature=self._temperature(rows, place)), fed

    def _temperature(self, rows: slice, place: Array) -> Array | None:
        """Return the temperatures of the log in a straight line between rows; None where it has none."""
        known = self.log.log.temperature
        if known is None:
            return None
        at = np.append(np.add.outer(np.arange(rows.start, rows.stop), place).ravel(), rows.stop)
        return np.stack([np.interp(at, np.arange(len(known)), own) for own in known.T], axis=1)

    def masses(self, body: Plant) -> Array:
        """Return mass matrices along the reference, shape (looks, n, n).

        Raises:
            NotConsistent: One is not positive definite.
        """
        return body.masses(self.reference[0, np.linspace(0, self.reference.shape[1] - 1, LOOKS).astype(int)])


def _hermite(rows: Array, wanted: slice, place: Array, rate: float, order: int) -> Array:
    """Return a derivative of the quintic through rows (3, N, n) at places between them and at the last one's end."""
    last = rows.shape[1]
    ends = rows[:, wanted.start : min(wanted.stop + 1, last)]
    if wanted.stop == last:  # beyond the last row the motion goes on as it was
        value, slope, bend = ends[:, -1]
        step = 1.0 / rate
        after = np.array([value + step * slope + step**2 / 2 * bend, slope + step * bend, bend])
        ends = np.concatenate([ends, after[:, None]], axis=1)
    scaled = ends * (1.0 / rate) ** np.arange(3)[:, None, None]
    pairs = np.concatenate([scaled[:, :-1], scaled[:, 1:]])
    places = np.append(place, 1.0)
    powers = np.zeros((len(places), 6))
    for k in range(order, 6):
        powers[:, k] = math.perm(k, order) * places ** (k - order)
    found = rate**order * np.einsum("sk,krj->rsj", powers @ _HERMITE.T, pairs)
    return np.concatenate([found[:, :-1].reshape(-1, rows.shape[2]), found[-1:, -1]])


def course_of(prepared: Prepared, options: LoopOptions, fed: str, known: bool) -> Course:
    """Return the course of one log.

    Args:
        prepared: The preprocessed log.
        options: With a reference that is not ``auto``.
        fed: What is fed forward.
        known: Whether the controller's gains are stated: the simulation then starts where the robot was.

    Raises:
        LogMismatch: The log has no commanded positions or no torques, and they are asked for.
    """
    log = prepared.log
    rate = (log.samples - 1) / log.duration
    if options.reference == "commanded":
        reference = commanded_motion(log)
    elif options.reference_hz is not None:
        reference = spline_derivatives(smoothed(log.q, min(options.reference_hz / rate, 0.4)), rate)
    else:
        measured = motion_of(log)
        reference = np.stack([measured.q, measured.dq, measured.ddq])
    behind = _first_state(reference[0] - log.q, rate) if known else np.zeros_like(reference[:2, 0])
    torque = None
    if fed == "measured":
        found = log.torque if log.raw_torque is None else log.raw_torque
        if found is None:
            raise LogMismatch(log.name, "no torques to feed forward", "map torque columns in the case file")
        torque = spline_derivatives(found, rate)
    return Course(prepared, reference, torque, reference[:2, 0] - behind, rate)


def refuse_states(model: DynamicModel, what: str) -> None:
    """Refuse friction with a state of its own where its derivative by the parameters would be asked for.

    Raises:
        BadOption: There is such a part; ``what`` says who asks.
    """
    for part in model.friction:
        if part.states:
            step = f"{what} has no derivative of its state; use didim or iv, or leave the part out"
            raise BadOption("friction", FRICTION.name_of(part), step)


def smoothed(signal: Array, cutoff: float) -> Array:
    """Return a signal, shape (N, n), without what is faster than ``cutoff``, in cycles a sample; its phase is kept.

    The minimiser of |x - signal|^2 + strength |third differences of x|^2 (Whittaker 1923): a zero-phase filter with the
    gain 1 / (1 + (f / cutoff)^6) at low frequencies, one half at the cut-off. Parabolas pass as they are, so the ends,
    unlike those of a filter that goes on beyond them, keep their velocity and acceleration.

    Raises:
        SolverFailed: The cut-off is so low that the equations are lost to rounding.
    """
    strength = (2.0 * np.sin(np.pi * cutoff)) ** -6
    differences = np.array([1.0, -3.0, 3.0, -1.0])
    count = len(signal)
    bands = np.zeros((4, count))
    bands[0] = 1.0
    for start in range(4):
        for other in range(start, 4):
            bands[other - start, start : count - 3 + start] += strength * differences[start] * differences[other]
    try:
        return scipy.linalg.solveh_banded(bands, signal, lower=True)
    except np.linalg.LinAlgError as error:
        evidence = f"its cut-off is one period in {1 / cutoff:.0f} samples"
        raise SolverFailed("the zero-phase filter", evidence, "give a higher frequency, such as 5 Hz") from error


def _first_state(signal: Array, rate: float) -> Array:
    """Return value and slope of a signal (N, n) at the first row by a cubic through the first rows, shape (2, n)."""
    count = min(len(signal), max(START_ROWS, round(START_S * rate)))
    time = np.arange(count) / rate
    found = np.linalg.lstsq(time[:, None] ** np.arange(4), signal[:count], rcond=None)[0]
    return found[:2]
