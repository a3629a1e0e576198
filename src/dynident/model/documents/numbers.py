"""Numbers and names of a description, checked: each error names the file, the place, the evidence, the next step."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass
from typing import Final

from dynident.errors import DescriptionError

#: Beyond this a length, mass or moment is a slip, and its products would overflow; limits may be larger.
LARGEST: Final = 1e50

_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_INFINITE = re.compile(r"[+-]?\.?inf(inity)?", re.IGNORECASE)
_NOT_A_NUMBER = re.compile(r"[+-]?\.?nan", re.IGNORECASE)
_SHOWN = 40


def shown(value: object) -> str:
    """Return a value from a file as a message shows it: quoted, on one line, cut when long."""
    if isinstance(value, str):
        return repr(value) if len(value) <= _SHOWN else f"{value[:_SHOWN]!r}..."
    if isinstance(value, int) and value.bit_length() > 1024:
        return "a whole number of hundreds of digits"  # Python refuses to write out the longest
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


@dataclass(frozen=True)
class Place:
    """Where in a description a value stands.

    Attributes:
        path: The file.
        where: The link, the joint, or the line and the key path.
    """

    path: object
    where: str = ""

    def error(self, evidence: str, step: str) -> DescriptionError:
        """Return the error that names this place."""
        return DescriptionError(self.path, self.where, evidence, step)


def decimal(place: Place, what: str, text: str, *, unbounded: bool = False) -> float:
    """Return the number written in ``text``.

    Args:
        place: Where it stands.
        what: What the number is, such as ``"mass value"``; may be empty.
        text: The text.
        unbounded: Whether ``inf`` is an answer, as it is for limits.

    Raises:
        DescriptionError: No plain finite number.
    """
    written = text.strip()
    label = f"{what} {shown(written)}".strip()
    if not written:
        raise place.error(f"{what or 'the value'} is empty", "write a number")
    if unbounded and _INFINITE.fullmatch(written):
        return float(written.replace(".", ""))
    if _INFINITE.fullmatch(written) or _NOT_A_NUMBER.fullmatch(written):
        raise place.error(f"{label} is not a finite number", "write a finite number")
    if not _DECIMAL.fullmatch(written):
        raise place.error(f"{label} is not a number", _advice(written))
    return in_range(place, label, float(written), unbounded=unbounded)


def in_range(place: Place, label: str, value: float, *, unbounded: bool = False) -> float:
    """Return ``value`` after a look at its size.

    Raises:
        DescriptionError: Larger than any real robot has and arithmetic stands.
    """
    largest = sys.float_info.max if unbounded else LARGEST
    if not abs(value) <= largest:
        step = "write 'inf' where there is no limit" if unbounded else "write a number in SI units"
        raise place.error(f"{label} is too large", step)
    return value


def expression(place: Place, text: str, *, unbounded: bool = False) -> float:
    """Return the value of a number or a product of numbers and ``pi``, such as ``-pi/2`` or ``90*pi/180``.

    Raises:
        DescriptionError: Something else, or a division by zero.
    """
    factors = re.split(r"([*/])", text)
    if len(factors) == 1 and "pi" not in text:
        return decimal(place, "", text, unbounded=unbounded)
    value = _factor(place, factors[0])
    for sign, factor in zip(factors[1::2], factors[2::2], strict=True):
        operand = _factor(place, factor)
        if sign == "*":
            value *= operand
        elif operand == 0.0:
            raise place.error(f"{shown(text)} divides by zero", "write a number, or a product such as pi/2")
        else:
            value /= operand
    return in_range(place, shown(text), value)


def _factor(place: Place, text: str) -> float:
    written = text.strip()
    if written in ("pi", "+pi", "-pi"):
        return -math.pi if written[0] == "-" else math.pi
    if not _DECIMAL.fullmatch(written):
        raise place.error(f"{shown(written)} is not a number", "write a number, or a product such as pi/2")
    return in_range(place, shown(written), float(written))


def _advice(written: str) -> str:
    if re.fullmatch(r"[+-]?\d*,\d+", written):
        return f"write a decimal point: {written.replace(',', '.')}"
    return "write one plain number, without a unit"


def check_name(place: Place, what: str, text: str) -> str:
    """Return a name as it is.

    Raises:
        DescriptionError: Empty, or with characters that cannot be printed.
    """
    if not text.strip():
        raise place.error(f"{what} is empty", "give it a name")
    if not text.isprintable():
        raise place.error(f"{what} {shown(text)} has characters that cannot be printed", "use plain letters")
    return text


def check_order(place: Place, lower: float, upper: float) -> None:
    """Check the two position limits of a joint.

    Raises:
        DescriptionError: The lower one is above the upper one, or one is infinite on the wrong side.
    """
    if not lower <= upper or lower == math.inf or upper == -math.inf:
        raise place.error(f"the lower limit {lower:g} is above the upper limit {upper:g}", "exchange or correct them")
