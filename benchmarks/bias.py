"""Bias by encoder noise: unfiltered differences of noisy positions in closed loop, a Monte Carlo over the noise.

A three-joint and a six-joint arm follow one motion under a stated joint controller; positions have white noise, the
controller sees it, velocities and accelerations are plain central differences. Printed per method: the norm of the mean
error over that of the truth (columns scaled by their norms), the largest bias of a parameter in Monte Carlo deviations,
stated over true deviation (median), and how often the test of Durbin, Wu and Hausman finds least squares biased at 1 %.
Run: python -m benchmarks.bias [runs]
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace

import numpy as np

from dynident import DynamicModel, FourierSeries, Preprocessing, read_robot
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import central_differences
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.ols import OLS
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.residuals.instruments import instruments
from dynident.identification.simulated.closed_loop import simulated_logs
from dynident.identification.simulated.estimators.didim import DIDIM
from dynident.identification.simulated.estimators.iv import IV
from dynident.identification.simulated.iteration import started
from dynident.identification.uncertainty.exogeneity import durbin_wu_hausman
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.simulation.controllers.pd import Pd
from dynident.simulation.plant import plant
from dynident.simulation.virtual_robot import Noise, Timing, simulate
from dynident.studies.er16_article import LOCKED

NOISE, RATE, CONTROL, PERIOD, BANDWIDTH = 1e-4, 200.0, 2000.0, 5.0, 5.0


def cell(robot, size):
    """Return the model, its parameters, the motion and the controller's gains."""
    model = DynamicModel(robot, (Coulomb(0.2), Viscous()))
    theta = np.concatenate([robot.nominal, np.tile([2.0, 3.0], robot.dof)])
    sine, cosine = size * np.random.default_rng(0).normal(size=(2, robot.dof, 5))
    path = FourierSeries(np.zeros(robot.dof), sine, cosine, PERIOD)
    masses = plant(model, theta).masses(path.evaluate(np.linspace(0, PERIOD, 100))[0])
    pulsation = 2 * np.pi * BANDWIDTH
    stiffness = pulsation**2 * np.diagonal(masses, axis1=1, axis2=2).mean(axis=0)
    return model, theta, path, stiffness, 2 * stiffness / pulsation


def problem_of(model, theta, path, stiffness, damping, seed):
    controller = Pd(rate=CONTROL, stiffness=tuple(stiffness), damping=tuple(damping), feedforward="none")
    noise = Noise(position=NOISE, torque=0.2)
    run = simulate(model, theta, path, timing=Timing(rate=RATE), controller=controller, noise=noise, seed=seed)
    if run.saturated:
        raise SystemExit(f"{run.saturated} torques were cut at their limits")
    dq = central_differences(run.log.q, run.log.rate)
    log = replace(run.log, dq=dq, ddq=central_differences(dq, run.log.rate))
    return build_problem(model, [log], Preprocessing(AsGiven(), rest="keep", trim_s=0.1))


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    arms = (("er16, 3 joints", read_robot("er16").locked(LOCKED), 0.08), ("6r", read_robot("generic-6r"), 0.08))
    for name, robot, size in arms:
        model, theta, path, stiffness, damping = cell(robot, size)
        known = DIDIM(kp=tuple(stiffness), kd=tuple(damping), control_hz=CONTROL)
        methods = {"ols": OLS(), "wls": WLS(), "iv": IV(), "didim": known}
        errors, stated, detected, seconds = (
            {m: [] for m in methods},
            {m: [] for m in methods},
            0,
            dict.fromkeys(methods, 0.0),
        )
        norms, truth = np.ones(1), np.ones(1)
        for seed in range(runs):
            problem = problem_of(model, theta, path, stiffness, damping, seed)
            truth, norms = problem.base.from_standard(theta), problem.reduced().column_norms
            for method, part in methods.items():
                start = time.perf_counter()
                estimate = fit(problem, part)
                seconds[method] += (time.perf_counter() - start) / runs
                errors[method].append(estimate.beta - truth)
                stated[method].append(estimate.std)
            loop, begin = started(problem, IV(), as_instruments=True)
            made = instruments(problem, simulated_logs(loop, loop.simulate(begin)))
            detected += durbin_wu_hausman(made).is_biased(0.01)
        print(f"{name}: {len(truth)} base parameters, {runs} runs, encoder noise {NOISE:g} rad, {RATE:g} Hz")
        for method in methods:
            error, own = np.array(errors[method]), np.array(stated[method])
            spread = error.std(axis=0, ddof=1)
            print(
                json.dumps(
                    {
                        "method": method,
                        "bias_of_truth": round(
                            float(np.linalg.norm(error.mean(0) * norms) / np.linalg.norm(truth * norms)), 5
                        ),
                        "median_bias_in_deviations": round(float(np.median(np.abs(error.mean(0)) / spread)), 2),
                        "largest_bias_in_deviations": round(float(np.max(np.abs(error.mean(0)) / spread)), 2),
                        "stated_over_true_deviation": round(float(np.median(own.mean(0) / spread)), 2),
                        "seconds": round(seconds[method], 2),
                    }
                )
            )
        print(f"bias of least squares detected in {detected} of {runs}")


if __name__ == "__main__":
    main()
