"""Intervals of what the log checks state of a cause, against errors of the model.

    python -m benchmarks.faults.cause_intervals [FIRST LAST]

The random arms of ``benchmarks.faults.scale_intervals`` have a clock that runs fast, a base that leans, a spring, a
counterbalance, a drift, or a torque that lags behind. Counted are the causes that are named, and their stated 95 %
intervals that hold the figure. What is such a cause itself is no error of the model: first axes do not lean, and arms
with a spring or a counterbalance have neither springs nor waves of up to three periods a turn.
"""

from __future__ import annotations

import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.faults import injections as put
from benchmarks.faults.figures import Stated, stated
from benchmarks.faults.scale_intervals import arm
from benchmarks.faults.trials import Trial, subject_of, tracked
from dynident.diagnosis.checks.residual_trends import ResidualTrends
from dynident.diagnosis.checks.torque_delay import TorqueDelay

ARMS = 60

#: Strengths of a fault, a share of a torque: decimal logarithms between which it is drawn.
STRENGTHS = (-1.5, -0.3)

Fault = Callable[[Trial, float, np.random.Generator], tuple[Trial, complex | np.ndarray]]

#: Faults of the joint with the largest torque.
OF_ONE_JOINT = ("spring", "counterbalance", "drift")


def _sprung(trial: Trial, share: float, generator: np.random.Generator) -> tuple[Trial, complex]:
    joint = put.heaviest(trial)
    return put.sprung(trial, share, joint), share * put.spreads(trial, "tau")[joint] / put.spreads(trial, "q")[joint]


#: What is done to a log of a strength, and the figure that the finding of this name is to state.
FAULTS: Mapping[str, Fault] = {
    "time scale": lambda c, s, g: (put.timed(c, 1 + s / 4), 1 + s / 4),
    "tilt": lambda c, s, g: (put.tilted(c, 4 * s, g), np.asarray(c.case.robot.gravity)),
    "spring": _sprung,
    "counterbalance": lambda c, s, g: (put.balanced(c, s, g), s * put.spreads(c, "tau").max()),
    "drift": lambda c, s, g: (put.drifting(c, s, g), s * put.spreads(c, "tau").max()),
    "torque delay": lambda c, s, g: (put.delayed(c, 6 * s), 6 * s * put.step_of(c)),
}


def told(seed: int, folder: Path) -> Iterator[tuple[str, complex | np.ndarray, Stated | None]]:
    """Yield each fault of the arm of a seed, its figure, and what the checks state; None where they do not name it."""
    generator = np.random.default_rng([240, seed])
    for name, fault in FAULTS.items():
        right, lack = arm(seed, folder, 0.0 if name in ("spring", "counterbalance") else 1.0, leaning=False)
        share = float(10 ** generator.uniform(*STRENGTHS))
        faulty, wanted = fault(right, share, generator)
        subject = subject_of(faulty, folder)
        check = TorqueDelay() if name == "torque delay" else ResidualTrends()
        joint = right.case.robot.joint_names[put.heaviest(right)] if name in OF_ONE_JOINT else ""
        named = [one for one in check.findings(subject) if (one.name, one.joint, one.beside) == (name, joint, "")]
        figure = stated(named[0], faulty) if named else None
        if figure is not None and name == "counterbalance":  # the interval is that of its size
            figure = replace(figure, value=abs(figure.value))
        yield name, wanted, figure
        if figure is not None and _away(figure, wanted) > figure.half:
            print(f"{seed} (lacks up to {lack:.1%}): {name} {figure.value} +- {figure.half:.2g}, is {wanted}")


def _away(one: Stated, wanted: complex | np.ndarray) -> float:
    return float(np.linalg.norm(np.atleast_1d(one.value - wanted)))


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ARMS)
    errors, widths = defaultdict[str, list[float]](list), defaultdict[str, list[float]](list)
    with tempfile.TemporaryDirectory() as folder:
        for seed in tracked(range(first, last), "arms"):
            for name, wanted, one in told(seed, Path(folder)):
                if one is not None:
                    errors[name].append(_away(one, wanted) / max(one.half, 1e-300))
                    widths[name].append(one.half / float(np.linalg.norm(np.atleast_1d(wanted - one.nothing))))
    for name, own in errors.items():
        held, quantile = int(np.sum(np.array(own) <= 1.0)), float(np.quantile(own, 0.95))
        print(
            f"{name}: {len(own)} of {last - first} named, {held} of their intervals hold the figure "
            f"({held / len(own):.0%}; error over half-width {quantile:.2g} at 95 %), "
            f"half-width {np.median(widths[name]):.2g} of it in the median"
        )


if __name__ == "__main__":
    main()
