"""The C++ player, compiled against stand-ins of the libfranka headers and run against a robot that only obeys."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from driven_plans import plan_of

from dynident.data.formats import ColumnMap, read_log
from dynident.exports.motions import MOTION_EXPORTERS, Playback, export_motion

#: The part of libfranka that the player uses; the robot takes each command, moves there at once and counts time in ms.
ROBOT = r"""#pragma once
#include <array>
#include <cstdint>
#include <fstream>
#include <functional>
#include <string>
namespace franka {
struct Duration {
  uint64_t ms = 0;
  uint64_t toMSec() const noexcept { return ms; }
  double toSec() const noexcept { return 1e-3 * static_cast<double>(ms); }
};
struct Finishable { bool motion_finished = false; };
struct JointPositions : Finishable {
  JointPositions(const std::array<double, 7>& values) noexcept : q(values) {}
  std::array<double, 7> q{};
};
inline JointPositions MotionFinished(JointPositions command) noexcept {
  command.motion_finished = true;
  return command;
}
struct RobotState {
  std::array<double, 7> q{}, dq{}, q_d{}, tau_J{};
  Duration time;
};
enum class ControllerMode { kJointImpedance, kCartesianImpedance };
class Robot {
 public:
  explicit Robot(const std::string& address) : commands_(address) {
    state_.q_d = {{0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7}};
    state_.q = state_.q_d;
    commands_.precision(15);
  }
  void control(std::function<JointPositions(const RobotState&, Duration)> callback,
               ControllerMode mode = ControllerMode::kJointImpedance, bool limit_rate = true, double cutoff = 100.0) {
    (void)mode; (void)limit_rate; (void)cutoff;
    Duration period{0};
    for (bool done = false; !done;) {
      const JointPositions command = callback(state_, period);
      for (double value : command.q) commands_ << value << ' ';
      commands_ << '\n';
      state_.q = state_.q_d = command.q;
      state_.tau_J.fill(static_cast<double>(state_.time.ms));
      period.ms = 1;
      state_.time.ms += 1;
      done = command.motion_finished;
    }
    commands_ << "0 0 0 0 0 0 9\n";
  }
 private:
  RobotState state_;
  std::ofstream commands_;
};
}  // namespace franka
"""


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_the_player_approaches_drives_the_table_and_records(tmp_path: Path) -> None:
    plan = plan_of(7, scale=0.2)
    found = export_motion(
        plan,
        MOTION_EXPORTERS.make("libfranka", {"player": True}),
        tmp_path / "m.csv",
        playback=Playback(from_posture="start", speed=100),
    )
    assert [Path(file).name for file in found.files] == ["m.csv", "m_player.cpp"]
    (tmp_path / "franka").mkdir()
    (tmp_path / "franka" / "robot.h").write_text(ROBOT)
    (tmp_path / "franka" / "exception.h").write_text("#pragma once\n")
    build = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-I", ".", "m_player.cpp", "-o", "player"]
    subprocess.run(build, cwd=tmp_path, check=True)
    done = subprocess.run(["./player", "commands", "m.csv", "log.csv"], cwd=tmp_path, input=b"\n", check=False)
    assert done.returncode == 0
    commands = np.loadtxt(tmp_path / "commands")
    first_end, second_end = np.flatnonzero(commands[:, 6] == 9)
    approach, motion = commands[:first_end], commands[first_end + 1 : second_end]
    table = np.loadtxt(tmp_path / "m.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(motion, table[:, 1:8], atol=1e-9)
    np.testing.assert_allclose(approach[0], [0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7])
    np.testing.assert_allclose(approach[-1], table[0, 1:8], atol=1e-12)
    for order, bound in enumerate((0.3, 2.0, 20.0), start=1):  # a tenth of 3, 20 and 200
        assert np.abs(np.diff(approach, order, axis=0)).max() * 1000.0**order <= bound * 1.001
    log = read_log(tmp_path / "log.csv", ColumnMap(joints=plan.joints))
    assert len(log.time) == len(table)
    np.testing.assert_allclose(log.time, table[:, 0], atol=1e-9)
    np.testing.assert_allclose(log.q[1:], table[:-1, 1:8], atol=1e-9)


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler")
def test_the_player_names_a_table_that_is_none(tmp_path: Path) -> None:
    export_motion(
        plan_of(7),
        MOTION_EXPORTERS.make("libfranka", {"player": True}),
        tmp_path / "m.csv",
        playback=Playback(from_posture="start"),
    )
    (tmp_path / "franka").mkdir()
    (tmp_path / "franka" / "robot.h").write_text(ROBOT)
    (tmp_path / "franka" / "exception.h").write_text("#pragma once\n")
    subprocess.run(["g++", "-std=c++17", "-I", ".", "m_player.cpp", "-o", "player"], cwd=tmp_path, check=True)
    lines = (tmp_path / "m.csv").read_text().splitlines()
    for text, message in [
        ("t,q1\n0,1\n", "is no table for seven joints"),
        ("\n".join([*lines[:3], lines[9]]) + "\n", "is not sampled at 1 kHz"),
        ("\n".join([*lines[:3], "0.002,1,2"]) + "\n", "has a row that is cut off"),
        (lines[0] + "\n", "holds no motion"),
    ]:
        (tmp_path / "bad.csv").write_text(text)
        done = subprocess.run(
            ["./player", "commands", "bad.csv", "log.csv"], cwd=tmp_path, input=b"\n", capture_output=True, check=False
        )
        assert done.returncode == 1 and message in done.stderr.decode() and not (tmp_path / "log.csv").exists()
