"""FIGAROH's own search for an excitation of the UR10: a spline through waypoints, IPOPT, forward differences.

Its settings for this arm: 7 waypoints 2 s apart, 20 Hz, 5 % of each range kept free, 100 iterations; friction counted,
limits to position, speed and torque, no collision. It runs in a process of its own, which prints one line of JSON for
each iteration and is stopped after a number of seconds of the processor. Run: python -m benchmarks.speed.figaroh_search
SEED SECONDS
"""

from __future__ import annotations

import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.speed.arms import ur10
from benchmarks.speed.designs import POSITION, VELOCITY
from dynident.arrays import Array

SETTINGS = {
    "trajectory": {"waypoints": 7, "frequency": 20, "segment_duration": 2.0},
    "problem": {"soft_lim": 0.05, "max_iterations": 100, "max_attempts": 1000},
}
FEASIBLE = 1e-3  # largest violation of a bound, as IPOPT states it
EFFORT = (330.0, 330.0, 150.0, 56.0, 56.0, 56.0)  # N m, as the maker publishes them


def search(seed: int, goal: float, cap: float) -> dict[str, Any]:
    """Return what FIGAROH reaches within a number of seconds of the processor: best, last, and when the goal was."""
    words = [sys.executable, "-m", "benchmarks.speed.figaroh_search", str(seed), str(cap)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    if not lines:
        return {"seed": seed, "fault": (done.stderr.strip().splitlines() or ["no line"])[-1]}
    kept = [line for line in lines if line["violation"] <= FEASIBLE]
    return {
        "seed": seed,
        "iterations": len(lines),
        "processor_s": lines[-1]["processor"],
        "stopped": done.returncode != 0,
        "best": min((line["condition"] for line in kept), default=None),
        "last": lines[-1]["condition"],
        "reached_s": min((line["processor"] for line in kept if line["condition"] <= goal), default=None),
    }


def main() -> None:
    seed, cap = int(sys.argv[1]), float(sys.argv[2])
    from figaroh.optimal.base_optimal_trajectory import BaseOptimalTrajectory, BaseTrajectoryIPOPTProblem
    from figaroh.optimal.config import create_config
    from figaroh.tools.robot import Robot

    np.random.seed(seed)  # noqa: NPY002 - the generator that FIGAROH draws from
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "ur10.urdf"
        place.write_text(urdf())
        robot = Robot(str(place), folder)
    began = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(began + cap), math.ceil(began + cap) + 5))

    class Problem(BaseTrajectoryIPOPTProblem):
        def intermediate(self, mode: int, count: int, objective: float, violation: float, *rest: Any) -> Any:
            spent = time.process_time() - began
            line = {"processor": spent, "condition": float(objective), "violation": float(violation)}
            print(json.dumps(line), flush=True)
            return super().intermediate(mode, count, objective, violation, *rest)

    class Search(BaseOptimalTrajectory):
        def __init__(self) -> None:
            self.robot, self.model = robot, robot.model
            self.active_joints = [f"joint{i}" for i in range(1, 7)]
            self.logger = __import__("logging").getLogger("figaroh")
            self.trajectory_config = create_config(SETTINGS)
            joints = list(range(6))
            self.identif_config = {
                "has_friction": True,
                "act_idxv": joints,
                "act_idxq": joints,
                "is_joint_torques": True,
            }
            names = ("T_F", "P_F", "V_F", "A_F", "iteration_data")
            self.results = {**{name: [] for name in names}, "final_regressor_shape": None}

        def create_ipopt_problem(self, *arguments: Any) -> Problem:
            return Problem(self, *arguments)

    found = Search()
    found.initialize()
    found.solve(stack_reps=1)


def urdf() -> str:
    """Return the arm of the rows as URDF, with its limits."""

    def words(values: Any) -> str:
        return " ".join(repr(float(value)) for value in values)

    robot, parts = ur10(), ['<link name="base"/>']
    for k, (link, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        own, parent = link.inertia, "base" if k == 0 else robot.links[k - 1].name
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        places = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
        inertia = " ".join(f'{n}="{float(own.about_centre[p])!r}"' for n, p in zip(names, places, strict=True))
        parts.append(
            f'<link name="{link.name}"><inertial><origin xyz="{words(own.centre_of_mass)}"/>'
            f'<mass value="{own.mass!r}"/><inertia {inertia}/></inertial></link>'
            f'<joint name="{joint.name}" type="revolute"><origin xyz="{words(joint.translation)}" '
            f'rpy="{words(angles(np.asarray(joint.rotation)))}"/><parent link="{parent}"/><child link="{link.name}"/>'
            f'<axis xyz="{words(joint.axis)}"/><limit lower="{-POSITION}" upper="{POSITION}" '
            f'velocity="{VELOCITY[k]}" effort="{EFFORT[k]}"/></joint>'
        )
    return f'<robot name="ur10">{"".join(parts)}</robot>'


def angles(turn: Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a rotation away from pitch of a right angle."""
    pitch = math.asin(-turn[2, 0])
    return math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])


if __name__ == "__main__":
    main()
