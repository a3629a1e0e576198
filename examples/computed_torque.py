"""Tracking with an identified model and with a nominal one that is 20 % wrong: computed torque in a virtual cell.

    python computed_torque.py

A SCARA arm is identified from a simulated run. Two controllers then follow another motion, alike but for the model:
masses, inertias and friction of the nominal one are 20 % too large. The plant is integrated by the classical
Runge-Kutta rule, the torque is held between the ticks of the controller.
"""

import numpy as np

import dynident
from dynident.estimation.compensation import computed_torque, friction_torque, mass_matrices, parameters_of
from dynident.experiment.simulation.virtual_robot import Noise
from dynident.model.kernels import batched

robot = dynident.read_robot("generic-scara")
model = dynident.DynamicModel(robot, tuple(dynident.FRICTION.make(name) for name in ("coulomb", "viscous")))
truth = np.asarray(model.nominal())  # the robots that ship state inertias, damping and friction
reach, offset = np.array([0.5, 0.5, 0.03, 0.6]), np.array([0.0, 0.3, 0.08, 0.0])
generator = np.random.default_rng(0)


def motion() -> dynident.FourierSeries:
    """Return a random periodic motion of 10 s."""
    sine, cosine = (reach[:, None] * generator.uniform(-1, 1, (4, 4)) / [1, 2, 3, 4] for _ in range(2))
    return dynident.FourierSeries(offset, sine, cosine, period=10.0)


def acceleration(q: np.ndarray, dq: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Return the acceleration of the true robot."""
    inertial = truth[: model.inertial_count]
    bias = batched.inverse_dynamics(robot.chain, inertial, q[None], dq[None], np.zeros((1, len(q))))[0]
    return np.linalg.solve(mass_matrices(model, truth, q), torque - bias - friction_torque(model, truth, q, dq))


def tracking_error(theta: np.ndarray, path: dynident.FourierSeries, seconds: float, step: float = 4e-3) -> np.ndarray:
    """Return the root mean square position error of each joint under computed torque with the parameters theta."""
    times = np.arange(round(seconds / step)) * step
    planned = path.evaluate(times)
    q, dq = planned[0][0].copy(), planned[1][0].copy()
    errors = np.empty((len(times), robot.dof))
    stiffness = (2 * np.pi * 3.0) ** 2
    for k, goal in enumerate(zip(*planned, strict=True)):
        errors[k] = goal[0] - q
        torque = computed_torque(model, theta, goal, q, dq, stiffness, 2 * stiffness**0.5)
        half = 0.5 * step
        a1 = acceleration(q, dq, torque)
        a2 = acceleration(q + half * dq, dq + half * a1, torque)
        a3 = acceleration(q + half * dq + half**2 * a1, dq + half * a2, torque)
        a4 = acceleration(q + step * dq + step * half * a2, dq + step * a3, torque)
        q = q + step * dq + step**2 / 6 * (a1 + a2 + a3)
        dq = dq + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return np.sqrt(np.mean(errors**2, axis=0))


noise = Noise(position=2e-6, torque=[1.0, 0.5, 2.0, 0.05])
log = dynident.simulate(model, truth, motion(), rate=500.0, noise=noise, seed=1).log
estimate = dynident.identify(model, [log])
path = motion()
errors = {
    name: tracking_error(theta, path, seconds=2.0)
    for name, theta in {"nominal": 1.2 * truth, "identified": parameters_of(estimate), "true": truth}.items()
}
for name, error in errors.items():
    print(f"{name:10} " + " ".join(f"{value:.3e}" for value in error) + " rad or m")
total = {name: float(np.linalg.norm(error / reach)) for name, error in errors.items()}
print(f"identified over nominal: {total['identified'] / total['nominal']:.3f}")
