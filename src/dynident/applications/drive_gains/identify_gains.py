"""Drive gains from logs of currents: from two runs with and without a payload, or against a known description."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dynident.applications.drive_gains.drive_gains import NOT_DETERMINED, DriveGains
from dynident.applications.drive_gains.drive_rows import DriveRows
from dynident.applications.drive_gains.gain_data import GainData
from dynident.applications.drive_gains.intervals import spread_of
from dynident.applications.drive_gains.methods import METHODS, GainFit, fit_gains
from dynident.applications.drive_gains.payload import CarriedBody
from dynident.applications.drive_gains.unknowns import Unknowns, unknowns_with_payload, unknowns_with_prior
from dynident.applications.drive_gains.verdicts import judged, share_remark
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, default_preprocessing, preprocess
from dynident.errors import BadOption, LogMismatch, SolverFailed
from dynident.identification.problem.problem import Problem, counting_rows
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.selection.delay import find_delays
from dynident.identification.selection.friction.load import PASSES, without_load
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot

#: Passes of load-dependent friction agree when no gain changes by more than this share.
AGREED = 1e-4

#: How often it is told what rows are worth beside what is known of the bodies, from the residual of the fit before.
WORTHS = 2

#: Torque of a drive in N m at most while the delay of the currents is sought: a gain that is not determined grows past
#: all bounds; it is lowered so far, as currents have to read as torques and no factor of a drive's rows moves it.
LARGEST_TORQUE = 1e6

Progress = Callable[[str], None]
Runs = tuple[tuple[Log, ...], ...]


@dataclass(frozen=True)
class GainOptions:
    """How gains are found.

    Attributes:
        method: One of ``structured``, ``tls``, ``wls``, ``ols``.
        signed: Give each sign of the current a gain of its own.
        level: Confidence of the intervals.
        current: Unit of the currents in the logs, for what is shown.
    """

    method: str = "structured"
    signed: bool = False
    level: float = 0.95
    current: str = "A"


STANDARD = GainOptions()


def gains_from_payload(
    model: DynamicModel,
    without: Sequence[Log],
    loaded: Sequence[Log],
    payload: CarriedBody,
    preprocessing: Preprocessing | None = None,
    options: GainOptions = STANDARD,
    progress: Progress = lambda step: None,
) -> DriveGains:
    """Return the drive gains from runs without and with a payload of which at least the mass is known.

    Inertial parameters, friction of each run, the gains and what is not known of the payload are found in one fit, of
    all joints at once (Gautier and Briot 2014): the known mass sets the scale. Positions are taken to be exact.

    Args:
        model: Robot and friction; the gains of its drives are not used.
        without: Logs with currents, without the payload.
        loaded: Logs with currents, with it.
        payload: What is known of it.
        preprocessing: How logs become rows; default: ``default_preprocessing``.
        options: Method, signs and confidence.
        progress: Called with each step in words.

    Raises:
        BadOption: A level that is none, or a payload that does not move.
        LogMismatch: A log without currents, with a constant one, or given twice.
        SolverFailed: The method did not converge.
        UnknownChoice: No such method, or frame of the payload.
    """
    base = base_parameters(model)
    unknowns = unknowns_with_payload(model, base, payload)
    runs = _checked(model, (tuple(without), tuple(loaded)))
    share = payload.deviation / payload.mass
    solve = _Solve(model, base, unknowns, preprocessing or default_preprocessing(), options, progress)
    words = f"a payload of {payload.described(model.robot)}"
    ready = solve.prepared(runs)
    found = solve.gains(ready, share, words, "payload", _payload_found(payload))
    if payload.centre is None or options.method != METHODS[0]:
        return found
    fewer = [replace(payload, inertia=None)] if payload.inertia is not None else []
    for unknown in (*fewer, replace(payload, centre=None, inertia=None)):
        free = replace(solve, unknowns=unknowns_with_payload(model, base, unknown), progress=lambda step: None)
        try:
            other = free.gains(ready, share, words, "payload", _payload_found(unknown))
        except (BadOption, SolverFailed):  # the mass alone does nothing about these axes
            continue
        if any(gain.is_apart_from(each) for gain, each in zip(found.gains, other.gains, strict=True)):
            return _contradicted(found, other, unknown, model.robot)
    return found


def _contradicted(found: DriveGains, other: DriveGains, unknown: CarriedBody, robot: Robot) -> DriveGains:
    """Return gains none of which is determined: with less known of the payload the same logs have others."""
    frame = f"in the frame '{unknown.frame_in(robot)}'"
    if unknown.centre is None:
        place = ", ".join(f"{value:.3g}" for value in other.found.values())
        reason = (
            f"the stated centre contradicts the logs: they place it at {place} m {frame}; name the frame that it is"
            " stated in (--frame), or leave it out (--com)"
        )
    else:
        reason = (
            "the stated inertia contradicts the logs: without it other gains are found; give it about the centre of"
            f" mass {frame}, or leave it out (--inertia)"
        )
    none = {"low": -np.inf, "high": np.inf, "deviation": np.inf, "label": NOT_DETERMINED, "reason": reason}
    return replace(found, gains=tuple(replace(gain, **none) for gain in found.gains))


def gains_from_prior(
    model: DynamicModel,
    logs: Sequence[Log],
    theta: npt.ArrayLike | None = None,
    share: float = 0.0,
    preprocessing: Preprocessing | None = None,
    options: GainOptions = STANDARD,
    progress: Progress = lambda step: None,
) -> DriveGains:
    """Return the drive gains of an arm whose bodies are known: gravity and inertia against the currents.

    Friction and rotors are found along with the gains. What is wrong about the bodies is wrong about the gains; with
    a share each link is a factor off and each of its parameters by an error of its own, which the intervals take in.

    Args:
        model: Robot and friction.
        logs: Logs with currents.
        theta: Standard parameters, shape (10 l,) or longer; None for those of the robot model.
        share: Relative standard deviation of links and of their parameters; 0 takes the bodies for exact.
        preprocessing: How logs become rows.
        options: Method, signs and confidence.
        progress: Called with each step in words.

    Raises:
        BadOption: No inertias are known, or a share or level that is none.
        LogMismatch: A log without currents or with a constant one.
        SolverFailed: The method did not converge.
        UnknownChoice: No such method.
    """
    known = model.robot.nominal if theta is None else np.asarray(theta, dtype=float)
    if known is None:
        lacking = next(link.name for link in model.robot.links if link.inertia is None)
        raise BadOption("prior", f"none for {lacking}", "give a robot model or an estimate with all inertias")
    if share and options.method in METHODS[1:]:
        raise BadOption("method", options.method, "only 'structured' takes bodies that are trusted to a share")
    base = base_parameters(model)
    unknowns = unknowns_with_prior(model, base, known, share)
    runs = _checked(model, (tuple(logs),))
    trusted = f"each link within {100 * share:g} % (std)" if share else "taken to be exact"
    solve = _Solve(model, base, unknowns, preprocessing or default_preprocessing(), options, progress, share)
    return solve.gains(solve.prepared(runs), 0.0, f"known bodies, {trusted}", "bodies", lambda names, z: {})


def _payload_found(payload: CarriedBody) -> Callable[[Sequence[str], Array], dict[str, float]]:
    """Return what tells the centre of a payload of which only the mass is known."""

    def found(names: Sequence[str], z: Array) -> dict[str, float]:
        if payload.centre is not None:
            return {}
        at = dict(zip(names, z.tolist(), strict=True))
        return {f"centre {axis} [m]": at[f"m{axis} of the payload"] / payload.mass for axis in "xyz"}

    return found


@dataclass(frozen=True)
class _PreparedRuns:
    """Runs of logs made into rows, with the delay of each log where it was looked for."""

    logs: tuple[tuple[Prepared, ...], ...]
    delays: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Solve:
    """One question to the logs: model, unknowns, preparation and method."""

    model: DynamicModel
    base: BaseParameters
    unknowns: Unknowns
    how: Preprocessing
    options: GainOptions
    progress: Progress
    prior_share: float = 0.0

    def prepared(self, runs: Runs) -> _PreparedRuns:
        """Return runs of logs whose torques are C' i, preprocessed, with the delay of the currents taken out."""
        if not 0.5 <= self.options.level < 1:
            raise BadOption("level", self.options.level, "give the confidence of the intervals, such as 0.95")
        self.progress("preprocessing")
        how = self.how if self.how.delay_s is not None else replace(self.how, delay_s=0.0)
        prepared = tuple(tuple(preprocess(log, how) for log in run) for run in runs)
        if self.how.delay_s is not None:
            return _PreparedRuns(prepared)
        _, fit = self._fit(prepared)
        self.progress("delay of the currents")
        return self._delayed(runs, fit)

    def gains(
        self,
        runs: _PreparedRuns,
        scale_share: float,
        scale: str,
        kind: str,
        tell: Callable[[Sequence[str], Array], dict[str, float]],
    ) -> DriveGains:
        """Return the gains of prepared runs of logs."""
        data, fit = self._fit(runs.logs)
        self.progress("intervals")
        spread = spread_of(data, fit, scale_share, self.options.level)
        gains = judged(data, fit, spread, kind, self.options.current)
        return DriveGains(
            gains=gains,
            method=self.options.method,
            scale=scale,
            level=self.options.level,
            covariance=spread.covariance,
            logs=tuple(tuple(each.log.name for each in run) for run in runs.logs),
            delays=runs.delays,
            found=tell(self.unknowns.names, fit.z),
            remarks=(*self._remarks(), *share_remark(gains, spread, self.prior_share)),
            filter=runs.logs[0][0].statement(),
        )

    def _remarks(self) -> tuple[str, ...]:
        if self.options.method in ("wls", "ols"):
            return (f"'{self.options.method}' takes currents for exact: where they are noisy its gains are too small",)
        if self.options.method == "tls":
            return ("'tls' takes all columns for noisy alike, and its intervals are of first order",)
        return ()

    def _fit(self, runs: Sequence[Sequence[Prepared]]) -> tuple[GainData, GainFit]:
        """Return the fit; where friction depends on the load, with the load of its own solution."""
        loaded = "torque" in self.model.needs
        loads: list[Array | None] = [np.zeros(self.base.count) if loaded else None for _ in runs]
        data = self._data(runs, loads)
        fit = self._solved(data)
        for _ in range(PASSES if loaded else 0):
            self.progress("load of the drives")
            before = fit.gains
            data = self._data(runs, [self.unknowns.beta(run, fit.z) for run in range(len(runs))])
            fit = self._solved(data)
            if np.max(np.abs(fit.gains / before - 1.0)) < AGREED:
                break
        return data, fit

    def _data(self, runs: Sequence[Sequence[Prepared]], loads: Sequence[Array | None]) -> GainData:
        self.progress("reduction")
        rows = []
        for logs, load in zip(runs, loads, strict=True):
            masks = tuple(counting_rows(self.model, log) for log in logs)
            rows.append(DriveRows(Problem(self.model, self.base, tuple(logs), masks, (), load), self.options.signed))
        return GainData.of(rows, self.unknowns)

    def _solved(self, data: GainData) -> GainFit:
        self.progress(f"method {self.options.method}")
        if not np.any(np.isfinite(self.unknowns.deviations)):
            return fit_gains(data, self.options.method)
        # What is known of z weighs as one row: the rows of the logs must count as what they are worth.
        fit = fit_gains(data, "ols")
        for _ in range(WORTHS):
            residual = [rows.group_residuals(each) for rows, each in zip(data.rows, fit.rows.vectors, strict=True)]
            worth = correlation_factors(residual, [rows.counting for rows in data.rows])
            fit = fit_gains(data, self.options.method, worth)
        return fit

    def _delayed(self, runs: Runs, fit: GainFit) -> _PreparedRuns:
        """Return the logs prepared with the delay of each."""
        simple = without_load(self.model)
        robot = self.model.robot
        gains = np.zeros(robot.dof)
        for group, gain in zip(_groups(robot.joint_names, self.options.signed), fit.gains, strict=True):
            gains[group] += gain / (2.0 if self.options.signed else 1.0)
        currents = [np.abs(np.asarray(log.current)).max(axis=0) for run in runs for log in run]
        most = LARGEST_TORQUE / np.maximum(np.max(currents, axis=0), 1e-100)
        gains = np.clip(gains, -most, most)
        coupling = np.asarray(robot.coupling)
        delays: list[float] = []
        prepared: list[tuple[Prepared, ...]] = []
        for run in runs:
            scaled = [replace(log, torque=np.asarray(log.current) * gains @ coupling) for log in run]
            plain = [preprocess(log, self.how) for log in scaled]
            found, _ = find_delays(simple, base_parameters(simple), plain, may_lag=False)
            applied = [float(delay.applied) for delay in found]
            delays += applied
            hows = [replace(self.how, delay_s=delay) for delay in applied]
            prepared.append(tuple(preprocess(log, how) for log, how in zip(run, hows, strict=True)))
        return _PreparedRuns(tuple(prepared), tuple(delays))


