"""Gains that a controller chooses by itself: light arms with dry friction follow their motion."""

from __future__ import annotations

import numpy as np
import pytest

from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, JointLimits
from dynident.model.robot import Link, Robot
from dynident.simulation.cell import Cell, CellRun
from dynident.simulation.cell_simulation import NEAR, simulate_cell
from dynident.simulation.controllers import CONTROLLERS, Controller
from dynident.simulation.controllers.base import SAFE, Loop, following
from dynident.simulation.effects import Encoder

X, Y, Z = np.eye(3)


def arm(lengths: list[float], masses: list[float], axes: list[np.ndarray], effort: float, rotor: float) -> Robot:
    """Return an arm of links that point up, with the inertia of a rotor at each joint."""
    links, joints, below = [], [], 0.0
    for k, (length, mass, axis) in enumerate(zip(lengths, masses, axes, strict=True)):
        about = mass * length**2 / 12
        body = Inertia.from_centre_of_mass(mass, [0.02 * length, 0, length / 2], np.diag([about, about, 0.2 * about]))
        links.append(Link(f"link{k + 1}", body))
        limits = JointLimits(-2.0, 2.0, 8.0, effort=effort)
        joints.append(Joint(f"joint{k + 1}", "revolute", k - 1, np.eye(3), below * Z, axis, limits, Drive(1.0, rotor)))
        below = length
    return Robot("small", tuple(links), tuple(joints))


#: A hobby arm of five bus servos (100 g links, 0.05 N m of dry and 0.2 N m s of viscous friction), and one of grams.
HOBBY = arm([0.05, 0.116, 0.135, 0.06, 0.09], [0.15, 0.1, 0.1, 0.06, 0.08], [Z, Y, Y, Y, Z], 2.9, 1e-4)
GRAMS = arm([0.03, 0.04, 0.03], [0.008, 0.005, 0.003], [Z, Y, X], 0.05, 1e-6)
HEAVY = arm([0.3, 0.7, 0.6, 0.2], [60.0, 40.0, 20.0, 6.0], [Z, Y, Y, X], 3000.0, 2.0)
FRICTION = {"hobby": (HOBBY, 0.05, 0.2), "grams": (GRAMS, 0.002, 0.0005)}


def run(robot: Robot, dry: float, viscous: float, controller: Controller, size: float = 0.5) -> CellRun:
    """Return a swing of half a radian, once in 2 s, with encoders of a hobby servo's kind."""
    model = DynamicModel(robot, (Coulomb(0.05), Viscous()))
    assert robot.nominal is not None
    theta = np.concatenate([robot.nominal, np.tile([dry, viscous], robot.dof)])
    phase = np.arange(robot.dof)[:, None]
    motion = FourierSeries(np.full(robot.dof, 0.2), size * np.sin(phase), size * np.cos(phase), 2.0)
    cell = Cell(controller, Encoder((1e-4,), (2e-5,)), lead_in=0.5)
    return simulate_cell(model, theta, motion, cell, seed=2)


@pytest.mark.parametrize("kind", sorted(FRICTION))
@pytest.mark.parametrize("name", ["pd", "pid"])
def test_a_small_arm_with_dry_friction_follows_by_default(kind: str, name: str) -> None:
    found = run(*FRICTION[kind], CONTROLLERS.make(name))
    moved = np.std(np.asarray(found.log.q_ref), axis=0)
    assert not found.left_behind() and found.saturated == 0
    assert np.all(found.tracking_error() < 1.5 * NEAR * moved)


@pytest.mark.parametrize("kind", sorted(FRICTION))
def test_at_the_usual_bandwidth_it_would_stick(kind: str) -> None:
    assert run(*FRICTION[kind], CONTROLLERS.make("pd", {"bandwidth_hz": 8.0})).left_behind()


def test_an_arm_that_follows_anyway_has_the_usual_bandwidth() -> None:
    chosen = run(HEAVY, 3.0, 5.0, CONTROLLERS.make("pd"), 0.2)
    usual = run(HEAVY, 3.0, 5.0, CONTROLLERS.make("pd", {"bandwidth_hz": 8.0}), 0.2)
    np.testing.assert_array_equal(chosen.log.torque, usual.log.torque)
    assert not usual.left_behind()


def test_what_is_fed_forward_needs_no_stiffness() -> None:
    robot, dry, viscous = FRICTION["grams"]
    fed = run(robot, dry, viscous, CONTROLLERS.make("pd", {"feedforward": "model"}))
    usual = run(robot, dry, viscous, CONTROLLERS.make("pd", {"feedforward": "model", "bandwidth_hz": 8.0}))
    np.testing.assert_array_equal(fed.log.torque, usual.log.torque)
    assert not fed.left_behind()


def test_a_slow_controller_is_as_stiff_as_its_ticks_allow() -> None:
    fast, found = (following(loop_at(rate), 1.0) for rate in (2000.0, 200.0))
    slow = loop_at(200.0)
    assert np.all(found[0] <= fast[0]) and found[0][1] < 0.5 * fast[0][1] and slow.decay(found[1]) <= SAFE
    ratio = (found[1] + slow.friction) / (2 * np.sqrt(found[0] * slow.inertia))
    assert np.all(ratio >= 0.5 - 1e-9)


def loop_at(rate: float) -> Loop:
    """Return two joints of which the second is light and has friction that damps."""
    masses = np.array([[[0.02, 0.002], [0.002, 0.001]]])
    return Loop(np.array([0.02, 0.001]), masses, 1.0 / rate, np.array([0.0, 0.05]), np.array([80.0, 300.0]))
