"""From a simulated experiment to a report: a SCARA arm in closed loop with noise, whose truth is known.

    python identify_virtual_robot.py [FOLDER]

Writes the logs, the estimate and the report into FOLDER (the working directory by default).
"""

import sys
from pathlib import Path

import numpy as np

import dynident

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
robot = dynident.read_robot("generic-scara")
model = dynident.DynamicModel(robot, ["coulomb", "viscous"])
truth = np.asarray(model.nominal())  # the robots that ship state inertias, damping and friction

generator = np.random.default_rng(0)
reach = np.array([0.5, 0.5, 0.03, 0.6])  # rad, rad, m, rad
offset = np.array([0.0, 0.3, 0.08, 0.0])
noise = dynident.Noise(position=2e-6, torque=[1.0, 0.5, 2.0, 0.05])


def record(name: str, seed: int) -> dynident.Log:
    """Simulate a run of 10 s along a random Fourier series and write its log."""
    sine, cosine = (reach[:, None] * generator.uniform(-1, 1, (4, 4)) / [1, 2, 3, 4] for _ in range(2))
    trajectory = dynident.FourierSeries(offset, sine, cosine, period=10.0)
    log = dynident.simulate(model, truth, trajectory, timing=dynident.Timing(rate=500.0), noise=noise, seed=seed).log
    dynident.write_log(log, folder / name)
    return log


train, test = record("train.csv", seed=1), record("test.csv", seed=2)
estimate = dynident.identify(model, train)
validation = dynident.validate(estimate, test)
estimate.save(folder / "estimate.json")
dynident.write_report(folder / "report.html", estimate, [validation])

known = estimate.base.from_standard(truth)
for parameter, true in zip(estimate.parameters(), known, strict=True):
    value, std = parameter["value"], parameter["std"]
    print(f"{parameter['name']:45} {value:9.4f} +- {std:.4f}  truth {true:9.4f} {parameter['unit']}")
print(f"relative torque error on the test run: {validation.total_relative_error:.2%}")
print(f"physically consistent: {estimate.consistency.consistent}")
