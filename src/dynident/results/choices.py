"""Tables of what was found on the way to an estimate: delays, the friction of each joint, non-linear fields."""

from __future__ import annotations

import math
from collections.abc import Sequence

from dynident.identification.problem.choices import (
    Choices,
    DelayRecord,
    FieldChoice,
    FieldEstimate,
    GainUncertainty,
    NoiseBias,
)
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import WHOLE_PART, auto_friction, called
from dynident.model.friction.periodic import Periodic
from dynident.results.text import (
    MISSING,
    Table,
    columns_of,
    format_given,
    format_number,
    format_percent,
    format_value,
    label,
)


def choice_tables(choices: Choices, model: DynamicModel | None = None) -> tuple[tuple[str, Table], ...]:
    """Return the tables, each with its title, from the choices of an estimate; none where nothing was chosen.

    Args:
        choices: The choices.
        model: The model of the estimate, where noise of positions is among the choices, or parts that were not offered
            are to be named.
    """
    tables = []
    if choices.delays:
        tables.append(("Time delay between torque and position signals", _delays(choices.delays)))
    if tried := [each for each in choices.chosen_fields or () if not each.not_tried]:
        tables.append(("Friction model selection by cross-validation", _held_out(tried, model)))
    if missing := _not_tried(choices.chosen_fields or (), model):
        columns = columns_of("part", "joints", "field", ">given", "reason")
        tables.append(("Friction that was not tried", Table(columns, tuple(missing))))
    if choices.non_linear:
        tables.append(("Friction fields estimated from the logs", _fields(choices.non_linear)))
    if choices.gain_std is not None:
        tables.append(("Drive gain uncertainty", _gains(choices.gain_std)))
    if choices.position_noise is not None:
        left = choices.position_noise.left
        done = f"taken out, but for {format_percent(left)} that may be left" if left < 1.0 else "in the intervals"
        tables.append(
            (
                f"Noise of the positions: its bias is {done}",
                _noise(choices.position_noise, () if model is None else model.robot.joint_names),
            )
        )
    return tuple(tables)


def cutoff_table(choices: Choices) -> Table | None:
    """Return how the estimate depends on the cut-off of its filter; None where that was not tried."""
    found = choices.cutoff_sensitivity
    if found is None:
        return None
    columns = columns_of(">cut-off [Hz]", ">cross-validation error [%]", "moves most", ">by [std]")
    rows = []
    for row in found.table:
        own = row.cutoff_hz == found.cutoff_hz
        moved = ("the fit's own", MISSING) if own else (label(row.parameter), format_number(row.largest_change, 2))
        error = format_number(100.0 * row.cross_validation_error, 3)
        rows.append((format_given(row.cutoff_hz), error, *moved))
    note = f"Errors are those of {found.folds} blocks of the training data, each held out once."
    return Table(columns, tuple(rows), note)


def _gains(stated: GainUncertainty) -> Table:
    rows = tuple((label(joint), format_percent(value, sign=False)) for joint, value in stated.relative.items())
    note = (
        "Parameters carry these errors beside their own deviations, which do not contain them: a gain that is 2 % off "
        "moves what its drive determines by 2 %. extras.gain_std.parameters of the estimate has the figures."
    )
    return Table(columns_of("joint", ">rel. std of the gain [%]"), rows, note)


def _noise(found: NoiseBias, joints: Sequence[str]) -> Table:
    rows = tuple((label(joint), format_number(size, 2)) for joint, size in zip(joints, found.positions, strict=True))
    note = "Its bias of the parameters (errors in variables; extras.position_noise.parameters) is "
    if found.left < 1.0:
        note += f"taken out of the estimate; {format_percent(found.left)} of it may be left and is in the intervals."
    else:
        note += "in the intervals, not taken out of the estimate."
    return Table(columns_of("joint", ">std [rad or m]"), rows, note)


def _delays(delays: Sequence[DelayRecord]) -> Table:
    columns = columns_of("log", ">delay [ms]", ">std [ms]", ">applied [ms]")
    rows = tuple(
        (label(each.log), *format_value(1e3 * each.seconds, 1e3 * each.std), f"{1e3 * each.applied:.3g}")
        for each in delays
    )
    note = "A delay within two standard deviations of zero is not applied. Beside friction with a memory it lies "
    note += "between none and that found without it. Other logs are taken to have the mean that is applied."
    return Table(columns, rows, note)


def _field(found: FieldChoice | FieldEstimate) -> tuple[str, str, str]:
    """Return part, joints and name of a field."""
    return label(found.part), ", ".join(map(label, found.joints or ())) or "all", label(found.field)


