"""Motions that determine the servos of an arm, within its limits, and the intervals that they would give."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_fit import SATURATED, JointData
from dynident.actuators.joint_load import JointLoad, measured_loads, measured_motion, rigid_inertia, with_payload
from dynident.actuators.linear_start import free_parameters, has_weight, refinable, start_rows
from dynident.actuators.nominal_servo import RESOLUTION, STEP_OF_SLIDES, NominalServo
from dynident.actuators.output_error import ServoProblem
from dynident.actuators.parameters import FRICTION_MODELS, PLACE, unit_for
from dynident.actuators.rollout import encoder_step, record_of, rolled_out
from dynident.actuators.servo_log import ServoLog
from dynident.actuators.servo_motions import KINDS, MOST_TURN, MotionFrame, ServoMotion, caught_release
from dynident.actuators.verdict import Known, Spread, known_parameters, spread_of
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.design.limits import MotionLimits, limits_of
from dynident.model.robot import Robot
from dynident.simulation.effects import Payload

#: Sets of motions beside the single kinds: all of them, and all of them without and with each payload.
ALL, PAYLOAD = "all", "payload"

#: Scatter of the time stamps of a simulated log in s.
_JITTER_S: Final = 5e-4

#: Factor between two tries of an amplitude, and number of tries.
_SHRINK, _TRIES = 0.8, 14

#: Times in s after which a release is caught, where a free swing would leave the limits.
_CATCHES = (1.0, 0.6, 0.4, 0.25, 0.15)

#: Fewest steps of the encoder that a motion spans.
_LEAST: Final = 20

#: A joint swings where its weight is this many times its Coulomb friction at both ends of the lift.
_SWINGS = 2.0

#: Servos near the assumed one that intervals are averaged over, and the standard deviation of their parameters.
_NEIGHBOURS: Final = 16
_NEAR: Final = 0.05


@dataclass(frozen=True)
class MotionRequest:
    """What is asked of the motions.

    Attributes:
        rate: Commands a second.
        seconds: Length of a motion.
        margin: Share of each limit that commands leave unused.
        gains: Position gains to record at, in the drive's unit.
        pose: Positions about which the joints move and at which they are held, shape (n,), in rad or m; None for the
            middles of the ranges.
        payloads: Payloads to record with, beside none, by name.
        can_release: Whether the drive of each joint can be switched off by itself.
    """

    rate: float = 100.0
    seconds: float = 6.0
    margin: float = 0.05
    gains: tuple[float, ...] = (1.0,)
    pose: Array | None = None
    payloads: Mapping[str, Payload] | None = None
    can_release: bool = True


@dataclass(frozen=True)
class SimulatedMotion:
    """A motion with what the nominal servo makes of it, over all gains and payloads.

    Attributes:
        motion: Its commands.
        lowest: Lowest simulated position, in rad or m.
        highest: Highest simulated position.
        fastest: Largest simulated speed.
        saturated: Share of the samples at the limit of the duty.
    """

    motion: ServoMotion
    lowest: float
    highest: float
    fastest: float
    saturated: float


@dataclass(frozen=True)
class JointExcitation:
    """Motions of one joint, and the intervals that they would give.

    Attributes:
        joint: Name of the joint.
        servo: The servo that is assumed.
        slides: Whether the joint slides.
        resolution: Step of the encoder in rad or m that is assumed.
        motions: The motions.
        known: By set of motions (a kind alone, ALL, PAYLOAD) what would be known of each parameter. ``damping`` is
            viscous friction and back-EMF together, ``stiffness`` gain times torque at full duty.
    """

    joint: str
    servo: NominalServo
    slides: bool
    resolution: float
    motions: tuple[SimulatedMotion, ...]
    known: Mapping[str, tuple[Known, ...]]

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters in the order of a table, each whole behind its parts."""
        found = {one.name for own in self.known.values() for one in own}
        parts = {name for whole in found & set(_TOGETHER) for name in _TOGETHER[whole] if name != "gain_ratio"}
        return tuple(sorted(found | parts, key=_ORDER.index))

    def of(self, name: str, motions: str) -> Known | None:
        """Return what a set of motions tells of a parameter; None where it does not separate it."""
        return next((one for one in self.known[motions] if one.name == name and np.isfinite(one.half_width)), None)

    def best(self, name: str) -> Known | None:
        """Return what all motions tell of a parameter; None where they do not separate it."""
        return self.of(name, PAYLOAD if PAYLOAD in self.known else ALL)

    def separated_by(self, name: str) -> tuple[str, ...]:
        """Return the kinds of motions that identify a parameter alone."""
        found = ((kind, self.of(name, kind)) for kind in KINDS if kind in self.known)
        return tuple(kind for kind, one in found if one is not None and one.label == "identified")


