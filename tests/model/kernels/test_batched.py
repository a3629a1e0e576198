"""Both kernels against Pinocchio, MuJoCo and the laws of mechanics."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from random_arms import Arm, pinocchio_model, random_arm

from dynident.arrays import Array
from dynident.diagnosis.causes.bodies_in_motion import weight_torques
from dynident.errors import BadOption
from dynident.model.kernels import batched
from dynident.model.kernels.compiled import lanes
from dynident.model.kernels.generated import chain_kernel
from dynident.model.kernels.generic import solve
from dynident.model.kernels.jit import compiled

#: Pinocchio's order of the ten (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz) by ours.
PINOCCHIO = [4, 5, 7, 6, 8, 9, 1, 2, 3, 0]

pytestmark = pytest.mark.usefixtures("kernel")


def error(found: Array, expected: Array) -> float:
    """Return the largest difference relative to the largest entry."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def test_regressor_agrees_with_pinocchio(arm: Arm) -> None:
    pin, model = pinocchio_model(arm)
    data, motion = model.createData(), arm.states(5)
    found = batched.torque_regressor(arm.chain, *motion)
    for row, state in zip(found, zip(*motion, strict=True), strict=True):
        theirs = pin.computeJointTorqueRegressor(model, data, *state).reshape(arm.chain.joints, -1, 10)
        assert error(row, theirs[:, :, PINOCCHIO].reshape(row.shape)) < 1e-12


def test_dynamics_agree_with_pinocchio(arm: Arm) -> None:
    pin, model = pinocchio_model(arm)
    data, (q, dq, ddq) = model.createData(), arm.states(5)
    tau = batched.inverse_dynamics(arm.chain, arm.theta, q, dq, ddq)
    mass = batched.mass_matrix(arm.chain, arm.theta, q)
    turns, places = batched.link_poses(arm.chain, q)
    for s in range(len(q)):
        assert error(tau[s], pin.rnea(model, data, q[s], dq[s], ddq[s])) < 1e-12
        upper = np.triu(pin.crba(model, data, q[s]))
        assert error(mass[s], upper + np.triu(upper, 1).T) < 1e-12
        pin.forwardKinematics(model, data, q[s])
        for i in range(arm.chain.links):
            assert np.abs(turns[s, i] - data.oMi[i + 1].rotation).max() < 1e-13
            assert np.abs(places[s, i] - data.oMi[i + 1].translation).max() < 1e-12


def test_weight_is_the_torque_at_rest_under_any_gravity(arm: Arm) -> None:
    (q, _, _), fields = arm.states(5), np.array([[0.0, 0.0, -9.81], [3.0, -1.0, 2.0]])
    found = weight_torques(arm.chain, arm.theta, q, fields)
    for field, torque in zip(fields, found, strict=True):
        chain = replace(arm.chain, gravity=field)
        assert error(torque, batched.inverse_dynamics(chain, arm.theta, q, 0.0 * q, 0.0 * q)) < 1e-12


def test_mimic_joints_carry_the_torques_of_all_their_links() -> None:
    """tau_j = sum of multiplier times link torque; the matrices follow by M = S' M S."""
    free = random_arm(5, True, 0.3)
    joint, factor = np.array([0, 1, 1, 2, 0]), np.array([1.0, 1.0, -0.7, 1.0, 0.5])
    offset = np.array([0.0, 0.0, 0.3, 0.0, 0.1])
    chain = replace(free.chain, joint=joint, multiplier=factor, offset=offset, joints=3)
    follow = np.zeros((5, 3))
    follow[np.arange(5), joint] = factor
    q, dq, ddq = Arm(chain, free.bodies).states(6)
    links = (q @ follow.T + offset, dq @ follow.T, ddq @ follow.T)
    tau = batched.inverse_dynamics(chain, free.theta, q, dq, ddq)
    assert error(tau, batched.inverse_dynamics(free.chain, free.theta, *links) @ follow) < 1e-12
    mass = batched.mass_matrix(chain, free.theta, q)
    assert error(mass, follow.T @ batched.mass_matrix(free.chain, free.theta, links[0]) @ follow) < 1e-12
    rows = batched.torque_regressor(chain, q, dq, ddq)
    assert error(rows, np.einsum("lj,slp->sjp", follow, batched.torque_regressor(free.chain, *links))) < 1e-12
    for ours, theirs in zip(batched.link_poses(chain, q), batched.link_poses(free.chain, links[0]), strict=True):
        assert np.abs(ours - theirs).max() < 1e-12


def test_every_number_of_samples_gives_the_same_rows(six: Arm) -> None:
    motion = six.states(3 * lanes() + 1)
    full = batched.torque_regressor(six.chain, *motion)
    for count in range(len(full) + 1):
        q, dq, ddq = (values[:count] for values in motion)
        part = batched.torque_regressor(six.chain, q, dq, ddq)
        assert part.shape == (count, 6, 60)
        assert np.array_equal(part, full[:count])


def test_a_bad_sample_spoils_no_other(six: Arm) -> None:
    motion = six.states(20)
    good = batched.inverse_dynamics(six.chain, six.theta, *motion)
    motion[0][7, 2] = np.nan
    bad = batched.inverse_dynamics(six.chain, six.theta, *motion)
    assert np.isnan(bad[7, :3]).all()
    assert np.array_equal(np.delete(bad, 7, 0), np.delete(good, 7, 0))


