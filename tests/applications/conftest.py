"""The robot of the tests of applications."""

from __future__ import annotations

import pytest

from dynident.model.robot import Robot
from dynident.robot_files import read_robot


@pytest.fixture(scope="session")
def robot() -> Robot:
    """Six joints with masses and limits."""
    return read_robot("generic-6r")
