"""25 s of a 6R arm under control, RK4 at 1 kHz: the compiled loop beside a Python loop over pinocchio.aba.

Pinocchio integrates the same plant (viscous and Coulomb friction) under the same sampled controller and must end in the
same state.
model there; its figure is only beside ours. Then the virtual cell, from bare to all effects, beside the same bare loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.speed.arms import as_pinocchio
from benchmarks.speed.harness import Line, Record
from dynident.arrays import Array
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.simulation.cell import Cell
from dynident.simulation.cell_simulation import simulate_cell
from dynident.simulation.controllers import CONTROLLERS
from dynident.simulation.effects import Bristles, Effort, Encoder, Payload, Recorder, Ripple, Tilt, Warming
from dynident.simulation.plant import plant

SECONDS, RATE, REPEATS = 25.0, 1000, 5
STIFFNESS, DAMPING, WIDTH, COULOMB = 1500.0, 80.0, 0.02, 2.0
HERE, LOOP = "virtual robot, whole call", "Pinocchio aba, Python loop"
CELLS = {"effects": "virtual cell, all effects", "bristles": "virtual cell, and bristles"}


def measure() -> Record:
    found = Record("simulation", f"{SECONDS:g} s of a 6R arm under control at {RATE} Hz, RK4")
    robot = read_robot("generic-6r")
    model = DynamicModel(robot, ("coulomb", "viscous"))
    nominal = model.nominal()
    assert nominal is not None
    theta = nominal.copy()
    theta[model.inertial_count :: 2] = COULOMB
    sine, cosine = 0.15 * np.random.default_rng(0).normal(size=(2, 6, 5))
    motion = FourierSeries(np.array([0, -1.0, 1.0, 0, 0.5, 0]), sine, cosine, SECONDS)
    pd = CONTROLLERS.make("pd", {"rate": RATE, "stiffness": (STIFFNESS,), "damping": (DAMPING,)})
    bare = Cell(pd, lead_in=0.0, integration_rate=RATE)
    every, other = _all_friction(robot)
    soft = replace(_full_cell(), bristles=Bristles(2e-3, stiction=0.2))
    calls: dict[str, Callable[[], Any]] = {
        HERE: lambda: simulate_cell(model, theta, motion, bare),
        CELLS["effects"]: lambda: simulate_cell(every, other, motion, _full_cell()),
        CELLS["bristles"]: lambda: simulate_cell(every, other, motion, soft),
    }
    if pinocchio := found.peer("pinocchio", "pin"):
        body, rows = plant(model, theta), round(SECONDS * RATE)
        goal = motion.evaluate(np.arange(rows) / RATE)
        reference = np.stack([goal[0], goal[1], body.gravity(goal[0])], axis=1)
        oracle, viscous = as_pinocchio(robot, body.armature), theta[model.inertial_count + 1 :: 2]
        calls[LOOP] = lambda: _python_loop(pinocchio, oracle, viscous, reference)
        end = np.concatenate(calls[LOOP]())
        truth = calls[HERE]().truth
        found.agree(f"end states of {HERE} and Pinocchio, rad and rad/s", _apart(truth, end), 1e-9)
    found.time(calls, REPEATS)
    found.lines = [Line("25 s of a 6R arm under control, RK4 at 1 kHz", HERE, LOOP, 4.0)]
    found.lines += [Line(f"{name}, beside the same bare loop", name, LOOP) for name in CELLS.values()]
    return found


def _apart(truth: Any, end: Array) -> float:
    return float(np.abs(np.concatenate([truth.q[-1], truth.dq[-1]]) - end).max())


def _python_loop(pinocchio: Any, model: Any, viscous: Array, reference: Array) -> tuple[Array, Array]:
    """Return the last state of the same simulation as a Python loop over aba."""
    data, step = model.createData(), 1.0 / RATE
    q, dq = reference[0, 0].copy(), reference[0, 1].copy()

    def slope(q: Array, dq: Array, tau: Array) -> Array:
        friction = COULOMB * np.tanh(dq / WIDTH) + viscous * dq
        return pinocchio.aba(model, data, q, dq, tau - friction).copy()

    for k in range(len(reference) - 1):
        tau = reference[k, 2] + STIFFNESS * (reference[k, 0] - q) + DAMPING * (reference[k, 1] - dq)
        a1 = slope(q, dq, tau)
        v2 = dq + step / 2 * a1
        a2 = slope(q + step / 2 * dq, v2, tau)
        v3 = dq + step / 2 * a2
        a3 = slope(q + step / 2 * v2, v3, tau)
        v4 = dq + step * a3
        a4 = slope(q + step * v3, v4, tau)
        q = q + step / 6 * (dq + 2 * (v2 + v3) + v4)
        dq = dq + step / 6 * (a1 + 2 * (a2 + a3) + a4)
    return q, dq


def _full_cell() -> Cell:
    """Return a cell with every effect of stiff joints but bristles."""
    return Cell(
        CONTROLLERS.make("pid", {"rate": RATE, "delay_s": 1e-3, "current_hz": 200.0}),
        Encoder((1e-5,), (2e-6,), velocity="difference", filter_hz=100.0),
        Ripple((0.5,), (101.0,)),
        warming=Warming(end=(45.0,), time_constant=60.0, per_kelvin=-0.01),
        payload=Payload(1.0, (0.0, 0.0, 0.1)),
        tilt=Tilt(0.02, 0.02),
        effort=Effort((0.3,), (0.05,), 0.002),
        recorder=Recorder(RATE, 1e-4, dropped=0.01),
        lead_in=0.0,
    )


def _all_friction(robot: Robot) -> tuple[DynamicModel, Array]:
    """Return the model with every friction part at once, and its parameters."""
    parts = ("asymmetric", "viscous", "offset", "stribeck", "polynomial", "degressive", "load", "periodic")
    model = DynamicModel(robot, (*parts, "temperature", "rotor_inertia"))
    values = [2.0, 1.8, 5.0, 0.2, 0.5, 0.2, 0.1, 0.5, 0.03, 0.1, 0.1, 0.1, 0.1, -0.01, -0.01, 0.05]
    return model, np.concatenate([robot.nominal, np.tile(values, robot.dof)])
