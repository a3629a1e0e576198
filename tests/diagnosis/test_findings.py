"""What single checks tell of logs with a fault of their own: name, joints, evidence and the next step."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2]))  # the benchmark makes the clean log

from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import Case
from dynident.data.formats import ColumnMap
from dynident.data.preprocessing import default_preprocessing
from dynident.diagnosis.causes.cause_search import Blame, Cause
from dynident.diagnosis.causes.trend_findings import is_grave
from dynident.diagnosis.checks import CHECKS
from dynident.diagnosis.checks.base import CheckedLog
from dynident.diagnosis.checks.readings import simple_ratio
from dynident.diagnosis.finding import Finding, ordered
from dynident.diagnosis.recording import read_recording
from dynident.diagnosis.repair import repair
from dynident.model.friction import FRICTION, default_friction
from dynident.model.joint import Drive, JointLimits
from dynident.model.robot import Robot


@pytest.fixture(scope="module")
def trial(spatial_3r: Robot) -> Trial:
    """A clean log; the joints have names of two words."""
    joints = tuple(
        replace(joint, name=f"{joint.name} of it", damping=2.0, friction=3.0, limits=JointLimits(-3.0, 3.0))
        for joint in spatial_3r.joints
    )
    robot = replace(spatial_3r, joints=joints, coupling=None)
    friction = tuple(FRICTION.make(name) for name in default_friction())
    return virtual(Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing()), rate=100.0)


def told(trial: Trial, check: str, folder: Path) -> list[Finding]:
    """Return what one check says of a log, after the safe repairs."""
    raw = read_recording(trial.case, str(trial.written(folder)))
    return list(CHECKS.make(check).findings(CheckedLog(trial.case, raw, repair(raw, trial.case.robot).recording)))


def changed(trial: Trial, name: str, change: Callable[[np.ndarray], object]) -> Trial:
    values = trial.columns[name].copy()
    change(values)
    return trial.with_columns(**{name: values})


def put(name: str, index: object, value: object) -> Callable[[Trial], Trial]:
    """Return what writes values at an index of a signal."""
    return lambda trial: changed(trial, name, lambda values: values.__setitem__(index, value))  # type: ignore[call-overload]


def scaled(name: str, index: object, factor: float) -> Callable[[Trial], Trial]:
    return lambda trial: changed(trial, name, lambda v: v.__setitem__(index, factor * v[index]))  # type: ignore[call-overload, index]


def mapped(trial: Trial, **columns: tuple[str, ...]) -> Trial:
    return replace(trial, case=replace(trial.case, columns=replace(trial.case.columns, **columns)))  # type: ignore[arg-type]


def commanded(slower: float = 1.0, turned: tuple[int, ...] = ()) -> Callable[[Trial], Trial]:
    """Return what adds commanded positions, of which the measured ones are so much slower, or of other signs."""

    def add(trial: Trial) -> Trial:
        clock = trial.columns["t"] - trial.columns["t"][0]
        reference = np.column_stack([np.interp(clock / slower, clock, column) for column in trial.columns["q"].T])
        reference[:, turned] *= -1.0
        return mapped(trial.with_columns(qr=reference), q_ref=("qr1", "qr2", "qr3"))

    return add


def positions_alone(trial: Trial) -> Trial:
    return mapped(trial.without("tau"), torque=(), current=())


def as_currents(trial: Trial) -> Trial:
    return mapped(trial, torque=(), current=("tau1", "tau2", "tau3"))


def of_motors(turns: float, stated: float) -> Callable[[Trial], Trial]:
    """Return what logs positions of motors that turn so often, with a gear ratio stated."""

    def geared(trial: Trial) -> Trial:
        drives = {joint.name: Drive(gear_ratio=stated) for joint in trial.case.robot.active}
        columns = replace(trial.case.columns, motor=("q",))
        case = replace(trial.case, robot=trial.case.robot.with_drives(drives), columns=columns)
        return replace(trial, case=case).with_columns(q=turns * trial.columns["q"])

    return geared


ALL = slice(None)
FIRST = "joint1 of it"

#: Check, fault, then severity, name, joints, and words of evidence or next step.
FAULTS: dict[str, tuple[str, Callable[[Trial], Trial], tuple[str, str, str], str]] = {
    "a commanded position of the other sign": (
        "following", commanded(turned=(1,)), ("warning", "not following", "joint2 of it"), "away from the commanded",
    ),
    "a motion slowed down": ("following", commanded(0.6), ("warning", "speed scaling", ""), "at 60 % of the commanded"),
    "beyond the limits": (
        "position_range", put("q", (ALL, 0), np.linspace(-3.0, 3.4, 2000)), ("warning", "joint limits", FIRST),
        r"joint1 of it -3 to 3\.4 \(limits -3 to 3\)",
    ),
    "gear ratios upside down": (
        "position_range", of_motors(100.0, 0.01), ("error", "gear ratio", "joint1 of it, joint2 of it, joint3 of it"),
        r"turns of the joint: state the inverse \(drives: \{joint1 of it: \{gear_ratio: 100\}",
    ),
    "a joint at rest behind a noisy encoder": (
        "position_range", put("q", (ALL, 0), 0.3 + np.random.default_rng(0).normal(scale=3e-4, size=2000)),
        ("error", "joint never moved", FIRST), "no more than the noise from sample to sample makes",
    ),
    "no torques": (
        "torque_source", positions_alone, ("error", "no torque", ""), "positions alone give no masses",
    ),
    "currents alone": (
        "torque_source", as_currents, ("error", "no drive gain", "joint1 of it, joint2 of it, joint3 of it"),
        "state gains, torque at the joint per unit of current",
    ),
    "one torque for ever": (
        "resolution", put("tau", (ALL, 2), 1.5), ("error", "torque never changes", "joint3 of it"), "one value in all",
    ),
    "a torque that dies": (
        "saturation", put("tau", (slice(500, 900), 1), 0.0), ("error", "torque held", "joint2 of it"),
        r"0 in all 400 rows from 5 s to 8\.99 s \(20 % of the log\), while the joint moves",
    ),
    "a torque written twice": (
        "equal_columns", lambda t: changed(t, "tau", lambda v: v.__setitem__((ALL, 2), v[:, 0])),
        ("error", "equal columns", "joint1 of it, joint3 of it"), "are the same in all 2000 samples",
    ),
    "a position written twice": (
        "equal_columns", lambda t: changed(t, "q", lambda v: v.__setitem__((ALL, 1), v[:, 0])),
        ("warning", "equal columns", "joint1 of it, joint2 of it"), r"log: columns: q\)",
    ),
    "a velocity of noise": (
        "velocity", put("dq", (ALL, 1), np.random.default_rng(0).normal(size=2000)),
        ("warning", "velocity mismatch", "joint2 of it"), "does not follow the derivative of q",
    ),
    "a velocity behind another gear": (
        "velocity", scaled("dq", (ALL, 0), 1.5), ("warning", "velocity scale", FIRST), r"dq is 1\.5 times",
    ),
    "a velocity of a coarse encoder": (
        "velocity", scaled("dq", (ALL, 0), 1.06), ("note", "velocity scale", FIRST), r"dq is 1\.06 times",
    ),
    "a clock at another speed": (
        "velocity", scaled("t", ALL, 1.25), ("warning", "time scale", ""), "check the scale of the time column",
    ),
    "equal stamps": (
        "time_order", lambda t: changed(t, "t", lambda v: v.__setitem__(slice(101, 120, 2), v[100:119:2])),
        ("error", "equal time stamps", ""), "10 rows have the time of the row before and other values",
    ),
    "six rows": ("time_steps", lambda t: t.rows(np.arange(6)), ("error", "too few rows", ""), "6 rows with a time"),
    "a pause": (
        "time_steps", lambda t: changed(t, "t", lambda v: v.__setitem__(slice(900, None), v[900:] + 3.0)),
        ("error", "gap in time", ""), r"a gap of 3\.01 s after .*split the log there",
    ),
    "stamps in pairs": (
        "time_steps", lambda t: changed(t, "t", lambda v: v.__setitem__(slice(1, None, 2), v[1::2] - 0.008)),
        ("warning", "time jitter", ""), r"steps of 2 to 18 ms",
    ),
    "rows that got lost": (
        "time_steps", lambda t: t.rows(np.delete(np.arange(2000), [300, 700, 701, 702, 1500])),
        ("note", "lost rows", ""), r"5 rows \(0\.25 %\) are missing in 3 places, up to 3 in a row; the",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_told_in_true_words(fault: str, trial: Trial, tmp_path: Path) -> None:
    check, change, (severity, name, joints), words = FAULTS[fault]
    (found,) = told(change(trial), check, tmp_path)
    assert (found.severity, found.name, found.joint) == (severity, name, joints)
    assert re.search(words, found.line()), found.line()


@pytest.mark.parametrize("check", sorted({check for check, *_ in FAULTS.values()}))
def test_nothing_is_told_of_the_clean_log(check: str, trial: Trial, tmp_path: Path) -> None:
    assert told(commanded()(trial), check, tmp_path) == []


def test_a_torque_with_a_dead_zone_is_not_held(trial: Trial, tmp_path: Path) -> None:
    """The TIAGo's wrist has a zero as long as 240 rows, and others nearly as long."""

    def dead_zone(values: np.ndarray) -> None:
        middle, half = np.quantile(values[:, 1], 0.5), 0.3 * np.ptp(values[:, 1])
        near = np.abs(values[:, 1] - middle) < half
        values[near, 1] = middle

    dead = changed(trial, "tau", dead_zone)
    assert [found.name for found in told(dead, "saturation", tmp_path)] == []


