"""Positions whose counters start again after a whole turn: counted on, and the unit that the turn tells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.case.draft.readings import LogReading
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.signal_units import SignalUnit
from dynident.data.turns import jumps_of_a_turn, turns_counted


def with_turns(found: Recognised) -> Recognised:
    """Return what was found with positions whose counters start again counted on, in the units of the file."""
    for turn in (2 * np.pi, 360.0):
        again = np.any([_start_again(reading, turn) for reading in found.readings], axis=0)
        if again.any():
            readings = tuple(
                replace(reading, signals=_counted(reading.signals, again, turn)) for reading in found.readings
            )
            return replace(found, readings=readings, turn=turn)
    return found


def _start_again(reading: LogReading, turn: float) -> BoolArray:
    """Return which positions jump by a turn and stay within one: a slip of a few degrees is no counter."""
    q = reading.signals["q"]
    return (jumps_of_a_turn(q, turn, reading.time) > 0) & (np.ptp(q, axis=0) <= 1.01 * turn)


def _counted(signals: Mapping[str, Array], again: BoolArray, turn: float) -> dict[str, Array]:
    """Return signals with positions counted on where they start ``again``, shape (n,)."""
    found = dict(signals)
    for key in ("q", "q_ref"):
        if key in signals and signals[key].shape[1] == len(again):
            found[key] = np.where(again, turns_counted(signals[key], turn=turn), signals[key])
    return found


def with_wrapped(found: Recognised) -> Recognised:
    """Return what was found with the joints whose turns are counted on: all that turn, as they have one electronics."""
    if not found.turn:
        return found
    kinds = {joint.name: joint.kind for joint in found.robot.active}
    return replace(found, wrapped=tuple(name for name in found.joints.names if kinds[name] == "revolute"))


def unit_of_turn(found: Recognised, stated: str) -> SignalUnit:
    """Return the unit of positions that start again after a turn: that of the turn, where all joints turn."""
    word = "deg" if found.turn > 2 * np.pi else "rad"
    fits = len(found.wrapped) == len(found.joints.names) and stated in ("", word)
    return SignalUnit((word,), fits, f"they start again after {found.turn:.4g}, a whole turn")
