"""Causes of a residual that need no robot model of the bodies: springs, drift, friction curves, tilt, clock, scales."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_figures import figure_beside, figured
from dynident.diagnosis.causes.cause_search import CHANCE, Blame, Cause, CauseSearch
from dynident.diagnosis.causes.frame_errors import frame_errors
from dynident.diagnosis.causes.frame_search import AXES, axes_off, blames_beside_frames
from dynident.diagnosis.causes.held_out import judged
from dynident.diagnosis.causes.model_error import FitErrors, ModelError
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING, QuickFit
from dynident.identification.problem.problem import rest_speeds
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.quantiles import chi_square_tail

#: Step of the finite difference by the clock, a share.
CLOCK_STEP = 1e-3

#: Smoothing of the sign of a velocity in rad/s, of slides less.
WIDTH = 0.02


class Trends:
    """What the residual of a quick fit follows."""

    def __init__(self, fit: QuickFit, gravity_observers: Sequence[RegressorStream] | None = None) -> None:
        self.fit = fit
        self._gravity = gravity_observers or fit.gravity_observers
        self._log = fit.rows.prepared.log
        coupling = np.asarray(fit.model.robot.coupling)
        self._coupling = coupling
        self._speed = np.asarray(self._log.dq) @ coupling.T

    @cached_property
    def blames(self) -> tuple[Blame, ...]:
        """The causes that are sure, the one that explains most first."""
        return self._figured[0] if self._found else ()

    @cached_property
    def frames(self) -> tuple[Blame, ...]:
        """Axes of the robot model that are surely off, from the base on; none where one is off by too much."""
        return axes_off(self._beside_frames, self.fit.model.robot)

    def is_sure_beside_frames(self, cause: Cause) -> bool:
        """Return whether a cause is sure where axes of the robot model may be off as well, or no axis explains it.

        So is one that explains the log about as well as another cause that is, and is no axis.
        """
        others = {(one.name, one.joint) for one in self.causes} - {("friction drift", "")}
        sure = [blame for blame in self._beside_frames if blame.cause.name not in AXES]
        beside = {(each.cause.name, each.cause.joint) for blame in sure for each in (blame, *blame.rivals)}
        key = (cause.name, cause.joint)
        return key in beside or key not in others or cause.name == "friction curve"

    def is_of_lag(self, cause: Cause) -> bool:
        """Return whether a rotor inertia takes in a time lag of all that its joint's torque has, friction too.

        It is not sure beside a column of that then. One that free bodies take in is no part of it.
        """
        numbers = {(one.name, one.joint): k for k, one in enumerate(self._lags.causes)}
        own, found = numbers[cause.name, cause.joint], {(each.cause.name, each.cause.joint) for each in self._found}
        others = [*(numbers[key] for key in found if numbers[key] != own), numbers["lag", cause.joint]]
        if (cause.name, cause.joint) not in found:
            return False
        before, after = self._lags.fit(others), self._lags.fit([*others, own])
        ((worth, _),) = self._lags.worths([(*others, own)])
        ratio = float(worth @ np.log(before.variances / after.variances)) * (after.beta[-1] > 0.0)
        return bool(len(numbers) * chi_square_tail(ratio, 1) > CHANCE)

    @cached_property
    def _lags(self) -> CauseSearch:
        names, slope = self.fit.model.robot.joint_names, self._slope(self.fit.plain.beta)
        every = [_cause("lag", name, self._at_joint(i, slope[:, i])) for i, name in enumerate(names)]
        return CauseSearch(self._rows, [*self.causes, *self._filtered(every)], self._rows.shared)

    @cached_property
    def _beside_frames(self) -> tuple[Blame, ...]:
        return blames_beside_frames(self.fit, self._rows, self.causes, self._error)

    @cached_property
    def criterion(self) -> float:
        """Schwarz's criterion of the fit with these causes: the lower, the likelier are the rows and the causes."""
        worth, causes = self._rows.worth, [blame.cause for blame in self._found]
        chosen = [k for k, one in enumerate(self.causes) if any(one is cause for cause in causes)]
        columns = sum(len(cause.columns) for cause in causes)
        return float(worth @ np.log(self._search.fit(chosen).variances) + columns * np.log(worth.sum()))

    @cached_property
    def least_criterion(self) -> float:
        """What the criterion is at least: all causes are fitted, and none of their columns counts."""
        return float(self._rows.worth @ np.log(self._search.fit(range(len(self.causes))).variances))

    @cached_property
    def _search(self) -> CauseSearch:
        return CauseSearch(self._rows, self.causes, self._rows.shared)

    @cached_property
    def _found(self) -> tuple[Blame, ...]:
        return self._search.blames()

    @cached_property
    def delay(self) -> tuple[float, float]:
        """Delay of the torque in s that is left beside these causes, and its standard deviation by all errors."""
        slope = _cause("torque delay", "", self._slope(self.fit.plain.beta))
        causes = [blame.cause for blame in self.blames]
        return figure_beside(self._rows, causes, self._filtered([slope])[0], self._error)

    @cached_property
    def _rows(self) -> CauseRows:
        rows = self.fit.rows
        target = rows.torque - rows.known
        return CauseRows(rows.blocks, rows.columns, self.fit.base.count, target, rows.torque, rows.masks, OVERSAMPLING)

    @cached_property
    def _error(self) -> ModelError:
        error = ModelError.of_fit(self.fit)
        return replace(error, frames=frame_errors(self.fit, error.every))

    @cached_property
    def errors(self) -> FitErrors:
        """The errors of the model that the fit with these causes has, those of link frames left out."""
        return replace(self._figured[1], model=replace(self._error, frames=None))

    @cached_property
    def _figured(self) -> tuple[tuple[Blame, ...], FitErrors]:
        return figured(self._search, self._found, self._error, self._made_again)

    def _made_again(self, cause: Cause, beta: Array) -> Cause:
        """Return the clock or the lean of the base about bodies of other base parameters, shape (b,)."""
        make = {"time scale": self._clock, "tilt": self._tilt}.get(cause.name)
        return cause if make is None else self._filtered([make(beta)])[0]

    @cached_property
    def causes(self) -> tuple[Cause, ...]:
        """The causes that are tried, filtered as the torques are."""
        return self._filtered(list(self._causes()))

    def _filtered(self, found: list[Cause]) -> tuple[Cause, ...]:
        """Return causes filtered as the torques are, those that are not yet, all at once."""
        prepared = self.fit.rows.prepared
        columns = [cause.columns.transpose(0, 2, 1) for cause in found if not cause.is_filtered]
        there = [column.any(axis=2) for column in columns]
        smooth = prepared.smooth(np.concatenate([column[at] for column, at in zip(columns, there, strict=True)]))
        ends = np.cumsum([np.count_nonzero(at) for at in there])
        filtered = zip(there, np.split(smooth[:, prepared.keep], ends[:-1]), strict=True)
        for k, cause in enumerate(found):
            if not cause.is_filtered:
                at, own = next(filtered)
                values = np.zeros((*at.shape, own.shape[1]))
                values[at] = own
                found[k] = replace(cause, columns=values.transpose(0, 2, 1), is_filtered=True)
        return tuple(found)

    def _causes(self) -> Iterator[Cause]:
        """Yield the causes that are tried, not filtered yet; a torque that was predicted is."""
        names = self.fit.model.robot.joint_names
        clock = self.fit.clock(np.asarray(self._log.time))
        clock = (clock - clock.mean()) / max(float(np.ptp(clock)), 1e-9)
        sign, q = np.tanh(self._speed / rest_speeds(self.fit.model.robot, WIDTH)), np.asarray(self._log.q)
        load = np.abs(self.fit.regressor.predict(self._log, self._bodies(self.fit.plain.beta)))
        told = judged(self.fit.rows.masks)
        found_later = [part for part in self.fit.model.friction if part.is_of_position and part.vary]
        bent = {name for part in found_later for name in part.joints or names}  # by springs whose fields the fit finds
        rotors = {parameter.owner for parameter in self.fit.model.parameters if parameter.kind == "rotor"}
        inertial = np.asarray(self._log.ddq) @ self._coupling.T
        late = self._slope(self._bodies(self.fit.plain.beta))  # friction that turns early has columns of its own
        for i, (name, joint) in enumerate(zip(names, self.fit.model.robot.active, strict=True)):
            if not told[i]:
                continue
            yield _cause("drift", name, self._at_joint(i, clock))
            if name not in bent:
                yield _cause("spring", name, self._at_joint(i, q[:, i] - q[:, i].mean()))
            if name not in bent and joint.kind == "revolute":
                yield _cause(
                    "counterbalance", name, self._at_joint(i, np.sin(q[:, i])), self._at_joint(i, np.cos(q[:, i]))
                )
            if name not in rotors:
                yield replace(_cause("rotor inertia", name, self._at_drive(i, inertial[:, i])), is_positive=True)
            speed = self._speed[:, i]
            size = np.abs(speed)
            turn = 1.0 - sign[:, i] ** 2
            flank = speed * turn  # of a sign that is wider or narrower
            root, loaded = sign[:, i] * np.sqrt(size), sign[:, i] * load[:, i]
            curves = (speed * size, root, loaded, size, turn * inertial[:, i], flank)
            yield _cause("friction curve", name, *(self._at_drive(i, curve) for curve in curves))
            yield Cause("torque scale", name, self._own_torque(i)[None], is_filtered=True)
            if not self.fit.how.delay_s:  # else those of some joints would take the delay of all back
                yield _cause("torque delay", name, self._at_joint(i, late[:, i]))
        warm = [self._at_drive(i, clock * sign[:, i] * told[i]) for i in range(len(names))]
        yield _cause("friction drift", "", *warm)
        yield self._clock(self.fit.plain.beta)
        if np.any(self.fit.model.robot.gravity):
            yield self._tilt(self.fit.plain.beta)

    def _slope(self, beta: Array) -> Array:
        """Return what a delay of the torques by 1 s adds to them, as a straight line, shape (N, n)."""
        return -np.gradient(self.fit.regressor.predict(self._log, beta), np.asarray(self._log.time), axis=0)

    def _bodies(self, beta: Array) -> Array:
        """Return base parameters (b,) without friction."""
        return np.where(self.fit.base.is_friction, 0.0, beta)

    def _at_joint(self, joint: int, values: Array) -> Array:
        """Return values (N,) as a torque of one joint, shape (N, n)."""
        column = np.zeros((len(values), self.fit.model.robot.dof))
        column[:, joint] = values
        return column

    def _at_drive(self, drive: int, values: Array) -> Array:
        """Return values (N,) as a torque of one drive, at the joints, shape (N, n)."""
        return values[:, None] * self._coupling[drive]

    def _own_torque(self, joint: int) -> Array:
        """Return what is predicted at one joint, shape (N, n): with the measured torque its noise would count."""
        column = np.zeros_like(self.fit.rows.torque)
        column[:, joint] = self.fit.rows.torque[:, joint] - self.fit.residual[:, joint]
        return column

    def _clock(self, beta: Array) -> Cause:
        """Return the derivative of the bodies' torque by the speed of the clock.

        Friction is left out: what a clock does to it, its own columns take in, but for the width of its sign, and a
        wrong width would be taken for a wrong clock.
        """
        log, speed = self._log, 1.0 + CLOCK_STEP
        beta = self._bodies(beta)
        faster = replace(log, dq=np.asarray(log.dq) * speed, ddq=np.asarray(log.ddq) * speed**2)
        slope = (self.fit.regressor.predict(faster, beta) - self.fit.regressor.predict(log, beta)) / CLOCK_STEP
        return _cause("time scale", "", slope)

    def _tilt(self, beta: Array) -> Cause:
        """Return the lean of the base about both axes across gravity; the first joint then carries its own link too."""
        return _cause(
            "tilt", "", *lean_torques(self._gravity, self._log, beta, np.asarray(self.fit.model.robot.gravity))
        )


