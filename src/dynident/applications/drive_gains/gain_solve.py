"""One question to logs of currents: model, unknowns, preparation and method, and the gains that follow.

Each gain has a verdict: whether the logs determine it, and where they do not, why not and what to do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynident.applications.drive_gains.drive_gains import IDENTIFIED, NOT_DETERMINED, REVERSED, DriveGain, DriveGains
from dynident.applications.drive_gains.gain_data import DriveRows, GainData, group_squares
from dynident.applications.drive_gains.intervals import GainSpread, spread_of
from dynident.applications.drive_gains.methods import GainFit, fit_gains
from dynident.applications.drive_gains.unknowns import FOUND, STEPS, UPRIGHT, Unknowns, pulls, under, with_lean
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, preprocess
from dynident.diagnosis.causes.bodies_in_motion import leaned
from dynident.errors import BadOption
from dynident.identification.problem.problem import Problem, counting_rows
from dynident.identification.problem.regressor_stream import motion_of
from dynident.identification.residuals.covariance import correlation_factors
from dynident.identification.selection.delay import find_delays
from dynident.identification.selection.friction.column_pool import ROWS
from dynident.identification.selection.friction.load import PASSES, without_load
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion

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


@dataclass(frozen=True)
class PreparedRuns:
    """Runs of logs made into rows, with the delay of each log where it was looked for."""

    logs: tuple[tuple[Prepared, ...], ...]
    delays: tuple[float, ...] = ()

    def sparser(self) -> PreparedRuns:
        """Return the runs with as many rows as a comparison of fits needs."""
        return replace(self, logs=tuple(tuple(log.sparser(ROWS) for log in run) for run in self.logs))


@dataclass(frozen=True)
class GainSolve:
    """One question to the logs: model, unknowns, preparation and method."""

    model: DynamicModel
    base: BaseParameters
    unknowns: Unknowns
    how: Preprocessing
    options: GainOptions
    progress: Progress
    prior_share: float = 0.0

    def prepared(self, runs: Runs) -> PreparedRuns:
        """Return runs of logs whose torques are C' i, preprocessed, with the delay of the currents taken out."""
        if not 0.5 <= self.options.level < 1:
            raise BadOption("level", self.options.level, "give the confidence of the intervals, such as 0.95")
        self.progress("preprocessing")
        how = self.how if self.how.delay_s is not None else replace(self.how, delay_s=0.0)
        prepared = tuple(tuple(preprocess(log, how) for log in run) for run in runs)
        if self.how.delay_s is not None:
            return PreparedRuns(prepared)
        _, fit = self._fit(prepared)
        self.progress("delay of the currents")
        return self._delayed(runs, fit)

    def gains(
        self,
        runs: PreparedRuns,
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

    def misfit(self, runs: PreparedRuns, gravity: Array | None = None) -> float:
        """Return the misfit of the gains of prepared runs of logs, under another gravity (3,) if given.

        Friction that depends on the load is taken without one, which makes the misfit larger, never smaller than it is.
        """
        model = self.model if gravity is None else under(self.model, gravity)
        solve = replace(self, model=model, progress=lambda step: None)
        data = solve._data(runs.logs, [np.zeros(self.base.count) if "torque" in model.needs else None] * len(runs.logs))
        return _misfit(data, solve._solved(data))

    def under_free_gravity(self, runs: PreparedRuns, start: Array) -> tuple[Array, float]:
        """Return the direction of gravity near a start that fits prepared runs of logs best, and the misfit with it.

        The base parameters are those of :func:`~.gravity.base_in_any_direction`.

        Args:
            runs: Prepared runs of logs.
            start: Where the search begins, shape (3,), in m/s^2.
        """
        base, plain, gravity = self.base, self.unknowns, start
        quiet = replace(self, model=under(self.model, start), progress=lambda step: None)
        free = replace(quiet, unknowns=with_lean(plain))
        loads = [np.zeros(base.count) if "torque" in self.model.needs else None for _ in runs.logs]
        data = quiet._data(runs.logs, loads)
        fit = quiet._solved(data)  # without a lean, for what the bodies are about
        for step in range(STEPS):
            model = under(self.model, gravity)
            betas = [plain.beta(run, fit.z[: plain.count]) for run in range(len(runs.logs))]
            lean = [pulls(model, base, beta, logs) for beta, logs in zip(betas, runs.logs, strict=True)]
            loads = [None if load is None else beta for load, beta in zip(loads, betas, strict=True)]
            turn = replace(free, model=model)
            data = turn._data(runs.logs, loads, lean)
            fit = turn._solved(data)
            gravity = leaned(gravity, fit.z[-2:])
            if float(np.max(np.abs(fit.z[-2:]))) < (UPRIGHT if step == 0 else FOUND):
                break
        return gravity, _misfit(data, fit)

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

    def _data(
        self,
        runs: Sequence[Sequence[Prepared]],
        loads: Sequence[Array | None],
        lean: Sequence[Sequence[Array]] | None = None,
    ) -> GainData:
        self.progress("reduction")
        rows = []
        for k, (logs, load) in enumerate(zip(runs, loads, strict=True)):
            masks = tuple(counting_rows(self.model, log) for log in logs)
            problem = Problem(self.model, self.base, tuple(logs), masks, (), load)
            rows.append(DriveRows(problem, self.options.signed, pulls=None if lean is None else lean[k]))
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

    def _delayed(self, runs: Runs, fit: GainFit) -> PreparedRuns:
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
        return PreparedRuns(tuple(prepared), tuple(delays))


def misfit_of(squares: Array) -> float:
    """Return the logarithm of the product of residual currents from their mean squares (G,); less is a better fit.

    Groups without a residual, as of drives that rest, do not count.
    """
    return float(np.sum(0.5 * np.log(squares[squares > 0])))


def _misfit(data: GainData, fit: GainFit) -> float:
    return misfit_of(group_squares(data, fit.rows) / np.maximum(data.counts, 1.0))


def _groups(joints: tuple[str, ...], signed: bool) -> list[int]:
    return [drive for drive in range(len(joints)) for _ in range(2 if signed else 1)]


#: Half an interval over the gain above which a gain counts as not determined.
LOOSE = 0.2

#: Share of what the known bodies ask of a drive below which gravity has no part in it.
STILL = 0.02

#: Postures at which gravity is looked at, in each run.
POSTURES = 200


def judged(data: GainData, fit: GainFit, spread: GainSpread, scale: str, current_unit: str) -> tuple[DriveGain, ...]:
    """Return the gains with their labels and reasons.

    Args:
        data: Reduced rows.
        fit: What a method found.
        spread: Their intervals.
        scale: What sets the scale: ``"payload"`` or ``"bodies"``.
        current_unit: Unit of the currents.
    """
    counts = np.maximum(data.counts, 1.0)
    residual = np.sqrt(group_squares(data, fit.rows) / counts)
    if not fit.rows.inverse:
        residual = residual / np.maximum(np.abs(fit.gains), 1e-100)
    driven, still = _driven(data, fit), _still(data, fit)
    current = np.sqrt(data.current_squares / counts)
    units = {joint.name: joint.unit for joint in data.rows[0].problem.model.robot.active}
    found = []
    sizes = np.maximum(np.abs(fit.gains), 1e-100)
    for g, group in enumerate(data.groups):
        half = 0.5 * (spread.high[g] - spread.low[g]) / sizes[g]
        asked = float(driven[g] / sizes[g])
        label, reason = IDENTIFIED, ""
        if spread.open[g] or not half <= LOOSE:
            evidence = "no row tells it from the rest" if spread.open[g] else _width(half)
            evidence += f"; the {scale} ask{'s' if scale == 'payload' else ''} {asked:.2g} {current_unit} of it"
            evidence += f", the fit leaves {residual[g]:.2g} {current_unit}"
            label, reason = NOT_DETERMINED, f"{evidence}; {_step(still[g] < STILL * driven[g], scale)}"
        elif fit.gains[g] < 0:
            label = REVERSED
            reason = (
                "its current counts against the motion of the joint; right where the drive is wired so, else turn "
                "the sign of the column or of the axis"
            )
        value, low, high = (float(each[g]) for each in (fit.gains, spread.low, spread.high))
        told = (float(spread.deviations[g]), label, reason, asked, float(residual[g]), float(current[g]))
        found.append(
            DriveGain(group.joint, group.sign, value, low, high, *told, f"{units[group.joint]}/{current_unit}")
        )
    return tuple(found)


def share_remark(gains: tuple[DriveGain, ...], spread: GainSpread, share: float) -> tuple[str, ...]:
    """Return the share of the bodies that would determine gains, where it is the share that leaves them open."""
    factors = spread.share_for(LOOSE * (1.0 - LOOSE**2))  # a half interval h of 1 / K is one of h / (1 - h^2) of K
    wide = {g.name: share * f for g, f in zip(gains, factors.tolist(), strict=True) if not g.known and f < 1.0}
    if not wide:
        return ()
    digit = 10.0 ** np.floor(np.log10(min(wide.values())))
    enough = digit * np.floor(min(wide.values()) / digit)  # rounded down: to first order alone
    return (
        f"bodies trusted within {100 * share:g} % leave intervals of more than {100 * LOOSE:.0f} % to either side "
        f"({', '.join(wide)}): --prior-share {enough:.1g} determines them; state it only where the robot model is that "
        "good, else use a known payload (--load)",
    )


def _width(half: float) -> str:
    if not np.isfinite(half):
        return "its interval has no end"
    return f"its interval is {100 * half:.0f} % to either side"


def _step(without_gravity: bool, scale: str) -> str:
    if scale == "bodies":
        return "use two runs with and without a known payload, or log a motion in which this drive works harder"
    if without_gravity:
        return (
            "gravity on the payload does not act about this axis: accelerate it more with the payload far out, state "
            "the payload's centre and inertia, fix the payload off this axis, or mount the arm tilted"
        )
    return "take a heavier payload, further out, and turn this joint through its range in both runs"


def _driven(data: GainData, fit: GainFit) -> Array:
    """Return the root mean square torque that the bodies that set the scale ask of each group, shape (G,)."""
    squares, counts = np.zeros(len(data.groups)), np.zeros(len(data.groups))
    for run, triangles in enumerate(data.triangles):
        body = np.append(data.unknowns.scale_bodies(run, fit.z), [0.0, 0.0])
        if not np.any(body):
            continue
        for g, triangle in enumerate(triangles):
            squares[g] += np.sum((triangle.factor[:, :-1] @ body[triangle.columns]) ** 2)
            counts[g] += triangle.rows
    return np.sqrt(squares / np.maximum(counts, 1.0))


def _still(data: GainData, fit: GainFit) -> Array:
    """Return the root mean square of the same at rest, of gravity alone and about its mean sign, shape (G,)."""
    squares, count = np.zeros(len(data.groups)), 0
    for run, rows in enumerate(data.rows):
        body = data.unknowns.scale_bodies(run, fit.z)
        if not np.any(body):
            continue
        model, base = rows.problem.model, rows.problem.base
        turn = np.linalg.inv(np.asarray(model.robot.coupling))
        for log in rows.problem.logs:
            q = motion_of(log.log).q[log.keep[:: max(1, len(log.keep) // POSTURES)]]
            none = np.zeros_like(q)
            columns = model.regressor(Motion(q, none, none, torque=none, temperature=none))[..., base.independent]
            torque = (columns @ body[: base.count]) @ turn
            squares += np.sum(torque[:, [group.drive for group in data.groups]] ** 2, axis=0)
            count += len(q)
    return np.sqrt(squares / max(count, 1))
