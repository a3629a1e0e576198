"""What a case file says of its robot: gravity, limits, drives, coupling and joints that do not move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dynident.case.case_values import gravity_of, guarded, texts
from dynident.model.documents.sections import Section
from dynident.model.joint import Drive
from dynident.model.robot import Robot

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
