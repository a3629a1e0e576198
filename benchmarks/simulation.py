"""25 s of a 6R arm under control, RK4 at 1 kHz: the compiled loops beside a Python loop over pinocchio.aba.

All integrate the same plant (viscous and Coulomb friction, rotor inertia) under the same sampled controller and must
end in the same state. Then the virtual cell has all effects that stiff joints know, and bristles at the steps that they
ask for, beside the same bare Python loop. Run: python -m benchmarks.simulation
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pinocchio

from dynident.experiment.simulation import cell_simulation
from dynident.experiment.simulation.cell import Cell
from dynident.experiment.simulation.controllers import CONTROLLERS
from dynident.experiment.simulation.effects import Bristles, Effort, Encoder, Payload, Recorder, Ripple, Tilt, Warming
from dynident.experiment.simulation.plant import plant
from dynident.experiment.simulation.virtual_robot import Controller, simulate
from dynident.experiment.trajectories.fourier import FourierSeries
from dynident.model.descriptions import read_robot
from dynident.model.dynamic_model import DynamicModel

SECONDS, RATE, REPEATS = 25.0, 1000, 5
STIFFNESS, DAMPING, WIDTH, COULOMB = 1500.0, 80.0, 0.02, 2.0


def as_pinocchio(robot, armature):
    """Return the robot as a pinocchio model, joint by joint."""
    model = pinocchio.Model()
    for link, joint in zip(robot.links, robot.joints, strict=True):
        place = pinocchio.SE3(np.array(joint.rotation), np.array(joint.translation))
        turning = pinocchio.JointModelRevoluteUnaligned(np.array(joint.axis))
        index = model.addJoint(joint.parent + 1, turning, place, joint.name)
        body = link.inertia
        inertia = pinocchio.Inertia(body.mass, body.centre_of_mass, body.about_centre)
        model.appendBodyToJoint(index, inertia, pinocchio.SE3.Identity())
    model.gravity.linear = np.array(robot.gravity)
    model.armature = np.diagonal(armature).copy()
    return model


def python_loop(model, viscous, reference, rows):
    """Return the last state of the same simulation as a Python loop over aba."""
    data, step = model.createData(), 1.0 / RATE
    q, dq = reference[0, 0].copy(), reference[0, 1].copy()

    def slope(q, dq, tau):
        friction = COULOMB * np.tanh(dq / WIDTH) + viscous * dq
        return pinocchio.aba(model, data, q, dq, tau - friction).copy()

    for k in range(rows - 1):
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


def best(function):
    """Return the shortest of a few processor times in s, which other programs disturb little, and the result."""
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        result = function()
        times.append(time.process_time() - start)
    return min(times), result


def best_of_cell(*arguments):
    """Return the shortest times of the compiled loop alone and of the whole call of a cell, in s, and its run."""
    loops, ready = [], cell_simulation._compiled

    def timed(*own):
        loop = ready(*own)

        def run(*values):
            start = time.process_time()
            result = loop(*values)
            loops.append(time.process_time() - start)
            return result

        return run

    cell_simulation._compiled = timed
    whole, run = best(lambda: cell_simulation.simulate_cell(*arguments))
    cell_simulation._compiled = ready
    return min(loops), whole, run


def full_cell():
    """Return a cell with every effect of stiff joints but bristles."""
    return Cell(
        CONTROLLERS.make("pid", rate=RATE, delay_s=1e-3, current_hz=200.0),
        Encoder((1e-5,), (2e-6,), velocity="difference", filter_hz=100.0),
        Ripple((0.5,), (101.0,)),
        warming=Warming(end=(45.0,), time_constant=60.0, per_kelvin=-0.01),
        payload=Payload(1.0, (0.0, 0.0, 0.1)),
        tilt=Tilt(0.02, 0.02),
        effort=Effort((0.3,), (0.05,), 0.002),
        recorder=Recorder(RATE, 1e-4, dropped=0.01),
        lead_in=0.0,
    )


def model_with_all_friction(robot):
    """Return the model with every friction part at once, and its parameters."""
    parts = ("asymmetric", "viscous", "offset", "stribeck", "polynomial", "degressive", "load", "periodic")
    model = DynamicModel(robot, (*parts, "temperature", "rotor_inertia"))
    values = [2.0, 1.8, 5.0, 0.2, 0.5, 0.2, 0.1, 0.5, 0.03, 0.1, 0.1, 0.1, 0.1, -0.01, -0.01, 0.05]
    return model, np.concatenate([robot.nominal, np.tile(values, robot.dof)])


def main() -> None:
    robot = read_robot("generic-6r")
    model = DynamicModel(robot, ("coulomb", "viscous"))
    theta = model.nominal()
    assert theta is not None
    theta = theta.copy()
    theta[model.inertial_count :: 2] = COULOMB
    viscous = theta[model.inertial_count + 1 :: 2]
    generator = np.random.default_rng(0)
    sine, cosine = 0.15 * generator.normal(size=(2, 6, 5))
    motion = FourierSeries(np.array([0, -1.0, 1.0, 0, 0.5, 0]), sine, cosine, SECONDS)
    controller = Controller(rate=RATE, stiffness=STIFFNESS, damping=DAMPING)
    rows = round(SECONDS * RATE)

    def ours():
        return simulate(model, theta, motion, rate=RATE, integration_rate=RATE, controller=controller, lead_in=0.0)

    start = time.perf_counter()
    ours()
    first = time.perf_counter() - start
    mine, run = best(ours)

    body = plant(model, theta)
    goal = motion.evaluate(np.arange(rows) / RATE)
    reference = np.stack([goal[0], goal[1], body.gravity(goal[0])], axis=1)
    oracle = as_pinocchio(robot, body.armature)
    theirs, (q, dq) = best(lambda: python_loop(oracle, viscous, reference, rows))

    pd = CONTROLLERS.make("pd", rate=RATE, stiffness=(STIFFNESS,), damping=(DAMPING,))
    bare = Cell(pd, lead_in=0.0, integration_rate=RATE)
    every, other = model_with_all_friction(robot)
    soft = replace(full_cell(), bristles=Bristles(2e-3, stiction=0.2))
    cells = {
        "bare": best_of_cell(model, theta, motion, bare),
        "all effects": best_of_cell(every, other, motion, full_cell()),
        "and bristles": best_of_cell(every, other, motion, soft),
    }
    kept = cells["bare"][2]

    apart = max(np.abs(run.truth.q[-1] - q).max(), np.abs(run.truth.dq[-1] - dq).max())
    print(f"{SECONDS:g} s of {robot.name} at {RATE} Hz, RK4, processor time, best of {REPEATS}")
    print(f"  dynident, whole call       {mine:8.3f} s   (first call {first:.2f} s)")
    print(f"  pinocchio.aba, Python loop {theirs:8.3f} s")
    print(f"  ratio {theirs / mine:.1f}, end states {apart:.1e} apart (rad, rad/s)")
    away = max(np.abs(kept.truth.q[-1] - q).max(), np.abs(kept.truth.dq[-1] - dq).max())
    print("  virtual cell                loop   ratio   whole call   ratio")
    for name, (loop, whole, found) in cells.items():
        rate = f"{found.integration_rate:g} Hz"
        print(f"    {name:<13}{rate:>8} {loop:7.3f} s {theirs / loop:6.1f} {whole:10.3f} s {theirs / whole:6.1f}")
    print(f"  its end state is {away:.1e} from that of pinocchio")
    if not max(apart, away) < 1e-9:
        raise SystemExit("the two simulations differ")


if __name__ == "__main__":
    main()
