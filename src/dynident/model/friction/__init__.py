"""Friction and drive terms, a family: one part per file, each a block of regressor columns."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from dynident.errors import BrokenPart
from dynident.model.friction._motion import Motion
from dynident.model.friction.base import WHOLE_PART, Coefficient, Friction, SelectionUse
from dynident.plugins import Family

if TYPE_CHECKING:
    from dynident.model.robot import Robot

FRICTION: Family[Friction] = Family("dynident.model.friction", Friction, "friction model")  # type: ignore[type-abstract]


def _listed() -> list[tuple[str, SelectionUse]]:
    """Return the names of the parts that the selection of friction knows, and their use there, in their order."""
    found: list[tuple[str, SelectionUse]] = []
    for name in FRICTION.names():
        with suppress(BrokenPart):  # of a package: whoever asks for it by name is told
            found += [(name, use) for use in (FRICTION.get(name).selection,) if use is not None]
    return sorted(found, key=lambda each: each[1].place)


def default_friction() -> tuple[str, ...]:
    """Return the names of the parts of a model whose friction is not stated."""
    return tuple(name for name, use in _listed() if use.is_default)


def auto_friction(robot: Robot | None = None) -> tuple[Friction, ...]:
    """Return the parts that ``friction: auto`` stands for, as a draft has them: held-out samples decide on them.

    Inertia of the rotors is there where all torques are those of motor currents, which turn the rotors as well.
    """
    parts = (FRICTION.make(name, use.options) for name, use in _listed())
    of_currents = robot is not None and all(own.drive.gain and not own.drive.rotor_inertia for own in robot.active)
    return tuple(replace(part, choose=None) if of_currents and all(part.is_inertia) else part for part in parts)


def called(part: Friction) -> str:
    """Return the name of a part, with the number of its element where that is not the first."""
    return FRICTION.name_of(part) + (f" {number}" if (number := part.options.get("element", 1)) > 1 else "")


def motor_ripple(robot: Robot) -> tuple[Friction, ...]:
    """Return ripple over a turn of the motors, a part for each stated gear ratio; held-out samples decide on them."""
    ratios: dict[float, tuple[str, ...]] = {}
    for joint in robot.active:
        if (ratio := abs(joint.drive.gear_ratio)) != 1.0:
            ratios[ratio] = (*ratios.get(ratio, ()), joint.name)
    options = ({"cycles": ratio, "joints": joints, "choose": (WHOLE_PART,)} for ratio, joints in ratios.items())
    return tuple(FRICTION.make("periodic", own) for own in options)


__all__ = [
    "FRICTION",
    "WHOLE_PART",
    "Coefficient",
    "Friction",
    "Motion",
    "SelectionUse",
    "auto_friction",
    "called",
    "default_friction",
    "motor_ripple",
]