#: What is known together, and its parts.
_TOGETHER: Final[Mapping[str, tuple[str, ...]]] = {
    "stiffness": ("full_torque", "gain_ratio"),
    "damping": ("viscous", "back_emf"),
}

#: Names in the order of a table.
_ORDER: Final = ("gain_ratio", "full_torque", "stiffness", "back_emf", "viscous", "damping", *(
    name for name in PLACE if name not in ("gain_ratio", "full_torque", "back_emf", "viscous")
))  # fmt: skip


@dataclass(frozen=True)
class _Joint:
    """One joint with the others held: robots of one joint by payload, and what bounds it."""

    name: str
    slides: bool
    law: DriveLaw
    robots: Mapping[str, Robot]
    lower: float
    upper: float
    speed: float

    def logs(
        self, motion: ServoMotion, gains: Sequence[float], parameters: Array, resolution: float, payload: str
    ) -> list[ServoLog]:
        """Return the simulated log at each gain, with one payload."""
        bench = ServoBench(self.robots[payload], self.law, resolution, jitter_s=_JITTER_S)
        course = (motion.time, motion.command)
        return [virtual_log(bench, parameters, *course, kp, motion.enabled, seed) for seed, kp in enumerate(gains)]


def servo_excitation(
    robot: Robot,
    servos: Callable[[int, bool], NominalServo],
    request: MotionRequest,
    progress: Callable[[str], None] = lambda step: None,
) -> tuple[JointExcitation, ...]:
    """Return motions for each joint, one joint at a time, and the intervals that they would give.

    Amplitudes are as large as the limits allow: commands keep the margin, and the simulated motion of the nominal
    servo stays within the limits at every gain and payload. Intervals are those of ``identify``, at the parameters of
    the nominal servo, on simulated logs whose positions are in steps of the encoder.

    Args:
        robot: With limits and inertias.
        servos: Returns the nominal servo of a joint by its number and whether weight acts on it.
        request: What is asked.
        progress: Called with each step in words.

    Raises:
        BadOption: A limit that is not stated, a pose outside the limits, or no amplitude that keeps them and is seen.
        NotConsistent: The robot model has no inertias.
    """
    rigid_inertia(robot)
    inner, outer = limits_of(robot, request.margin, 0.0), limits_of(robot, 0.0, 0.0)
    pose = inner.centre if request.pose is None else request.pose
    _check_pose(robot, pose, inner)
    found = []
    for k, name in enumerate(robot.joint_names):
        progress(name)
        held = {other: float(pose[j]) for j, other in enumerate(robot.joint_names) if j != k}

        def single(payload: Payload | None, held: dict[str, float] = held) -> Robot:
            loaded = robot if payload is None else with_payload(robot, payload)
            return loaded.locked(held) if held else loaded

        robots = {"": single(None), **{key: single(one) for key, one in (request.payloads or {}).items()}}
        load = _load(robots[""], float(pose[k]))
        has_weight = float(np.hypot(load.bias[0, 1], load.bias[0, 2])) > 0.0
        servo = servos(k, has_weight)
        ends = float(outer.lower[k]), float(outer.upper[k])
        joint = _Joint(name, not inner.revolute[k], servo.law, robots, *ends, float(outer.velocity[k]))
        frame = _frame(robot, k, float(pose[k]), inner, request, load, servo)
        found.append(_excited(joint, frame, servo, request))
    return tuple(found)


def _check_pose(robot: Robot, pose: Array, limits: MotionLimits) -> None:
    for k, name in enumerate(robot.joint_names):
        if not limits.lower[k] < pose[k] < limits.upper[k]:
            step = (
                f"give a position between {limits.lower[k]:.4g} and {limits.upper[k]:.4g}, the limits less the margin"
            )
            raise BadOption(f"pose of {name}", float(pose[k]), step)


