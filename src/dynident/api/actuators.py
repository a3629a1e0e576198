"""actuators and follow: a case with servos and its logs to the actuators of its robot, and these on other logs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from dynident.actuators.estimate import ActuatorEstimate
from dynident.actuators.followed_log import FollowedJoint, followed
from dynident.actuators.identify import identify_actuators
from dynident.actuators.servo_files import read_servo_logs
from dynident.actuators.servo_log import ServoLog, ServoSetup, check_travel, with_slides
from dynident.actuators.torque_state import check_torque_state
from dynident.api.case_logs import check_distinct, logs_named, with_logs
from dynident.api.estimate_output import file_of_fit
from dynident.case.case import Case, read_case
from dynident.case.part_sections import AUTO
from dynident.errors import BadOption, DescriptionError
from dynident.files import sha256_of
from dynident.model.threads import one_blas_thread
from dynident.robot_files.robot_origin import is_unchanged, robot_facts
from dynident.robot_files.xacro import split_arguments


def actuators(
    case: Case | str | Path, *, command: str = "", progress: Callable[[str], None] = lambda step: None
) -> ActuatorEstimate:
    """Identify the actuators of a case whose logs have commanded and measured positions and no torque.

    Args:
        case: A case with the key ``servo``, or its file.
        command: What was typed, to be repeated; empty for nothing.
        progress: Called with each step in words.

    Raises:
        DescriptionError: The case has no key ``servo``, a split of a single log, or constraints of bodies that are not
            found.
        BadOption: No training log is named.
        LogFormatError: A log lacks a column, or is no sound log.
        LogMismatch: A log that determines nothing (no command, one pose, counts, saturated throughout), or whose column
            of the torque state is inverted.
        NotConsistent: The robot model has no inertias, or not of all links where the bodies are to be found.
        ContradictoryConstraints: No robot meets the constraints.
        SolverFailed: No start gives a finite roll-out.
    """
    if not isinstance(case, Case):
        case = read_case(case)
    train, test = logs_of_servos(case)
    assert case.servo is not None
    setup = _with_bodies(case, case.servo)
    with one_blas_thread():
        found = identify_actuators(case.robot, setup, train, test, progress)
    paths = dict.fromkeys(log.path for log in (*train, *test))
    provenance = {
        "dynident": version("dynident"),
        "command": command,
        "case": {"path": case.path, "sha256": sha256_of(case.path)},
        "robot": robot_facts(case.robot_path),
        "logs": [{"path": path, "sha256": sha256_of(path)} for path in paths],
        "train": [log.name for log in train],
        "left_out": [text for log in (*train, *test) for text in log.left_out],
    }
    return replace(found, provenance=provenance)


def _with_bodies(case: Case, setup: ServoSetup) -> ServoSetup:
    """Return how the servos of a case are found, with the bodies that it asks for: by default the robot model's.

    Raises:
        DescriptionError: Constraints without bodies that may be found, or of parameters that bodies have not.
    """
    bodies, known = "plausible" if case.bodies == AUTO else case.bodies, case.constraints
    if not bodies and not known.is_empty:
        step = "write bodies: plausible to find the bodies beside the drives, or leave constraints out"
        raise DescriptionError(case.path, "constraints", "the bodies of a case with servo are the robot model's", step)
    if known.fixed:
        step = "leave fixed out: state masses and centres of links, which bodies: plausible keeps"
        raise DescriptionError(case.path, "constraints.fixed", "it has no effect beside servo", step)
    return replace(setup, bodies=bodies, constraints=known)


def follow(estimate: ActuatorEstimate, logs: Sequence[str | Path] = ()) -> tuple[FollowedJoint, ...]:
    """Roll out actuators over logs, read as the case of the estimate reads them; the commands are the only input.

    Args:
        estimate: The actuators, as :func:`actuators` or ``read_actuators`` gives them.
        logs: The logs; by default the test logs of the case, or its training logs where it has none, or those of the
            identification where the case names none.

    Raises:
        FileError: The case file of the estimate is gone.
        DescriptionError: The robot model is not the one that the actuators were identified with.
        DynidentError: A log that is not sound, as of :func:`actuators`.
    """
    case, found = logs_to_follow(estimate, logs)
    with one_blas_thread():
        return followed(estimate, case.robot, found, _seen(estimate, found))


def logs_to_follow(estimate: ActuatorEstimate, logs: Sequence[str | Path] = ()) -> tuple[Case, list[ServoLog]]:
    """Return the case of an estimate and the logs of :func:`follow`.

    Raises:
        DynidentError: As of :func:`follow`.
    """
    stated = estimate.provenance.get("case", {})
    case = read_case(file_of_fit(estimate, stated) or stated.get("path", ""))
    facts = estimate.provenance.get("robot", {})
    if facts and not is_unchanged(facts, split_arguments(case.robot_path)[0]):
        step = "identify again: its inertias are the scale of all torques"
        raise DescriptionError(case.robot_path, "", "it has changed since these actuators were identified", step)
    if not (logs or case.train):
        logs = _test_logs(estimate)
    if logs:
        case = replace(with_logs(case, [str(log) for log in logs], ())[0], split=None)
    train, test = logs_of_servos(case)
    return case, test or train


def _test_logs(estimate: ActuatorEstimate) -> list[str]:
    """Return the files that an estimate was tested on, or trained on where it was not tested."""
    logs = estimate.provenance.get("logs", ())
    trained = tuple(estimate.provenance.get("train", ()))
    others = [one for one in logs if not any(name.startswith(str(one["path"])) for name in trained)] or logs
    return [file_of_fit(estimate, one) or str(one["path"]) for one in others]


def _seen(estimate: ActuatorEstimate, logs: Sequence[ServoLog]) -> frozenset[str]:
    """Return the names of logs whose content the estimate was trained on."""
    digests = {one["path"]: one["sha256"] for one in estimate.provenance.get("logs", ())}
    known = {
        (digest, name.removeprefix(path))
        for name in estimate.provenance.get("train", ())
        for path, digest in digests.items()
        if name.startswith(path)
    }
    return frozenset(log.name for log in logs if (sha256_of(log.path), log.name.removeprefix(log.path)) in known)


def logs_of_servos(case: Case) -> tuple[list[ServoLog], list[ServoLog]]:
    """Return the training and the test logs of a case with servos.

    Raises:
        DynidentError: As of :func:`actuators`.
    """
    if case.servo is None:
        raise DescriptionError(case.path or "the case", "servo", "is missing", "state the drive law of the servos")
    if not case.train:
        raise BadOption("LOG", "", "name a log on the command line, or under train: in the case file")
    files = [[case.find(name) for name in logs_named(names, case.find)[0]] for names in (case.train, case.test)]
    train, test = ([log for file in part for log in read_servo_logs(file, case.servo.columns)] for part in files)
    check_distinct((str(file), sha256_of(file)) for part in files for file in part)
    travel = np.array([joint.limits.upper - joint.limits.lower for joint in case.robot.active])
    for log in (*train, *test):
        check_travel(log, travel)
    if any(slides := [joint.kind == "prismatic" for joint in case.robot.active]):
        logs = with_slides([*train, *test], slides)
        train, test = logs[: len(train)], logs[len(train) :]
    for log in (*train, *test):
        check_torque_state(case.robot, log)
    return (train, test) if case.split is None else _split(case, train)


def _split(case: Case, logs: list[ServoLog]) -> tuple[list[ServoLog], list[ServoLog]]:
    """Return the first and the other episodes of a case with a split."""
    assert case.split is not None
    if case.split.first is None or len(logs) < 2:
        evidence = (
            f"{case.split} of {len(logs)} log{'s' * (len(logs) != 1)}: with servo it divides whole logs or episodes"
        )
        raise DescriptionError(
            case.path, "split", evidence, "name other logs under test, or write first:0.67 with several"
        )
    count = min(max(round(case.split.first * len(logs)), 1), len(logs) - 1)
    return logs[:count], logs[count:]
