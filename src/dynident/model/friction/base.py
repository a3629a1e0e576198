"""What a friction part is: one expression a coefficient, from which columns, derivatives and exported code come."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, ClassVar, Literal

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.errors import BadOption
from dynident.model.friction._expression import Expression, Inputs, stacked
from dynident.model.friction._motion import Motion
from dynident.model.kernels.trace import (
    Number,
    Scalar,
    cosine,
    exponential,
    larger,
    power,
    sine,
    smaller,
    smooth_sign,
    tangent_hyperbolic,
)

__all__ = ["WHOLE_PART", "Coefficient", "Friction", "Inputs", "Motion", "Number", "Range", "SelectionUse", "State"]
__all__ += ["check_positive", "cosine", "exponential", "larger", "power", "sine", "smaller", "smooth_sign"]
__all__ += ["tangent_hyperbolic"]


@dataclass(frozen=True)
class Coefficient:
    """One coefficient per drive.

    Attributes:
        symbol: Such as ``"Fc"``.
        unit: Unit on a revolute joint.
        linear_unit: Unit on a prismatic joint.
        nonnegative: Whether physics asks for a value >= 0.
        in_simulators: What a joint of simulators and robot models has for it, if anything: ``damping``, ``friction``
            (dry, with a sharp sign) or ``armature``.
    """

    symbol: str
    unit: str
    linear_unit: str
    nonnegative: bool
    in_simulators: Literal["", "damping", "friction", "armature"] = ""

    def unit_of(self, kind: str) -> str:
        """Return the unit on a kind of joint: ``revolute`` or ``prismatic``."""
        return self.unit if kind == "revolute" else self.linear_unit


@dataclass(frozen=True)
class Range:
    """Where a field that enters the columns non-linearly is looked for, on a logarithmic scale.

    Attributes:
        low: Least value, above 0.
        high: Greatest value.
        is_speed: Whether it is a speed: then nothing beyond the fastest motion is tried.
        is_distance: Whether it is a distance: then nothing below the resolution of the positions is tried.
        is_duration: Whether it is a duration: then nothing beyond the longest log is tried.
    """

    low: float
    high: float
    is_speed: bool = False
    is_distance: bool = False
    is_duration: bool = False

    @property
    def least_log(self) -> float:
        """How long a log has to be for a duration to be looked for, in s."""
        return 2.0 * self.low


@dataclass(frozen=True)
class State:
    """What a part remembers at each drive, such as the deflection of bristles or a temperature.

    A log does not state it: it begins at ``start``, and may have been anywhere between the bounds.

    Attributes:
        symbol: Such as ``"z"``.
        unit: Unit on a revolute joint.
        linear_unit: Unit on a prismatic joint.
        low: Least value at the first sample.
        high: Greatest value at the first sample.
        start: Value at the first sample.
    """

    symbol: str
    unit: str
    linear_unit: str
    low: float
    high: float
    start: float = 0.0


@dataclass(frozen=True)
class SelectionUse:
    """How a part stands in the list that ``friction: auto`` and drafts leave to held-out samples.

    Attributes:
        place: Place in the list, from 0.
        options: Options of the part there; with ``choose`` among them held-out samples decide.
        is_default: Whether a model whose friction is not stated has it, with the defaults of its options.
    """

    place: int
    options: Mapping[str, Any] = field(default_factory=dict)
    is_default: bool = False


#: What ``choose`` names where the logs decide whether a part is there at all.
WHOLE_PART = "part"


@dataclass(frozen=True)
class Friction(ABC):
    """Torque of each drive that is linear in a few coefficients of its own: tau_j = sum_c x_jc f_c(motion)_j.

    A part is a frozen dataclass whose fields are its options. It states each f_c once, as an expression.

    Attributes:
        joints: Joints that the part acts on; None for all.
        vary: Names of its non-linear fields whose values are to be found from the log; the stated ones are the start.
        choose: Names of such fields whose stated values stand unless held-out samples of the log ask for others; with
            ``part`` the part itself is only there if they ask for it.
    """

    coefficients: ClassVar[tuple[Coefficient, ...]]

    #: Fields that enter the columns non-linearly, and where a good value may be.
    ranges: ClassVar[dict[str, Range]] = {}

    #: Its place in the list of ``friction: auto``; it is to be stated where there is none.
    selection: ClassVar[SelectionUse | None] = None

    #: Parts that it contains as stated: it may come in their place where the logs decide about all of them.
    in_place_of: ClassVar[tuple[str, ...]] = ()

    #: Parts that it contains with other values of its fields, beside those of ``in_place_of``.
    contains: ClassVar[tuple[str, ...]] = ()

    #: Parts of which one is there before the logs may add it.
    after: ClassVar[tuple[str, ...]] = ()

    joints: tuple[str, ...] | None = field(default=None, kw_only=True)
    vary: tuple[str, ...] | None = field(default=None, kw_only=True)
    choose: tuple[str, ...] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        for name, what in _POSITIVE.items():
            if name in self.__dataclass_fields__:
                check_positive(getattr(self, name), name, what)

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process needs: the fields, and nothing that is made of them."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @property
    def is_optional(self) -> bool:
        """Whether it is only there if held-out samples of the log ask for it."""
        return WHOLE_PART in (self.choose or ())

    @property
    def is_default(self) -> bool:
        """Whether a model whose friction is not stated has it."""
        return self.selection is not None and self.selection.is_default

    @property
    def cycle(self) -> float | None:
        """Range of positions after which its torque repeats, in rad or m; None where none is known."""
        return None

    @property
    def options(self) -> dict[str, Any]:
        """Its own options by name: what its columns depend on, not for which joints it is or what the logs decide."""
        shared = {each.name for each in fields(Friction)}
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name not in shared}

    @property
    def states(self) -> tuple[State, ...]:
        """What it remembers at each drive; nothing as a rule."""
        return ()

    @property
    def lags(self) -> bool:
        """Whether its torque follows a reversal late, as that of a log with a delay does: what remembers, as a rule."""
        return bool(self.states)

    @property
    def needs_memory(self) -> bool:
        """Whether it has states and no :meth:`terms_without_memory`."""
        return bool(self.states) and type(self).terms_without_memory is Friction.terms_without_memory

    @abstractmethod
    def terms(self, at: Inputs) -> tuple[Number, ...]:
        """Return the expressions f_c of a drive, one for each of the k coefficients.

        They may read all inputs but ``moved`` and ``step``.
        """

    def terms_without_memory(self, at: Inputs) -> tuple[Number, ...]:
        """Return what stands for :meth:`terms` where its states are not known; without it such motions are refused."""
        return self.terms(at)

    def update(self, at: Inputs) -> tuple[Number, ...]:
        """Return each of ``states`` at a sample from ``at.state``, their values at the sample before."""
        return at.state

    @cached_property
    def expression(self) -> Expression:
        """Its expressions, traced."""
        return Expression(self.terms, self.update, len(self.coefficients), len(self.states))

    @cached_property
    def _forgetful(self) -> Expression:
        return Expression(self.terms_without_memory, self.update, len(self.coefficients), len(self.states))

    def _expression_at(self, motion: Motion) -> Expression:
        return self.expression if motion.state is not None or not self.states else self._forgetful

    @cached_property
    def needs(self) -> tuple[str, ...]:
        """Signals beyond the motion itself that it reads: ``torque``, ``temperature``, ``state``."""
        reads = frozenset().union(*self.expression.reads)
        return tuple(name for name, array in _SIGNALS.items() if array in reads)

    @cached_property
    def is_of_position(self) -> bool:
        """Whether its torque follows the position alone, as that of a spring or a ripple."""
        return frozenset().union(*self.expression.reads) == {"q"}

    @property
    def is_spring(self) -> bool:
        """Whether it acts as a spring does: its torque follows the position and repeats after no cycle."""
        return self.is_of_position and self.cycle is None

    @cached_property
    def is_inertia(self) -> tuple[bool, ...]:
        """Which coefficients are inertias of the drive: their expression is the acceleration itself."""
        return tuple(self.expression.is_input(term, "ddq") for term in self.expression.terms)

    @cached_property
    def is_constant(self) -> tuple[bool, ...]:
        """Which coefficients are constant torques: their expression is 1."""
        return tuple(not isinstance(term, Scalar) and term == 1.0 for term in self.expression.terms)

    def in_simulators(self, values: Array) -> tuple[dict[str, float], dict[str, float]]:
        """Return what a joint of simulators holds of coefficients (k,), and by symbol what is left over.

        A part that a joint holds only nearly says here what comes nearest.
        """
        held, left = {}, {}
        for coefficient, value in zip(self.coefficients, values.tolist(), strict=True):
            if coefficient.in_simulators:
                held[coefficient.in_simulators] = value
            else:
                left[coefficient.symbol] = value
        return held, left

    def columns(self, motion: Motion) -> Array:
        """Return f_c at every drive, shape (N, n, k) for the k coefficients.

        Raises:
            BadOption: The motion lacks a signal that it needs.
        """
        found = self._expression_at(motion).columns(self._inputs(motion))
        return stacked([found[k] for k in range(len(self.coefficients))], motion.dq.shape)

    def derivatives(self, motion: Motion) -> tuple[Array, Array, Array]:
        """Return the derivatives of every value of :meth:`columns` by its q, dq and ddq, each (N, n, k), exact.

        What the gradient of an excitation criterion asks for; torque, temperature and states are held. A jump (a sharp
        sign) has the derivative 0.

        Raises:
            BadOption: The motion lacks a signal that it needs.
        """
        found, count = self._expression_at(motion).slopes(self._inputs(motion)), len(self.coefficients)
        slopes = [[found.get(order * count + k, 0.0) for k in range(count)] for order in range(3)]
        by_q, by_dq, by_ddq = (stacked(own, motion.dq.shape) for own in slopes)
        return by_q, by_dq, by_ddq

    def states_along(self, motion: Motion, step: float, first: Array | None = None) -> Array:
        """Return its states along samples that follow each other, shape (N, n, s), from their start on.

        Args:
            motion: The motion at the samples.
            step: Time from one sample to the next, in s.
            first: States at the first sample, shape (n, s); None for their start.
        """
        found = np.empty((*motion.dq.shape, len(self.states)))
        found[:1] = [state.start for state in self.states] if first is None else first
        moved, update = np.diff(motion.q, axis=0), self.expression.update
        for k in range(1, len(found)):
            inputs = self._inputs(replace(motion.rows(slice(k, k + 1)), state=found[k - 1 : k]))
            for slot, values in update({**inputs, "moved": moved[None, k - 1 : k], "step": (step,)}).items():
                found[k, :, slot] = values
        return found

    def is_unsettled(self, motion: Motion) -> BoolArray:
        """Return where its states still depend on those at the first sample, which no log states, shape (N, n)."""
        return np.zeros(motion.q.shape, dtype=bool)

    def _inputs(self, motion: Motion) -> Mapping[str, Any]:
        """Return what the programs read.

        Raises:
            BadOption: The motion lacks a signal that they need.
        """
        for name in self.needs:
            if getattr(motion, name) is None and (name != "state" or self.needs_memory):
                raise BadOption("friction", type(self).__module__.rsplit(".", 1)[-1], _LACKING[name])
        state = () if motion.state is None else motion.state.transpose(2, 0, 1)
        return {
            "q": (motion.q,),
            "dq": (motion.dq,),
            "ddq": (motion.ddq,),
            "load": (motion.torque,),
            "temperature": (motion.temperature,),
            "state": state,
        }


#: What is to be given for the fields of these names.
_POSITIVE = {
    **dict.fromkeys(("velocity", "width", "crossover"), "a speed in rad/s"),
    "exponent": "a number such as 1 or 2,",
    "length": "a distance in rad, at least the resolution of the encoder,",
    "time_constant": "a time in s, at most as long as the logs,",
}

#: Input that stands for a signal beyond the motion, and what is to be done where it is not there.
_SIGNALS = {"torque": "load", "temperature": "temperature", "state": "state"}
_LACKING = {
    "torque": "the torque of the rigid bodies is not known here; leave the part out",
    "temperature": "there are no temperatures here; map them (log: columns: temperature), or leave the part out",
    "state": "its state is not known here, only along a log or a simulation; leave the part out",
}


def check_positive(value: float, name: str, what: str) -> None:
    """Refuse an option that is not a finite number above 0; ``what`` says what is to be given instead.

    Raises:
        BadOption: It is not.
    """
    if not 0 < value < np.inf:
        raise BadOption(name, value, f"give {what} above 0")
