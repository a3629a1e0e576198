"""Recordings of ROS whose commands are trajectories, or that have the state of a trajectory controller."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from servo_bench import parameters, virtual_logs

pytest.importorskip("rosbags", reason="recordings of ROS need the package rosbags (extra ros)")

from recordings import CONTROLLER, GOAL, GOALS, NEW, OLD, STATE, Message, goal, point, record, state

from dynident.actuators.formats.trajectory import commanded
from dynident.api.actuators import actuators, logs_of_servos
from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.data.formats import FORMATS
from dynident.errors import LogFormatError
from dynident.model.robot import Robot


def test_a_stream_of_trajectories_is_the_command(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each with one point that is wanted at once, as a leader arm sends them: init finds them, identify reads them."""
    monkeypatch.chdir(tmp_path)
    log = virtual_logs(robot, parameters(), gains=(4.0,))[0]
    time = log.time - log.time[0]
    rows = [
        row
        for at, q, q_ref in zip(time, log.q[:, 0], log.q_ref[:, 0], strict=True)
        for row in ((at, GOALS, goal((0.0, q_ref))), (at, "/joint_states", state(q)))
    ]
    record({"/joint_states": STATE, GOALS: GOAL}, rows)
    assert main(["init", "pendulum.urdf", "run.mcap", "-o", "case.yaml"]) == 0
    text = Path("case.yaml").read_text()
    assert f"format: {{trajectory: {{states: /joint_states, commands: {GOALS}}}}}" in text
    ((found,), _) = logs_of_servos(read_case("case.yaml"))
    np.testing.assert_allclose(found.q, log.q, atol=1e-12)
    np.testing.assert_allclose(found.q_ref, log.q_ref, atol=1e-12)
    Path("case.yaml").write_text(
        """case: 2
robot: pendulum.urdf
servo: {law: feetech_sts3215, kp: 4, friction: m1}
log:
  format: {trajectory: {}}
  columns: {time: t, q: [joint1.position], q_ref: [joint1.command], torque: none}
train: run.mcap
"""
    )
    assert actuators("case.yaml").joints[0].value("armature") == pytest.approx(0.012, rel=0.05)


@pytest.mark.parametrize("words", [OLD, NEW])
@pytest.mark.parametrize("has_states", [True, False])
def test_init_finds_the_state_of_a_trajectory_controller(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], has_states: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    log = virtual_logs(robot, parameters(), gains=(4.0,))[0]
    values = {"desired": log.q_ref, "reference": log.q_ref, "output": log.q_ref, "error": log.q_ref - log.q}

    def controller(row: int) -> Message:
        def made(types: Any, header: Any, _: int) -> Any:
            return types[CONTROLLER](
                header, ["joint1"], *(point(types, float(values.get(word, log.q)[row, 0])) for word in words)
            )

        return made

    topic, rows = "/arm_controller/controller_state", []
    for row, at in enumerate(log.time - log.time[0]):
        rows.append((at, topic, controller(row)))
        if has_states:
            rows.append((at, "/joint_states", state(log.q[row, 0])))
    record({topic: CONTROLLER} | ({"/joint_states": STATE} if has_states else {}), rows, words)
    assert main(["init", "pendulum.urdf", "run.mcap", "-o", "case.yaml"]) == 0
    ((found,), _) = logs_of_servos(read_case("case.yaml"))
    np.testing.assert_allclose(found.q, log.q, atol=1e-12)
    np.testing.assert_allclose(found.q_ref, log.q_ref, atol=1e-12)


def test_points_ask_for_lines_and_splines() -> None:
    time, q = np.linspace(0.0, 4.0, 41), np.full(41, 0.5)
    line = commanded(time, q, None, [(1.0, [(1.0, 1.5)])])
    np.testing.assert_allclose(line, np.interp(time, [1.0, 2.0], [0.5, 1.5]), atol=1e-12)
    # both ends at rest: a cubic spline, 3 s^2 - 2 s^3
    share = np.clip(time - 1.0, 0.0, 1.0)
    cubic = commanded(time, q, np.zeros(41), [(1.0, [(1.0, 1.5, 0.0)])])
    np.testing.assert_allclose(cubic, 0.5 + 3 * share**2 - 2 * share**3, atol=1e-12)
    # accelerations count where both ends have them: between the two points
    points = [(1.0, 0.5, 0.0, 0.0), (2.0, 1.5, 0.0, 0.0)]
    share = np.clip(time - 2.0, 0.0, 1.0)
    quintic = commanded(time, q, None, [(1.0, points)])
    np.testing.assert_allclose(quintic, 0.5 + 10 * share**3 - 15 * share**4 + 6 * share**5, atol=1e-12)


