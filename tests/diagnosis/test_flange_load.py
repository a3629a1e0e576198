"""The mass of a load at the flange that stands off it: arms and torques by Pinocchio, robot models that are off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.clean import told
from benchmarks.faults.loads import named

from dynident.diagnosis.causes.flange_load import FAR, TOLD, carried, own_inertia

pytest.importorskip("pinocchio")


def inertia_of_point(values: np.ndarray) -> np.ndarray:
    first, mass = values[:3], values[3]
    distance = np.hypot(mass, np.linalg.norm(first) / FAR)
    about = first @ first * np.eye(3) - np.outer(first, first)
    return np.sign(mass) * about[np.triu_indices(3)] / distance


@pytest.mark.parametrize("mass", [1.5, -1.5, 0.01])
def test_moments_of_inertia_follow_mass_and_first_moments(mass: float) -> None:
    """The slopes are those of finite differences, and the straight lines go through the point itself."""
    values, step = np.array([0.1, -0.2, 0.3, mass]), 1e-6
    slopes = carried(values)[TOLD:, :TOLD]
    for k, unit in enumerate(np.eye(TOLD)):
        rise = inertia_of_point(values + step * unit) - inertia_of_point(values - step * unit)
        np.testing.assert_allclose(slopes[:, k], rise / (2 * step), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(slopes @ values, inertia_of_point(values), rtol=1e-12, atol=1e-15)


def test_nothing_goes_with_a_load_that_is_none() -> None:
    np.testing.assert_array_equal(carried(np.zeros(TOLD)), np.eye(10))
    assert own_inertia(np.zeros(TOLD)) > 0.0


@pytest.mark.parametrize("seed", [5, 16, *(pytest.param(k, marks=pytest.mark.battery) for k in (2, 7, 14, 18))])
def test_the_interval_holds_the_mass_of_a_load_off_the_flange(seed: int, tmp_path: Path) -> None:
    """Its centre is 0.1 m off in each direction; without its inertia the mass came out 10 to 20 % too small."""
    mass, found = named(seed, 2.0, tmp_path)
    assert found is not None and found.severity == "warning"
    half = float(found.evidence.split("+- ")[1].split()[0])
    assert abs(found.numbers["mass_kg"] - mass) < half < 0.35 * mass
    assert found.numbers["mass_kg"] == pytest.approx(mass, rel=0.12)


@pytest.mark.parametrize("seed", [5, 16, *(pytest.param(k, marks=pytest.mark.battery) for k in (2, 7, 8, 14, 18))])
def test_errors_of_the_last_link_are_no_load(seed: int, tmp_path: Path) -> None:
    found = named(seed, 0.0, tmp_path)[1]
    assert found is None or found.severity == "note"


def test_a_load_has_to_explain_more_combinations_of_bodies_than_it_has_parameters(tmp_path: Path) -> None:
    """Errors of the robot model of a short arm with a slide were a load as heavy as its last link."""
    found, arm = told(6007, tmp_path)
    assert arm.startswith("RPRR") and not [one for one in found if one.name == "load at the flange"]
