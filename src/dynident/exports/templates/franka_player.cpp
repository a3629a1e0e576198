// Drives a table t, q1..q7, dq1..dq7, ddq1..ddq7 of 1 kHz with libfranka and records t, q, dq, tau.
// Written by dynident; checked against stand-ins of the libfranka headers only, never run on a robot.
// Build with C++17 and libfranka, run: player ROBOT-ADDRESS TABLE.csv LOG.csv
// The arm first goes slowly, in joint space, from where it is to the first row: look at that way before.
// The approach is not checked for obstacles, the motion as far as its plan says. Keep a hand on the stop.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <exception>
#include <fstream>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <franka/exception.h>
#include <franka/robot.h>

namespace {

using Joints = std::array<double, 7>;

// A tenth of the plan's limits of speed, acceleration and jerk, in rad/s, rad/s^2 and rad/s^3.
constexpr Joints kSpeed{{@SPEED@}};
constexpr Joints kAcceleration{{@ACCELERATION@}};
constexpr Joints kJerk{{@JERK@}};

// Largest distance in rad between the commanded posture and the first row after the approach.
constexpr double kSame = 1e-4;

std::vector<Joints> readTable(const std::string& name) {
  std::ifstream file(name);
  std::string line;
  if (!file || !std::getline(file, line) || line.rfind("t,q1,q2,q3,q4,q5,q6,q7,", 0) != 0) {
    throw std::runtime_error(name + " is no table for seven joints");
  }
  std::vector<Joints> rows;
  while (std::getline(file, line)) {
    std::istringstream cells(line);
    std::string cell;
    Joints q{};
    std::getline(cells, cell, ',');
    if (std::abs(std::stod(cell) - 0.001 * static_cast<double>(rows.size())) > 1e-6) {
      throw std::runtime_error(name + " is not sampled at 1 kHz");
    }
    for (double& value : q) {
      if (!std::getline(cells, cell, ',')) {
        throw std::runtime_error(name + " has a row that is cut off");
      }
      value = std::stod(cell);
    }
    rows.push_back(q);
  }
  if (rows.size() < 2) {
    throw std::runtime_error(name + " holds no motion");
  }
  return rows;
}

// Peaks of the quintic from rest to rest over the distance d in the time T: 15/8 d/T, 10/sqrt(3) d/T^2, 60 d/T^3.
double approachTime(const Joints& from, const Joints& to) {
  double length = 2.0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const double distance = std::abs(to[i] - from[i]);
    length = std::max(length, 1.875 * distance / kSpeed[i]);
    length = std::max(length, std::sqrt(10.0 / std::sqrt(3.0) * distance / kAcceleration[i]));
    length = std::max(length, std::cbrt(60.0 * distance / kJerk[i]));
  }
  return length;
}

void approach(franka::Robot& robot, const Joints& to) {
  Joints from{};
  double length = 0.0;
  double time = 0.0;
  bool begun = false;
  auto command = [&](const franka::RobotState& state, franka::Duration period) -> franka::JointPositions {
    if (!begun) {
      from = state.q_d;
      length = approachTime(from, to);
      begun = true;
    } else {
      time += period.toSec();
    }
    const double s = std::min(time / length, 1.0);
    const double share = s * s * s * (10.0 + s * (-15.0 + 6.0 * s));
    Joints q{};
    for (std::size_t i = 0; i < q.size(); ++i) {
      q[i] = from[i] + share * (to[i] - from[i]);
    }
    franka::JointPositions found(q);
    return s < 1.0 ? found : franka::MotionFinished(found);
  };
  robot.control(command, franka::ControllerMode::kJointImpedance, false, 1000.0);
}

std::vector<std::array<double, 22>> drive(franka::Robot& robot, const std::vector<Joints>& rows) {
  std::vector<std::array<double, 22>> log;
  log.reserve(rows.size() + 1000);
  Joints shift{};
  std::size_t k = 0;
  bool begun = false;
  auto command = [&](const franka::RobotState& state, franka::Duration period) -> franka::JointPositions {
    if (!begun) {
      for (std::size_t i = 0; i < shift.size(); ++i) {
        shift[i] = state.q_d[i] - rows[0][i];
        if (!(std::abs(shift[i]) < kSame)) {
          throw std::runtime_error("the robot is not commanded to be at the first row");
        }
      }
      begun = true;
    } else {
      k = std::min(k + static_cast<std::size_t>(period.toMSec()), rows.size() - 1);
    }
    std::array<double, 22> now{};
    now[0] = state.time.toSec();
    std::copy(state.q.begin(), state.q.end(), now.begin() + 1);
    std::copy(state.dq.begin(), state.dq.end(), now.begin() + 8);
    std::copy(state.tau_J.begin(), state.tau_J.end(), now.begin() + 15);
    if (log.size() < log.capacity()) {
      log.push_back(now);
    }
    Joints q{};
    for (std::size_t i = 0; i < q.size(); ++i) {
      q[i] = rows[k][i] + shift[i];
    }
    franka::JointPositions found(q);
    return k + 1 < rows.size() ? found : franka::MotionFinished(found);
  };
  robot.control(command, franka::ControllerMode::kJointImpedance, false, 1000.0);
  return log;
}

void writeLog(const std::string& name, const std::vector<std::array<double, 22>>& log) {
  std::ofstream file(name);
  file.precision(12);
  file << "t";
  for (const char* signal : {"q", "dq", "tau"}) {
    for (int i = 1; i <= 7; ++i) {
      file << ',' << signal << i;
    }
  }
  file << '\n';
  for (const auto& row : log) {
    file << row[0] - log.front()[0];
    for (std::size_t i = 1; i < row.size(); ++i) {
      file << ',' << row[i];
    }
    file << '\n';
  }
  if (!file.flush()) {
    throw std::runtime_error(name + " cannot be written");
  }
}

}  // namespace

int main(int count, char** words) {
  if (count != 4) {
    std::cerr << "usage: " << words[0] << " ROBOT-ADDRESS TABLE.csv LOG.csv\n";
    return 2;
  }
  try {
    const std::vector<Joints> rows = readTable(words[2]);
    franka::Robot robot(words[1]);
    std::cout << "The arm will move. Press Enter with a hand on the stop.\n";
    std::cin.ignore();
    approach(robot, rows.front());
    writeLog(words[3], drive(robot, rows));
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << '\n';
    return 1;
  }
  return 0;
}
