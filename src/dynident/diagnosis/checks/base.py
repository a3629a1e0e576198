"""What a check of a log is, and what it sees."""

from __future__ import annotations

import re
import shlex
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from dynident.arrays import BoolArray
from dynident.case.case import Case
from dynident.data.preprocessing import LONGEST_GAP
from dynident.diagnosis.causes.against_bodies import AgainstBodies
from dynident.diagnosis.causes.known_bodies import KnownBodies, known_bodies
from dynident.diagnosis.causes.position_scale import PositionScale, position_scale
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.saturated_rows import saturated_rows, without_saturation
from dynident.diagnosis.causes.thin_fit import beyond_quick_fit, thin_fit
from dynident.diagnosis.causes.torque_scales import JointScale, is_sure, joint_scales, other_scales
from dynident.diagnosis.causes.trends import STRETCH, Trends
from dynident.diagnosis.finding import Finding
from dynident.diagnosis.recording import Recording
from dynident.errors import DynidentError
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.choices import DelayRecord
from dynident.identification.selection.delay import find_delays
from dynident.model.base_parameters import base_parameters
from dynident.model.friction import Friction, auto_friction

#: A delay counts from this many of its standard deviations on.
SURE_DELAY = 5.0

#: Share of the acceleration that rounding makes of it from which positions are coarse: parameters are then off by its
#: square, a thousandth.
ROUNDING = 0.03


