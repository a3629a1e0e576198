"""The number of base parameters against the rank in exact arithmetic, for arms of 2 to 12 joints of any geometry."""

from __future__ import annotations

import numpy as np
import pytest
from exact_arms import RIGHT, ExactArm, exact_arms, off
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.applications.identifiability import structure
from dynident.model.base_parameters import TOLERANCE, base_parameters
from dynident.model.dynamic_model import DynamicModel

#: A calibrated arm: axes off by 2e-6 to 2e-2 rad.
NEARLY = st.sampled_from([100, 1000, 5000, 20_000, 100_000, 300_000, 1_000_000])


def check_rank(arm: ExactArm, rotors: bool) -> None:
    model = DynamicModel(arm.robot, ("rotor_inertia",) if rotors else ())  # type: ignore[arg-type]
    motion = model.random_motion(4)
    np.testing.assert_allclose(arm.floating(motion), model.regressor(motion)[..., : model.inertial_count], atol=1e-9)
    base = base_parameters(model)
    assert base.count == structure(model).count == arm.rank(rotors)
    assert base.neglected == 0


def check_answer(arm: ExactArm) -> None:
    """Nearly special arms: never more than the exact rank, and fewer only where that is said."""
    model = DynamicModel(arm.robot)
    base = base_parameters(model)
    exact = arm.rank()
    assert base.count <= exact
    assert base.count == exact or 0 < base.neglected <= TOLERANCE
    assert np.all(base.shares > 0) and np.all(np.diff(base.shares[base.weak]) >= 0)
    theta = np.random.default_rng(0).normal(size=len(model.parameters)) * np.tile(
        [0.1] * 6 + [0.3] * 3 + [1.0], model.robot.dof
    )
    regressor = model.regressor(model.random_motion(30, 5))
    torque, found = regressor @ theta, regressor[..., base.independent] @ base.from_standard(theta)
    assert np.abs(found - torque).max() <= 1e-3 * np.abs(torque).max()


@settings(max_examples=10)
@given(arm=exact_arms(2, 8), rotors=st.booleans())
def test_the_count_is_the_exact_rank(arm: ExactArm, rotors: bool) -> None:
    check_rank(arm, rotors)


@settings(max_examples=10)
@given(nearly=NEARLY, data=st.data())
def test_nearly_special_arms_get_an_answer(nearly: int, data: st.DataObject) -> None:
    check_answer(data.draw(exact_arms(2, 8, nearly)))


@pytest.mark.battery
@settings(max_examples=400)
@given(arm=exact_arms(2, 12), rotors=st.booleans())
def test_the_count_is_the_exact_rank_of_many(arm: ExactArm, rotors: bool) -> None:
    check_rank(arm, rotors)


@pytest.mark.battery
@settings(max_examples=600)
@given(nearly=NEARLY, data=st.data())
def test_many_nearly_special_arms_get_an_answer(nearly: int, data: st.DataObject) -> None:
    check_answer(data.draw(exact_arms(2, 12, nearly)))


def test_a_known_arm_has_its_known_rank() -> None:
    """Two parallel turns with gravity across: six; a turn about the vertical: one; off by a little: three."""
    plane = ExactArm((-1, 0), ("revolute", "revolute"), (RIGHT[1], RIGHT[0]), ((0, 0, 0), (50, 0, 0)), (2, 2))
    assert plane.rank() == 6
    assert ExactArm((-1,), ("revolute",), (RIGHT[0],), ((0, 0, 0),), (2,)).rank() == 1
    assert ExactArm((-1,), ("revolute",), (off(RIGHT[0], (1, 0, 0), 10**6),), ((0, 0, 0),), (2,)).rank() == 3
