"""A friction part in a temporary folder goes the whole way: fit, selection, both simulations and all exporters."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.exports.models import MODEL_EXPORTERS, export_model
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.robot import Robot
from dynident.simulation.cell import Cell
from dynident.simulation.cell_simulation import simulate_cell
from dynident.simulation.effects import Bristles

SEAL = '''
from dataclasses import dataclass
from typing import ClassVar
from dynident.model.friction.base import (
    Coefficient, Friction, Inputs, Number, Range, SelectionUse, cosine, smooth_sign,
)

@dataclass(frozen=True)
class Seal(Friction):
    """Dry friction Fg (1.2 + cos q) tanh(dq / width) of a shaft that runs out of true."""

    width: float = 0.05

    coefficients: ClassVar = (Coefficient("Fg", "N m", "N", nonnegative=True),)
    ranges: ClassVar = {"width": Range(1e-3, 0.3, is_speed=True)}
    selection: ClassVar = SelectionUse(20, {"choose": ("part", "width")})

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return ((1.2 + cosine(at.q)) * smooth_sign(at.dq, self.width),)
'''

#: What these formats hold of friction is the whole of it; the others have one number of dry friction, or none.
WHOLE = {"c_header", "casadi", "fmu", "json", "numpy", "ros2_friction", "csv", "latex"}

HOW = Preprocessing(AsGiven(), rest="keep")

SUFFIX = {"urdf": ".urdf", "pinocchio": ".urdf", "mjcf": ".xml", "sdf": ".sdf", "drake": ".dmd.yaml", "numpy": ".py"}
SUFFIX |= {"c_header": ".h", "fmu": ".fmu", "casadi": ".py", "json": ".json"}


@pytest.fixture
def model(install: Callable[[str, str, str], None], planar_2r: Robot) -> DynamicModel:
    install("seal", "seal = seal", SEAL)
    return DynamicModel(planar_2r, ("seal", "viscous"))  # type: ignore[arg-type]


@pytest.fixture
def theta(model: DynamicModel) -> Array:
    assert model.robot.nominal is not None
    return np.append(model.robot.nominal, [0.6, 0.4, 0.8, 0.3])


@pytest.fixture
def estimate(model: DynamicModel, theta: Array, exact_log: Callable[..., Log]) -> Estimate:
    return identify(model, [exact_log(model, theta, noise=0.01, samples=1000)], "consistent", HOW)


def test_it_is_identified_and_selected(
    model: DynamicModel, theta: Array, estimate: Estimate, exact_log: Callable[..., Log]
) -> None:
    found = estimate.theta
    assert found is not None
    np.testing.assert_allclose(found[model.inertial_count :], theta[model.inertial_count :], rtol=0.01)
    log = exact_log(model, theta, noise=0.05, samples=1600, rate=80.0)
    chosen = identify(DynamicModel(model.robot), [log], "wls", HOW, choose_friction=True)
    (seal,) = (part for part in chosen.model.friction if FRICTION.name_of(part) == "seal")
    np.testing.assert_allclose(seal.width, 0.05, rtol=0.1)


def test_the_simulation_has_it(model: DynamicModel, theta: Array) -> None:
    sine, cosine = 0.2 * np.random.default_rng(1).normal(size=(2, 2, 3))
    motion = FourierSeries(np.zeros(2), sine, cosine, 2.0)
    true = simulate_cell(model, theta, motion).truth
    torque = model.torque(Motion(true.q, true.dq, true.ddq), theta)
    np.testing.assert_allclose(torque, true.torque, atol=1e-9 * np.abs(true.torque).max())
    soft = simulate_cell(model, theta, motion, Cell(bristles=Bristles(5e-3)))
    true = soft.truth
    level = model.friction_values(Motion(true.q, np.ones_like(true.dq), true.ddq))[..., 0] * [0.6, 0.8]
    dry, fast = np.abs(soft.friction - true.dq * [0.4, 0.3]), np.abs(true.dq) > 0.4
    assert np.mean(np.abs(dry - level)[fast] < 0.02 * level[fast]) > 0.9  # bristles bend first after each turn


@pytest.mark.parametrize("name", MODEL_EXPORTERS.names())
def test_every_exporter_holds_it_or_states_what_it_lacks(estimate: Estimate, tmp_path: Path, name: str) -> None:
    """Files are loaded again by the exporters themselves: torques that differ by more than a millionth raise."""
    export = export_model(estimate, name, tmp_path / f"arm{SUFFIX.get(name, '.txt')}")
    lacking = {term.part for term in export.left_out}
    if name in WHOLE:
        assert "seal" not in lacking
        return
    assert "seal" in lacking
    least = rest_of_two_numbers(estimate)
    if name == "drake":  # it holds no dry friction at all
        assert all(torque > 0.3 for torque in export.neglected.values())
    else:
        assert [*export.neglected.values()] == pytest.approx(least, rel=0.1)


def rest_of_two_numbers(estimate: Estimate) -> list[float]:
    """Return what is left of the friction of each joint, rms, beside the best damping and Coulomb friction."""
    seen, theta = estimate.envelope, estimate.theta
    assert seen is not None and theta is not None
    drawn = np.random.default_rng(0).normal(size=(20000, 6)) @ np.linalg.inv(seen.whitener)
    q, dq = (np.clip((seen.mean + drawn)[:, 2 * k : 2 * k + 2], seen.low[k], seen.high[k]) for k in (0, 1))
    seal, viscous = theta[-4::2], theta[-3::2]
    torque = seal * (1.2 + np.cos(q)) * np.tanh(dq / 0.05) + viscous * dq
    left = []
    for j in range(2):
        two = np.column_stack([dq[:, j], np.sign(dq[:, j])])
        rest = torque[:, j] - two @ np.linalg.lstsq(two, torque[:, j], rcond=None)[0]
        left.append(float(np.sqrt(np.mean(rest**2))))
    return left
