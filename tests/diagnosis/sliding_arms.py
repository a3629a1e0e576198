"""Arms with one joint that slides; torques by Pinocchio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import Trial
from benchmarks.strangers.plant import Body, cylinder, urdf

from dynident.case.case import read_case

pinocchio = pytest.importorskip("pinocchio")


def with_slide(links: Sequence[tuple], slide: str, travel: tuple[float, float], speed: float) -> list[Body]:
    """Return bodies by name, place, axis, mass and length, of which one slides; limits in m and m/s."""
    return [
        Body(
            joint=name,
            place=place,
            axis=axis,
            limits=travel if name == slide else (-2.5, 2.5),
            speed=speed if name == slide else 2.0,
            effort=1000.0,
            mass=mass,
            centre=(0.02, 0.01, length / 2),
            inertia=cylinder(mass, 0.05, length, 2),
            kind="prismatic" if name == slide else "revolute",
        )
        for name, place, axis, mass, length in links
    ]


def torques(bodies: list[Body], seed: int, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Return the torques (N, n) of the arm as it is built with a seed, without friction."""
    model = pinocchio.buildModelFromXML(urdf("arm", bodies, seed))
    data = model.createData()
    return np.array([pinocchio.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])


def trial_of(bodies: list[Body], columns: Mapping[str, np.ndarray], folder: Path) -> Trial:
    """Return a log beside the case of the arm as it is described."""
    (folder / "arm.urdf").write_text(urdf("arm", bodies))
    (folder / "case.yaml").write_text("case: 2\nrobot: arm.urdf\nfriction: [coulomb, viscous, offset]\n")
    return Trial(read_case(folder / "case.yaml"), columns)
