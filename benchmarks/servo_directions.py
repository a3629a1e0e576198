"""Are joints that run the other way named, and only these? Virtual arms of servos, with some joints turned over.

The arms and logs of servos.py: all joints in motion at two gains, or with --single one at a time, with --slow slow
motions. Of each arm some joints are drawn and their axes, commands or positions turned over in the logs. With --bodies
the bodies of the robot model are off by about 30 %. What is named counts as right where it is what was turned over, or
the same of the mirrored arm: turned about a plane, the axes of all joints that lie in it run the other way.
Run: python -m benchmarks.servo_directions [--joints N] [--first K] [--seeds N] [--turned M ...] [--bodies]
[--single | --slow]
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.servo_arms import VirtualArm, arm_logs, drawn_arm, single_logs
from benchmarks.servo_bodies import disturbed
from benchmarks.servos import LAW, RATES, add_slew_limits, add_stiction, slow_logs
from dynident.actuators.direction_search import turned_over
from dynident.actuators.directions import AXIS, POSITION, Turned
from dynident.actuators.servo_log import ServoLog
from dynident.actuators.torque_rows import COMMAND

#: Direction of the axis of each joint of the drawn arms, and those that turn over in a mirror.
_AXES, _MIRRORS = "zyyyxy", ("", "yz", "xz", "xy")

#: Kinds that are drawn: three in five are axes.
_KINDS = (AXIS, AXIS, AXIS, COMMAND, POSITION)


def logs_of(seed: int, joints: int, motion: str, folder: Path) -> tuple[VirtualArm, list[ServoLog]]:
    """Return a drawn arm and its logs: ``all`` joints at once, ``single`` ones, or ``slow``."""
    random, rate = np.random.default_rng([11, joints, seed]), RATES[seed % len(RATES)]
    arm = drawn_arm(random, joints, LAW, folder)
    add_stiction(random, arm.true)
    add_slew_limits(random, arm.true)
    if motion == "single":
        return arm, single_logs(arm, rate, {8.0: random.uniform(-0.8, 0.8, joints)})
    return arm, slow_logs(arm, rate) if motion == "slow" else arm_logs(arm, rate, (8.0, 16.0))


def turned(log: ServoLog, those: Sequence[tuple[str, int]]) -> ServoLog:
    """Return a log with some joints turned over, by kind and joint."""
    q, q_ref = log.q.copy(), log.q_ref.copy()
    for kind, joint in those:
        q[:, joint] *= 1.0 if kind == COMMAND else -1.0
        q_ref[:, joint] *= 1.0 if kind == POSITION else -1.0
    return replace(log, q=q, q_ref=q_ref)


def verdict(found: Sequence[Turned], those: Sequence[tuple[str, int]], joints: int) -> str:
    """Return whether what is named is what was turned over."""
    if not those:
        return "silent" if not found else "named"
    ways = product(*([(one.kind, one.joint), *one.others] for one in found))
    return "right" if any(_is_mirrored(way, those, joints) for way in ways) else "other" if found else "silent"


def _is_mirrored(found: Sequence[tuple[str, int]], those: Sequence[tuple[str, int]], joints: int) -> bool:
    """Return whether two sets of joints turn over the same drives, and the same axes up to those of a mirror."""

    def of(kinds: tuple[str, str], way: Sequence[tuple[str, int]]) -> list[bool]:
        return [any(kind in kinds and own == joint for kind, own in way) for joint in range(joints)]

    drives, axes = (COMMAND, POSITION), (AXIS, POSITION)
    differ = [one != other for one, other in zip(of(axes, found), of(axes, those), strict=True)]
    mirrors = [[axis in mirror for axis in _AXES[:joints]] for mirror in _MIRRORS]
    return of(drives, found) == of(drives, those) and differ in mirrors


def main() -> None:
    """Print what is named of each arm where it is not what was turned over, and the counts."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--joints", type=int, default=3, choices=(3, 6))
    options.add_argument("--first", type=int, default=200)
    options.add_argument("--seeds", type=int, default=20)
    options.add_argument("--turned", type=int, nargs="+", default=(0, 1, 2, 3))
    options.add_argument("--bodies", action="store_true")
    options.add_argument("--single", dest="motion", action="store_const", const="single", default="all")
    options.add_argument("--slow", dest="motion", action="store_const", const="slow")
    chosen = options.parse_args()
    n, counts = chosen.joints, Counter[tuple[int, str]]()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(chosen.first, chosen.first + chosen.seeds):
            arm, logs = logs_of(seed, n, chosen.motion, Path(folder))
            robot = disturbed(arm.robot, np.random.default_rng(seed)) if chosen.bodies else arm.robot
            random = np.random.default_rng([5, seed, n])
            for many in chosen.turned:
                places = sorted(random.choice(n, many, replace=False).tolist())
                those = [(str(random.choice(_KINDS)), joint) for joint in places]
                found = turned_over(robot, [turned(log, those) for log in logs])
                word = verdict(found, those, n)
                counts[many, word] += 1
                if word != ("right" if those else "silent"):
                    print(seed, those, [(one.kind, one.joint, one.is_zero, one.others) for one in found], flush=True)
    for (many, word), count in sorted(counts.items()):
        print(f"{many} turned over: {word} {count}")


if __name__ == "__main__":
    main()
