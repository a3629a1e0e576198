"""The operations of a traced program: what NumPy gives for each, and how large the terms of a value are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

import numpy as np

from dynident.arrays import Array

Rules: TypeAlias = Mapping[str, Callable[..., Array]]

#: Operations with a constant of their own, the value of their node: the width of a sign that turns, a power.
VALUED: Final = frozenset({"turn", "pow"})


def _turn(value: Array, width: float) -> Array:
    return np.tanh(value / width) if width else np.sign(value)


def _ratio(one: Array, other: Array) -> Array:
    """Return one / other, 0 where the other is 0: the slope of a power at 0, where it may be infinite."""
    shape = np.broadcast_shapes(np.shape(one), np.shape(other))
    return np.divide(one, other, out=np.zeros(shape), where=np.asarray(other) != 0)


def _greater(one: Array, other: Array) -> Array:
    return np.asarray(one > other, dtype=np.float64)


def _side(value: Array) -> Array:
    """Return -1 or 1: the sign of a motion that is forward where it stands still."""
    return np.where(np.asarray(value) >= 0, 1.0, -1.0)


VALUES: Final[Rules] = {
    "input": np.asarray,
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "tanh": np.tanh,
    "abs": np.abs,
    "sign": np.sign,
    "side": _side,
    "max": np.maximum,
    "min": np.minimum,
    "turn": _turn,
    "pow": np.power,
    "ratio": _ratio,
    "greater": _greater,
}

#: How large the terms are that make up a value; of the operations that bodies need.
SIZES: Final[Rules] = {
    "input": np.abs,
    "add": np.add,
    "sub": np.add,
    "mul": np.multiply,
    "neg": np.abs,
    "sin": np.ones_like,
    "cos": np.ones_like,
}