def _load(robot: Robot, position: float) -> JointLoad:
    """Return the load of the joint of a robot of one joint that stands still."""
    count = 40
    column, zero = np.full((count, 1), position), np.zeros((count, 1))
    log = ServoLog(
        "at rest", robot.joint_names, np.arange(count) / 100.0, column, column, zero, zero,
        np.ones((count, 1), dtype=bool), np.ones(count), np.zeros((count, 1), dtype=bool), 1.0,
    )  # fmt: skip
    return measured_loads(robot, log)[0]


def _frame(
    robot: Robot,
    k: int,
    centre: float,
    limits: MotionLimits,
    request: MotionRequest,
    load: JointLoad,
    servo: NominalServo,
) -> MotionFrame:
    reach = min(centre - float(limits.lower[k]), float(limits.upper[k]) - centre)
    most = dict(MOST_TURN) if limits.revolute[k] else dict.fromkeys(KINDS, np.inf)
    size = min(reach, most["release"])
    ends = load.torque(load.time, centre + np.linspace(-size, size, len(load.bias)))[[0, -1]]
    swings = bool(np.min(np.abs(ends)) > _SWINGS * servo.value("coulomb"))
    return MotionFrame(centre, reach, float(limits.velocity[k]), request.rate, request.seconds, most, swings)


def _excited(joint: _Joint, frame: MotionFrame, servo: NominalServo, request: MotionRequest) -> JointExcitation:
    kinds = [kind for kind in KINDS if kind != "release" or request.can_release]
    motions = tuple(_fitted(joint, frame, servo, kind, request.gains) for kind in kinds)
    resolution = servo.law.resolution or ((joint.upper - joint.lower) * STEP_OF_SLIDES if joint.slides else RESOLUTION)
    for one in motions:
        if one.highest - one.lowest < _LEAST * resolution:
            size = f"{1e3 * resolution:.3g} {unit_for('mrad', joint.slides)}"
            step = (
                f"it moves less than {_LEAST} steps of the encoder ({size}) within its limits: give another pose "
                "(--pose), the limits that the joint has, the step of its encoder (servo: resolution), or lock it "
                "(locked: in the case file)"
            )
            raise BadOption(f"{one.motion.kind} of {joint.name}", one.highest - one.lowest, step)
    sets: dict[str, tuple[tuple[ServoMotion, ...], tuple[str, ...]]] = {
        one.motion.kind: ((one.motion,), ("",)) for one in motions
    }
    sets[ALL] = (tuple(one.motion for one in motions), ("",))
    if len(joint.robots) > 1:
        sets[PAYLOAD] = (sets[ALL][0], tuple(joint.robots))
    known = {}
    for name, (own, payloads) in sets.items():
        data = _simulated_set(joint, own, payloads, servo.parameters, request.gains, resolution)
        if not data.has_off:  # viscous friction may then have all of the damping: what is fitted is what is simulated
            merged = refinable(servo.parameters, servo.law, FRICTION_MODELS[servo.friction], False)
            data = _simulated_set(joint, own, payloads, merged, request.gains, resolution)
        known[name] = _known(data, servo)
    return JointExcitation(joint.name, servo, joint.slides, resolution, motions, known)


def _simulated_set(
    joint: _Joint,
    motions: Sequence[ServoMotion],
    payloads: Sequence[str],
    parameters: Array,
    gains: Sequence[float],
    resolution: float,
) -> JointData:
    """Return the simulated logs of some motions, at all gains and some payloads, as ``identify`` takes them."""
    records, rows = [], []
    for payload in payloads:
        for motion in motions:
            for log in joint.logs(motion, gains, parameters, resolution, payload):
                smooth = measured_motion(log)
                (load,) = measured_loads(joint.robots[payload], log, smooth)
                records.append(record_of(log, 0, load, joint.law))
                rows.append(start_rows(log, 0, load, smooth, joint.law))
    return JointData(joint.name, joint.law, tuple(records), (), tuple(rows))


