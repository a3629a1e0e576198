"""What was chosen from the logs on the way to an estimate, as the estimate, its file and its report state it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints


@dataclass(frozen=True)
class DelayRecord:
    """Time delay between torque and position signals of one log.

    Attributes:
        log: Name of the log.
        seconds: By how much its torque lags behind its positions, in s.
        std: Standard deviation of it, in s.
        applied: What the motion is shifted by, in s.
    """

    log: str
    seconds: float
    std: float
    applied: float


@dataclass(frozen=True)
class FieldChoice:
    """A field of a friction part that the logs could have had otherwise.

    Attributes:
        part: Name of the friction part; of all whose sign turns over one width.
        joints: The joints that it is for; None for all.
        field: Name of the field; ``part`` for the part itself, whose values are 0 (left out) and 1 (there).
        stated: The value that was stated.
        best: The value with the least cross-validation error, made finer by all samples where it was taken.
        value: The one that was taken.
        gain: Share of the mean squared cross-validation residual that the best value takes off; below 0 it grows.
        error: Standard error of that share, block by block; None where the logs have too few rows to hold some out.
        fastest: Share of the fastest samples alone, predicted by a fit of the others; None where nothing differs there.
        not_tried: Why the logs could not decide on a part; empty where they could.
    """

    part: str
    joints: tuple[str, ...] | None
    field: str
    stated: float
    best: float
    value: float
    gain: float
    error: float | None
    fastest: float | None = None
    not_tried: str = ""


@dataclass(frozen=True)
class FieldEstimate:
    """Value of one non-linear field of a friction part.

    Attributes:
        part: Name of the friction part.
        joints: The joints that it is for; None for all.
        field: Name of the field.
        value: The best value.
        low: Values below leave a residual that is worse by more than it is certain, or the end of the range.
        high: The same above.
    """

    part: str
    joints: tuple[str, ...] | None
    field: str
    value: float
    low: float
    high: float

    @property
    def end(self) -> int:
        """-1 at the lower end of the range that was searched, 1 at the upper one, 0 at neither."""
        return int(math.isclose(self.value, self.high)) - int(math.isclose(self.value, self.low))


@dataclass(frozen=True)
class CutoffRecord:
    """The cut-off that was chosen.

    Attributes:
        cutoff_hz: The cut-off.
        as_good_hz: Least and greatest of those that are as good.
        reason: The choice in one sentence.
        share_of_time: Share of the recorded time that was looked at.
        candidates: Variance and squared biases of each cut-off that was tried.
        spectra: Of the longest log.
    """

    cutoff_hz: float
    as_good_hz: tuple[float, ...]
    reason: str
    share_of_time: float
    candidates: tuple[Mapping[str, float], ...]
    spectra: Mapping[str, Any]


@dataclass(frozen=True)
class CutoffTrial:
    """The fit at one cut-off, judged at that of the estimate.

    Attributes:
        cutoff_hz: The cut-off.
        cross_validation_error: Relative error on blocks of the training data, each left out once.
        largest_change: Of a parameter, in standard deviations of the estimate.
        parameter: The one that changes most.
        beyond_chance: Largest change in standard deviations at the cut-off that knows less.
        farthest: The parameter of that change.
        changes: Of all parameters, in standard deviations, shape (b,).
    """

    cutoff_hz: float
    cross_validation_error: float
    largest_change: float
    parameter: str
    beyond_chance: float
    farthest: str
    changes: tuple[float, ...]


@dataclass(frozen=True)
class CutoffSensitivity:
    """How the estimate depends on the cut-off of its filter.

    Attributes:
        cutoff_hz: That of the estimate.
        folds: Blocks, each left out once.
        table: Cut-offs that were tried, its own included.
    """

    cutoff_hz: float
    folds: int
    table: tuple[CutoffTrial, ...]


@dataclass(frozen=True)
class GainUncertainty:
    """What uncertain drive gains do to the estimate.

    Attributes:
        relative: Stated relative standard deviation of the gain, by joint.
        parameters: Standard deviation that they add to each base parameter, shape (b,), gains independent.
    """

    relative: Mapping[str, float]
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class NoiseBias:
    """What noise of the positions does to least squares.

    Attributes:
        positions: Standard deviation of the white noise of each joint's positions, in rad or m, shape (n,).
        parameters: Bias of each base parameter by it, in its unit, shape (b,).
        left: Share of it that may be left in the estimate, whose square is in the covariance; 1: it was not taken out.
    """

    positions: tuple[float, ...]
    parameters: tuple[float, ...]
    left: float = 1.0


@dataclass(frozen=True)
class Choices:
    """What was chosen on the way to an estimate, and what is known of it; None where it was not asked for.

    Attributes:
        cutoff_choice: The cut-off, where it was open.
        delays: Of each log.
        delay_s: What logs that had no part in the fit are shifted by, in s.
        chosen_fields: Fields of friction parts that cross-validation decided.
        non_linear: Fields of friction parts that were estimated.
        gain_std: What uncertain drive gains add.
        position_noise: Bias by noise of the positions, where it is not small beside the standard deviations.
        cutoff_sensitivity: Fits at other cut-offs.
        constraints_not_kept: Name of an estimator that leaves stated constraints aside.
    """

    cutoff_choice: CutoffRecord | None = None
    delays: tuple[DelayRecord, ...] | None = None
    delay_s: float | None = None
    chosen_fields: tuple[FieldChoice, ...] | None = None
    non_linear: tuple[FieldEstimate, ...] | None = None
    gain_std: GainUncertainty | None = None
    position_noise: NoiseBias | None = None
    cutoff_sensitivity: CutoffSensitivity | None = None
    constraints_not_kept: str | None = None

    def data(self) -> dict[str, Any]:
        """Return what is known as plain data; files and JSON have these keys."""
        return {name: value for name, value in asdict(self).items() if value is not None}


#: Keys of the choices in files and JSON.
CHOICES = frozenset(each.name for each in fields(Choices))


def choices_of(data: Mapping[str, Any]) -> Choices:
    """Return the choices in plain data; other keys are left aside.

    Raises:
        KeyError: A key of a choice is missing.
    """
    known = {each.name: data[each.name] for each in fields(Choices) if each.name in data}
    return Choices(**{name: _read(_hints(Choices)[name], value) for name, value in known.items()})


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _read(hint: Any, value: Any) -> Any:
    """Return a value of a kind from plain data."""
    if value is None or hint is Any:
        return value
    if get_origin(hint) is UnionType:
        return _read(next(kind for kind in get_args(hint) if kind is not NoneType), value)
    if is_dataclass(hint):
        names = [each.name for each in fields(hint) if each.name in value or each.default is MISSING]
        return hint(**{name: _read(_hints(hint)[name], value[name]) for name in names})  # type: ignore[operator]
    if isinstance(value, Mapping):
        return {key: _read(get_args(hint)[1], own) for key, own in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(_read(get_args(hint)[0], own) for own in value)
    return value
