"""Units of the columns of a log, and how their values become SI values."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, UnknownChoice

_TURN = (math.pi, 180.0)
_MILLI = (1.0, 1e3)

#: The factor of a unit that is SI.
ONE = (1.0, 1.0)


def _of_motion(per: str) -> dict[str, tuple[tuple[float, float], str]]:
    """Return the units of positions, or of their derivatives: a length or an angle and what follows it."""
    own = {"rad": (ONE, "revolute"), "deg": (_TURN, "revolute"), "m": (ONE, "prismatic"), "mm": (_MILLI, "prismatic")}
    return {"SI": (ONE, ""), **{unit + per: found for unit, found in own.items()}}


#: Units that are shares: of the rated torque of a joint, or of a current that its drive gain counts in.
RATED = frozenset(("percent", "permille"))

#: Per quantity, unit word -> ((numerator, denominator) to SI, kind of joint it belongs to; empty for any).
UNITS: dict[str, dict[str, tuple[tuple[float, float], str]]] = {
    "time": {"s": (ONE, ""), "ms": (_MILLI, ""), "us": ((1.0, 1e6), ""), "ns": ((1.0, 1e9), "")},
    "position": _of_motion(""),
    "velocity": _of_motion("/s"),
    "acceleration": _of_motion("/s^2"),
    "torque": {
        "SI": (ONE, ""),
        "N m": (ONE, "revolute"),
        "mN m": (_MILLI, "revolute"),
        "N": (ONE, "prismatic"),
        "percent": ((1.0, 100.0), ""),
        "permille": (_MILLI, ""),
    },
    "current": {"A": (ONE, ""), "mA": (_MILLI, ""), **{share: (ONE, "") for share in sorted(RATED)}},
    "temperature": {"degC": (ONE, "")},
}

#: A unit behind the number of it that one count of a column is: ``-deg`` counts backwards.
_COUNT = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|-|) ?(.*)", re.DOTALL)

#: The quantity of each signal, by the field of the log.
QUANTITY = {
    "q": "position",
    "dq": "velocity",
    "ddq": "acceleration",
    "torque": "torque",
    "current": "current",
    "raw_torque": "torque",
    "temperature": "temperature",
    "q_ref": "position",
    "dq_ref": "velocity",
}


def counted_unit(word: str) -> tuple[float, str]:
    """Return the number before a unit and the unit: -1 and ``deg`` of ``-deg``, 1 where there is none."""
    number, unit = _COUNT.fullmatch(word).groups()  # type: ignore[union-attr]
    return float({"": 1.0, "-": -1.0}.get(number, number)), unit


def unit_of(quantity: str, word: str) -> tuple[tuple[float, float], str]:
    """Return (numerator, denominator) to SI of a counted unit, and the kind of joint it belongs to.

    Raises:
        UnknownChoice: There is no such unit, or its number is 0, or of a time not above 0.
    """
    count, unit = counted_unit(word)
    if unit not in UNITS[quantity] or not (0 < count < math.inf or (-math.inf < count < 0 and quantity != "time")):
        raise UnknownChoice(f"unit of {quantity}", word, list(UNITS[quantity]))
    (numerator, denominator), kind = UNITS[quantity][unit]
    return (count * numerator, denominator), kind


@dataclass(frozen=True)
class Units:
    """Units of the columns: one word for all joints or one per joint; nothing is ever converted on a guess.

    The word ``"SI"`` stands for rad or m (and what follows from it), as the joint moves. A number before a unit is how
    many of it one count is: ``-N m`` turns the sign, ``0.01 deg`` and ``6 deg/s`` (a turn a minute) are counts.

    Attributes:
        time: s, ms, us or ns.
        position: SI, rad, deg, m or mm.
        velocity: SI, rad/s, deg/s, m/s or mm/s.
        acceleration: SI, rad/s^2, deg/s^2, m/s^2 or mm/s^2.
        torque: SI, N m, mN m, N, or percent or permille of the rated torque; of filtered and unfiltered torques.
        current: A or mA; percent or permille, of which drive gains are then.

    Raises:
        UnknownChoice: A word that is not listed.
    """

    time: str = "s"
    position: str | tuple[str, ...] = "SI"
    velocity: str | tuple[str, ...] = "SI"
    acceleration: str | tuple[str, ...] = "SI"
    torque: str | tuple[str, ...] = "SI"
    current: str | tuple[str, ...] = "A"

    def __post_init__(self) -> None:
        for f in fields(self):
            words = getattr(self, f.name)
            if not isinstance(words, str):
                words = tuple(words)
                object.__setattr__(self, f.name, words)
            for word in (words,) if isinstance(words, str) else words:
                unit_of(f.name, str(word))
        if not isinstance(self.time, str):
            raise BadOption("units.time", self.time, "give one unit")

    def of(self, quantity: str, joints: int) -> tuple[str, ...]:
        """Return the unit of a quantity for each of the joints.

        Raises:
            BadOption: One unit per joint was given, for another number of joints.
        """
        words = getattr(self, quantity, "degC")
        if isinstance(words, str):
            return (words,) * joints
        if len(words) != joints:
            raise BadOption(f"units.{quantity}", list(words), f"give one unit, or one for each of the {joints} joints")
        return words


def converted(values: Array, quantity: str, words: Sequence[str]) -> Array:
    """Return values, shape (N, k), of a quantity in SI units, from one unit per column."""
    factors = np.array([unit_of(quantity, word)[0] for word in words])
    # Multiplied and divided: 3 ms is then exactly the double nearest to 0.003 s.
    return values if np.all(factors == 1.0) else values * factors[:, 0] / factors[:, 1]