def test_of_two_findings_that_explain_each_other_one_is_told() -> None:
    scale = Finding("error", "torque scale", "joint1", "", "", {}, ("torque unit", "spring"))
    unit = Finding("error", "torque unit", "", "", "", {}, ("torque scale",))
    spring, warned = Finding("note", "spring", "joint2", "", ""), replace(unit, severity="warning")
    assert ordered([unit, scale, spring]) == (unit,) and ordered([scale, unit, spring]) == (scale,)
    assert ordered([warned, scale]) == (scale,) and ordered([unit, spring]) == (unit, spring)
    assert ordered([unit], [scale]) == ()


@pytest.mark.parametrize(
    ("name", "share", "size", "grave"),
    [
        ("spring", 0.9, 0.3, True),
        ("spring", 0.9, 0.05, False),
        ("spring", 0.4, 0.3, False),
        ("friction curve", 0.9, 0.3, False),
    ],
)
def test_what_explains_most_of_a_joint_may_be_exchanged_columns(
    name: str, share: float, size: float, grave: bool
) -> None:
    cause = Cause(name, "joint1", np.zeros((1, 9, 3)))
    blame = Blame(cause, np.ones(1), np.eye(1), 9.0, 3.0, share, size, np.ones(3), np.ones(3))
    assert is_grave(blame) == grave


