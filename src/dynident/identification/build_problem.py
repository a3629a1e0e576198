"""Preprocessed logs and a model to the problem that every estimator can be asked to solve."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, default_preprocessing, preprocess
from dynident.errors import LogMismatch
from dynident.identification.problem.choices import Choices, DelayRecord, FieldChoice
from dynident.identification.problem.prior import BodyPrior
from dynident.identification.problem.problem import Problem
from dynident.identification.selection.cutoff.choice import with_cutoff
from dynident.identification.selection.friction.load import problem_of, without_load
from dynident.identification.selection.friction.variable_projection import (
    finest_of,
    has_choices,
    has_varying,
    reach_of,
    vary_fields,
    without_optional,
)
from dynident.model.base_parameters import base_parameters, with_stated_rotors
from dynident.model.body_constraints import Constraints
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import WHOLE_PART, Friction, auto_friction, called, motor_ripple

if TYPE_CHECKING:  # a case that states its friction chooses none
    from dynident.identification.selection.friction.column_pool import SharedRows
    from dynident.identification.selection.friction.held_out_fields import FrictionSearch

#: A delay that moves by more of its standard deviations is another one.
MOVED = 2.0


@dataclass(frozen=True)
class PriorKnowledge:
    """What is known about the bodies beforehand.

    Attributes:
        constraints: Masses, centres and hulls; estimators that keep them say so.
        prior: Standard parameters, in place of those of the robot model; None for those of the robot model.
    """

    constraints: Constraints = field(default_factory=Constraints)
    prior: BodyPrior | None = None


def build_problem(
    model: DynamicModel,
    logs: Sequence[Log],
    preprocessing: Preprocessing | None = None,
    progress: Callable[[str], None] = lambda step: None,
    choose_friction: bool = False,
    knowledge: PriorKnowledge | None = None,
) -> Problem:
    """Return the problem that every estimator can be asked to solve.

    The order: cut-off, delay, friction parts and fields that held-out samples choose, fields that vary.

    Args:
        model: Robot, drives and friction; fields that its friction parts vary are found first.
        logs: Raw logs with positions and torques; each is preprocessed on its own.
        preprocessing: How logs become rows; default: ``default_preprocessing``.
        progress: Called with each step in words.
        choose_friction: Choose the friction from the logs, in place of the model's, from the parts of a draft.
        knowledge: What is known about the bodies beforehand.

    Raises:
        ContradictoryConstraints: No robot meets the constraints.
        LogMismatch: A log does not fit the robot, or is too short.
        PoorExcitation: The logs do not determine all base parameters.
    """
    if not logs:
        raise LogMismatch("identify", "no log", "give at least one log")
    preprocessing, knowledge = preprocessing or default_preprocessing(), knowledge or PriorKnowledge()
    ordered = [log.ordered(model.robot.joint_names) for log in logs]
    if choose_friction:
        model = replace(model, friction=(*auto_friction(model.robot), *motor_ripple(model.robot)))
    model = with_stated_rotors(model)
    preprocessing, cutoff = with_cutoff(without_optional(model), ordered, preprocessing, progress)
    model, finest, aside = _within_logs(model, ordered, preprocessing)
    progress("preprocessing")
    plain = tuple(preprocess(log, preprocessing) for log in ordered)
    prepared, delays = _with_delays(without_optional(model), plain, progress, model.lags)
    choices = Choices(cutoff_choice=cutoff, **delays)
    if has_choices(model):
        from dynident.identification.selection.friction.column_pool import ROWS, SharedRows
        from dynident.identification.selection.friction.search_friction import search_friction

        shared = SharedRows(model.robot, [log.sparser(ROWS) for log in plain])
        search = partial(search_friction, progress=progress, finest=finest, shared=shared)
        before, rows = (prepared, choices), (shared, partial(_sharper, ordered, preprocessing))
        model, prepared, choices = _with_chosen_fields(model, plain, before, progress, search, rows)
    if aside:
        given = {(each.part, each.field): each.stated for each in aside}
        told = [replace(it, stated=given.get((it.part, it.field), it.stated)) for it in choices.chosen_fields or ()]
        choices = replace(choices, chosen_fields=(*told, *aside))
    if has_varying(model):
        model, varied = vary_fields(model, prepared, progress, finest)
        choices = replace(choices, non_linear=tuple(varied))
    progress("base parameters and reduction")
    problem = problem_of(model, prepared)
    knowledge.constraints.check(model.robot, model.parameters)
    prior = knowledge.prior and knowledge.prior.for_model(model)
    return replace(problem, choices=choices, constraints=knowledge.constraints, prior=prior)


def _resolution(model: DynamicModel, logs: Sequence[Log]) -> Array | None:
    """Return the least distance that the positions of each drive show, shape (n,); None where no friction part asks.

    That is their resolution, or half of what nearly all steps from sample to sample of moving ones exceed.
    """
    if not any(span.is_distance for part in model.friction for span in part.ranges.values()):
        return None
    steps = [own for log in logs for own in np.abs(np.diff(log.q, axis=0)).T]
    least = np.reshape([0.5 * np.quantile(own[own > 0], 0.01) if own.any() else 0.0 for own in steps], (len(logs), -1))
    joints = np.max([*(log.resolution for log in logs), *least], axis=0)
    return np.max(np.abs(np.asarray(model.robot.coupling)) * joints, axis=1)


def _within_logs(
    model: DynamicModel, logs: Sequence[Log], how: Preprocessing
) -> tuple[DynamicModel, Array | None, tuple[FieldChoice, ...]]:
    """Return the model whose friction the logs can tell, the resolution of each drive, and what was left aside and why.

    Distances of friction that are left to the logs begin at the resolution. Parts that may be missing are missing
    where logs are too short for their duration or have no temperatures and they read some, and on drives whose logs do
    not show their cycle.

    Raises:
        LogMismatch: A distance that is stated is below the resolution or beyond half the motion, a duration beyond the
            longest log, or a cycle beyond the motion.
    """
    finest, longest = _resolution(model, logs), max(float(log.time[-1] - log.time[0]) for log in logs)
    furthest, lack_temperatures = reach_of(model, logs), any(log.temperature is None for log in logs)
    parts, aside = list[Friction](), list[FieldChoice]()
    for stated in model.friction:
        part, spans = _within_cycle(model, stated, logs, how), stated.ranges.items()
        needed = max((span.least_log for _, span in spans if span.is_duration), default=0.0)
        reason = "" if part == stated else "less than half a cycle in the logs: log slow motions over a whole one"
        if stated.is_optional and lack_temperatures and "temperature" in stated.needs:
            part, reason = None, "no temperatures are read (log: columns: temperature)"
        elif stated.is_optional and longest < needed:
            part, reason = None, f"logs of {longest:.3g} s: log {needed:.3g} s or more from a cold start"
        if reason:
            left = None if part is None else {*(part.joints or ())}
            joints = stated.joints if left is None else tuple(own for own in model.robot.joint_names if own not in left)
            aside.append(FieldChoice(called(stated), joints, WHOLE_PART, 0.0, 0.0, 0.0, 0.0, None, None, reason))
        if part is None:
            continue
        least, left_open, moved = finest_of(model, part, finest), (part.choose or (), part.vary or ()), dict[str, Any]()
        for name, span in spans:
            value, low = getattr(part, name), least if span.is_distance else 0.0
            high = furthest if span.is_distance else longest if span.is_duration else np.inf
            if 0.999 * low <= value <= 1.001 * high:
                continue
            why, step = _beyond(span.is_distance, value < low, low, high)
            why = f"{value:g} {why}"
            if not any(name in those for those in left_open):
                raise LogMismatch(logs[0].name, f"{called(part)}: {name} {why}", step)
            end = moved[name] = low if value < low else high
            aside.append(FieldChoice(called(part), part.joints, name, value, end, end, 0.0, None, None, why))
        parts.append(replace(part, **moved) if moved else part)
    model = replace(model, friction=tuple(parts)) if tuple(parts) != model.friction else model
    return model, finest, tuple(aside)


def _beyond(is_distance: bool, is_below: bool, low: float, high: float) -> tuple[str, str]:
    """Return why logs cannot tell a value outside of ``low`` to ``high``, and what to do."""
    if not is_distance:
        step = "log at least as long from a cold start, state a shorter time, or leave the part out"
        return f"s is longer than the longest log, {high:.3g} s", step
    if is_below:
        step = f"state at least {low:.2g}, or log finer positions at a higher rate"
        return f"is below the least distance that the positions show, {low:.3g} rad (or m)", step
    why = f"is more than half the range of the motion, {2 * high:.3g} rad (or m): no drive moves far enough to slip"
    return why, f"state at most {high:.2g}, or log larger motions"


def _with_chosen_fields(
    model: DynamicModel,
    plain: Sequence[Prepared],
    before: tuple[Sequence[Prepared], Choices],
    progress: Callable[[str], None],
    search: Callable[..., FrictionSearch],
    shared: tuple[SharedRows, Callable[[DynamicModel], tuple[SharedRows, float] | None]],
) -> tuple[DynamicModel, Sequence[Prepared], Choices]:
    """Return the model with the fields that held-out data ask for, the logs with their delay, and the choice of both.

    A delay that is to be found is free at first, so that neither it nor friction passes for the other. A free delay
    also hides what the sign of dry friction does, so the fields are chosen again with the delay that was found, and
    once more where the delay beside these is another one. A part that remembers is tried beside the list without it,
    the delay free even where it is stated; where it is taken, the other parts are chosen again beside it, and both have
    to predict better than that list and its delay. Drives that stick at reversals look alike, as the filter of the
    positions smears it: with a cut-off r times higher that lasts 1 / r as long, and what is left without any filter has
    to count as that of a part. ``search`` is :func:`search_friction` with its settings, ``shared`` the rows of the logs
    and what makes those of positions that are filtered less, and r.
    """
    from dynident.identification.selection.friction.held_out_errors import OF_A_PART
    from dynident.identification.selection.friction.search_friction import predicts_better

    (prepared, choices), delay_is_free = before, plain[0].how.delay_s is None

    def settled(
        found: FrictionSearch, rows: Sequence[Prepared], own: Choices, last: DynamicModel, after: FrictionSearch | None
    ) -> tuple[FrictionSearch, Sequence[Prepared], Choices]:
        without = own.delays or ()
        for left in (2, 1, 0):
            is_moved = left == 2
            if delay_is_free and found.chosen != last:
                rows, delays = _with_delays(found.chosen, plain, progress, model.lags, without)
                pairs = zip(own.delays or (), delays["delays"], strict=True)
                is_moved |= any(abs(new.applied - old.applied) > MOVED * new.std for old, new in pairs)
                own = replace(own, **delays)
            if not (left and is_moved and (delay_is_free or after)):
                break
            last, found = found.chosen, search(model, rows, after=after)
        return found, rows, replace(own, chosen_fields=found.told)

    found = search(model, prepared, delay_is_free=delay_is_free)
    found, prepared, choices = settled(found, prepared, choices, without_optional(model), None)
    lagging = [called(part) for part in model.friction if part.lags and part.is_optional]
    beside = search(model, prepared, delay_is_free=True, after=found) if lagging else found
    if not beside.remembers:
        return found.chosen, prepared, replace(choices, chosen_fields=beside.told)
    beside, rows, own = settled(beside, prepared, choices, found.chosen, beside)
    better, tried = predicts_better(beside.chosen, rows, found.chosen, prepared, shared[0])
    if better and (sharper := shared[1](model)):
        less = predicts_better(beside.chosen, rows, found.chosen, prepared, sharper[0])[1]
        better = less[0].gain - (tried[0].gain - less[0].gain) / (sharper[1] - 1.0) > OF_A_PART
        tried = tried if better else tuple(replace(each, value=0.0) for each in less)
    told = tuple(each for each in beside.told if each.field != WHOLE_PART or each.part not in lagging)
    if not better:
        return found.chosen, prepared, replace(choices, chosen_fields=(*found.told, *tried))
    return beside.chosen, rows, replace(own, chosen_fields=(*told, *tried))


def _sharper(logs: Sequence[Log], how: Preprocessing, model: DynamicModel) -> tuple[SharedRows, float] | None:
    """Return rows of logs whose positions are filtered less, and by which ratio; None where the filter has no such."""
    from dynident.identification.selection.friction.column_pool import ROWS, SharedRows

    filters = [found for log in logs if (found := how.filter.sharper(log.rate))]
    if len(filters) < len(logs):
        return None
    rows = [preprocess(log, replace(how, filter=less)) for log, (less, _) in zip(logs, filters, strict=True)]
    return SharedRows(model.robot, [log.sparser(ROWS) for log in rows]), min(ratio for _, ratio in filters)


def _within_cycle(model: DynamicModel, part: Friction, logs: Sequence[Log], how: Preprocessing) -> Friction | None:
    """Return a part that may be missing for the drives that show half of its cycle at least; None where none does.

    What counts is motion above standstill whose cycles are slower than the bandwidth of the filter, or half the rate.

    Raises:
        LogMismatch: Drives of a part that is stated do not.
    """
    if part.cycle is None:
        return part
    names, coupling = model.robot.joint_names, np.asarray(model.robot.coupling)
    fastest, seen = part.cycle * (how.filter.bandwidth() or min(log.rate for log in logs) / 2), list[Array]()
    for log in logs:
        q = np.asarray(log.q) @ coupling.T
        speed = np.abs(np.gradient(q, axis=0)) * log.rate
        seen.append(np.where((speed >= how.standstill) & (speed <= fastest), q, np.nan))
    span = np.nan_to_num(np.fmax.reduce(np.concatenate(seen)) - np.fmin.reduce(np.concatenate(seen)))
    short = [drive for drive in model.drives_of(part) if span[drive] < 0.5 * part.cycle]
    if part.is_optional:
        kept = tuple(names[drive] for drive in model.drives_of(part) if drive not in short)
        return replace(part, joints=kept) if kept and short else part if kept else None
    if short:
        moved = ", ".join(f"'{names[drive]}' {span[drive]:.3g}" for drive in short)
        repeats = f"{called(part)} repeats after {part.cycle:.3g} rad (or m)"
        evidence = f"{repeats}, and less than half of that is seen: {moved}"
        slow = f"slower than {fastest:.3g} rad/s (or m/s), where the filter passes it"
        step = f"log motions over at least a whole cycle, {slow}, or state the part for other joints (joints: ...)"
        raise LogMismatch(logs[0].name, evidence, step)
    return part


def _with_delays(
    model: DynamicModel,
    plain: Sequence[Prepared],
    progress: Callable[[str], None],
    may_lag: bool,
    without: Sequence[DelayRecord] = (),
) -> tuple[Sequence[Prepared], dict[str, Any]]:
    """Return preprocessed logs with the delay of each taken out, and these delays, where they are asked for.

    ``may_lag`` says whether friction that remembers is stated or may be chosen; ``without`` are the delays as they are
    told without such friction, where that is known.
    """
    if plain[0].how.delay_s is not None:
        return plain, {}
    from dynident.identification.selection.delay import common_delay, find_delays  # few need it

    progress("time delay between torque and position")
    simple = without_load(model)
    bounds = without if simple.lags else ()
    if simple.lags and not bounds:
        forgetful = replace(simple, friction=tuple(part for part in simple.friction if not part.lags))
        bounds, _ = find_delays(forgetful, base_parameters(forgetful), plain)
    within = [delay.applied for delay in bounds]
    delays, prepared = find_delays(simple, base_parameters(simple), plain, within, may_lag)
    return prepared, {"delays": delays, "delay_s": common_delay(delays)}