def _fitted(
    joint: _Joint, frame: MotionFrame, servo: NominalServo, kind: str, gains: Sequence[float]
) -> SimulatedMotion:
    """Return the largest motion of a kind whose simulation keeps the limits; a release is caught before it is shrunk.

    Raises:
        BadOption: No amplitude keeps them.
    """
    share, last = 1.0, None
    for _ in range(_TRIES):
        catches = _CATCHES if kind == "release" and frame.carries_weight else ()
        for motion in (frame.scaled(kind, share), *(caught_release(frame, share, time) for time in catches)):
            last = _simulated(joint, motion, servo, gains)
            inside = joint.lower <= last.lowest and last.highest <= joint.upper
            if inside and last.fastest <= joint.speed:
                return last
        share *= _SHRINK
    assert last is not None
    step = (
        f"the simulated motion reaches {last.lowest:.3g} to {last.highest:.3g} at {last.fastest:.3g} a second, the "
        f"limits are {joint.lower:.3g} to {joint.upper:.3g} and {joint.speed:.3g}: give another pose (--pose), a lower "
        "gain (--kp), or limits that the joint has"
    )
    raise BadOption(f"{kind} of {joint.name}", frame.amplitude(kind, share), step)


def _simulated(joint: _Joint, motion: ServoMotion, servo: NominalServo, gains: Sequence[float]) -> SimulatedMotion:
    data = _simulated_set(joint, (motion,), tuple(joint.robots), servo.parameters, gains, 0.0)
    speeds = [np.max(np.abs(np.gradient(one.q, one.samples[:, 0]))) for one in data.train]
    duties = [rolled_out(one, servo.parameters).saturated for one in data.train]
    return SimulatedMotion(
        motion,
        float(min(np.min(one.q) for one in data.train)),
        float(max(np.max(one.q) for one in data.train)),
        float(max(speeds)),
        float(np.mean(np.concatenate(duties))),
    )


def _known(data: JointData, servo: NominalServo) -> tuple[Known, ...]:
    """Return what ``identify`` would know from logs of the nominal servo, with names for what is known together."""
    law, model, values = servo.law, FRICTION_MODELS[servo.friction], servo.parameters.copy()
    if not has_weight(data.rows):
        values[PLACE["angle_offset"]] = 0.0
    saturated = np.concatenate([rolled_out(one, values).saturated for one in data.train])
    has_gain = law.gain_is_free and float(np.mean(saturated)) > SATURATED
    start = refinable(values, law, model, data.has_off)
    free = free_parameters(law, model, start, has_gain, data.has_off)
    known = known_parameters(*_average(ServoProblem(data.train, free, model).finely, start))
    whole = {}
    if law.gain_is_free and not has_gain:
        whole["full_torque"] = ("stiffness", float(values[PLACE["gain_ratio"]]) * law.error_gain)
    if not law.controls_torque and "back_emf" not in free:
        whole["viscous"] = ("damping", 1.0)
    return tuple(
        replace(one.scaled(whole[one.name][1]), name=whole[one.name][0]) if one.name in whole else one for one in known
    )


def _average(problem: ServoProblem, parameters: Array) -> tuple[ServoProblem, Array, Spread]:
    """Return a problem, its parameters and their spread, averaged over servos near them.

    Where a joint comes to rest between two steps of the encoder decides which errors repeat. That changes from one
    servo to the next, and the half widths of their intervals with it, by a factor of two and more.
    A parameter that would leave its bounds is moved the other way: at a bound its variance would count as 0.
    """
    random, values, found = np.random.default_rng(0), parameters[problem.places], []
    lower, upper = problem.bounds()
    step = encoder_step(problem.records)
    for _ in range(_NEIGHBOURS):
        beside = values * random.normal(1.0, _NEAR, len(values))
        beside = np.where((beside < lower) | (beside > upper), 2.0 * values - beside, beside)
        near = problem.full(beside, parameters)
        records = []
        for record in problem.records:
            q = rolled_out(record, near).q
            records.append(replace(record, q=np.round(q / step) * step))
        found.append(spread_of(replace(problem, records=tuple(records)), near))
    covariance = np.mean([one.covariance for one in found], axis=0)
    seen = np.all([one.seen for one in found], axis=0)
    return problem, parameters, replace(found[0], covariance=covariance, seen=seen, own=np.zeros(len(values)))
