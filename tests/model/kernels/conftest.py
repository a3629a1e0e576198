"""Random arms and the choice of the kernel."""

from __future__ import annotations

import pytest
from random_arms import SHAPES, Arm, random_arm


@pytest.fixture(params=SHAPES)
def arm(request: pytest.FixtureRequest) -> Arm:
    return random_arm(*SHAPES[request.param])


@pytest.fixture
def six() -> Arm:
    return random_arm(*SHAPES["six revolute"])


@pytest.fixture
def tree() -> Arm:
    return random_arm(*SHAPES["tree"])


@pytest.fixture(autouse=True)
def automatic(monkeypatch: pytest.MonkeyPatch) -> None:
    """Choose the kernel as users do, whatever the other tests choose."""
    monkeypatch.delenv("DYNIDENT_KERNEL", raising=False)


@pytest.fixture(params=["generic", "generated"])
def kernel(automatic: None, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run the test with each of the two kernels."""
    monkeypatch.setenv("DYNIDENT_KERNEL", request.param)
    return request.param
