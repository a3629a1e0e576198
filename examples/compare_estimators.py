"""Several estimators on one log: the rows are reduced once, and each method solves the same problem.

    python compare_estimators.py

The log is short and noisy. Unconstrained least squares then finds bodies that cannot exist; the consistent estimator
does not, and here it predicts an unseen run better.
"""

import numpy as np

import dynident

robot = dynident.read_robot("generic-6r")
model = dynident.DynamicModel(robot, ["coulomb", "viscous"])
truth = np.asarray(model.nominal())  # the robots that ship state inertias, damping and friction
generator = np.random.default_rng(4)


def run(seconds: float, noise: float) -> dynident.Log:
    """Return a log of a random Fourier motion with exact derivatives, torques with noise (share of their size)."""
    series = [generator.uniform(-0.4, 0.4, shape) for shape in (6, (6, 5), (6, 5))]
    time = np.arange(0, seconds, 0.01)
    q, dq, ddq = dynident.FourierSeries(*series, period=10.0).evaluate(time)
    torque = model.torque(q, dq, ddq, truth)
    torque = torque + noise * torque.std(axis=0) * generator.normal(size=torque.shape)
    return dynident.Log(robot.joint_names, time, q, dq, ddq, torque)


how = dynident.Preprocessing(dynident.FILTERS.make("as_given"), standstill=0.02)
problem = dynident.build_problem(model, [run(seconds=4.0, noise=0.2)], how)
unseen = run(seconds=10.0, noise=0.0)

print(f"{'estimator':12} {'training error':>15} {'unseen error':>13}  possible robot")
for name in ("ols", "wls", "consistent"):
    estimate = dynident.fit(problem, dynident.ESTIMATORS.make(name))
    test = dynident.validate(estimate, unseen)
    verdict = "yes" if estimate.consistency.consistent else f"no: {estimate.consistency.reasons[0]}"
    print(f"{name:12} {estimate.train.total_relative_error:15.2%} {test.total_relative_error:13.2%}  {verdict}")
