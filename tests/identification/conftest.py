"""The arm that most tests of estimators are made on."""

from __future__ import annotations

import pytest

from dynident.model.robot import Robot
from noisy_arms import Bench, MakeLog


@pytest.fixture(scope="module")
def bench(spatial_3r: Robot, exact_log: MakeLog) -> Bench:
    """A spatial arm with Coulomb and viscous friction, and an exact log of 400 samples."""
    return Bench(spatial_3r, exact_log)