def _held_out(found: Sequence[FieldChoice], model: DynamicModel | None) -> Table:
    columns = columns_of("part", "joints", "field", ">given", ">best", ">reduction [%]", ">fastest [%]", "used")
    open_parts = {(each.part, each.joints) for each in found if each.field == WHOLE_PART}
    order = list(dict.fromkeys(each.part for each in found))  # rows of a part stand together
    rows = tuple(
        (
            *_field(each),
            *_values(each),
            " ± ".join(format_value(100.0 * each.gain, 100.0 * each.error)) if each.error else MISSING,
            MISSING if each.fastest is None else format_number(100.0 * each.fastest, 2),
            _used(each, (each.part, each.joints) in open_parts and each.field != "width"),
        )
        for each in sorted(found, key=lambda each: order.index(each.part))
    )
    note = (
        "Reduction of the mean squared residual of held-out samples ± its std, by the best value of a field, by a part "
        "against its absence; below zero it grows. It is over blocks and, as one more, the fastest fifth of the "
        "samples, out of the range of the fit, whose own stands beside it. The given value is kept unless the "
        "reduction is half a per cent and more than chance makes it in one of twenty logs. Of a part that was open it "
        "is a start: the reduction is that of the best values of a grid, together for all fields, and the values that "
        "fit all samples best are used ('fitted'). Of parts without fields of their own the shortest list within "
        f"a standard error of the best is there. {MISSING}: nothing differs, as where no samples are faster."
    )
    ends = [" ".join(_field(each)[::2]) for each in found if _is_at_end(each, model)]
    return Table(columns, rows, note + f" At an end of the range that is tried: {', '.join(ends)}." * bool(ends))


def _is_at_end(held: FieldChoice, model: DynamicModel | None) -> bool:
    """Return whether another value than the stated one was taken that is an end of the range of its field."""
    parts = () if model is None or held.value == held.stated else model.friction
    spans = [part.ranges[held.field] for part in parts if called(part) in held.part and held.field in part.ranges]
    return any(math.isclose(held.value, end, rel_tol=1e-3) for span in spans for end in (span.low, span.high))


def _not_tried(found: Sequence[FieldChoice], model: DynamicModel | None) -> list[tuple[str, ...]]:
    """Return what the logs could not decide on, and the parts of ``friction: auto`` that the case does not offer."""
    left = [each for each in found if each.not_tried]
    starts = [f"; the search began at {each.best:.3g}" * (each.best != each.stated) for each in left]
    pairs = zip(left, starts, strict=True)
    rows = [(*_field(each), _values(each)[0], each.not_tried + start) for each, start in pairs]
    if not found or model is None:
        return rows
    known = {name for each in found for name in each.part.split(", ")} | {called(part) for part in model.friction}
    for part in (*auto_friction(), Periodic()):
        needed = max((span.least_log for span in part.ranges.values() if span.is_duration), default=0.0)
        needs = f"; it needs logs of {needed:g} s and more" if needed else ""
        needs = "; it needs temperatures (log: columns: temperature)" if "temperature" in part.needs else needs
        needs = "; it needs the cycles of gear or motor (friction: periodic: {cycles: ...})" if part.cycle else needs
        if (name := called(part)) not in known:
            rows.append((label(name), "all", WHOLE_PART, "left out", f"not among the parts of the case{needs}"))
    return rows


def _used(held: FieldChoice, is_start: bool) -> str:
    """Return which value the model has; of a whole part, whether it is there. Of an open part the given is a start."""
    if held.field == WHOLE_PART:
        return "in the model" if held.value else "left out"
    return "given" if held.value == held.stated else "fitted" if is_start else "best"


def _values(held: FieldChoice) -> tuple[str, str]:
    """Return the stated and the best value of a field; of a whole part, whether it is there."""
    if held.field == WHOLE_PART:
        return "left out", "there" if held.best else "left out"
    return format_given(held.stated), format_number(held.best, 3)


def _fields(found: Sequence[FieldEstimate]) -> Table:
    columns = columns_of("part", "joints", "field", ">value", ">as good from", ">to")
    rows = tuple(
        (*_field(each), *(format_number(value, 3) for value in (each.value, each.low, each.high))) for each in found
    )
    at_end = [" ".join(_field(each)[::2]) for each in found if each.end]
    note = f"At an end of the range that is looked at, beyond which the data may ask for more: {', '.join(at_end)}."
    return Table(columns, rows, note if at_end else "")


def cutoff_lines(choices: Choices) -> list[str]:
    """Return a line on how the cut-off was chosen and one on what it matters, where they are known."""
    lines = []
    if choices.cutoff_choice is not None:
        lines.append(f"cut-off chosen: {choices.cutoff_choice.reason}")
    found = choices.cutoff_sensitivity
    if found is not None:
        own = next(row for row in found.table if row.cutoff_hz == found.cutoff_hz)
        others = [
            f"{100 * row.cross_validation_error:.3g} % at {row.cutoff_hz:g} Hz ({row.parameter} moves by "
            f"{row.largest_change:.2g} std)"
            for row in found.table
            if row is not own
        ]
        error = f"{100 * own.cross_validation_error:.3g} % at {own.cutoff_hz:g} Hz"
        lines.append(f"held-out error on blocks of the training data: {error}, {', '.join(others)}")
    return lines
