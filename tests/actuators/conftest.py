"""The robot of the tests of actuators."""

from __future__ import annotations

import pytest
from servo_bench import pendulum

from dynident.model.robot import Robot


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A pendulum of known mass."""
    return pendulum(tmp_path_factory.mktemp("pendulum"))
