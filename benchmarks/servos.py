"""Are servos found with intervals that hold? Virtual arms whose servos are known, seed by seed.

One joint: each seed draws a pendulum (0.2 to 1.5 kg, 0.08 to 0.25 m), a servo for it (torque at full duty 2.5 to 6
times the weight's torque, back-EMF, armature, friction, delay 2 to 20 ms, one in three with a slew limit) and logs of
6 s at 200 Hz, 4096 counts a turn: chirp, steps, lift and free swing at two position gains. The drive law is that of
the STS3215. A second answer, of arms too, gets slow motions without saturation and no gain: the torque at full duty
has to be called not separable. Three or six joints: arms of desk size, all joints in motion at once, at 30, 50, 100 or
200 Hz, an integrator of their own (servo_arms.py), one drive in three with a slew limit. One seed in four has stiction
(Stribeck), and friction m2 is stated; m1 for the others. One line a seed is added to the file, and seeds that it holds
are not run again. With --minutes the arms have logs of that length in all, at position gains from 6 to 20, without
stiction and slew limits: how long does the answer take? With --bodies the bodies of the robot model are off by about
30 % and free; with --payload logs of a known payload are added. With --single one joint of an arm moves at a time, the
others hold a pose, another one at each gain. With --load friction grows with the load, without stiction, and m3 is
stated; with --on no drive is ever off.
Run: python -m benchmarks.servos FILE [--joints N] [--seeds N] [--first K] [--minutes M] [--bodies] [--payload]
[--single] [--load] [--on]
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil
from pathlib import Path

import numpy as np

from benchmarks.servo_arms import VirtualArm, arm_log, arm_logs, drawn_arm, single_logs
from benchmarks.servo_bodies import disturbed, held, lines_of
from dynident.actuators.drive_law import preset
from dynident.actuators.estimate import JointActuator
from dynident.actuators.identify import identify_actuators
from dynident.actuators.joint_load import with_payload
from dynident.actuators.parameters import PLACE, neutral
from dynident.actuators.servo_log import ServoColumns, ServoLog, ServoSetup
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.arrays import Array
from dynident.model.robot import Robot
from dynident.model.threads import one_blas_thread
from dynident.robot_files import read_robot
from dynident.simulation.effects import Payload

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -{length}"/>
<mass value="{mass}"/><inertia ixx="{own}" ixy="0" ixz="0" iyy="{own}" iyz="0" izz="{own}"/></inertial></link>
<joint name="joint1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3.2" upper="3.2" effort="50" velocity="30"/></joint></robot>"""

LAW = preset("feetech_sts3215")
RATE, SECONDS = 200.0, 6.0

#: Payload of the logs that have one, on the last link.
PAYLOAD = Payload(0.1, (0.0, 0.03, -0.08))

#: Parameters whose intervals and relative errors are counted.
COUNTED = (
    "full_torque",
    "back_emf",
    "viscous",
    "coulomb",
    "coulomb_stribeck",
    "stribeck_velocity",
    "load_motor",
    "armature",
    "angle_offset",
    "delay",
    "slew_limit",
)

#: What is asked of gains, friction and armature where they are identifiable, as a share, and of the delay in s.
ASKED, ASKED_DELAY = 0.03, 1e-3

#: Rates in Hz of the logs of arms, by seed.
RATES = (30.0, 50.0, 100.0, 200.0)


def drawn(random, folder: Path):
    """Return a pendulum and the true parameters of its servo."""
    mass, length = float(random.uniform(0.2, 1.5)), float(random.uniform(0.08, 0.25))
    (folder / "p.urdf").write_text(PENDULUM.format(length=length, mass=mass, own=0.1 * mass * length**2))
    weight, inertia = 9.81 * mass * length, 1.1 * mass * length**2
    true = neutral()
    fastest = random.uniform(4.0, 8.0)  # rad/s without load
    torque = weight * random.uniform(2.5, 6.0)
    values = {
        "full_torque": torque,
        "back_emf": 0.8 * torque / fastest,
        "viscous": 0.2 * torque / fastest,
        "coulomb": weight * random.uniform(0.02, 0.12),
        "armature": inertia * random.uniform(0.1, 1.0),
        "angle_offset": random.uniform(-0.03, 0.03),
        "delay": random.uniform(0.002, 0.020),
    }
    if random.random() < 1 / 3:
        values["slew_limit"] = random.uniform(2.0, 3.5)
    for name, value in values.items():
        true[PLACE[name]] = value
    add_stiction(random, true[None])
    return read_robot(str(folder / "p.urdf")), true


