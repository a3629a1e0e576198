"""The functions of FMI 3.0 that a unit of an arm must have and has no use for: each is refused, in C."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

#: Types of which the unit has no variable.
_OTHERS: Final = (
    "Float32",
    "Int8",
    "UInt8",
    "Int16",
    "UInt16",
    "Int32",
    "UInt32",
    "Int64",
    "UInt64",
    "Boolean",
    "String",
)

_WHICH: Final = ("const fmi3ValueReference {}[]", "size_t {}")
_BINARY: Final = ("const fmi3Binary {}[]", "size_t {}")
_SLOPE: Final = (*_WHICH, *_WHICH, "const fmi3Float64 {}[]", "size_t {}", "fmi3Float64 {}[]", "size_t {}")
_FRACTION: Final = ("fmi3UInt64 {}[]", "fmi3UInt64 {}[]")
_FIXED_FRACTION: Final = ("const fmi3UInt64 {}[]", "const fmi3UInt64 {}[]")
_STATES: Final = ("fmi3Float64 {}[]", "size_t {}")

#: Refused whatever is asked; the parameters behind the instance.
_ALWAYS: Final[dict[str, Sequence[str]]] = {
    "GetNumberOfVariableDependencies": ("fmi3ValueReference {}", "size_t *{}"),
    "GetVariableDependencies": (
        "fmi3ValueReference {}",
        "size_t {}[]",
        "fmi3ValueReference {}[]",
        "size_t {}[]",
        "fmi3DependencyKind {}[]",
        "size_t {}",
    ),
    "SerializedFMUStateSize": ("fmi3FMUState {}", "size_t *{}"),
    "SerializeFMUState": ("fmi3FMUState {}", "fmi3Byte {}[]", "size_t {}"),
    "DeserializeFMUState": ("const fmi3Byte {}[]", "size_t {}", "fmi3FMUState *{}"),
    "GetDirectionalDerivative": _SLOPE,
    "GetAdjointDerivative": _SLOPE,
    "EnterConfigurationMode": (),
    "ExitConfigurationMode": (),
    "EnterStepMode": (),
    "ActivateModelPartition": ("fmi3ValueReference {}", "fmi3Float64 {}"),
}

#: Refused where they are asked for something; the second parameter behind the instance says for how many.
_SOMETHING: Final[dict[str, Sequence[str]]] = {
    **{f"Get{kind}": (*_WHICH, f"fmi3{kind} {{}}[]", "size_t {}") for kind in _OTHERS},
    **{f"Set{kind}": (*_WHICH, f"const fmi3{kind} {{}}[]", "size_t {}") for kind in _OTHERS},
    "GetBinary": (*_WHICH, "size_t {}[]", "fmi3Binary {}[]", "size_t {}"),
    "SetBinary": (*_WHICH, "const size_t {}[]", *_BINARY),
    "GetClock": (*_WHICH, "fmi3Clock {}[]"),
    "SetClock": (*_WHICH, "const fmi3Clock {}[]"),
    "GetIntervalDecimal": (*_WHICH, "fmi3Float64 {}[]", "fmi3IntervalQualifier {}[]"),
    "GetIntervalFraction": (*_WHICH, *_FRACTION, "fmi3IntervalQualifier {}[]"),
    "GetShiftDecimal": (*_WHICH, "fmi3Float64 {}[]"),
    "GetShiftFraction": (*_WHICH, *_FRACTION),
    "SetIntervalDecimal": (*_WHICH, "const fmi3Float64 {}[]"),
    "SetIntervalFraction": (*_WHICH, *_FIXED_FRACTION),
    "SetShiftDecimal": (*_WHICH, "const fmi3Float64 {}[]"),
    "SetShiftFraction": (*_WHICH, *_FIXED_FRACTION),
    "GetOutputDerivatives": (*_WHICH, "const fmi3Int32 {}[]", "fmi3Float64 {}[]", "size_t {}"),
    "SetContinuousStates": ("const fmi3Float64 {}[]", "size_t {}"),
    "GetContinuousStateDerivatives": _STATES,
    "GetEventIndicators": _STATES,
    "GetContinuousStates": _STATES,
    "GetNominalsOfContinuousStates": _STATES,
}

#: Numbers that are 0.
_ZERO: Final = ("GetNumberOfEventIndicators", "GetNumberOfContinuousStates")


def lacking_functions() -> Iterator[str]:
    """Yield the C source of these functions."""
    for name, parameters in _ALWAYS.items():
        yield _function(name, parameters, f'refused(unit, "this unit does not have {name}")')
    for name, parameters in _SOMETHING.items():
        yield _function(name, parameters, 'b ? refused(unit, "this unit has none of these") : fmi3OK')
    for name in _ZERO:
        yield _function(name, ("size_t *{}",), "fmi3OK", "    *a = 0;\n")


def _function(name: str, parameters: Sequence[str], answer: str, more: str = "") -> str:
    letters = "abcdefghi"[: len(parameters)]
    takes = ", ".join(["fmi3Instance unit", *(one.format(k) for one, k in zip(parameters, letters, strict=True))])
    unused = ", ".join(f"(void){letter}" for letter in ("unit", *letters))
    return f"\nSTATUS(fmi3{name})({takes})\n{{\n    {unused};\n{more}    return {answer};\n}}"
