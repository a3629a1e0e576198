"""What the generated programs take as exact, and constants that become part of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from random_arms import Arm

from dynident.model.kernels import batched
from dynident.model.kernels.recursion import TracedChain, snapped


def test_only_the_rounding_of_a_description_is_removed(six: Arm) -> None:
    """Eleven digits of a right angle are a right angle, four are what they say."""
    cosines = np.cos([1.57079632679, 1.5708, 1.0471975512, 0.3])
    turns = six.chain.rotation.copy()
    turns[0, 0], turns[1, 0, 0] = cosines[:3], -cosines[0]
    places = six.chain.translation.copy()
    places[2] = [1e-17, 1e-4, 0.3]
    chain = snapped(replace(six.chain, rotation=turns, translation=places, gravity=np.array([4e-11, 2e-6, -9.81])))
    assert chain.rotation[0, 0].tolist() == [0.0, cosines[1], 0.5]
    assert chain.rotation[1, 0, 0] == 0.0
    assert chain.translation[2].tolist() == [0.0, 1e-4, 0.3]
    assert chain.gravity.tolist() == [0.0, 2e-6, -9.81]
    assert np.array_equal(chain.rotation[3:], six.chain.rotation[3:])
    assert np.array_equal(chain.axis, six.chain.axis)


def test_a_chain_without_gravity_or_length_is_no_special_case(six: Arm) -> None:
    chain = replace(six.chain, gravity=np.zeros(3), translation=np.zeros((6, 3)))
    assert np.array_equal(snapped(chain).translation, chain.translation)
    motion = six.states(3)
    rest = (motion[0], np.zeros((3, 6)), np.zeros((3, 6)))
    assert np.abs(batched.inverse_dynamics(chain, six.theta, *rest)).max() == 0.0


def test_known_parameters_become_constants(six: Arm) -> None:
    theta = six.theta.copy()
    theta[10:20] = 0.0
    q, dq, ddq = six.states(4)
    traced, open_ended = TracedChain(six.chain, theta), TracedChain(six.chain)
    program = traced.trace.program(traced.torque())
    assert program.arrays == ("ddq", "dq", "q")
    assert program.operations < open_ended.trace.program(open_ended.torque()).operations
    found = program.evaluate({"q": q.T, "dq": dq.T, "ddq": ddq.T})
    expected = batched.inverse_dynamics(six.chain, theta, q, dq, ddq)
    for joint, values in found.items():
        assert np.abs(values - expected[:, joint]).max() < 1e-13 * np.abs(expected).max()


def test_arrays_may_stand_for_each_other_or_for_zeros(six: Arm) -> None:
    """No speed, the speed for the acceleration and no gravity give the momentum M dq; neither of both, gravity."""
    q, dq, ddq = six.states(4)
    still = np.zeros_like(dq)
    mass = batched.mass_matrix(six.chain, six.theta, q)
    momentum = TracedChain(replace(six.chain, gravity=np.zeros(3)), six.theta, {"dq": "", "ddq": "dq"})
    gravity = TracedChain(six.chain, six.theta, {"dq": "", "ddq": ""})
    cases = (
        (momentum, ("dq", "q"), np.einsum("nij,nj->ni", mass, dq)),
        (gravity, ("q",), batched.inverse_dynamics(six.chain, six.theta, q, still, still)),
    )
    for traced, arrays, expected in cases:
        program = traced.trace.program(traced.torque())
        assert program.arrays == arrays
        for joint, values in program.evaluate({"q": q.T, "dq": dq.T, "ddq": ddq.T}).items():
            assert np.abs(values - expected[:, joint]).max() < 1e-13 * np.abs(expected).max()
