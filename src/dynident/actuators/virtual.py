"""Logs of a virtual servo whose parameters are known: what an answer is held against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.actuators.drive_law import DriveLaw
from dynident.actuators.joint_load import loop_samples, measured_loads
from dynident.actuators.rollout import NONE
from dynident.actuators.rollout_loop import roll_out
from dynident.actuators.servo_log import ServoLog
from dynident.arrays import Array, BoolArray
from dynident.errors import BadOption
from dynident.model.robot import Robot

#: Step of the integration in s: a tenth of that of the identification, so that its own error is part of the test.
STEP = 1e-4


@dataclass(frozen=True)
class ServoBench:
    """How a virtual servo is logged.

    Attributes:
        robot: With one joint.
        law: Drive law.
        resolution: Step of the measured positions in rad.
        noise: Standard deviation of the measured positions before rounding, in rad.
        jitter_s: Standard deviation of the time between two samples.
        failed: Share of the reads that fail (they are nan).
    """

    robot: Robot
    law: DriveLaw
    resolution: float = 2.0 * np.pi / 4096
    noise: float = 0.0
    jitter_s: float = 0.0
    failed: float = 0.0


def virtual_log(
    bench: ServoBench,
    parameters: Array,
    time: Array,
    command: Array,
    kp: float,
    enabled: BoolArray | None = None,
    seed: int = 0,
) -> ServoLog:
    """Return the log of a virtual servo.

    Args:
        bench: Robot, drive law and sensors.
        parameters: True parameters in the order of PARAMETERS, shape (COUNT,).
        time: Times of the samples, shape (N,), in s.
        command: Commanded positions, shape (N,), in rad.
        kp: Position gain in the drive's unit.
        enabled: Whether the drive is on, shape (N,); None for always.
        seed: Of noise, jitter and failed reads.

    Raises:
        BadOption: The robot has more than one joint.
    """
    if bench.robot.dof != 1:
        raise BadOption("robot", bench.robot.name, f"a virtual servo has one joint, and it has {bench.robot.dof}")
    random = np.random.default_rng(seed)
    count = len(time)
    moved = time + bench.jitter_s * random.uniform(-1.0, 1.0, count)
    column = command[:, None]
    on = np.ones((count, 1), dtype=bool) if enabled is None else np.asarray(enabled, dtype=bool)[:, None]
    log = ServoLog(
        name=f"virtual kp{kp:g} seed {seed}",
        joints=bench.robot.joint_names,
        time=moved,
        q=column,
        q_ref=column,
        dq_ref=np.zeros((count, 1)),
        added=np.zeros((count, 1)),
        enabled=on,
        supply=np.ones(count),
        failed=np.zeros((count, 1), dtype=bool),
        kp=kp,
    )
    (load,) = measured_loads(bench.robot, log)
    out = np.empty((count, 3))
    start = np.array([command[0], 0.0])
    samples = loop_samples(log, 0)
    roll_out(parameters, samples, load.rows, bench.law.numbers(kp), start, STEP, NONE, out)
    seen = out[:, 0] + bench.noise * random.standard_normal(count)
    if bench.resolution > 0:
        seen = np.round(seen / bench.resolution) * bench.resolution
    failed = random.random(count) < bench.failed
    failed[0] = False
    bridged = np.interp(time, time[~failed], seen[~failed])
    return ServoLog(**{**vars(log), "q": bridged[:, None], "failed": failed[:, None]})
