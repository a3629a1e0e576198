"""servo_motions: motions for the position servos of a case, as command files, with the intervals they would give."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from dynident.actuators.command_files import ServoMotions, command_files
from dynident.actuators.estimate import read_actuators
from dynident.actuators.nominal_servo import NominalServo, of_estimate, of_limits
from dynident.actuators.servo_excitation import JointExcitation, MotionRequest, servo_excitation
from dynident.actuators.servo_log import AUTO, ServoColumns
from dynident.api.excite import case_clearance
from dynident.arrays import Array
from dynident.case.case import Case, read_case
from dynident.errors import BadOption, DescriptionError
from dynident.excitation.design.limits import limits_of
from dynident.model.threads import one_blas_thread

#: Friction model that motions are judged with where the case lets logs choose it.
FRICTION = "m3"

#: Postures of a joint over its simulated range at which clearances are looked at.
_POSTURES = 81


def servo_motions(
    case: Case | str | Path,
    *,
    rate: float = 100.0,
    seconds: float = 6.0,
    margin: float = 0.05,
    gains: Sequence[float] = (),
    pose: Sequence[float] | None = None,
    model: str | Path | None = None,
    progress: Callable[[str], None] = lambda step: None,
) -> ServoMotions:
    """Offer motions that determine the servos of a case, one joint at a time, within its limits.

    Args:
        case: A case with the key ``servo``, or its file.
        rate: Commands a second, at least 10.
        seconds: Length of a motion, at least 2.
        margin: Share of each limit that commands leave unused.
        gains: Position gains to record at; by default those that the case states.
        pose: Position of each joint at which it is held, and about which it moves; None for the middles of the ranges.
        model: File of an earlier estimate, in place of the nominal servo.
        progress: Called with each step in words.

    Raises:
        DescriptionError: The case has no key ``servo``.
        BadOption: A limit or gain that is not stated, a pose outside the limits, no motion that keeps them, or one
            that comes too near to something.
        NotConsistent: The robot model has no inertias.
        EstimateFormatError: The earlier estimate is none of actuators.
    """
    if not isinstance(case, Case):
        case = read_case(case)
    if case.servo is None:
        raise DescriptionError(case.path or "the case", "servo", "is missing", "state the drive law of the servos")
    columns, count = case.servo.columns, case.robot.dof
    for name, value, least in (("--rate", rate, 10.0), ("--period", seconds, 2.0)):
        if not least <= value < float("inf"):
            raise BadOption(name, value, f"give {least:g} or more")
    if pose is not None and len(pose) != count:
        raise BadOption("--pose", list(pose), f"give {count} numbers, one for each joint")
    own = np.array(pose, dtype=float) if pose is not None else limits_of(case.robot, margin, 0.0).centre
    can_release = len(columns.enabled) == count
    request = MotionRequest(rate, seconds, margin, _gains(case, gains), own, columns.payloads, can_release)
    with one_blas_thread():
        found = servo_excitation(case.robot, _servos(case, request, model), request, progress)
    outer = limits_of(case.robot, 0.0, 0.0)
    return ServoMotions(
        robot=case.robot.name,
        request=request,
        pose=own,
        limits=np.column_stack([outer.lower, outer.upper, outer.velocity]),
        joints=found,
        files=command_files(found, own, request, columns),
        clearance=_clearance(case, own, found),
        remarks=_remarks(columns, can_release),
    )


def _gains(case: Case, given: Sequence[float]) -> tuple[float, ...]:
    """Return the position gains to record at, sorted.

    Raises:
        BadOption: One that is no gain, or none is stated.
    """
    assert case.servo is not None
    kp, law = case.servo.columns.kp, case.servo.laws[0]
    if given:
        for value in given:
            if not 0 < value < float("inf"):
                raise BadOption("--kp", value, "give position gains of the drive, above 0")
        return tuple(sorted(set(map(float, given))))
    if isinstance(kp, int | float):
        return (float(kp),)
    if isinstance(kp, str):
        raise BadOption(
            "--kp", None, f"the case reads kp from logs ('{kp}'); give the gains to record at: --kp 100 400"
        )
    if kp:
        return tuple(sorted(set(map(float, kp.values()))))
    return (1.0 if law.kp is None else law.kp,)


def _servos(case: Case, request: MotionRequest, path: str | Path | None) -> Callable[[int, bool], NominalServo]:
    """Return what gives the nominal servo of a joint: of an earlier estimate, or of limits."""
    assert case.servo is not None
    setup, joints = case.servo, case.robot.active
    laws = setup.laws if setup.columns.kp is not None else [law.without_gain for law in setup.laws]
    model = None if path is None else read_actuators(path)
    friction = FRICTION if setup.friction == AUTO else setup.friction
    if model is not None and tuple(joint.name for joint in model.joints) != case.robot.joint_names:
        step = f"it has the joints {', '.join(joint.name for joint in model.joints)}; identify this robot first"
        raise BadOption("--model", path, step)

    def servo(k: int, has_weight: bool) -> NominalServo:
        if model is not None:
            return of_estimate(model.joints[k], laws[k], str(path))
        return of_limits(joints[k], laws[k], friction, request.gains[0], has_weight)

    return servo


def _clearance(case: Case, pose: Array, found: Sequence[JointExcitation]) -> tuple[float, str] | None:
    """Return the smallest distance to spare over all simulated ranges, in m, and between what; None without workspace.

    Raises:
        BadOption: A joint comes nearer to something than the workspace allows.
    """
    clearance = case_clearance(case)
    if clearance is None or not clearance.names:
        return None
    least = (float("inf"), "")
    for k, joint in enumerate(found):
        postures = np.tile(pose, (_POSTURES, 1))
        ends = min(one.lowest for one in joint.motions), max(one.highest for one in joint.motions)
        postures[:, k] = np.linspace(*ends, _POSTURES)
        spare = clearance.distances(postures) - clearance.required
        row, pair = np.unravel_index(int(np.argmin(spare)), spare.shape)
        own = (float(spare[row, pair]), clearance.names[int(pair)])
        if own[0] < 0:
            step = (
                f"at {postures[row, k]:.3g} {own[1]} come {-own[0]:.3g} m nearer than the workspace allows: give "
                "another pose (--pose), or narrower limits of the joint (limits: in the case file)"
            )
            raise BadOption(f"motions of {joint.joint}", float(postures[row, k]), step)
        least = min(least, own)
    return least


def _remarks(columns: ServoColumns, can_release: bool) -> tuple[str, ...]:
    remarks = []
    if not can_release and columns.enabled:
        remarks.append(
            f"no release: {columns.enabled[0]} would switch off all joints; name one column for each (servo: enabled)"
        )
    elif not can_release:
        remarks.append("no release: name the column of the torque state (servo: {enabled: torque_enable})")
    if not columns.payloads:
        remarks.append(
            "second payload: state it to get its motions: servo: {payloads: {load2: {mass: 0.2, centre: [0, 0, 0.1]}}}"
        )
    return tuple(remarks)