def add_stiction(random: np.random.Generator, true: Array) -> None:
    """Give the drives of one seed in four friction that falls with the speed, in place; shape (n, COUNT)."""
    if random.random() < 0.25:
        true[:, PLACE["coulomb_stribeck"]] = true[:, PLACE["coulomb"]] * random.uniform(0.3, 0.8, len(true))
        true[:, PLACE["stribeck_velocity"]] = random.uniform(0.1, 0.4, len(true))


def add_load(random: np.random.Generator, true: Array) -> None:
    """Give drives friction that grows with the load and no stiction, in place; shape (n, COUNT)."""
    true[:, PLACE["coulomb_stribeck"]] = 0.0
    true[:, [PLACE["load_motor"], PLACE["load_external"]]] = random.uniform(0.05, 0.2, len(true))[:, None]


def add_slew_limits(random: np.random.Generator, true: Array) -> None:
    """Give one drive in three of an arm a slew limit, in place; shape (n, COUNT)."""
    limited = random.random(len(true)) < 1 / 3
    true[limited, PLACE["slew_limit"]] = random.uniform(2.0, 3.5, int(limited.sum()))


def logs_of(robot, true, seed: int, gains, motions):
    """Return the logs of some motions at some gains."""
    time_ = np.arange(0.0, SECONDS, 1.0 / RATE)
    on = np.ones(len(time_), dtype=bool)
    commands = {
        "chirp": (0.9 * np.sin(2 * np.pi * (0.3 + 0.12 * time_) * time_), on),
        "slow": (0.4 * np.sin(2 * np.pi * (0.2 + 0.04 * time_) * time_), on),
        "steps": (1.1 * np.sign(np.sin(2 * np.pi * 0.4 * time_)) * np.minimum(time_ / 0.5, 1.0), on),
        "drop": (np.clip(time_, 0.0, 1.5), time_ < 2.0),
    }
    bench = ServoBench(robot, LAW, jitter_s=5e-4)
    return [
        virtual_log(bench, true, time_, commands[name][0], kp, commands[name][1], seed=100 * seed + 10 * i + j)
        for i, kp in enumerate(gains)
        for j, name in enumerate(motions)
    ]


def gains_of(minutes: float) -> tuple[float, ...]:
    """Return the position gains at which an arm is logged, three logs each."""
    return tuple(np.linspace(6.0, 20.0, ceil(20.0 * minutes / SECONDS))) if minutes else (8.0, 16.0)


