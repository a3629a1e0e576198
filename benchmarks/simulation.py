"""25 s of a 6R arm under control, RK4 at 1 kHz: the compiled loop beside a Python loop over pinocchio.aba.

Both integrate the same plant (viscous and Coulomb friction, rotor inertia) under the same sampled controller and must
end in the same state. Run: python -m benchmarks.simulation
"""

from __future__ import annotations

import time

import numpy as np
import pinocchio

from dynident.experiment.simulation.plant import plant
from dynident.experiment.simulation.virtual_robot import Controller, simulate
from dynident.experiment.trajectories.fourier import FourierSeries
from dynident.model.descriptions import read_robot
from dynident.model.dynamic_model import DynamicModel

SECONDS, RATE, REPEATS = 25.0, 1000, 3
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
    """Return the shortest of a few times in s, and the result."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return min(times), result


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

    apart = max(np.abs(run.truth.q[-1] - q).max(), np.abs(run.truth.dq[-1] - dq).max())
    print(f"{SECONDS:g} s of {robot.name} at {RATE} Hz, RK4, best of {REPEATS}")
    print(f"  dynident, whole call       {mine:8.3f} s   (first call {first:.2f} s)")
    print(f"  pinocchio.aba, Python loop {theirs:8.3f} s")
    print(f"  ratio {theirs / mine:.1f}, end states {apart:.1e} apart (rad, rad/s)")
    if not apart < 1e-9:
        raise SystemExit("the two simulations differ")


if __name__ == "__main__":
    main()
