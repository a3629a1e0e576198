"""What every joint controller of the virtual cell must do: one battery for the whole folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.kernels.generic import WORK, pack
from dynident.model.robot import Link, Robot
from dynident.simulation.controllers import CONTROLLERS, Controller, Loop

PARTS = CONTROLLERS.names()
INERTIA = np.array([0.4, 1.5, 0.07])
PERIOD = 1e-3


@pytest.fixture(params=PARTS)
def part(request: pytest.FixtureRequest) -> Controller:
    return CONTROLLERS.make(request.param)


def robot(order: IntArray, size: float) -> Robot:
    """Return three turns beside each other on one base: what moves one says nothing about the others."""
    axes = np.eye(3)
    joints = tuple(
        Joint(f"j{k}", "revolute", -1, np.eye(3), np.array([0.3 * k, 0, 0]), axes[2]) for k in range(len(order))
    )
    links = tuple(
        Link(f"l{k}", Inertia.from_vector(size * INERTIA[k] * np.r_[1, 0, 0, 1, 0, 1, 0, 0, 0, 1])) for k in order
    )
    return Robot("star", links, joints, np.zeros(3))


def known(size: float = 1.0, places: Sequence[int] = (0, 1, 2)) -> Loop:
    """Return what is known of joints without friction that move as the usual loops let them, seen after 0.25 ms."""
    inertia = size * INERTIA[np.array(places)]
    return Loop(inertia, np.diag(inertia)[None], 2.5e-4, np.zeros(len(inertia)), np.zeros(len(inertia)))


class Bench:
    """A controller with its memory, driven tick by tick without a plant."""

    def __init__(
        self, part: Controller, order: Sequence[int] = (0, 1, 2), size: float = 1.0, limit: float = np.inf
    ) -> None:
        places = np.array(order)
        star, n = robot(places, size), len(places)
        assert star.nominal is not None
        self.settings = part.settings(known(size, order))
        self.memory, self.work = np.zeros((part.memory, n)), np.zeros((n + 1, WORK))
        self.model: Any = (*pack(star.chain), np.array(star.nominal), np.zeros((n, n)))
        self.robot, self.law = (np.full(n, limit), PERIOD, self.model), part.law()

    def tick(self, goal: Array, seen: Array) -> Array:
        """Return the torque of one tick, the memory counted on as the cell does."""
        tau = np.full(goal.shape[1], np.nan)
        self.law(self.settings, goal, seen, self.robot, self.memory, self.work, tau)
        self.memory[0] += 1.0
        return tau

    def run(self, goals: Array, seen: Array) -> Array:
        return np.array([self.tick(goal, at) for goal, at in zip(goals, seen, strict=True)])


def course(seed: int = 0, ticks: int = 12) -> tuple[Array, Array]:
    """Return goals (K, 5, n) and measurements (K, 2, n) of a motion that is not followed exactly."""
    generator = np.random.default_rng(seed)
    return generator.normal(size=(ticks, 5, 3)), generator.normal(size=(ticks, 2, 3))


def test_settings_are_finite_numbers_of_each_joint(part: Controller) -> None:
    loop = known()
    settings = part.settings(loop)
    assert settings.ndim == 2 and settings.shape[1] == 3
    assert np.all(np.isfinite(settings)) and np.all(settings >= 0)
    np.testing.assert_array_equal(part.settings(loop), settings)
    np.testing.assert_array_equal(loop.inertia, INERTIA)
    assert part.memory >= 1 and replace(part) == part


def test_every_tick_gives_finite_torques_and_changes_only_its_memory(part: Controller) -> None:
    goals, seen = course()
    bench = Bench(part)
    kept = [values.copy() for values in (goals, seen, bench.settings, bench.robot[0], *bench.model)]
    torques = bench.run(goals, seen)
    assert torques.shape == (12, 3) and np.all(np.isfinite(torques))
    for value, before in zip((goals, seen, bench.settings, bench.robot[0], *bench.model), kept, strict=True):
        np.testing.assert_array_equal(value, before)
    np.testing.assert_array_equal(bench.memory[0], 12.0)


def test_the_same_course_gives_the_same_torques(part: Controller) -> None:
    np.testing.assert_array_equal(Bench(part).run(*course(3)), Bench(part).run(*course(3)))


def test_on_its_goal_it_adds_nothing_to_what_is_fed_forward(part: Controller) -> None:
    goals = np.zeros((6, 5, 3))
    goals[:, 0], goals[:, 3] = 0.3, [1.0, -2.0, 0.5]
    goals[:, 4] = goals[:, 3]  # the bodies of the star need no torque at rest
    seen = np.zeros((6, 2, 3))
    seen[:, 0] = 0.3
    np.testing.assert_allclose(Bench(part).run(goals, seen), goals[:, 3], atol=1e-12)


@pytest.mark.parametrize("row", [0, 1], ids=["position", "speed"])
def test_it_works_against_the_error_of_each_joint_alone(part: Controller, row: int) -> None:
    goals, seen = np.zeros((8, 5, 3)), np.zeros((8, 2, 3))
    for joint in range(3):
        off = seen.copy()
        off[:, row, joint] = 0.01
        found = Bench(part).run(goals, off)
        assert np.all(found[:, joint] < 0)
        np.testing.assert_allclose(np.delete(found, joint, axis=1), 0.0, atol=1e-12)


def test_the_order_of_joints_does_not_matter(part: Controller) -> None:
    goals, seen = course(5)
    order = [2, 0, 1]
    found = Bench(part, order).run(np.ascontiguousarray(goals[:, :, order]), np.ascontiguousarray(seen[:, :, order]))
    np.testing.assert_allclose(found, Bench(part).run(goals, seen)[:, order], rtol=1e-12, atol=1e-12)


def test_another_unit_of_mass_changes_torques_by_itself(part: Controller) -> None:
    goals, seen = course(6)
    scaled = goals.copy()
    scaled[:, 3:] *= 1000.0
    found = Bench(part, size=1000.0).run(scaled, seen)
    np.testing.assert_allclose(found, 1000.0 * Bench(part).run(goals, seen), rtol=1e-9)


def test_what_it_remembers_does_not_grow_while_the_torque_is_at_its_limit(part: Controller) -> None:
    """After a second at the limit it turns round as soon as the error does."""
    goals, seen = np.zeros((1000, 5, 3)), np.zeros((1000, 2, 3))
    seen[:, 0] = 10.0
    bench = Bench(part, limit=1e-3)
    bench.run(goals, seen)
    turned = bench.run(goals[:8], -seen[:8])
    assert np.all(turned[-1] > 0)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -1.0])
def test_numbers_that_make_no_sense_are_refused_by_name(part: Controller, wrong: float) -> None:
    numbers = [f.name for f in fields(part) if isinstance(getattr(part, f.name), float)]
    assert numbers
    for name in numbers:
        with pytest.raises(BadOption, match=f"controller.{name}"):
            CONTROLLERS.make(CONTROLLERS.name_of(part), {name: wrong})


@pytest.mark.parametrize("name", [name for name in PARTS if hasattr(CONTROLLERS.get(name), "stiffness")])
def test_gains_for_another_number_of_joints_are_refused(name: str) -> None:
    with pytest.raises(BadOption, match=r"controller\.stiffness"):
        CONTROLLERS.make(name, {"stiffness": (1.0, 2.0)}).settings(known())
