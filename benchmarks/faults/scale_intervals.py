"""Intervals of the scale of one joint's torque against errors of the model.

    python -m benchmarks.faults.scale_intervals [FIRST LAST]

Random arms of ``benchmarks.faults.clean``, simulated by Pinocchio, whose logs have what no model of the checks has:
link frames off by millimetres and tenths of a degree, friction that falls with the speed, grows with the load and
ripples with the position, cables that pull, and drives that bend. The scale of every torque is right, so each interval
is to hold 1; a torque times 4 is tried as well, whose interval is to hold 0.25.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.faults import injections as put
from benchmarks.faults.clean import case_of, log, robot, written
from benchmarks.faults.trials import Trial, tracked
from benchmarks.strangers.plant import Body, urdf
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.thin_fit import quick_fit
from dynident.diagnosis.causes.torque_scales import SHARP, JointScale, joint_scales

ARMS = 100

#: Standard deviations of a link frame, m and rad.
MOVED, TURNED = 1e-3, 3e-3

#: What no model has as a share of each torque, at most: decimal logarithms between which it is drawn.
LACKS = (-2.3, -1.0)

#: Periods a turn up to which the pull of a cable looks like a spring or a counterbalance.
SLOW = 3

#: What the torque of one joint is multiplied by besides.
FACTOR = 4.0


def off(generator: np.random.Generator, bodies: list[Body], leaning: bool = True) -> list[Body]:
    """Return the bodies as they were built: frames a little off the described ones, the first axis if ``leaning``."""
    built = []
    for body in bodies:
        axis = np.asarray(body.axis) + generator.normal(0, TURNED, 3)
        place = np.asarray(body.place) + generator.normal(0, MOVED, 3)
        built.append(replace(body, axis=axis / np.linalg.norm(axis), place=place))
    return built if leaning else [replace(built[0], axis=bodies[0].axis), *built[1:]]


def with_errors(generator: np.random.Generator, trial: Trial, share: float, named: float = 1.0) -> Trial:
    """Return a log with torques and positions that no model of the checks has, about ``share`` of each torque.

    Springs and waves that look like them, of up to three periods a turn or of no whole period within the range of the
    joint, are ``named`` times as large.
    """
    motion, tau = put.smoothed(trial, 20.0), trial.columns["tau"]
    size, count = tau.std(axis=0), trial.joints
    sign, speed = np.tanh(motion.dq / 0.01), np.abs(motion.dq)

    def some() -> np.ndarray:
        return share * size * generator.uniform(0.0, 1.0, count) * (generator.random(count) < 0.5)

    turns = generator.choice([1, 2, 3, 6, 20, 50], count)
    more = some() * sign * np.exp(-((speed / (0.1 * speed.max(axis=0))) ** 2))
    more += some() * sign * np.abs(tau) / size
    more += some() * sign * np.sin(turns * motion.q + generator.uniform(0, 6, count))
    wave = some() * np.sin(turns * motion.q + generator.uniform(0, 6, count))
    is_slow = (turns <= SLOW) | (turns * np.ptp(motion.q, axis=0) < 2 * np.pi)
    more += wave * np.where(is_slow, named, 1.0)
    more += named * some() * (motion.q - motion.q.mean(axis=0)) / motion.q.std(axis=0)
    bend = share * 0.02 * generator.uniform(0.0, 1.0, count) * motion.q.std(axis=0) * tau / np.abs(tau).max(axis=0)
    return trial.with_columns(tau=tau + more, q=trial.columns["q"] + bend)


def arm(seed: int, folder: Path, named: float = 1.0, leaning: bool = True) -> tuple[Trial, float]:
    """Return the log of the arm of a seed, and the share of each torque that no model has at most.

    Args:
        seed: Of the arm.
        folder: Where its case is written.
        named: As of :func:`with_errors`.
        leaning: Whether the first axis leans against the described one.
    """
    generator = np.random.default_rng([124, seed])
    bodies = robot(generator)
    built = off(generator, bodies, leaning)
    truth, described = urdf("arm", built, seed), urdf("arm", bodies)
    columns, side = log(generator, bodies, truth)
    case, lack = case_of(described, side, folder), float(10 ** generator.uniform(*LACKS))
    return with_errors(generator, Trial(case, columns), lack, named), lack


def fits(seed: int, folder: Path) -> tuple[list[QuickFit | None], float]:
    """Return the quick fits of the arm of a seed, as it is and with a joint's torque times ``FACTOR``, and its lack."""
    (right, lack), found = arm(seed, folder), []
    for trial in (right, put.scaled(right, FACTOR - 1.0, seed % right.joints)):
        written(trial.columns, folder / "run.csv")
        found.append(quick_fit(trial.case, trial.case.read(folder / "run.csv")))
    return found, lack


def told(seed: int, folder: Path) -> Iterator[tuple[JointScale, float]]:
    """Yield the scales that are told on the arm of a seed, with the right factor of each."""
    (right, wrong), lack = fits(seed, folder)
    for fit, factor in ((right, 1.0), (wrong, FACTOR)):
        for joint, scale in enumerate(joint_scales(fit) if fit else ()):
            if not scale.is_open and (factor == 1.0 or joint == seed % len(right.moves if right else ())):
                yield scale, 1.0 / factor
                if not scale.low <= 1.0 / factor <= scale.high:
                    print(f"{seed} (lacks up to {lack:.1%}): {scale.joint}, {scale.low:.3g} to {scale.high:.3g}")


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ARMS)
    with tempfile.TemporaryDirectory() as name:
        found = [each for seed in tracked(range(first, last), "arms") for each in told(seed, Path(name))]
    for right in (1.0, 1.0 / FACTOR):
        scales = [scale for scale, factor in found if factor == right]
        held = sum(scale.low <= right <= scale.high for scale in scales)
        widths = np.array([scale.spread for scale in scales])
        print(
            f"factor {right:g}: {held} of {len(scales)} intervals hold it ({held / max(len(scales), 1):.1%}), "
            f"half-width {np.median(widths):.3f} in the median, {np.mean(widths <= SHARP):.0%} at most {SHARP}"
        )


if __name__ == "__main__":
    main()
