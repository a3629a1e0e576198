"""Log checks of an arm that a vertical slide lifts, whose friction grows with the load; torques by Pinocchio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import Trial, subject_of
from benchmarks.strangers.plant import Body, cylinder, urdf, waves

from dynident.case.case import read_case

pinocchio = pytest.importorskip("pinocchio")

RATE, SECONDS, NOISE, LOAD = 100.0, 20.0, 0.004, 0.05

#: Name, place, axis, mass and length of the links; the first one slides.
LINKS = (
    ("lift", (0.0, 0.0, 0.0), (0, 0, 1), 9.0, 0.3),
    ("turn", (0.1, 0.0, 0.2), (0, 0, 1), 6.0, 0.3),
    ("shoulder", (0.0, 0.1, 0.3), (0, 1, 0), 5.0, 0.4),
    ("elbow", (0.0, 0.0, 0.4), (0, 1, 0), 3.0, 0.3),
)


def arm() -> list[Body]:
    return [
        Body(
            joint=name,
            place=place,
            axis=axis,
            limits=(-0.4, 0.4) if name == "lift" else (-2.5, 2.5),
            speed=0.6 if name == "lift" else 2.0,
            effort=1000.0,
            mass=mass,
            centre=(0.02, 0.01, length / 2),
            inertia=cylinder(mass, 0.05, length, 2),
            kind="prismatic" if name == "lift" else "revolute",
        )
        for name, place, axis, mass, length in LINKS
    ]


def recorded(folder: Path, stiffness: float = 0.0, counterweight: float = 0.0) -> Trial:
    """Return a log, with a spring at the elbow in N m/rad and a constant force at the lift in N."""
    generator, bodies = np.random.default_rng(4), arm()
    t = np.arange(int(RATE * SECONDS)) / RATE
    q, dq, ddq = waves(bodies, 0.1, 5, 4, [0.25, 1.2, 1.2, 1.2], 0.0, 0.6)(t)
    model = pinocchio.buildModelFromXML(urdf("arm", bodies, 4))
    data = model.createData()
    carried = np.array([pinocchio.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])
    size = carried.std(axis=0)
    tau = (
        carried
        + (0.2 * size + LOAD * np.abs(carried)) * np.tanh(dq / 0.005)
        + NOISE * size * generator.normal(size=q.shape)
    )
    tau[:, 3] += stiffness * q[:, 3]
    tau[:, 0] -= counterweight
    (folder / "arm.urdf").write_text(urdf("arm", bodies))
    (folder / "case.yaml").write_text("case: 2\nrobot: arm.urdf\nfriction: [coulomb, viscous, offset]\n")
    return Trial(read_case(folder / "case.yaml"), {"t": t, "q": q + 1e-6 * generator.normal(size=q.shape), "tau": tau})


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