def one(
    seed: int,
    joints: int,
    folder: Path,
    minutes: float = 0.0,
    bodies: str = "",
    is_single: bool = False,
    is_loaded: bool = False,
    is_on: bool = False,
) -> dict[str, object]:
    """Return what one seed gives, as plain data; bodies: ``plausible``, or ``payload`` with logs of one too.

    The other options are those of the module.
    """
    random = np.random.default_rng([7, seed] if joints == 1 else [11, joints, seed])
    rate = RATE
    if joints == 1:
        robot, true = drawn(random, folder)
        if is_loaded:
            add_load(random, true[None])
        logs = logs_of(robot, true, seed, (3.0, 6.0), ("chirp", "steps", "slow" if is_on else "drop"))
        if bodies == "payload":
            logs += [
                replace(log, name=f"{log.name} load", payload=PAYLOAD)
                for log in logs_of(with_payload(robot, PAYLOAD), true, seed + 1, (6.0,), ("chirp", "steps", "drop"))
            ]
        quiet, true = logs_of(robot, true, seed, (1.5,), ("slow",)), true[None]
    else:
        arm = drawn_arm(random, joints, LAW, folder)
        if not minutes:
            add_stiction(random, arm.true)
            add_slew_limits(random, arm.true)
        if is_loaded:
            add_load(random, arm.true)
        robot, true, rate = arm.robot, arm.true, RATES[seed % len(RATES)]
        quiet = slow_logs(arm, rate)
        if is_single:
            poses = {kp: random.uniform(-0.8, 0.8, joints) for kp in gains_of(minutes)}
            logs = single_logs(arm, rate, poses)
        else:
            logs = arm_logs(arm, rate, gains_of(minutes), is_on=is_on)
        if bodies == "payload":
            loaded = replace(arm, robot=with_payload(robot, PAYLOAD))
            more = arm_logs(loaded, rate, (12.0,))
            logs += [replace(log, name=f"{log.name} load", payload=PAYLOAD) for log in more]
    friction = "m3" if is_loaded else "m2" if true[0, PLACE["coulomb_stribeck"]] > 0 else "m1"
    setup, begun = ServoSetup((LAW,) * joints, ServoColumns(robot.joint_names), friction), time.process_time()
    given = robot
    if bodies:
        given, setup = disturbed(robot, np.random.default_rng([13, joints, seed])), replace(setup, bodies="plausible")
    answer = identify_actuators(given, setup, logs)
    line = {
        "seed": seed,
        "rate": rate,
        "friction": friction,
        "seconds": time.process_time() - begun,
        "joints": [_of_joint(joint, own) for joint, own in zip(answer.joints, true, strict=True)],
    }
    if bodies:
        line["bodies"] = held(answer, robot, true)
    elif not minutes and not is_loaded:
        line["gain_unknown"] = gain_labels(robot, quiet)
    return line


def slow_logs(arm: VirtualArm, rate: float) -> list[ServoLog]:
    """Return logs of 6 s of slow motions of all joints, two sizes, whose duty stays below two thirds of its limit."""
    time = np.arange(0.0, SECONDS, 1.0 / rate)
    beats = 0.2 + 0.1 * np.linspace(0.0, 1.0, arm.robot.dof) + 0.04 * time[:, None]
    command, on = 0.4 * np.sin(2 * np.pi * beats * time[:, None]), np.ones(len(time), dtype=bool)
    return [replace(arm_log(arm, time, size * command, 4.0, on), name=f"slow {size}") for size in (1.0, 0.6)]


def gain_labels(robot: Robot, logs: Sequence[ServoLog]) -> list[str]:
    """Return how far the torque at full duty of each joint is called known where nothing is known of gain and law."""
    setup = ServoSetup((preset("position_servo"),) * robot.dof, ServoColumns(robot.joint_names), "m1")
    joints = identify_actuators(robot, setup, [replace(log, kp=float("nan")) for log in logs]).joints
    return [next(k.label for k in joint.known if k.name == "full_torque") for joint in joints]


def _of_joint(joint: JointActuator, true: Array) -> dict[str, dict[str, object]]:
    """Return truth, value, half width and label of each parameter of a joint that is counted."""
    known, found = {k.name: k for k in joint.known}, {}
    for name in COUNTED:
        value, truth = joint.value(name), float(true[PLACE[name]])
        if name not in known and name != "slew_limit":
            continue
        if name == "viscous" and "back_emf" not in known:  # damping as a whole
            truth += float(true[PLACE["back_emf"]])
        if not np.isfinite(truth) and not np.isfinite(value):
            continue
        half = known[name].half_width if name in known else float("nan")
        label = known[name].label if name in known else "left out"
        if name == "viscous" and known[name].together == "back_emf":
            label = "identified"
        found[name] = {
            "true": truth if np.isfinite(truth) else None,
            "value": value if np.isfinite(value) else None,
            "half": half if np.isfinite(half) else None,
            "label": label,
        }
    return found


