"""Recordings of ROS 2: joint states beside the topic of a position controller make a log of servos."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from servo_bench import PENDULUM, parameters, virtual_logs

pytest.importorskip("rosbags", reason="recordings of ROS need the package rosbags (extra ros)")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from dynident.api.actuators import actuators, logs_of_servos
from dynident.case.case import read_case
from dynident.model.robot import Robot

STORE = get_typestore(Stores.ROS2_HUMBLE)
FIRST = 1_700_000_000_000_000_000

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


def test_states_and_commands_of_a_recording(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    log = virtual_logs(robot, parameters(), gains=(4.0,))[0]
    types, empty = STORE.types, np.zeros(0)
    layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    with Writer(tmp_path / "rec", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {
            "/joint_states": "sensor_msgs/msg/JointState",
            "/position_controller/commands": "std_msgs/msg/Float64MultiArray",
        }
        topics = {name: writer.add_connection(name, kind, typestore=STORE) for name, kind in kinds.items()}

        def write(topic: str, stamp: int, message: Any) -> None:
            writer.write(topics[topic], stamp, STORE.serialize_cdr(message, kinds[topic]))

        for time, q, q_ref in zip(log.time - log.time[0], log.q[:, 0], log.q_ref[:, 0], strict=True):
            stamp = FIRST + round(time * 1e9)
            moment = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
            head = types["std_msgs/msg/Header"](stamp=moment, frame_id="")
            write(
                "/joint_states",
                stamp,
                types["sensor_msgs/msg/JointState"](head, ["joint1"], np.array([q]), empty, empty),
            )
            write(
                "/position_controller/commands",
                stamp,
                types["std_msgs/msg/Float64MultiArray"](layout, np.array([q_ref])),
            )
    (tmp_path / "rec" / "rec.mcap").rename("run.mcap")
    Path("pendulum.urdf").write_text(PENDULUM)
    Path("case.yaml").write_text(CASE)
    ((found,), _) = logs_of_servos(read_case("case.yaml"))
    np.testing.assert_allclose(found.q, log.q, atol=1e-12)
    np.testing.assert_allclose(found.q_ref, log.q_ref, atol=1e-12)
    np.testing.assert_allclose(found.time, log.time - log.time[0] + found.time[0], atol=1e-6)
    assert actuators("case.yaml").joints[0].value("armature") == pytest.approx(0.012, rel=0.05)
