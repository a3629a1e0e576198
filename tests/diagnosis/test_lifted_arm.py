"""Log checks of an arm that a vertical slide lifts, whose friction grows with the load; torques by Pinocchio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import Trial, subject_of
from benchmarks.strangers.plant import waves
from sliding_arms import torques, trial_of, with_slide

RATE, SECONDS, NOISE, LOAD = 100.0, 20.0, 0.004, 0.05

#: Name, place, axis, mass and length of the links; the first one slides.
LINKS = (
    ("lift", (0.0, 0.0, 0.0), (0, 0, 1), 9.0, 0.3),
    ("turn", (0.1, 0.0, 0.2), (0, 0, 1), 6.0, 0.3),
    ("shoulder", (0.0, 0.1, 0.3), (0, 1, 0), 5.0, 0.4),
    ("elbow", (0.0, 0.0, 0.4), (0, 1, 0), 3.0, 0.3),
)


def recorded(folder: Path, stiffness: float = 0.0, counterweight: float = 0.0) -> Trial:
    """Return a log, with a spring at the elbow in N m/rad and a constant force at the lift in N."""
    generator, bodies = np.random.default_rng(4), with_slide(LINKS, "lift", (-0.4, 0.4), 0.6)
    t = np.arange(int(RATE * SECONDS)) / RATE
    q, dq, ddq = waves(bodies, 0.1, 5, 4, [0.25, 1.2, 1.2, 1.2], 0.0, 0.6)(t)
    carried = torques(bodies, 4, q, dq, ddq)
    size = carried.std(axis=0)
    tau = (
        carried
        + (0.2 * size + LOAD * np.abs(carried)) * np.tanh(dq / 0.005)
        + NOISE * size * generator.normal(size=q.shape)
    )
    tau[:, 3] += stiffness * q[:, 3]
    tau[:, 0] -= counterweight
    return trial_of(bodies, {"t": t, "q": q + 1e-6 * generator.normal(size=q.shape), "tau": tau}, folder)


@pytest.mark.parametrize("counterweight", [0.0, 150.0])
def test_friction_that_grows_with_the_load_of_a_lifted_arm_is_no_spring(counterweight: float, tmp_path: Path) -> None:
    trends = subject_of(recorded(tmp_path, counterweight=counterweight), tmp_path).trends
    assert trends is not None
    assert {blame.cause.name for blame in trends.blames} == {"friction curve"}


def test_a_spring_of_a_lifted_arm_is_told_at_its_joint(tmp_path: Path) -> None:
    trends = subject_of(recorded(tmp_path, stiffness=2.0, counterweight=150.0), tmp_path).trends
    assert trends is not None
    (spring,) = [blame for blame in trends.blames if blame.cause.name != "friction curve"]
    assert (spring.cause.name, spring.cause.joint) == ("spring", "elbow")
    assert abs(spring.values[0] - 2.0) < spring.half_widths[0] < 0.2
