"""Recordings of ROS 2: joint states beside the topic of a position controller make a log of servos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from servo_bench import parameters, virtual_logs

pytest.importorskip("rosbags", reason="recordings of ROS need the package rosbags (extra ros)")

from recordings import STATE, record, state

from dynident.actuators.servo_log import ServoLog
from dynident.api.actuators import actuators, logs_of_servos
from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.model.robot import Robot

COMMANDS = "std_msgs/msg/Float64MultiArray"

CASE = """case: 2
robot: pendulum.urdf
servo: {law: feetech_sts3215, kp: 4, friction: m1}
log:
  format: {rosbag: {topics: [/joint_states, /position_controller/commands], stamps: receive}}
  columns:
    time: t
    q: ["/joint_states:joint1.position"]
    q_ref: ["/position_controller/commands:data[0]"]
    torque: none
train: run.mcap
"""


def write(log: ServoLog, topic: str, *effort: float) -> None:
    """Write run.mcap: states of the joint, with an effort if there is one, and its commands on a topic of their own."""

    def command(types: Any, header: Any, row: int) -> Any:
        layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        return types[COMMANDS](layout, log.q_ref[row // 2])

    rows = []
    for time, q in zip((log.time - log.time[0]).tolist(), log.q[:, 0].tolist(), strict=True):
        rows += [(time, "/joint_states", state(q, *effort)), (time, topic, command)]
    record({"/joint_states": STATE, topic: COMMANDS}, rows)


def test_states_and_commands_of_a_recording(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    log = virtual_logs(robot, parameters(), gains=(4.0,))[0]
    write(log, "/position_controller/commands")
    Path("case.yaml").write_text(CASE)
    ((found,), _) = logs_of_servos(read_case("case.yaml"))
    np.testing.assert_allclose(found.q, log.q, atol=1e-12)
    np.testing.assert_allclose(found.q_ref, log.q_ref, atol=1e-12)
    np.testing.assert_allclose(found.time, log.time - log.time[0] + found.time[0], atol=1e-6)
    assert actuators("case.yaml").joints[0].value("armature") == pytest.approx(0.012, rel=0.05)


@pytest.mark.parametrize(
    ("topic", "effort"), [("/position_controller/commands", None), ("/arm/commands", np.nan), ("/arm/commands", 0.3)]
)
def test_init_finds_the_topic_of_the_commands(
    robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, topic: str, effort: float | None
) -> None:
    """Where the states have efforts, the case is for them."""
    monkeypatch.chdir(tmp_path)
    log = virtual_logs(robot, parameters(), gains=(4.0,))[0]
    write(log, topic, *([] if effort is None else [effort]))
    assert main(["init", "pendulum.urdf", "run.mcap", "-o", "case.yaml"]) == 0
    case = read_case("case.yaml")
    if effort == 0.3:
        assert case.servo is None and case.columns.torque == ("joint1.effort",)
        return
    ((found,), _) = logs_of_servos(case)
    np.testing.assert_allclose(found.q, log.q, atol=1e-12)
    np.testing.assert_allclose(found.q_ref, log.q_ref, atol=1e-12)