def test_any_memory_layout_is_taken(six: Arm) -> None:
    q, dq, ddq = six.states(12)
    expected = batched.torque_regressor(six.chain, q, dq, ddq)
    frozen = q.copy()
    frozen.setflags(write=False)
    strange = (frozen, np.asfortranarray(dq), np.repeat(ddq, 2, axis=0)[::2])
    assert np.array_equal(batched.torque_regressor(six.chain, *strange), expected)
    assert np.array_equal(batched.torque_regressor(six.chain, q.tolist(), dq, ddq), expected)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        (((4, 5), (4, 6), (4, 6)), "q has shape (4, 5), expected (N, 6)"),
        (((4, 6), (3, 6), (4, 6)), "dq has shape (3, 6), expected (4, 6)"),
        (((4, 6), (4, 6), (6,)), "ddq has shape (6,), expected (4, 6)"),
    ],
)
def test_wrong_shapes_are_named(six: Arm, shapes: tuple[tuple[int, ...], ...], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        q, dq, ddq = (np.zeros(shape) for shape in shapes)
        batched.torque_regressor(six.chain, q, dq, ddq)


def test_wrong_parameters_are_named(six: Arm) -> None:
    q = np.zeros((2, 6))
    with pytest.raises(ValueError, match=re.escape("theta has shape (59,), expected (60,)")):
        batched.mass_matrix(six.chain, np.zeros(59), q)


@compiled
def solved(matrix: Array, vector: Array, scale: Array) -> bool:
    """Call the function that only compiled code can call."""
    return solve(matrix, vector, scale)


@pytest.mark.parametrize("kind", ["any", "indefinite", "of very different size"])
def test_systems_that_are_regular_are_solved(kind: str) -> None:
    """A rotor that weighs 1e-9 of the rest is small, not singular."""
    scale = 10.0 ** (np.linspace(-4.5, 1.5, 6) if kind == "of very different size" else np.zeros(6))
    matrix = np.random.default_rng(4).normal(size=(6, 6))
    matrix = (matrix + matrix.T if kind == "indefinite" else matrix @ matrix.T) * np.outer(scale, scale)
    assert solved(matrix.copy(), answer := matrix @ (1.0 / scale), np.empty(6))
    assert error(answer * scale, np.ones(6)) < 1e-9


def test_a_singular_mass_matrix_is_told(six: Arm) -> None:
    theta = six.theta.copy()
    theta[50:] = 0.0  # a last link that weighs nothing
    mass = batched.mass_matrix(six.chain, theta, six.states(1)[0])[0]
    assert not solved(mass.copy(), np.ones(6), np.empty(6))
    assert solved(mass + np.diag([0.0, 0.0, 0.0, 0.0, 0.0, 0.1]), np.ones(6), np.empty(6))


def test_generic_and_generated_agree(arm: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = arm.states(50)
    results = {}
    for choice in ("generic", "generated"):
        monkeypatch.setenv("DYNIDENT_KERNEL", choice)
        results[choice] = (
            batched.torque_regressor(arm.chain, *motion),
            batched.inverse_dynamics(arm.chain, arm.theta, *motion),
            batched.mass_matrix(arm.chain, arm.theta, motion[0]),
            *batched.link_poses(arm.chain, motion[0]),
        )
    for one, other in zip(results["generic"], results["generated"], strict=True):
        assert error(one, other) < 1e-13


def test_a_few_states_by_numpy_are_those_of_the_kernel(arm: Arm) -> None:
    """What is asked for once is not compiled; robots of any size."""
    motion = arm.states(7)
    compiled = batched.torque_regressor(arm.chain, *motion)
    assert error(batched.torque_regressor(arm.chain, *motion, once=True), compiled) < 1e-13
    mass = batched.mass_matrix(arm.chain, arm.theta, motion[0])
    assert error(batched.mass_matrix(arm.chain, arm.theta, motion[0], once=True), mass) < 1e-13
    none = np.zeros((0, arm.chain.joints))
    assert batched.torque_regressor(arm.chain, none, none, none, once=True).shape[0] == 0


def test_the_choice_of_kernel(six: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    large = random_arm(12, False, 0.0).chain
    monkeypatch.setenv("DYNIDENT_KERNEL", "generic")
    assert chain_kernel(six.chain, "torque") is None
    monkeypatch.delenv("DYNIDENT_KERNEL")
    assert chain_kernel(six.chain, "torque") is chain_kernel(replace(six.chain), "torque") is not None
    assert chain_kernel(large, "regressor") is None
    assert chain_kernel(random_arm(61, False, 0.0).chain, "regressor") is None
    monkeypatch.setenv("DYNIDENT_KERNEL", "fast")
    with pytest.raises(BadOption) as caught:
        batched.link_poses(six.chain, np.zeros((1, 6)))
    assert str(caught.value) == ("DYNIDENT_KERNEL = 'fast' is not possible; choose one of: auto, generic, generated")


def test_importing_loads_no_compiler() -> None:
    code = "import sys, dynident.model.kernels.batched; print({'numba', 'llvmlite'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
