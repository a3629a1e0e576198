"""How many operations the traces of a UR10 take: more would be a loss of speed that no timed test could see."""

from __future__ import annotations

import pytest
from benchmarks.speed.arms import ur10

from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Scalar, gradient

#: Operations of one sample, six sines and six cosines among them.
WHOLE, BASE, DERIVATIVE, TORQUE = 893, 707, 1855, 692


@pytest.fixture(scope="module")
def traced() -> TracedChain:
    return TracedChain(ur10().chain)


def test_the_whole_regressor(traced: TracedChain) -> None:
    assert traced.trace.program(traced.regressor(range(60))).operations <= WHOLE


def test_the_base_columns_and_their_derivative(traced: TracedChain) -> None:
    wanted = base_parameters(DynamicModel(ur10(), ()), inertial_only=True).independent
    values, trace = traced.regressor(wanted), traced.trace
    assert trace.program(values).operations <= BASE
    weights = {slot: trace.input("weight", slot) for slot in values}
    inputs: list[Scalar] = [trace.input(name, joint) for name in ("q", "dq", "ddq") for joint in range(6)]
    slopes = gradient(trace, values, weights, inputs)
    assert trace.program(dict(enumerate(slopes))).operations <= DERIVATIVE


def test_the_torque(traced: TracedChain) -> None:
    assert traced.trace.program(traced.torque()).operations <= TORQUE
