"""Monitor: thresholds for the observer's residual from clean runs, and one step of a stream."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
import numpy.typing as npt

from dynident.applications.monitor.band import BandWeights, Tail, fitted_band, lagged, shapes, shrunk, tail_of
from dynident.applications.monitor.momentum_observer import MomentumObserver
from dynident.applications.monitor.signals import Signals, held_share, residuals_of
from dynident.applications.standstill import StatePaths, end_states, state_paths
from dynident.arrays import Array, frozen
from dynident.errors import BadOption, LogMismatch
from dynident.model.friction import Motion

#: Time constants of the observer below the threshold after which an alarm is over.
APART = 5.0

#: Factor between the sampling rates of a run and of the clean runs up to which their noise is about the same.
NEAR_RATE = 1.2

#: Share of the clean runs in which a joint moves from which on their rests count by what static friction cannot hold.
MOVING = 0.1


@dataclass(frozen=True)
class Monitor:
    """A momentum observer with a threshold for each joint.

    The threshold of a joint is its factor times its torque band, the standard deviation of the residual at that state:
    wider where the model is less sure. Where drives rest what static friction can hold comes on top.

    Attributes:
        observer: The observer.
        band: The torque band.
        factors: Shape (n,).
        rates: False alarms a second that were asked for, shape (n,).
        tails: Of each joint's residual over its band, by which the factors were found.
        clean_steps: Shortest and longest seconds a sample of the clean runs.
    """

    observer: MomentumObserver
    band: BandWeights
    factors: Array
    rates: Array
    tails: tuple[Tail, ...]
    clean_steps: tuple[float, float]

    def __post_init__(self) -> None:
        joints = self.observer.model.robot.dof
        for name in ("factors", "rates"):
            object.__setattr__(self, name, frozen(getattr(self, name), (joints,), name))

    def other_rate(self, step: float) -> str:
        """Return what to do where samples of ``step`` s are at another rate than the clean runs; empty for nothing.

        Noise of the residual goes with the sampling rate: that of velocities made of positions with the rate itself.
        """
        low, high = self.clean_steps
        if low / NEAR_RATE <= step <= high * NEAR_RATE:
            return ""
        own = f"{1 / high:.4g}" if high <= low * NEAR_RATE else f"{1 / high:.4g} to {1 / low:.4g}"
        return (
            f"{1 / step:.4g} samples a second, and thresholds of clean runs with {own}: noise goes with the rate, so "
            "that false alarms are more or fewer than chosen; name clean runs of this rate (--clean), or send that rate"
        )

    def rate_range(self) -> tuple[float, float]:
        """Return between which rates a second that of a joint lies with 90 %, the widest of the joints."""
        ends = [np.quantile(t.rates(size), [0.05, 0.95]) for t, size in zip(self.tails, self.factors, strict=True)]
        return float(np.min(ends)), float(np.max(ends))

    def longest_step(self, usual: float) -> float:
        """Return the longest step of a stream that is no gap, in s, by its ``usual`` one and that of the clean runs."""
        return self.observer.longest_step(max(usual, self.clean_steps[1]))

    def thresholds(self, run: Signals) -> Array:
        """Return the threshold of each joint along a run, shape (N, n), in N m or N."""
        return np.sum(self.parts(run), axis=0)

    def parts(self, run: Signals) -> tuple[Array, Array]:
        """Return the thresholds without static friction, and what it can hold at rest, shape (N, n) each."""
        observer, found, held = self.observer, [], []
        start = 0
        for terms in observer.chunks(run.q, run.dq, run.step, run.temperature, run.first):
            dq = run.dq[start : start + len(terms.momentum)]
            found.append(self.band.variances(terms, observer.deviations(terms), dq))
            held.append(terms.held)
            start += len(dq)
        keep = float(np.exp(-observer.gain * run.step))
        own = np.asarray(self.factors) * np.sqrt(lagged(np.concatenate(found), keep))
        return own, held_share(np.concatenate(held), keep)


@dataclass(frozen=True)
class MonitorState:
    """What a stream keeps from one sample to the next: a few numbers a joint, however long it runs.

    Attributes:
        time: Of the last sample, in s; None before the first.
        momentum: Then, shape (n,).
        push: Measured torque less the model's drift then, shape (n,).
        residual: Torque from outside, shape (n,), in N m or N.
        variance: Of the residual without contact, shape (n,).
        active: Time at which each joint was last above its threshold, shape (n,); -inf for never.
        q: Positions of the last sample, shape (n,), in rad or m.
        friction: States of friction then, shape (n, s); None where none has one.
        held: How much of the residual static friction can be, and how much it could hold then, shape (n,) each.
        ends: States of friction from both ends at the start or a gap on, shape (n, s) each; None once they have come
            together.
        shortest: Shortest step so far, in s.
    """

    time: float | None = None
    momentum: Array | None = None
    push: Array | None = None
    residual: Array | None = None
    variance: Array | None = None
    active: Array | None = None
    q: Array | None = None
    friction: Array | None = None
    held: tuple[Array, Array] | None = None
    ends: StatePaths | None = None
    shortest: float = np.inf


@dataclass(frozen=True)
class MonitorSample:
    """One sample of a monitored stream.

    Attributes:
        time: In s.
        residual: Torque from outside, shape (n,), in N m or N.
        threshold: Shape (n,).
        held: How much of it is what static friction can hold at rest, shape (n,).
        above: Joints above their threshold.
        alarms: Those of them whose alarm begins here.
        is_new: Whether the observer begins here: at the start, and after a gap.
    """

    time: float
    residual: Array
    threshold: Array
    held: Array
    above: tuple[str, ...]
    alarms: tuple[str, ...]
    is_new: bool = False


@dataclass(frozen=True)
class Alarm:
    """A joint above its threshold.

    Attributes:
        joint: Name.
        start: When it rose above, in s.
        end: When it was last above, in s.
        peak: Largest torque from outside meanwhile, with its sign, in N m or N.
        threshold: At the peak.
    """

    joint: str
    start: float
    end: float
    peak: float
    threshold: float


def calibrated(observer: MomentumObserver, clean: Sequence[Signals], rates: npt.ArrayLike) -> Monitor:
    """Return a monitor whose joints raise false alarms at chosen rates, by the residuals of clean runs.

    Args:
        observer: The observer.
        clean: Signals of runs without contact, such as the monitored robot will make.
        rates: False alarms a second, one number or one per joint.

    Raises:
        BadOption: A rate that is not above 0.
        LogMismatch: Too little was recorded to know how often a residual rises.
    """
    model = observer.model
    wanted = np.asarray(rates, dtype=float)
    if wanted.shape not in ((), (model.robot.dof,)) or not np.all((wanted > 0) & np.isfinite(wanted)):
        step = f"give false alarms a second, above 0: one number, or one for each of the {model.robot.dof} joints"
        raise BadOption("rates", wanted.tolist(), step)
    wanted = np.broadcast_to(wanted, (model.robot.dof,))
    if not clean:
        raise LogMismatch("monitor", "no clean run", "give at least one log without contact")
    clean = [part for run in clean for part in run.stretches(observer)]
    band, shares = _band_and_shares(observer, clean)
    steps = [run.step for run in clean]
    tails = shrunk(
        [
            tail_of([one[:, j] for one in shares], steps, 1.0 / observer.gain, name)
            for j, name in enumerate(model.robot.joint_names)
        ]
    )
    factors = []
    for tail, rate, name in zip(tails, wanted, model.robot.joint_names, strict=True):
        if rate >= tail.rate:
            step = f"choose a rate below {3600 * tail.rate:.3g} alarms an hour for {name}"
            raise BadOption("rates", float(rate), step)
        factors.append(tail.threshold(float(rate)))
    return Monitor(observer, band, np.array(factors), wanted, tails, (min(steps), max(steps)))


def _band_and_shares(observer: MomentumObserver, clean: Sequence[Signals]) -> tuple[BandWeights, list[Array]]:
    """Return the band of clean runs, and the residual of each over it once the start is forgotten, (N, n) each.

    Of joints that move it is what static friction cannot hold at rest.
    """
    speeds = np.maximum(np.sqrt(np.mean(np.concatenate([run.dq**2 for run in clean]), axis=0)), 1e-9)
    keeps = [float(np.exp(-observer.gain * run.step)) for run in clean]
    residuals, moments, held = [], [], []
    for run, keep in zip(clean, keeps, strict=True):
        terms = list(observer.chunks(run.q, run.dq, run.step, run.temperature, run.first))
        ends = np.cumsum([0, *(len(one.momentum) for one in terms)])
        parts = zip(terms, ends, ends[1:], strict=False)
        moments.append(np.concatenate([shapes(o, observer.deviations(o), run.dq[a:b], speeds) for o, a, b in parts]))
        held.append(held_share(np.concatenate([one.held for one in terms]), keep))
        residuals.append(residuals_of(observer, run))
    moving = np.mean(np.concatenate(held) == 0.0, axis=0) >= MOVING
    pairs = zip(residuals, held, strict=True)
    residuals = [np.where(moving, np.maximum(np.abs(one) - own, 0.0), np.abs(one)) for one, own in pairs]
    starts = [_settled(run, observer) for run in clean]
    cut = [(one[s:], rows[s:]) for one, rows, s in zip(residuals, moments, starts, strict=True)]
    band = fitted_band([one for one, _ in cut], [rows for _, rows in cut], keeps, speeds)
    shares = []
    for residual, rows, keep, start in zip(residuals, moments, keeps, starts, strict=True):
        variance = lagged(np.einsum("sjf,jf->sj", rows, band.weights), keep)
        shares.append((residual / np.sqrt(variance))[start:])
    return band, shares


def _settled(run: Signals, observer: MomentumObserver) -> int:
    """Return the first sample at which the observer and what friction remembers have forgotten their start."""
    return min(max(round(APART / observer.gain / run.step), observer.known_from(run.q)), len(run.time) // 2)


def step(
    monitor: Monitor,
    state: MonitorState,
    time: float,
    q: npt.ArrayLike,
    dq: npt.ArrayLike,
    torque: npt.ArrayLike,
    temperature: npt.ArrayLike | None = None,
) -> tuple[MonitorState, MonitorSample]:
    """Return the next state and the reading of one sample of a stream; start with ``MonitorState()``.

    The residual is that of :func:`residuals_of` on a whole log, to rounding. After a gap
    (:meth:`MomentumObserver.longest_step`) the observer begins anew, and presliding may be anywhere.

    Args:
        monitor: The monitor.
        state: Of the sample before.
        time: In s.
        q: Positions, shape (n,), in rad or m.
        dq: Velocities, shape (n,), in rad/s or m/s.
        torque: Measured torques, shape (n,), in N m or N, of the same instant as the positions.
        temperature: Of the drives, shape (n,), where friction depends on it.

    Raises:
        BadOption: A shape that does not fit the robot.
        LogMismatch: Time that does not run forward, or a value that is no finite number.
    """
    observer, names = monitor.observer, monitor.observer.joint_names
    here, speed, effort = (_row(names, name, one) for name, one in (("q", q), ("dq", dq), ("torque", torque)))
    warm = None if temperature is None else _row(names, "temperature", temperature)
    way, since = here if state.q is None else np.stack([np.asarray(state.q), here[0]]), _since(state, time)
    is_new = state.time is None or since > monitor.longest_step(min(state.shortest, since))
    speeds = np.repeat(speed, len(way), axis=0)
    states, ends = _states_after(monitor, state, is_new, Motion(way, speeds, np.zeros_like(way)), since)
    terms = observer.equations.at(here, speed, warm, states, ends, observer.equations.rests(speed, since))
    momentum, push = terms.momentum, effort - terms.drift
    fresh = monitor.band.variances(terms, observer.deviations(terms), speed)[0]
    if is_new:
        residual, variance, held = np.zeros(len(names)), fresh, np.zeros(len(names))
    else:
        residual, variance, held = _followed(observer, state, since, (momentum[0], push[0]), (fresh, terms.held[0]))
    threshold = np.asarray(monitor.factors) * np.sqrt(variance) + held
    above = np.abs(residual) > threshold
    last = np.asarray(np.full(len(names), -np.inf) if state.active is None else state.active)
    named, begun = (tuple(compress(names, each)) for each in (above, above & (time - last > APART / observer.gain)))
    following = MonitorState(
        time=float(time),
        momentum=momentum[0],
        push=push[0],
        residual=residual,
        variance=variance,
        active=np.where(above, time, last),
        q=here[0],
        friction=None if states is None else states[0],
        held=(held, terms.held[0]),
        ends=None if ends is None or np.array_equal(*ends) else (ends[0][0], ends[1][0]),
        shortest=min(state.shortest, since or np.inf),
    )
    return following, MonitorSample(float(time), residual, threshold, held, named, begun, is_new)


def _since(state: MonitorState, time: float) -> float:
    """Return the time since the sample before, in s; 0 at the first one."""
    if not np.isfinite(time) or (state.time is not None and time <= state.time):
        raise LogMismatch("stream", f"time {time:g} s after {state.time} s", "send samples in order, each once")
    return 0.0 if state.time is None else time - state.time


def _followed(
    observer: MomentumObserver, state: MonitorState, since: float, here: tuple[Array, Array], now: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Return residual, its variance without contact and how much of it static friction can be, shape (n,) each.

    Args:
        observer: The observer.
        state: Of the sample before.
        since: Time since then, in s.
        here: Momentum, and measured torque less the model's drift, shape (n,) each.
        now: Variance of the torque from outside without contact, and what static friction can hold, shape (n,) each.
    """
    assert state.held is not None
    before, keep = (state.momentum, state.push), float(np.exp(-observer.gain * since))
    outside = observer.steps(
        np.array([since]), *(np.stack([np.asarray(a), b]) for a, b in zip(before, here, strict=True))
    )
    residual = keep * np.asarray(state.residual) + (1.0 - keep) * outside[0]
    variance = keep**2 * np.asarray(state.variance) + (1.0 - keep**2) * now[0]
    return residual, variance, keep * state.held[0] + (1.0 - keep) * 0.5 * (state.held[1] + now[1])


def _states_after(
    monitor: Monitor, state: MonitorState, is_new: bool, way: Motion, since: float
) -> tuple[Array | None, StatePaths | None]:
    """Return the states of friction (1, n, s) after a way of one or two samples, and those from both ends.

    Where the observer begins anew they may have turned on the way: friction that builds up over a distance may have any
    state after it.
    """
    model = monitor.observer.model
    states = model.with_states(way, since, state.friction).state
    last = None if states is None else states[-1:]
    paths = end_states(model, last) if is_new else state_paths(model, way, since, state.ends)
    return last, None if paths is None else (paths[0][-1:], paths[1][-1:])


def _row(names: Sequence[str], what: str, values: npt.ArrayLike) -> Array:
    row = np.asarray(values, dtype=float)
    if row.shape != (len(names),):
        raise BadOption(what, f"of shape {row.shape}", f"give one number for each of the {len(names)} joints")
    if not np.all(np.isfinite(row)):
        bad = names[int(np.argmin(np.isfinite(row)))]
        raise LogMismatch("stream", f"{what} of {bad} is no finite number", "leave this sample out")
    return row[None]