@pytest.mark.parametrize(("from_command", "begin"), [(False, 0.4), (True, 1.0)])
def test_a_message_takes_the_place_of_the_one_before(from_command: bool, begin: float) -> None:
    time, q = np.linspace(0.0, 4.0, 41), np.full(41, 0.4)
    found = commanded(time, q, None, [(0.0, [(2.0, 1.6)]), (1.0, [(1.0, 0.0)]), (3.0, [])], from_command)
    np.testing.assert_allclose(found[:10], 0.4 + 0.6 * time[:10], atol=1e-12)
    np.testing.assert_allclose(found[10:20], begin * (2.0 - time[10:20]), atol=1e-12)
    np.testing.assert_allclose(found[20:30], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[30:], 0.0 if from_command else 0.4, atol=1e-12)  # no points: hold


def test_an_open_loop_goes_on_with_the_velocity_of_the_command() -> None:
    """The second message comes half way through a cubic spline, where the command moves at 1.5 rad/s."""
    time, q = np.linspace(0.0, 2.0, 21), np.zeros(21)
    still = np.zeros(21)
    found = commanded(time, q, still, [(0.0, [(1.0, 1.0, 0.0)]), (0.5, [(1.0, 0.5, 0.0)])], from_command=True)
    share = time[5:16] - 0.5
    np.testing.assert_allclose(found[5:16], 0.5 + 1.5 * (share - 2 * share**2 + share**3), atol=1e-3)


def test_the_states_of_a_gripper_may_share_the_topic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def of_gripper(types: Any, header: Any, _: int) -> Any:
        return types[STATE](header, ["finger"], np.array([0.01]), np.zeros(0), np.zeros(0))

    rows: list[tuple[float, str, Message]] = [(0.05, "/joint_states", of_gripper)]
    rows += [(0.1 * k, "/joint_states", state(0.1 * k)) for k in range(1, 30)]
    record({"/joint_states": STATE, "/a": GOAL}, [*rows, (0.5, "/a", goal((1.0, 0.2)))])
    table = FORMATS.make("trajectory", {}).open("run.mcap")
    assert {"joint1.position", "joint1.command"} <= set(table.header)


@pytest.mark.parametrize(
    ("values", "told"), [((), "has a point without position of joint1"), ((float("nan"),), "asks joint1 for no number")]
)
def test_a_point_that_asks_for_no_position_is_refused(
    values: tuple[float, ...], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    def asked(types: Any, header: Any, _: int) -> Any:
        whole = types["builtin_interfaces/msg/Duration"](1, 0)
        lists = [np.array(values), np.array([0.3]), np.zeros(0), np.zeros(0)]
        own = types["trajectory_msgs/msg/JointTrajectoryPoint"](*lists, whole)
        return types[GOAL](header, ["joint1"], [own])

    rows: list[tuple[float, str, Message]] = [(0.1 * k, "/joint_states", state(0.0)) for k in range(20)]
    record({"/joint_states": STATE, "/a": GOAL}, [*rows, (0.5, "/a", asked)])
    with pytest.raises(LogFormatError, match=told):
        FORMATS.make("trajectory", {}).open("run.mcap")


@pytest.mark.parametrize(
    ("kinds", "made", "told"),
    [
        ({"/joint_states": STATE}, None, r"0 topics of trajectory_msgs"),
        ({"/joint_states": STATE, "/a": GOAL, "/b": GOAL}, None, r"2 topics of .* name both.*there are /a, /b$"),
        ({"/joint_states": STATE, "/a": GOAL}, None, r"no message of /a counts"),
        ({"/joint_states": STATE, "/a": GOAL}, 64, r"a trajectory of /a has 64 points or more"),
    ],
)
def test_recordings_without_a_command_say_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kinds: dict[str, str], made: int | None, told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = [(0.1 * k, "/joint_states", state(0.0)) for k in range(3)]
    if made:
        rows.append((0.3, "/a", goal(*((0.1 * k, 0.2) for k in range(made)))))
    record(kinds, rows)
    with pytest.raises(LogFormatError, match=told):
        FORMATS.make("trajectory", {}).open("run.mcap")
