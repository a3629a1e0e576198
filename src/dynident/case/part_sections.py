"""What a case file says of its robot, and by names of parts: friction, the filter, what prepares logs, the estimator.

Of the robot: gravity, limits, drives, coupling and joints that do not move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from dynident.case.case_values import gravity_of, guarded, part_of, texts
from dynident.data.preprocessing import FILTERS, Preprocessing, default_preprocessing
from dynident.model.documents.numbers import Place
from dynident.model.documents.sections import Section
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction, default_friction
from dynident.model.joint import Drive
from dynident.model.robot import Robot
from dynident.plugins import Family

#: What stands for a friction or a delay that is to be found from the logs.
AUTO = "auto"

_PREPROCESSING_KEYS = ("filter", "rate_hz", "trim_s", "standstill", "rest", "delay_s", "longest_gap_s")


@dataclass(frozen=True)
class PartChoice:
    """An estimator by name with its options as text."""

    name: str = "consistent"
    options: Mapping[str, str | None] = field(default_factory=dict)


def preprocessing_of(top: Section) -> Preprocessing:
    """Return how logs become rows; what is not stated is as by default."""
    stated = default_preprocessing()
    if not top.has("preprocessing"):
        return stated
    section = top.section("preprocessing", _PREPROCESSING_KEYS)
    has_filter = section.has("filter")
    kept = _made(section.place("filter"), section.value("filter"), FILTERS) if has_filter else stated.filter
    how = Preprocessing(filter=kept, rate_hz=stated.rate_hz)
    delay = section.value("delay_s") if section.has("delay_s") else "0"
    rate = section.value("rate_hz") if section.has("rate_hz") else AUTO
    return guarded(
        section.place(),
        lambda: replace(
            how,
            rate_hz=None if rate in (None, "all", AUTO) else section.number("rate_hz"),
            rows_per_period=stated.rows_per_period if rate == AUTO else None,
            trim_s=section.number("trim_s", stated.trim_s),
            standstill=section.number("standstill", stated.standstill),
            rest=section.choice("rest", ("mask", "keep"), stated.rest),
            delay_s=None if delay == AUTO else section.number("delay_s", 0.0),
            longest_gap_s=section.number("longest_gap_s", stated.longest_gap_s),
        ),
    )


def friction_of(top: Section, robot: Robot) -> tuple[Friction, ...]:
    """Return the friction parts; the joints that they name are those of the robot."""
    parts = tuple(_parts(top))
    if any(part.vary or part.choose or part.options.get("element", 1) > 1 for part in parts):
        from dynident.case.open_friction import check_part  # the others need none

        for i, part in enumerate(parts):
            guarded(top.place(f"friction.{i + 1}"), partial(check_part, part, parts[:i]))
    guarded(top.place("friction"), lambda: DynamicModel(robot, parts))
    return parts


def _parts(top: Section) -> list[Friction]:
    if not top.has("friction"):
        return [FRICTION.make(name) for name in default_friction()]
    value = top.value("friction")
    if not isinstance(value, list):
        step = f"write a list such as [{', '.join(default_friction())}]"
        raise top.place("friction").error("not a list", step)
    return [_made(top.place(f"friction.{i}"), item, FRICTION) for i, item in enumerate(value, start=1)]


def _made(place: Place, value: object, family: Family[Any]) -> Any:
    choice = _choice_of(place, value)
    return guarded(place, lambda: family.make_from_text(choice.name, choice.options))


def estimator_of(top: Section) -> PartChoice:
    """Return the estimator that is stated, else the default one."""
    return _choice_of(top.place("estimator"), top.value("estimator")) if top.has("estimator") else PartChoice()


def _choice_of(place: Place, value: object) -> PartChoice:
    """Return a part written as ``name`` or as ``name: {option: value}``."""
    return PartChoice(*part_of(place, value))


#: Keys of a joint under ``drives``.
DRIVE_KEYS = ("gear_ratio", "rotor_inertia", "gain", "bias", "gain_std")


def robot_of(top: Section, robot: Robot) -> tuple[Robot, dict[str, float]]:
    """Apply gravity, limits, drives, coupling and locked joints, in this order; return also the locked positions."""
    if top.has("gravity"):
        robot = robot.with_gravity(gravity_of(top))
    positions = _locked(top, names := robot.joint_names)
    if top.has("limits"):
        from dynident.case.workspace_section import robot_with_limits  # few cases need it

        robot = robot_with_limits(top, robot, [name for name in names if name not in positions])
    drives: dict[str, Drive] = {}
    if top.has("drives"):
        section = top.section("drives", names)
        for name, joint in zip(names, robot.active, strict=True):
            if section.has(name):
                own = section.section(name, DRIVE_KEYS)
                drives[name] = guarded(section.place(name), lambda own=own, joint=joint: _drive(own, joint.drive))
    coupling = top.matrix("coupling", len(names), len(names)) if top.has("coupling") else None
    robot = guarded(top.place("coupling"), lambda: robot.with_drives(drives, coupling))
    return guarded(top.place("locked"), lambda: robot.locked(positions)) if positions else robot, positions


def _locked(top: Section, names: Sequence[str]) -> dict[str, float]:
    if not top.has("locked"):
        return {}
    if top.value("locked") == "rest":
        return dict.fromkeys((name for name in names if name not in texts(top, "joints")), 0.0)
    section = top.section("locked", names)
    return {name: section.number(name) for name in names if section.has(name)}


def _drive(section: Section, stated: Drive) -> Drive:
    return replace(
        stated,
        gear_ratio=section.number("gear_ratio", stated.gear_ratio),
        rotor_inertia=section.number("rotor_inertia", stated.rotor_inertia),
        gain=section.number("gain") if section.has("gain") else stated.gain,
        bias=section.number("bias", stated.bias),
        gain_deviation=section.number("gain_std", 0.0 if section.has("gain") else stated.gain_deviation),
    )