def _groups(joints: tuple[str, ...], signed: bool) -> list[int]:
    return [drive for drive in range(len(joints)) for _ in range(2 if signed else 1)]


def _checked(model: DynamicModel, runs: Runs) -> Runs:
    """Return the logs in the order of the joints, with torques C' i; refuse those that cannot serve."""
    robot = model.robot
    coupling = np.asarray(robot.coupling)
    seen: dict[str, str] = {}
    found: list[tuple[Log, ...]] = []
    for run, words in zip(runs, ("without the payload", "with the payload"), strict=False):
        if not run:
            raise LogMismatch("drive gains", f"no log {words if len(runs) > 1 else ''}".rstrip(), "give one")
        ordered = []
        for log in run:
            one = log.ordered(robot.joint_names)
            if one.current is None:
                step = "map the columns of the currents (log: columns: {current: ...}); torques need no gains"
                raise LogMismatch(log.name, "no motor currents", step)
            if log.source.sha256 and log.source.sha256 in seen:
                step = "give each log once, and a run with the payload beside one without"
                raise LogMismatch(log.name, f"the same content as {seen[log.source.sha256]}", step)
            seen[log.source.sha256] = log.name
            for name, column in zip(robot.joint_names, np.asarray(one.current).T, strict=True):
                if np.ptp(column) <= 1e-12 * np.max(np.abs(column), initial=0.0):
                    step = "map the right column, or leave the joint out (locked:)"
                    raise LogMismatch(log.name, f"the current of {name} is {column[0]:.4g} A throughout", step)
            ordered.append(replace(one, torque=np.asarray(one.current) @ coupling, raw_torque=None))
        found.append(tuple(ordered))
    return tuple(found)
