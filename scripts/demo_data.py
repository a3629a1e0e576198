"""Write the virtual arm of ``dynident demo``: a URDF with wrong inertias, and a log of the true arm in closed loop.

The true arm is ``generic-6r`` with its friction and rotors. Its URDF states other bodies, as one from CAD does: masses
up to 25 % off, centres of mass up to 3 cm. The motion is the best of random Fourier series by the condition number; the
log has noise of encoders and torques, at 100 Hz. The seed fixes all of it.

  python scripts/demo_data.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import dynident as di

TARGET = Path(__file__).resolve().parent.parent / "src" / "dynident" / "api" / "demo_data"
SEED, PERIOD, HARMONICS, RATE, TRIALS = 26, 12.0, 5, 100.0, 200
FRICTION = ["coulomb", "viscous"]


def main() -> None:
    """Write both files."""
    generator = np.random.default_rng(SEED)
    robot = di.read_robot("generic-6r")
    model = di.DynamicModel(robot, FRICTION)
    truth = np.asarray(model.nominal())
    motion = best_motion(model, generator)
    torque = model.torque(*motion.evaluate(np.arange(0.0, PERIOD, 0.01)), truth)
    noise = di.Noise(position=5e-6, torque=0.01 * torque.std(axis=0))
    timing = di.Timing(duration=2.0 * PERIOD, rate=RATE)
    log = di.simulate(model, truth, motion, timing=timing, noise=noise, seed=SEED).log
    write_log(log, TARGET / "run.csv")
    estimate = di.identify(model, log, "wls", trust=di.TrustOptions())
    stated = np.append(np.concatenate([off(link.inertia, generator) for link in robot.links]), truth[60:] * 0.0)
    drawing = replace(estimate, theta=stated, beta=estimate.base.from_standard(stated))
    drawing.export("urdf", TARGET / "arm.urdf")
    (TARGET / "arm.urdf.dynident.json").unlink()


def best_motion(model: di.DynamicModel, generator: np.random.Generator) -> di.FourierSeries:
    """Return the Fourier series with the best conditioned columns of those that keep the limits of speed."""
    base = di.base_parameters(model)
    reach = np.array([1.5, 0.7, 0.9, 1.2, 1.2, 1.5])
    centre = np.array([0.0, -1.2, 1.2, 0.0, 0.6, 0.0])
    speed = np.array([joint.limits.velocity for joint in model.robot.active])
    best, found = np.inf, None
    for _ in range(TRIALS):
        sine, cosine = generator.uniform(-1, 1, (2, 6, HARMONICS)) / np.arange(1, HARMONICS + 1)
        series = di.FourierSeries(centre, sine, cosine, period=PERIOD)
        q, dq, _ = series.evaluate(np.arange(0.0, PERIOD, 0.05))
        scale = np.minimum(reach / np.abs(q - centre).max(axis=0), 0.8 * speed / np.abs(dq).max(axis=0))[:, None]
        series = di.FourierSeries(centre, sine * scale, cosine * scale, period=PERIOD)
        columns = model.regressor(*series.evaluate(np.arange(0.0, PERIOD, 0.05)))[..., base.independent]
        columns = columns.reshape(-1, base.count)
        condition = float(np.linalg.cond(columns / np.linalg.norm(columns, axis=0)))
        if condition < best:
            best, found = condition, series
    assert found is not None
    return found


def off(body: di.Inertia | None, generator: np.random.Generator) -> np.ndarray:
    """Return the ten parameters of a body like another one, as far off as one from CAD."""
    assert body is not None
    mass = body.mass * (1.0 + generator.uniform(-0.25, 0.25))
    centre = np.asarray(body.centre_of_mass) + generator.uniform(-0.03, 0.03, 3)
    return di.Inertia.from_centre_of_mass(mass, centre, np.asarray(body.about_centre) * mass / body.mass).vector


def write_log(log: di.Log, path: Path) -> None:
    """Write time, positions and torques with as many digits as the sensors have."""
    heads = ["t", *(f"{word}{k + 1}" for word in ("q", "tau") for k in range(6))]
    table = np.column_stack([log.time, np.asarray(log.q), np.asarray(log.torque)])
    formats = ["%.2f"] + ["%.6f"] * 6 + ["%.3f"] * 6
    np.savetxt(path, table, fmt=formats, delimiter=",", header=",".join(heads), comments="")


if __name__ == "__main__":
    main()
