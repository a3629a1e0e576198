"""The key ``servo`` of a case file: position servos whose logs have commands and positions, and no torque.

Keys for all joints: those of LAW_KEYS, kp, friction, enabled, supply, nominal_volts, feedforward, counts, calibration,
payloads, and joints with a mapping of LAW_KEYS and kp for one joint.
docs/case-file.md describes each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from dynident.actuators.drive_law import COUNTS, PRESETS, DriveLaw, preset
from dynident.actuators.lerobot_calibration import GRIPPER, MotorRange, read_calibration
from dynident.actuators.parameters import FRICTION_MODELS
from dynident.actuators.servo_log import AUTO, ServoColumns, ServoSetup
from dynident.case.case_values import find_file, guarded, texts
from dynident.data.formats import ColumnMap
from dynident.errors import BadOption
from dynident.model.documents.sections import Section
from dynident.model.robot import Robot
from dynident.simulation.effects import Payload

#: Keys of a drive law, for all joints or for one.
LAW_KEYS = (
    "law",
    "error_gain",
    "limit",
    "dead_zone",
    "punch",
    "slew_limit",
    "delay_s",
    "damping_gain",
    "resolution",
    "full_torque",
)

#: Keys for one joint.
JOINT_KEYS = (*LAW_KEYS, "kp")

KEYS = (
    *JOINT_KEYS,
    "friction",
    "enabled",
    "supply",
    "nominal_volts",
    "feedforward",
    "counts",
    "calibration",
    "payloads",
    "joints",
)


def servo_of(top: Section, robot: Robot, columns: ColumnMap) -> ServoSetup:
    """Return what the section ``servo`` says.

    Args:
        top: The whole case.
        robot: The robot whose joints the logs have.
        columns: Columns of time, positions and commands.

    Raises:
        DescriptionError: A fault in one of the keys, with the key.
    """
    section = top.section("servo", KEYS)
    names = robot.joint_names
    own = section.section("joints", names) if section.has("joints") else None
    common = _law(section, guarded(section.place("law"), lambda: preset(section.choice("law", tuple(PRESETS)))))
    kp, gains = _gains(section, own, names)
    laws = []
    for joint, gain in zip(robot.active, gains, strict=True):
        law = common
        if own is not None and own.has(joint.name):
            each = own.section(joint.name, JOINT_KEYS)
            law = _law(each, preset(each.choice("law", tuple(PRESETS))) if each.has("law") else common)
        law = law if gain == 1.0 else law.stated({"error_gain": gain * law.error_gain})
        laws.append(law if joint.kind == "revolute" else law.for_slide())
    place = section.place("joints")
    if not np.array_equal(np.asarray(robot.coupling), np.eye(len(names))):
        raise place.error("a coupling of drives beside servo", "leave out coupling: servos turn one joint each")
    if top.has("drives"):
        step = (
            "leave it out: armature and torque at full duty are found; to compare with a known armature, state it in "
            "the robot model and run validate"
        )
        raise top.place("drives").error("it has no effect beside servo", step)
    friction = section.choice("friction", (AUTO, *FRICTION_MODELS), AUTO)
    return ServoSetup(
        tuple(laws),
        ServoColumns(
            joints=names,
            columns=columns,
            enabled=texts(section, "enabled"),
            supply=section.text("supply", ""),
            nominal_volts=section.at_least_zero("nominal_volts", 0.0),
            added=texts(section, "feedforward"),
            kp=kp,
            counts=section.choice("counts", tuple(COUNTS)) if section.has("counts") else "",
            ranges=_ranges(section, columns, columns.joints or names) if section.has("calibration") else (),
            payloads=_payloads(section, tuple(link.name for link in robot.links)) if section.has("payloads") else {},
        ),
        friction,
    )


def _payloads(section: Section, links: tuple[str, ...]) -> dict[str, Payload]:
    """Return the payloads by the word that names of their logs contain."""
    named = section.value("payloads")
    if not isinstance(named, Mapping):
        step = "write a mapping such as payloads: {load2: {mass: 0.2, centre: [0, 0, 0.1]}}"
        raise section.place("payloads").error("no mapping of payloads by a word in the names of their logs", step)
    inner, found = section.section("payloads", tuple(map(str, named))), {}
    for key in map(str, named):
        own = inner.section(key, ("mass", "centre", "inertia", "link"))
        centre, inertia = own.numbers("centre", 3).tolist(), own.numbers("inertia", 3, (0.0, 0.0, 0.0)).tolist()
        link = own.choice("link", links) if own.has("link") else ""
        mass = own.at_least_zero("mass")
        found[key] = guarded(own.place(), partial(Payload, mass, tuple(centre), tuple(inertia), link))
    return found


def _ranges(section: Section, columns: ColumnMap, logged: tuple[str, ...]) -> tuple[MotorRange | None, ...]:
    """Return the range of the motor of each logged joint from a calibration file of LeRobot.

    Motors are those of the joints' names; where no name agrees, they are in the order of the joints. Where positions
    are degrees, the gripper alone is a share of its range.
    """
    place, unit = section.place("calibration"), columns.units.position
    found = _motors(section, logged)
    if unit == "rad":
        return found
    ranges = tuple(motor if motor.name.endswith(GRIPPER) else None for motor in found)
    if unit != "deg" or not any(ranges):
        step = "leave out units: position, or the calibration; beside degrees a gripper alone is a share of its range"
        raise place.error("a unit of positions beside shares", step)
    return ranges


def _motors(section: Section, logged: tuple[str, ...]) -> tuple[MotorRange, ...]:
    """Return the motor of each logged joint."""
    place = section.place("calibration")
    if section.has("counts"):
        raise place.error("counts and calibration beside each other", "state counts, or calibration of shares")
    found = read_calibration(find_file(section.text("calibration"), str(section.path)))
    own = {motor.name: motor for motor in found}
    missing = [name for name in logged if name not in own]
    if not missing:
        return tuple(own[name] for name in logged)
    if len(found) != len(logged) or len(missing) < len(logged):
        step = "name its motors as the joints of the log, or give one motor for each joint in their order"
        told = f"it has {', '.join(own) or 'no motors'}, and the log {', '.join(logged)}"
        raise place.error(f"no motor for {', '.join(missing)}: {told}", step)
    return found


def _law(section: Section, law: DriveLaw) -> DriveLaw:
    fields: dict[str, object] = {}
    for key in ("error_gain", "dead_zone", "punch", "resolution"):
        if section.has(key):
            fields[key] = section.at_least_zero(key)
    if section.has("limit"):
        fields["limit"] = section.at_least_zero("limit", unbounded=True)
    for key in ("slew_limit", "delay_s"):
        if section.has(key) and section.value(key) == AUTO:
            fields[key] = None
        elif section.has(key) and section.value(key) == "none":
            fields[key] = np.inf if key == "slew_limit" else 0.0
        elif section.has(key):
            fields[key] = section.at_least_zero(key, unbounded=True)
    if section.has("full_torque"):
        torque, half = section.numbers("full_torque", 2).tolist()
        if not (torque > 0.0 and 0.0 <= half < torque):
            step = "write the torque and the half width of its 95 % interval, such as [2.9, 0.3]"
            raise section.place("full_torque").error("no torque with a half width below it", step)
        fields["full_torque"] = (torque, half)
    if section.has("damping_gain"):
        is_free, is_none = (section.value("damping_gain") == word for word in ("free", "none"))
        fields["has_damping_gain"] = is_free
        fields["damping_gain"] = 0.0 if is_free or is_none else section.at_least_zero("damping_gain")
    return law.stated(fields) if fields else law


def _gains(
    section: Section, own: Section | None, names: Sequence[str]
) -> tuple[float | str | Mapping[str, float] | None, list[float]]:
    """Return the position gain, and by how much that of each joint is greater, of gains for all joints or some."""
    stated = section.value("kp") if section.has("kp") else None
    single = {} if own is None else {name: own.section(name, JOINT_KEYS) for name in names if own.has(name)}
    single = {name: _positive(each) for name, each in single.items() if each.has("kp")}
    if isinstance(stated, list):
        if single:
            step = "state one number for each joint in servo: kp, or one for all and others under joints"
            raise section.place("joints").error("kp of single joints beside a list of all", step)
        values = section.numbers("kp", len(names)).tolist()
        if min(values) <= 0.0:
            raise section.place("kp").error("a gain that is not above 0", "write one number above 0 for each joint")
        return values[0], [value / values[0] for value in values]
    if not single:
        return _kp(section), [1.0] * len(names)
    kp = _kp(section) if stated is not None or len(single) < len(names) else next(iter(single.values()))
    if not isinstance(kp, float):
        step = (
            "state kp as one number for the other joints; ratios of gains that logs name are error_gain of each joint"
        )
        raise section.place("joints").error("kp of single joints beside none that is a number", step)
    return kp, [single.get(name, kp) / kp for name in names]


def _positive(each: Section) -> float:
    value = each.number("kp")
    if value <= 0.0:
        raise each.place("kp").error("a gain that is not above 0", "write a number above 0")
    return value


def _kp(section: Section) -> float | str | Mapping[str, float] | None:
    if not section.has("kp") or section.value("kp") == "unknown":
        return None
    value = section.value("kp")
    if isinstance(value, Mapping):
        inner = section.section("kp", tuple(map(str, value)))
        return {str(key): inner.number(str(key)) for key in value}
    try:
        return section.number("kp")
    except Exception as error:
        if isinstance(value, str):
            return value
        raise BadOption(
            "servo.kp", value, "write a number, one for each joint, a pattern such as 'kp{}', a column, or unknown"
        ) from error