@dataclass(frozen=True)
class CheckedLog:
    """A log under examination.

    Attributes:
        case: Robot, columns and preparation.
        raw: The log as its file has it.
        sound: The same after the safe repairs: time runs forward, every value is finite.
        earlier: An estimate of the same robot that bodies are held against; None for the robot model.
        pooled: The fit of several logs, of which this is the first; None for that of this log alone.
    """

    case: Case
    raw: Recording
    sound: Recording
    earlier: Estimate | None = None
    pooled: QuickFit | None = None

    @property
    def fix(self) -> str:
        """The command that writes the log without what is safe to repair."""
        subject = self.case.path or self.case.robot_path or "CASE"
        return f"dynident check {shlex.quote(subject)} {shlex.quote(self.raw.log.name)} --fix OUT.csv"

    @cached_property
    def thin(self) -> QuickFit | None:
        """The fit of a few rows of the log whatever their number; None where the log has no torques."""
        return thin_fit(self.case, self.sound.log)

    @cached_property
    def fit(self) -> QuickFit | None:
        """A fit of few rows, without those cut off in a log alone; None where it has no torques or too few rows."""
        if self.pooled or self.thin is None or not self.thin.has_rows_enough:
            return self.pooled
        return without_saturation(self.thin, self.sound.log, np.any(self.saturated, axis=(0, 1)))

    def spans(self, fit: QuickFit, rows: BoolArray, apart: float, reach: float) -> list[tuple[float, float]]:
        """Return start and end of the spells of some kept rows of a fit, shape (N,), in s since their log began.

        Args:
            fit: The fit.
            rows: The rows.
            apart: Time in s between two spells at least.
            reach: Time in s by which each is wider at either end, to which a filter spreads what it has.
        """
        start = float(self.sound.log.time[0]) if len(fit.starts) == 1 else 0.0
        own = fit.clock(np.asarray(fit.rows.prepared.kept.time)[rows]) - start
        parts = np.split(own, np.flatnonzero(np.abs(np.diff(own)) > apart) + 1)
        return [(max(float(part[0]) - reach, 0.0), float(part[-1]) + reach) for part in parts]

    def without(self, fit: QuickFit, spans: Sequence[tuple[float, float]]) -> str:
        """Return how the spells of :meth:`spans` are left out of the log, by a line of the case file if it has one."""
        if self.raw.table is None or len(fit.starts) > 1:
            longest = max(last - first for first, last in spans)
            bridged = f" (preprocessing: longest_gap_s: {np.ceil(longest + 0.1):g})" if longest > LONGEST_GAP else ""
            return f"cut its rows out of the log{bridged}"
        told = ", ".join(f"[{first:.4g}, {last:.4g}]" for first, last in spans)
        name = re.split(r"[/\\]", self.raw.log.name)[-1]
        return f"leave it out (log: {{leave_out: {{{name}: [{told}]}}}})"

    @cached_property
    def saturated(self) -> BoolArray:
        """Where torques are cut off: at flat tops, at flat bottoms and at the limits of effort, shape (3, n, N)."""
        return saturated_rows(self.sound.log, self.case.robot)

    @cached_property
    def scales(self) -> tuple[JointScale, ...]:
        """The scale of each joint's torque against the others; nothing where there is no fit."""
        return () if self.fit is None else joint_scales(self.fit)

    @cached_property
    def sure_scale(self) -> JointScale | None:
        """The likeliest scale that is another one for sure; None where none is, or one of positions is likelier."""
        if self.stretched is not None:
            return None
        return next((scale for scale in other_scales(self.scales) if self.fit and is_sure(self.fit, scale)), None)

    @cached_property
    def stretched(self) -> PositionScale | None:
        """The scale of one joint's positions that explains the log, better than one of its torques; None for none."""
        causes = () if self.trends is None else self.trends.causes
        joint = next((cause.joint for cause in causes if cause.name == STRETCH), "")
        if self.fit is None or not joint:
            return None
        return position_scale(self.fit, joint, next(iter(other_scales(self.scales)), None))

    @cached_property
    def delay(self) -> DelayRecord | None:
        """The delay of the torque; ``applied`` is 0 where it may well be none, or other causes explain the log better.

        A lean of the base or a load passes for a delay where nothing else may explain it. Beside these causes it is
        told after another step of Gauss and Newton, where its standard deviation is smaller so.
        """
        asked, trends = self._asked_delay, self.trends
        if asked is None or trends is None or not trends.fit.late_s:
            return asked if asked is None else replace(asked, applied=0.0)
        left, std = trends.delay
        seconds = asked.applied + left * (std < asked.std)
        return replace(asked, seconds=seconds, std=max(asked.std, std))

    @cached_property
    def _asked_delay(self) -> DelayRecord | None:
        """The delay that the torques of the robot alone ask for."""
        if self.fit is None:
            return None
        more = [part for part in beyond_quick_fit(self.case) if not part.needs]
        model = replace(self.fit.model, friction=(*self.fit.model.friction, *more))  # a bend passes for a lead
        base = base_parameters(model) if more else self.fit.base
        try:
            (found,), _ = find_delays(model, base, [self.fit.rows.prepared], may_lag=False)
        except DynidentError:
            return None
        sure = abs(found.seconds) > SURE_DELAY * found.std
        return replace(found, applied=found.applied if sure else 0.0)

    @cached_property
    def trends(self) -> Trends | None:
        """What the residual follows, the delay of the torque taken out where that explains it; None without a fit."""
        if self.fit is None:
            return None
        plain = Trends(self.fit)
        late = 0.0 if self._asked_delay is None else self._asked_delay.applied
        if not late:
            return plain
        shifted = Trends(self.fit.delayed(late), plain)
        first, second = sorted((shifted, plain), key=lambda one: one.least_criterion)
        if first.criterion <= second.least_criterion:  # whatever a search would find there
            return first
        return min((shifted, plain), key=lambda one: one.criterion)

    @cached_property
    def described(self) -> frozenset[str]:
        """Names of causes that friction of the case describes, or is to be chosen for, and the quick fit has not."""
        more = beyond_quick_fit(self.case)  # a case with such friction has chosen its friction already
        chosen = bool(more) or self.case.choose_friction
        more += auto_friction(self.case.robot) if self.case.choose_friction else ()
        warms = any(map(self._follows_warming, more))
        return frozenset({"friction curve"} if chosen else ()) | frozenset({"friction drift"} if warms else ())

    def _follows_warming(self, part: Friction) -> bool:
        """Return whether a friction part follows drives that warm up, or may be chosen to in this log."""
        log, durations = self.sound.log, [span for span in part.ranges.values() if span.is_duration]
        if not part.is_optional:
            return bool(durations) or "temperature" in part.needs
        long_enough = any(span.least_log <= log.duration for span in durations)
        return long_enough or ("temperature" in part.needs and log.temperature is not None)

    def trend_scale(self, joint: str) -> JointScale | None:
        """Return the scale of a joint's torque once its delay is taken out, as where trends are; None without a fit."""
        trends = self.trends
        if trends is None or trends.fit is self.fit:
            return next((scale for scale in self.scales if scale.joint == joint), None)
        return joint_scales(trends.fit, [joint])[0]

    @cached_property
    def known(self) -> KnownBodies | None:
        """What the earlier estimate knows of the bodies; None where there is none, or it knows nothing of them."""
        if self.fit is None or self.earlier is None:
            return None
        return known_bodies(self.earlier, self.fit.model, self.fit.base)

    @cached_property
    def against_earlier(self) -> AgainstBodies | None:
        """What the torques leave beside the bodies of the earlier estimate; None where nothing is known of these."""
        trends, known = self.trends, self.known
        return None if trends is None or known is None else AgainstBodies(trends, known)


class Check(ABC):
    """A look at one side of a log; pure, never changes anything.

    Attributes:
        stage: 0 looks at the raw file, 1 at the repaired signals, 2 at a quick fit. A stage is left out after an error
            in an earlier one that no repair removes.
        tells: Names of all its findings, where an error of another check of its stage may explain them; such a check is
            left out then.
    """

    stage: ClassVar[int] = 1
    tells: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def findings(self, subject: CheckedLog) -> Sequence[Finding]:
        """Return what was found, nothing where all is well."""