@pytest.mark.parametrize(
    ("value", "half_width", "ratio"),
    [(0.9792, 0.04, 1.0), (-1.02, 0.05, -1.0), (0.97, 0.02, 0.0), (1.0, 0.04, 0.0), (0.49, 0.02, 0.5), (3.1, 0.2, 3.0)],
)
def test_a_coupling_whose_interval_holds_a_whole_ratio(value: float, half_width: float, ratio: float) -> None:
    assert simple_ratio(value, half_width) == ratio


def test_joints_at_rest_or_without_torque_are_no_equal_columns(trial: Trial, tmp_path: Path) -> None:
    still = changed(trial, "q", lambda v: v.__setitem__((ALL, [0, 1]), 0.25))
    assert told(changed(still, "tau", lambda v: v.__setitem__((ALL, [0, 1]), 0.0)), "equal_columns", tmp_path) == []


def test_the_last_digit_of_joints_at_rest_is_no_second_publisher(trial: Trial, tmp_path: Path) -> None:
    """One joint moves, then all rest, and the velocities of some alternate between zero and the smallest step."""

    def one_moves(dq: np.ndarray) -> None:
        dq[:, :2] = 1e-4 * np.random.default_rng(0).integers(-1, 2, (len(dq), 2))
        dq[1000:, 2] = 0.0

    def lost(dq: np.ndarray) -> None:
        one_moves(dq)
        dq[500:510] = 0.0

    assert told(changed(trial, "dq", one_moves), "cells", tmp_path) == []
    (found,) = told(changed(trial, "dq", lost), "cells", tmp_path)
    assert found.name == "two publishers" and "jumps to zero at 1 rows" in found.evidence


def test_a_count_of_an_encoder_as_an_arm_starts_is_no_second_publisher(trial: Trial, tmp_path: Path) -> None:
    """Velocities by differences of few counts: at the start of a slow motion one joint makes one, and none the next."""

    def slow(dq: np.ndarray) -> None:
        dq[:] = np.round(3.0 * dq / np.abs(dq).max()) * 0.1
        dq[:9] = 0.0
        dq[4, 0] = 0.1

    assert told(changed(trial, "dq", slow), "cells", tmp_path) == []


def limited(trial: Trial, fastest: float) -> Trial:
    """Return the trial of a robot with these limits of the speed, in rad/s."""
    robot = trial.case.robot
    joints = tuple(replace(joint, limits=JointLimits(-3.0, 3.0, velocity=fastest)) for joint in robot.joints)
    return replace(trial, case=replace(trial.case, robot=replace(robot, joints=joints)))


@pytest.mark.parametrize(("clock", "fastest", "is_told"), [(20.0, 500.0, True), (20.0, 1.0, False), (1.0, 1e5, False)])
def test_a_motion_too_slow_for_a_robot_is_in_another_unit_of_time(
    trial: Trial, clock: float, fastest: float, is_told: bool, tmp_path: Path
) -> None:
    """Steps of 0.2 s may be 5 kHz in ms: the speeds tell. A slow motion at 100 Hz is one: nobody records 100 kHz."""
    slow = limited(trial, fastest).with_columns(t=clock * trial.columns["t"])
    found = [finding for finding in told(slow, "time_steps", tmp_path) if finding.name == "time unit"]
    assert len(found) == is_told
    if is_told:
        assert "5000 samples a second then" in found[0].remedy and "of its speed limit" in found[0].evidence


def test_of_two_units_of_the_time_the_one_with_the_likelier_speeds_is_named(trial: Trial, tmp_path: Path) -> None:
    """Steps of 200 are 5 kHz in us or 5 Hz in ms, in which the positions would move a thousand times slower."""
    t = 200.0 * np.arange(len(trial.columns["t"]))
    (found,) = told(limited(trial, 100.0).with_columns(t=t), "time_steps", tmp_path)
    assert "{time: us}" in found.remedy and "5000 samples a second then" in found.remedy


def test_motors_that_turn_with_their_gears_are_right(trial: Trial, tmp_path: Path) -> None:
    assert told(of_motors(100.0, 100.0)(trial), "position_range", tmp_path) == []
