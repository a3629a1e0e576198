"""Tracking with an identified model and with a nominal one that is 20 % wrong: computed torque in a virtual cell.

    python computed_torque.py

A SCARA arm is identified from a simulated run. Two controllers then follow another motion, alike but for the model:
masses, inertias and friction of the nominal one are 20 % too large. All runs are those of a virtual cell, whose
controller believes what it is told and knows nothing of the true parameters.
"""

import numpy as np

import dynident

robot = dynident.read_robot("generic-scara")
model = dynident.DynamicModel(robot, ["coulomb", "viscous"])
truth = np.asarray(model.nominal())  # the robots that ship state inertias, damping and friction
reach, offset = np.array([0.5, 0.5, 0.03, 0.6]), np.array([0.0, 0.3, 0.08, 0.0])
generator = np.random.default_rng(0)


def motion() -> dynident.FourierSeries:
    """Return a random periodic motion of 10 s."""
    sine, cosine = (reach[:, None] * generator.uniform(-1, 1, (4, 4)) / [1, 2, 3, 4] for _ in range(2))
    return dynident.FourierSeries(offset, sine, cosine, period=10.0)


def tracking_error(theta: np.ndarray, path: dynident.FourierSeries, seconds: float) -> np.ndarray:
    """Return the root mean square position error of each joint under computed torque with the parameters theta."""
    controller = dynident.CONTROLLERS.make("computed_torque", {"bandwidth_hz": 3.0, "feedforward": "model"})
    cell = dynident.Cell(controller, lead_in=1.0)
    return dynident.simulate_cell(model, truth, path, cell, duration=seconds, believed=theta).tracking_error()


sensors = {"encoder": dynident.Encoder(noise=(2e-6,)), "effort": dynident.Effort(noise=(1.0, 0.5, 2.0, 0.05))}
log = dynident.simulate_cell(
    model, truth, motion(), dynident.Cell(recorder=dynident.Recorder(rate=500.0), **sensors), seed=1
).log
estimate = dynident.identify(model, log)
path = motion()
errors = {
    name: tracking_error(theta, path, seconds=4.0)
    for name, theta in {"nominal": 1.2 * truth, "identified": dynident.parameters_of(estimate), "true": truth}.items()
}
for name, error in errors.items():
    print(f"{name:10} " + " ".join(f"{value:.3e}" for value in error) + " rad or m")
total = {name: float(np.linalg.norm(error / reach)) for name, error in errors.items()}
print(f"identified over nominal: {total['identified'] / total['nominal']:.3f}")
