"""JointColumns: the entries of the regressor, only those that can differ from zero, and their exact derivatives."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from random_arms import Arm, random_arm

from dynident.arrays import Array
from dynident.model.kernels import batched
from dynident.model.kernels.batched import JointColumns
from dynident.model.robot import Chain


def anthropomorphic(joints: int = 3) -> Chain:
    """An arm as they are built: right angles, first axis upright."""
    turns = np.array([np.eye(3), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], np.eye(3)][:joints], dtype=float)
    return Chain(
        parent=np.arange(-1, joints - 1),
        kind=np.zeros(joints, dtype=np.int64),
        rotation=turns,
        translation=np.array([[0, 0, 0.3], [0.1, 0, 0], [0.5, 0, 0]][:joints]),
        axis=np.tile([0.0, 0.0, 1.0], (joints, 1)),
        joint=np.arange(joints),
        multiplier=np.ones(joints),
        offset=np.zeros(joints),
        gravity=np.array([0.0, 0.0, -9.81]),
        joints=joints,
    )


def dense(kernel: JointColumns, blocks: tuple[Array, ...]) -> Array:
    """Return the blocks as rows of the chosen columns, (N, n, b)."""
    full = np.zeros((blocks[0].shape[1], kernel.chain.joints, len(kernel.wanted)))
    for joint, (found, block) in enumerate(zip(kernel.columns, blocks, strict=True)):
        full[:, joint, found] = block.T
    return full


def test_blocks_are_the_columns_of_the_regressor(arm: Arm, kernel: str) -> None:
    some = np.random.default_rng(5).permutation(10 * arm.chain.links - 1)[: 7 * arm.chain.links]
    wanted = [10 * arm.chain.links - 1, *some]
    chosen, motion = JointColumns(arm.chain, wanted), arm.states(11)
    expected = batched.torque_regressor(arm.chain, *motion)[:, :, wanted]
    found = dense(chosen, chosen.evaluate(*motion))
    assert np.abs(found - expected).max() < 1e-13 * np.abs(expected).max()


def test_robots_that_differ_in_gravity_alone_share_their_columns(arm: Arm, kernel: str) -> None:
    wanted, motion = np.arange(10 * arm.chain.links), arm.states(11)
    for gravity in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.3, -5.0, 8.0)):
        chain = replace(arm.chain, gravity=np.array(gravity))
        chosen, own = JointColumns(chain, wanted, any_gravity=True), JointColumns(chain, wanted)
        found, expected = dense(chosen, chosen.evaluate(*motion)), batched.torque_regressor(chain, *motion)
        assert np.abs(found - expected).max() < 1e-13 * np.abs(expected).max()
        copied = pickle.loads(pickle.dumps(chosen))
        np.testing.assert_array_equal(dense(copied, copied.evaluate(*motion)), found)
        weights = np.random.default_rng(0).normal(size=expected.shape)
        slopes = [
            each.pullback(*motion, [np.ascontiguousarray(weights[:, i, own].T) for i, own in enumerate(each.columns)])
            for each in (chosen, own)
        ]
        for one, other in zip(*slopes, strict=True):
            np.testing.assert_allclose(one, other, atol=1e-12 * max(1.0, np.abs(other).max()))


def test_mimic_joints_sum_their_links(kernel: str) -> None:
    free = random_arm(4, True, 0.3)
    chain = replace(
        free.chain,
        joint=np.array([0, 1, 1, 0]),
        multiplier=np.array([1.0, 1.0, -0.7, 2.0]),
        offset=np.array([0.0, 0.0, 0.3, 0.1]),
        joints=2,
    )
    chosen, motion = JointColumns(chain, range(40)), Arm(chain, free.bodies).states(9)
    expected = batched.torque_regressor(chain, *motion)
    assert np.abs(dense(chosen, chosen.evaluate(*motion)) - expected).max() < 1e-13 * np.abs(expected).max()


def test_only_entries_that_are_always_zero_are_left_out() -> None:
    chain = anthropomorphic()
    chosen = JointColumns(chain, range(30))
    motion = np.random.default_rng(6).normal(size=(3, 200, 3))
    rows = batched.torque_regressor(chain, *motion)
    moves = [np.flatnonzero(np.abs(rows[:, joint]).max(axis=0) > 1e-12) for joint in range(3)]
    assert [found.tolist() for found in chosen.columns] == [found.tolist() for found in moves]
    assert chosen.columns[0][0] == 5  # of the first link only Izz about the upright axis


def test_rounded_right_angles_are_right_angles() -> None:
    """Angles with eleven digits, as descriptions write them, leave the structure and 1e-10 of every entry."""
    exact = anthropomorphic()
    angle = 1.57079632679
    turns = exact.rotation.copy()
    turns[1] = [[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]]
    rough = replace(exact, rotation=turns)
    motion = np.random.default_rng(7).normal(size=(3, 200, 3))
    chosen = JointColumns(rough, range(30))
    expected = JointColumns(exact, range(30))
    assert [found.tolist() for found in chosen.columns] == [found.tolist() for found in expected.columns]
    found = dense(chosen, chosen.evaluate(*motion))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DYNIDENT_KERNEL", "generic")
        unsnapped = batched.torque_regressor(rough, *motion)
    assert 0 < np.abs(found - unsnapped).max() < 1e-10 * np.abs(unsnapped).max()


def test_buffers_of_the_caller_are_filled(tree: Arm, kernel: str) -> None:
    chosen, motion = JointColumns(tree.chain, range(70)), tree.states(13)
    expected = chosen.evaluate(*motion)
    roomy = [np.full((len(found) + 2, 13), 9.0) for found in chosen.columns]  # two rows of the caller's own
    out = [block[:-2] for block in roomy]
    found = chosen.evaluate(*motion, out=out)
    for mine, block, want, given in zip(found, roomy, expected, out, strict=True):
        assert mine is given
        assert np.array_equal(block[:-2], want)
        assert (block[-2:] == 9.0).all()


def test_every_chunk_gives_the_same_rows(six: Arm, kernel: str) -> None:
    chosen, motion = JointColumns(six.chain, range(60)), six.states(21)
    whole = chosen.evaluate(*motion)
    for count in range(22):
        q, dq, ddq = (values[:count] for values in motion)
        part = chosen.evaluate(q, dq, ddq)
        assert all(np.array_equal(a, b[:, :count]) for a, b in zip(part, whole, strict=True))


def test_no_columns_are_possible(six: Arm, kernel: str) -> None:
    chosen = JointColumns(six.chain, [])
    assert [block.shape for block in chosen.evaluate(*six.states(9))] == [(0, 9)] * 6


def test_the_pullback_is_the_derivative(arm: Arm) -> None:
    """Against central differences of the weighted sum, sample by sample."""
    links, step = arm.chain.links, 1e-6
    chosen, motion = JointColumns(arm.chain, range(0, 10 * links, 3)), arm.states(9)
    random = np.random.default_rng(8)
    weights = tuple(random.normal(size=(len(found), 9)) for found in chosen.columns)

    def total(q: Array, dq: Array, ddq: Array) -> Array:
        blocks = chosen.evaluate(q, dq, ddq)
        return np.sum([(w * block).sum(axis=0) for w, block in zip(weights, blocks, strict=True)], axis=0)

    slopes = chosen.pullback(*motion, weights)
    for k, joint in np.ndindex(3, arm.chain.joints):
        shift = np.zeros((3, 1, arm.chain.joints))
        shift[k, 0, joint] = step
        rate = (total(*(np.array(motion) + shift)) - total(*(np.array(motion) - shift))) / (2 * step)
        assert np.abs(rate - slopes[k][:, joint]).max() < 1e-7 * max(1.0, np.abs(slopes[k]).max())


def test_a_copy_in_another_process_is_the_same(six: Arm) -> None:
    chosen, motion = JointColumns(six.chain, [5, 50, 59]), six.states(9)
    first = chosen.evaluate(*motion)
    again = pickle.loads(pickle.dumps(chosen)).evaluate(*motion)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ([0, 60], "columns reach from 0 to 60, expected 0 to 59"),
        ([-1, 3], "columns reach from -1 to 3, expected 0 to 59"),
        ([3, 3], "a column stands twice in columns"),
        ([1.5], "columns must be a list of whole numbers, got shape (1,) of float64"),
        ([[1]], "columns must be a list of whole numbers, got shape (1, 1) of int64"),
    ],
)
def test_wrong_columns_are_named(six: Arm, columns: list, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        JointColumns(six.chain, columns)


def test_wrong_buffers_are_named(six: Arm, kernel: str) -> None:
    chosen, motion = JointColumns(six.chain, [57, 59]), six.states(9)
    out = list(chosen.buffers(9))
    with pytest.raises(ValueError, match=re.escape("out has the shapes [(2, 8), ")):
        chosen.evaluate(*motion, out=chosen.buffers(8))
    out[1] = np.empty((9, 2)).T
    with pytest.raises(ValueError, match=re.escape("out[1] must be a C-contiguous float64 array, writeable")):
        chosen.evaluate(*motion, out=out)
    out[1] = np.empty((2, 9), dtype=np.float32)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=re.escape("out[1] must be")):
        chosen.evaluate(*motion, out=out)
    with pytest.raises(ValueError, match=re.escape("weights[1] must be a C-contiguous float64 array")):
        chosen.pullback(*motion, out)


def test_large_robots_are_left_to_the_generic_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    large = random_arm(13, False, 0.0)
    chosen = JointColumns(large.chain, range(130))
    compiled = []
    monkeypatch.setattr("dynident.model.kernels.joint_columns.kernel", lambda *_: compiled.append(1))
    blocks = chosen.evaluate(*large.states(3))
    assert not compiled
    assert np.abs(dense(chosen, blocks)).max() > 0
