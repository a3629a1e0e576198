"""What every friction part must do, whoever writes it: one battery for the whole folder."""

from __future__ import annotations

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

from dynident.model.friction import FRICTION, Friction, Motion

PARTS = FRICTION.names()
SAMPLES, JOINTS = 40, 3


@pytest.fixture(params=PARTS)
def part(request: pytest.FixtureRequest) -> Friction:
    return FRICTION.make(request.param)


@pytest.fixture(scope="module")
def motion() -> Motion:
    generator = np.random.default_rng(0)
    signals = [generator.normal(size=(SAMPLES, JOINTS)) for _ in range(4)]
    signals[1][0] = 0.0  # standing still
    return Motion(*signals, temperature=30.0 + signals[0], state=generator.normal(size=(SAMPLES, JOINTS, 4)))


def rows(motion: Motion, keep: object) -> Motion:
    return Motion(**{f.name: getattr(motion, f.name)[keep] for f in fields(motion)})


def test_columns_have_one_value_per_sample_drive_and_coefficient(part: Friction, motion: Motion) -> None:
    found = part.columns(motion)
    assert found.shape == (SAMPLES, JOINTS, len(part.coefficients))
    assert found.dtype == np.float64 and np.all(np.isfinite(found))
    assert len({c.symbol for c in part.coefficients}) == len(part.coefficients) > 0


def test_a_sample_knows_nothing_of_the_others(part: Friction, motion: Motion) -> None:
    whole = part.columns(motion)
    order = np.random.default_rng(1).permutation(SAMPLES)
    np.testing.assert_array_equal(part.columns(rows(motion, order)), whole[order])
    for k in (0, 7):
        np.testing.assert_array_equal(part.columns(rows(motion, [k])), whole[[k]])
    assert part.columns(rows(motion, [])).shape == (0, JOINTS, len(part.coefficients))


def test_a_drive_knows_nothing_of_the_others(part: Friction, motion: Motion) -> None:
    whole = part.columns(motion)
    alone = part.columns(rows(motion, (slice(None), [1])))
    np.testing.assert_array_equal(alone, whole[:, [1]])


def test_columns_are_a_pure_function(part: Friction, motion: Motion) -> None:
    before = {f.name: getattr(motion, f.name).copy() for f in fields(motion)}
    np.testing.assert_array_equal(part.columns(motion), part.columns(motion))
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(motion, name), values)


def test_a_part_goes_to_another_process_after_its_use(part: Friction, motion: Motion) -> None:
    whole = part.columns(motion), part.derivatives(motion)
    again = pickle.loads(pickle.dumps(part))
    assert again == part
    np.testing.assert_array_equal(again.columns(motion), whole[0])


def test_nonnegative_friction_never_drives(part: Friction, motion: Motion) -> None:
    """A coefficient >= 0 takes energy out (a rotor's inertia, in kg, and a spring only store it), none while standing.

    With equal coefficients the motion back is braked like the motion forth. Of a part that remembers this holds for a
    motion that comes back to where it was, with all that is remembered.
    """
    if part.states:
        time = np.linspace(0.0, 4.0, 4001)[:, None] * [1.0, 1.3, 2.0]
        turning = Motion(
            *(np.pi ** np.arange(3)[:, None, None] * np.sin(np.pi * time + np.pi / 2 * np.arange(3)[:, None, None]))
        )
        found = part.columns(replace(turning, state=part.states_along(turning, 1e-3)))[2000:, 0, :]
        assert np.all(np.sum(found * turning.dq[2000:, :1], axis=0) >= 0)
        return
    found, turned = part.columns(motion), part.columns(replace(motion, dq=-motion.dq))
    pairs = zip(part.coefficients, part.expression.reads, strict=True)
    brakes = [c.nonnegative and not c.unit.startswith("kg") and reads != {"q"} for c, reads in pairs]
    assert np.all(found[..., brakes] * motion.dq[..., None] >= 0)
    np.testing.assert_array_equal(found[0][:, brakes], 0.0)
    assert np.all(turned[..., brakes] * motion.dq[..., None] <= 0)
    np.testing.assert_allclose(turned[..., brakes].sum(axis=-1), -found[..., brakes].sum(axis=-1))


def test_units_go_with_the_kind_of_joint(part: Friction) -> None:
    """Torque becomes force where a joint slides: every unit of an angle loses its m or its rad."""
    pairs = {
        ("N m", "N"),
        ("N m s/rad", "N s/m"),
        ("kg m^2", "kg"),
        ("N m s^2/rad^2", "N s^2/m^2"),
        ("N m s^3/rad^3", "N s^3/m^3"),
        ("N m/K", "N/K"),
        ("N m/rad", "N/m"),
        ("N m s/(rad K)", "N s/(m K)"),
        ("1", "1"),
    }
    assert all((c.unit, c.linear_unit) in pairs for c in part.coefficients)