def lean_torques(observers: Sequence[RegressorStream], log: Log, beta: Array, gravity: Array) -> Array:
    """Return the torques of bodies by a lean of the base about both axes across gravity, per radian, shape (2, N, n).

    Args:
        observers: See :func:`~.quick_fit.gravity_observers`.
        log: The motion, of N samples.
        beta: Base parameters of the bodies, shape (b,).
        gravity: That which the base leans from, shape (3,), in m/s^2.
    """
    still, *along = (observer.predict(log, beta) for observer in observers)
    pulls, size = np.stack(along) - still, float(np.linalg.norm(gravity))
    return np.stack([size * np.tensordot(axis, pulls, 1) for axis in across_gravity(gravity)])


def leaned(gravity: Array, lean: Array) -> Array:
    """Return gravity (3,) turned by small angles (2,) in rad towards the vectors across it, of the same size."""
    size = float(np.linalg.norm(gravity))
    found = gravity + size * lean @ across_gravity(gravity)
    return found * (size / float(np.linalg.norm(found)))


def across_gravity(gravity: Array) -> Array:
    """Return two unit vectors across gravity and each other, shape (2, 3)."""
    return np.linalg.svd(gravity[None] / np.linalg.norm(gravity))[2][1:]


def _cause(name: str, joint: str, *columns: Array) -> Cause:
    """Return a cause with columns (N, n)."""
    return Cause(name, joint, np.stack(columns))
