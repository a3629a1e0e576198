"""Causes of a residual that need no robot model of the bodies: springs, drift, friction curves, tilt, clock, scales."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.diagnosis.causes.bodies_in_motion import BodiesInMotion, apart, lean_torques
from dynident.diagnosis.causes.cause_columns import CauseRows, joints_of
from dynident.diagnosis.causes.cause_figures import about_their_bodies, figure_beside, figured, with_likeliest
from dynident.diagnosis.causes.cause_search import CHANCE, Blame, Cause, CauseSearch
from dynident.diagnosis.causes.frame_errors import frame_errors
from dynident.diagnosis.causes.frame_search import AXES, axes_off, blames_beside_frames, corrected
from dynident.diagnosis.causes.held_out import judged
from dynident.diagnosis.causes.model_error import FitErrors, ModelError
from dynident.diagnosis.causes.position_spectrum import RIPPLE, ripples
from dynident.diagnosis.causes.quick_fit import OVERSAMPLING, QuickFit
from dynident.diagnosis.finding import CLOCKS
from dynident.identification.problem.problem import rest_speeds
from dynident.identification.residuals.quantiles import chi_square_tail

#: Causes of one joint that act on the motion, for which straight lines do not hold far.
CURVED = ELASTIC, ZERO, STRETCH, DELAY = "joint elasticity", "position zero", "position scale", "torque delay"

#: Hysteresis of a torque, and the rate of the torque, over its standard deviation, at which it turns over; friction
#: that fades with speed, and the speed in rad/s, of slides less.
HYSTERESIS, TURNING = "torque hysteresis", 0.25
FADING, FADED = "fading friction", 0.1

#: Share of a delay that is left at least beside friction and hysteresis of its joint.
KEPT = 0.75

#: Smoothing of the sign of a velocity in rad/s, of slides less.
WIDTH = 0.02

#: Another unit of one joint's torque.
SCALE = "torque scale"


class Trends:
    """What the residual of a quick fit follows."""

    def __init__(self, fit: QuickFit, logged: Trends | None = None) -> None:
        """Look at a fit.

        Args:
            fit: The fit.
            logged: What the torque as it was logged follows in the same motion, where that of ``fit`` is another one:
                the causes that act on the motion are the same. None where nothing was looked at yet.
        """
        self.fit, self._logged = fit, logged
        self._log = fit.rows.prepared.log
        self._coupling = np.asarray(fit.model.robot.coupling)
        self._speed = np.asarray(self._log.dq) @ self._coupling.T

    @cached_property
    def blames(self) -> tuple[Blame, ...]:
        """The causes that are sure, the one that explains most first."""
        return self._figured[0] if self._found else ()

    @cached_property
    def frames(self) -> tuple[Blame, ...]:
        """Axes of the robot model that are surely off, from the base on; none where one is off by too much."""
        return axes_off(self._beside_frames, self.fit.model.robot)

    @cached_property
    def frames_for_clock(self) -> tuple[tuple[Blame, ...], float]:
        """Axes that are off in the place of a clock, and what they explain over what the clock does; none at 0.

        Straight lines hold for no link that is a tenth too long, so the robot model is put right and fitted anew. Each
        is a fall of Schwarz's criterion.
        """
        others = [cause for cause in self.causes if cause.name != "time scale"]
        found, robot = blames_beside_frames(self.fit, self.rows, others, self._error), self.fit.model.robot
        best = sorted((blame for blame in found if blame.cause.name in AXES), key=lambda blame: -blame.share)[:1]
        axes = axes_off(found, robot) or axes_off(best, robot)
        if not axes:
            return (), 0.0
        worth, clock = self.rows.worth, [cause.name for cause in self._tangents.causes].index("time scale")
        plain, fast = (self._tangents.fit(chosen).variances for chosen in ([], [clock]))
        right, rows = corrected(self.fit, axes).plain.variances, float(np.log(worth.sum()))
        by_axes = float(worth @ np.log(plain / right)) - rows * sum(len(blame.values) for blame in axes)
        return axes, by_axes / max(float(worth @ np.log(plain / fast)) - rows, rows)

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
        return any(blame.cause is cause for blame in self._found) and not self._value_beside(cause, "lag")

    def is_delay(self, blame: Blame, place: Blame) -> bool:
        """Return whether a delay of one joint's torque has its figure beside friction and hysteresis of the joint, too.

        Friction that fades with speed, or depends on the way in which the torque changes, leads or lags what it acts
        on.

        Args:
            blame: The delay.
            place: The cause in whose place it is told; the same where it is told alone.
        """
        left = self._value_beside(blame.cause, "friction curve", FADING, HYSTERESIS, place=place.cause)
        return abs(left) > KEPT * abs(float(blame.values[0]))

    def _value_beside(self, cause: Cause, *names: str, place: Cause | None = None) -> float:
        """Return the value of a cause beside those found and others of its joint, by their names; 0 if it is not sure.

        Another cause that was found may be left out, ``place``.
        """
        numbers = {(one.name, one.joint): k for k, one in enumerate(self._beside.causes)}
        found = [(each.cause.name, each.cause.joint) for each in self._found]
        left_out = {(each.name, each.joint) for each in (cause, place) if each}
        keys = dict.fromkeys([*found, *((name, cause.joint) for name in names)])
        others, own = [numbers[key] for key in keys if key not in left_out], numbers[cause.name, cause.joint]
        before, after = self._beside.fit(others), self._beside.fit([*others, own])
        ((worth, _),) = self._beside.worths([(*others, own)])
        ratio, value = float(worth @ np.log(before.variances / after.variances)), float(after.beta[-1])
        is_sure = len(numbers) * chi_square_tail(ratio, 1) < CHANCE and (value > 0.0 or not cause.is_positive)
        return value if is_sure else 0.0

    @cached_property
    def _beside(self) -> CauseSearch:
        names, load = self.fit.model.robot.joint_names, np.abs(self._motion.rigid)
        fading = np.sign(self._speed) * np.exp(-((self._speed / rest_speeds(self.fit.model.robot, FADED)) ** 2))
        every = [_cause("lag", name, self._at_joint(i, self._late[:, i])) for i, name in enumerate(names)]
        for i, name in enumerate(names):
            columns = (fading[:, i], fading[:, i] * load[:, i])
            every.append(_cause(FADING, name, *(self._at_drive(i, column) for column in columns)))
        return CauseSearch(self.rows, [*self.causes, *self._filtered(every)], self.rows.shared)

    @cached_property
    def _late(self) -> Array:
        """What a delay by 1 s adds to the torques, friction with them, shape (N, n)."""
        return self._slope(self.fit.regressor.predict(self._log, self.fit.plain.beta))

    @cached_property
    def _beside_frames(self) -> tuple[Blame, ...]:
        return blames_beside_frames(self.fit, self.rows, self.causes, self._error)

    @cached_property
    def criterion(self) -> float:
        """Schwarz's criterion of the fit with these causes: the lower, the likelier are the rows and the causes."""
        worth, causes = self.rows.worth, [blame.cause for blame in self._found]
        chosen = [k for k, one in enumerate(self.causes) if any(one is cause for cause in causes)]
        columns = sum(len(cause.columns) for cause in causes)
        return float(worth @ np.log(self._search.fit(chosen).variances) + columns * np.log(worth.sum()))

    @cached_property
    def least_criterion(self) -> float:
        """What the criterion is at least: all causes are fitted, and none of their columns counts."""
        search = self._tangents
        return float(self.rows.worth @ np.log(search.fit(range(len(search.causes))).variances))

    @cached_property
    def _tangents(self) -> CauseSearch:
        search = CauseSearch(self.rows, tuple(self._tried()), self.rows.shared)
        if self._logged is not None:
            return search
        names = np.array(self.fit.model.robot.joint_names)[judged(self.fit.rows.masks)].tolist()
        scaled = [self._by_motion(STRETCH, name, self._motion) for name in names]
        return with_likeliest(search, self._filtered(scaled))

    def _tried(self) -> Iterator[Cause]:
        """Yield the causes that are tried, filtered as the torques are."""
        if self._logged is None:
            yield from self._filtered(list(self._causes()))
            return
        names = self.fit.model.robot.joint_names
        for cause in self._logged._tangents.causes:
            if cause.name == SCALE:
                yield replace(cause, columns=self._own_torque(names.index(cause.joint))[None])
            elif cause.name != DELAY:  # those of some joints would take the delay of all back
                yield cause

    @cached_property
    def _searched(self) -> tuple[CauseSearch, tuple[Blame, ...]]:
        """The search and what it has found, made again where curves of what was found tell more than straight lines."""
        search = self._tangents
        found = search.blames()
        before = [blame.cause for blame in found]
        if not any(cause.name in (*CURVED, CLOCKS) for cause in before):
            return search, found
        after, curved = about_their_bodies(self.rows, before, self.made_again)
        numbers = {id(cause): k for k, cause in enumerate(search.causes)}
        straight = search.fit([numbers[id(cause)] for cause in before])
        gain = abs(float(self.rows.worth @ np.log(straight.variances / curved.variances)))
        if chi_square_tail(gain, 1) > CHANCE:
            return search, found
        made = {id(old): new for old, new in zip(before, after, strict=True)}
        search = CauseSearch(self.rows, [made.get(id(one), one) for one in search.causes], self.rows.shared)
        return search, search.blames()

    @property
    def _search(self) -> CauseSearch:
        return self._searched[0]

    @property
    def _found(self) -> tuple[Blame, ...]:
        return self._searched[1]

    @cached_property
    def delay(self) -> tuple[float, float]:
        """Delay of the torque in s that is left beside these causes, and its standard deviation by all errors."""
        slope = _cause("torque delay", "", self._late)
        causes = [blame.cause for blame in self.blames]
        return figure_beside(self.rows, causes, self._filtered([slope])[0], self._error)

    @cached_property
    def rows(self) -> CauseRows:
        """The rows to which causes are added."""
        rows, target = self.fit.rows, self.fit.rows.torque - self.fit.rows.known
        if self._logged is not None:
            return replace(self._logged.rows, target=target, measured=rows.torque)
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
        return figured(self._search, self._found, self._error, partial(self.made_again, with_friction=True))

    def made_again(
        self, causes: Sequence[Cause], beta: Array, values: Sequence[Array], with_friction: bool = False
    ) -> list[Cause]:
        """Return the same causes, those that act on the motion about bodies of other base parameters, (b,).

        Each of these is a secant up to its values, (k,), where the zeros and scales before it have theirs: together
        they are exact. A delay of one joint moves its friction too, ``with_friction``, as a fit with it alone has that.
        """
        made, log = list[Cause](), self._log
        for cause, own in zip(causes, values, strict=True):
            if cause.name == "tilt":
                column = _cause("tilt", "", *lean_torques(self.fit.regressor, self._log, beta))
            elif cause.name == CLOCKS:
                column = self._apart(beta, float(own[0]))
            elif cause.name in (*CURVED, "time scale"):
                late = with_friction and cause.name == DELAY
                friction = CauseSearch(self.rows, [cause]).fit([0]).beta[: self.rows.size] if late else 0.0
                motion = self._motion_of(beta, friction, log)
                value = float(own[0])
                column = self._by_motion(cause.name, cause.joint, motion, value)
                if cause.name == ZERO:
                    log = motion.moved(self._number(cause.joint), value)
                elif cause.name == STRETCH:
                    place = self._number(cause.joint)
                    log = motion.scaled(place, self.fit.zero_of(place), value)
            else:
                made.append(cause)
                continue
            made.append(replace(cause, columns=column.columns, is_filtered=False))
        return [*self._filtered(made)] if any(not cause.is_filtered for cause in made) else made

    def _by_motion(self, name: str, joint: str, motion: BodiesInMotion, value: float = 0.0) -> Cause:
        """Return a cause that acts on the motion of links, as a secant up to a value.

        What a clock does to friction, its own columns take in, but for the width of its sign, and a wrong width would
        be taken for a wrong clock.
        """
        if name == "time scale":
            return _cause(name, "", motion.clock())
        place = self._number(joint)
        if name == STRETCH:
            return _cause(name, joint, motion.stretched(place, self.fit.zero_of(place), value))
        if name == ELASTIC:
            load = float(np.abs(motion.rigid[:, place]).max())
            return replace(_cause(name, joint, motion.elastic(place, value)), is_positive=True, load=load)
        return _cause(name, joint, {ZERO: motion.zero, DELAY: motion.late}[name](place, value))

    def _number(self, joint: str) -> int:
        return self.fit.model.robot.joint_names.index(joint)

    def _motion_of(self, beta: Array, friction: Array | float, log: Log) -> BodiesInMotion:
        """Return a motion with the bodies of base parameters, shape (b,), and the friction of others, or none."""
        both = np.where(self.fit.base.is_friction, friction, beta)
        return BodiesInMotion.of_bodies(self.fit.regressor, log, both)

    def stretch(self, joint: str) -> Cause:
        """Return the positions of a joint in another scale, as a straight line about the fitted bodies."""
        return self._filtered([self._by_motion(STRETCH, joint, self._motion)])[0]

    @cached_property
    def _motion(self) -> BodiesInMotion:
        return self._motion_of(self.fit.plain.beta, 0.0, self._log)

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The causes that are tried, filtered as the torques are."""
        return self._search.causes

    def _filtered(self, found: list[Cause]) -> tuple[Cause, ...]:
        """Return causes filtered as the torques are, those that are not yet, all at once."""
        prepared, made = self.fit.rows.prepared, [cause.columns for cause in found if not cause.is_filtered]
        columns, there = [column.transpose(0, 2, 1) for column in made], [*map(joints_of, made)]
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
        load, late = np.abs(self._motion.rigid), self._slope(self._motion.rigid)
        told = judged(self.fit.rows.masks)
        found_later = [part for part in self.fit.model.friction if part.is_of_position and part.vary]
        bent = {name for part in found_later for name in part.joints or names}  # by springs whose fields the fit finds
        rotors = {parameter.owner for parameter in self.fit.model.parameters if parameter.kind == "rotor"}
        inertial = np.asarray(self._log.ddq) @ self._coupling.T
        for i, (name, joint) in enumerate(zip(names, self.fit.model.robot.active, strict=True)):
            if not told[i]:
                continue
            yield _cause("drift", name, self._at_joint(i, clock))
            for one in (ELASTIC, ZERO):
                yield self._by_motion(one, name, self._motion)
            if name not in bent:
                yield _cause("spring", name, self._at_joint(i, q[:, i] - q[:, i].mean()))
            if name not in bent and joint.kind == "revolute":
                yield _cause("counterbalance", name, *(self._at_joint(i, wave(q[:, i])) for wave in (np.sin, np.cos)))
            if name not in rotors:
                yield replace(_cause("rotor inertia", name, self._at_drive(i, inertial[:, i])), is_positive=True)
            speed, size = self._speed[:, i], np.abs(self._speed[:, i])
            turn = 1.0 - sign[:, i] ** 2
            flank = speed * turn  # of a sign that is wider or narrower
            root, loaded = sign[:, i] * np.sqrt(size), sign[:, i] * load[:, i]
            curves = (speed * size, root, loaded, size, turn * inertial[:, i], flank)
            yield _cause("friction curve", name, *(self._at_drive(i, curve) for curve in curves))
            turning = np.tanh(-late[:, i] / max(TURNING * float(late[:, i].std()), 1e-300))
            yield replace(_cause(HYSTERESIS, name, self._at_joint(i, turning)), is_positive=True)
            yield Cause(SCALE, name, self._own_torque(i)[None], is_filtered=True)
            yield self._by_motion(DELAY, name, self._motion)  # of bodies: friction has columns that turn early
        warm = [self._at_drive(i, clock * sign[:, i] * told[i]) for i in range(len(names))]
        yield _cause("friction drift", "", *warm)
        yield self._by_motion("time scale", "", self._motion)
        yield self._apart(self.fit.plain.beta)
        for one in ripples(self.fit):
            waves = [self._at_drive(one.drive, wave) for wave in one.columns(q @ self._coupling[one.drive])]
            yield replace(_cause(RIPPLE, names[one.drive], *waves), cycles=(one.stated, one.std))
        if np.any(self.fit.model.robot.gravity):
            yield _cause("tilt", "", *lean_torques(self.fit.regressor, self._log, self.fit.plain.beta))

    def _apart(self, beta: Array, growth: float = 0.0) -> Cause:
        torque, log = self.fit.regressor.predict(self._log, beta), self._log
        return _cause(CLOCKS, "", apart(torque, np.asarray(log.time), self.fit.clock(np.asarray(log.time)), growth))

    def _slope(self, torque: Array) -> Array:
        """Return what a delay by 1 s adds to torques (N, n), as a straight line, of the same shape."""
        return -np.gradient(torque, np.asarray(self._log.time), axis=0)

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


def _cause(name: str, joint: str, *columns: Array) -> Cause:
    """Return a cause with columns (N, n)."""
    return Cause(name, joint, np.stack(columns))