def summary(lines: list[Mapping]) -> list[str]:
    """Return the figures over seeds as lines of text."""
    found = [f"{len(lines)} seeds, {np.median([line['seconds'] for line in lines]):.1f} s of the processor a seed"]
    found.append(
        "parameter         identified  holds the truth  relative error: median, 95 %    largest (labels aside)"
    )
    held, counted = 0.0, 0
    for name in COUNTED:
        rows = [joint[name] for line in lines for joint in line["joints"] if name in joint]
        both = [row for row in rows if row["true"] is not None and row["value"] is not None]
        sure = [row for row in both if row["half"] is not None]
        if not sure:
            continue
        holds = np.mean([abs(row["value"] - row["true"]) <= row["half"] for row in sure])
        held, counted = held + holds * len(sure), counted + len(sure)
        named = [row for row in both if row["label"] == "identified"] or sure
        scale = 1e3 if name in ("delay", "angle_offset") else 100.0
        unit = {"delay": "ms", "angle_offset": "mrad"}.get(name, "%")
        size = [1.0 if unit != "%" else row["true"] for row in named]
        errors = scale * np.abs([(row["value"] - row["true"]) / own for row, own in zip(named, size, strict=True)])
        share = sum(row["label"] == "identified" for row in both)
        middle, most = np.quantile(errors, [0.5, 0.95])
        text = f"{share:4d} of {len(both):3d} {100 * holds:8.1f} % of {len(sure):3d}"
        found.append(f"{name:18s}{text}   {middle:8.3g} {most:8.3g} {unit:5s} {errors.max():8.3g}")
        odd = len(rows) - len(both)
        if odd:
            found.append(f"{name:18s}{odd} times found where there is none, or missed")
    found.append(f"all intervals: {100 * held / max(counted, 1):.1f} % of {counted} hold the truth")
    found += [*within_asked(lines), *lines_of(lines)]
    told = [line["gain_unknown"] for line in lines if "gain_unknown" in line]
    labels = [label for own in told for label in ([own] if isinstance(own, str) else own)]
    if labels:
        right = labels.count("not separable")
        found.append(f"unknown gain without saturation called not separable: {right} of {len(labels)}")
    return found


def within_asked(lines: Sequence[Mapping]) -> list[str]:
    """Return how many values are as near to the truth as asked where their own intervals say so, as lines of text."""
    found = []
    for name in COUNTED:
        if name == "angle_offset":
            continue
        rows = [joint[name] for line in lines for joint in line["joints"] if name in joint]
        rows = [row for row in rows if row["half"] is not None and row["true"] is not None]
        most = [ASKED_DELAY if name == "delay" else ASKED * row["true"] for row in rows]
        near = [abs(row["value"] - row["true"]) <= own for row, own in zip(rows, most, strict=True)]
        told = [ok for ok, row, own in zip(near, rows, most, strict=True) if row["half"] <= own]
        if told:
            asked = "1 ms" if name == "delay" else "3 %"
            found.append(f"{name:18s}within {asked}: {sum(told)} of {len(told)} whose half width is below")
    return found


@one_blas_thread()
def main() -> None:
    """Run the seeds that the file lacks and print the summary."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("file", type=Path)
    options.add_argument("--joints", type=int, default=1, choices=(1, 3, 6))
    options.add_argument("--seeds", type=int, default=200)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--minutes", type=float, default=0.0)
    options.add_argument("--bodies", action="store_const", const="plausible", default="")
    options.add_argument("--payload", dest="bodies", action="store_const", const="payload")
    for flag in ("--single", "--load", "--on"):
        options.add_argument(flag, action="store_true")
    chosen = options.parse_args()
    file: Path = chosen.file
    lines = [json.loads(text) for text in file.read_text().splitlines()] if file.exists() else []
    done = {line["seed"] for line in lines}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(chosen.first, chosen.first + chosen.seeds):
            if seed not in done:
                flags = chosen.single, chosen.load, chosen.on
                lines.append(one(seed, chosen.joints, Path(folder), chosen.minutes, chosen.bodies, *flags))
                with file.open("a") as sink:
                    sink.write(json.dumps(lines[-1]) + "\n")
    print("\n".join(summary(lines)))


if __name__ == "__main__":
    main()
