"""Do stated 95 % intervals hold the truth in 95 of 100 cases? A Monte Carlo over the torque noise.

Arms of 3, 6 and 7 joints follow one motion; only the noise is new in each run: white, or of first order with 0.9 from
sample to sample, at 200 Hz. Rows are taken as they are, or filtered at 5 Hz with the default preprocessing. Printed per
arm, length, filter and noise, for each method: share of intervals over all base parameters and runs that hold the truth
(``pooled``), the smallest share of one parameter, stated over true deviation (median over the parameters) and, for
estimators, the largest bias in true deviations and the seconds a run.
Run: python -m benchmarks.coverage [--runs N] [--seconds S ...] for the ways to a covariance of least squares, or with
--estimators all (or names) for the estimators' own on the arm of 3 joints.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace

import numpy as np
import scipy.signal
import scipy.stats

from dynident import DynamicModel, FourierSeries, Log, Preprocessing, base_parameters, preprocess, read_robot
from dynident.data.preprocessing import default_preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.map import MAP
from dynident.identification.problem.problem import make_problem
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.residuals.bands import bands
from dynident.identification.residuals.coloured import Influence, Uncertainty, spectral_uncertainty, uncertainty_of
from dynident.identification.residuals.covariance import FEWEST_FREE, correlation_factors
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.residuals.stretches import stretches
from dynident.identification.uncertainty.bootstrap import errors_drawn
from dynident.model.friction import Motion
from dynident.studies.er16_article import LOCKED

RATE, PERIOD, PAST, RENEWALS = 200.0, 10.0, 400, 4

METHODS = ("integrated", "spectral", "bootstrap")

#: Of so many runs the slow methods see one.
SLOW = {"bootstrap": 10}

#: All estimators of base parameters; the Kalman filter, seconds a run, only by name.
ESTIMATORS_OF_BASE = (
    *("ols", "wls", "ridge", "map", "huber", "tukey", "irls", "l1", "tls", "ml", "two_step", "essential"),
    *("iv", "didim"),
)


class Bench:
    """Fixed rows, and weighted least squares for noise alone: the estimate is its own error."""

    def __init__(self, robot, seconds, how):
        model = DynamicModel(robot, ("coulomb", "viscous", "offset"))
        sine, cosine = 0.3 * np.random.default_rng(1).normal(size=(2, robot.dof, 5))
        times = np.arange(int(seconds * RATE)) / RATE
        q, dq, ddq = FourierSeries(np.zeros(robot.dof), sine, cosine, PERIOD).evaluate(times)
        theta = np.concatenate([robot.nominal, np.tile([2.0, 3.0, 1.0], robot.dof)])
        torque = model.torque(Motion(q, dq, ddq), theta)
        self.log = preprocess(Log(robot.joint_names, times, q, dq, ddq, torque), how)
        self.base = base_parameters(model)
        self.truth, self.model = self.base.from_standard(theta), model
        problem = make_problem(model, self.base, [self.log])
        self.passes = RowPasses(problem)
        self.mask, self.counts, self.columns = self.passes.counting, problem.counts, self.passes.columns
        self.size = problem.base.count
        self.rows = [
            np.concatenate([segment.blocks[i][:-1] for segment in self.passes], axis=1) * self.mask[:, i]
            for i in range(robot.dof)
        ]
        self.grams = np.zeros((robot.dof, self.size, self.size))
        for i, (own, rows) in enumerate(zip(self.columns, self.rows, strict=True)):
            self.grams[i][np.ix_(own, own)] = rows @ rows.T
        self.bands, self.stretches = list(bands(self.passes)), list(stretches(self.passes))

    def raw_noise(self, generator, memory):
        """Return torque noise (n, N), other joints other sizes."""
        joints = len(self.columns)
        white = generator.normal(size=(joints, self.log.log.samples + PAST)) * np.linspace(1, 3, joints)[:, None]
        return scipy.signal.lfilter([np.sqrt(1 - memory**2)], [1, -memory], white, axis=1)[:, PAST:]

    def noise(self, generator, memory):
        """Return torque noise of the kept rows, filtered as the torque."""
        return np.where(self.mask, self.log.smooth(self.raw_noise(generator, memory)).T[self.log.keep], 0.0)

    def fit(self, noise):
        """Return the error of weighted least squares, its residual, weights, deviations and (X'X)^-1."""
        products = np.zeros((len(self.columns), self.size))
        for i, own in enumerate(self.columns):
            products[i, own] = self.rows[i] @ noise[:, i]
        renewed = np.ones(len(self.columns))
        for _ in range(RENEWALS):
            weights = renewed
            matrix = np.einsum("i,ijk->jk", weights**2, self.grams)
            norms = np.sqrt(np.diag(matrix))
            inverse = np.linalg.inv(matrix / norms / norms[:, None]) / norms / norms[:, None]
            error = inverse @ (weights**2 @ products)
            fitted = [error[own] @ rows for own, rows in zip(self.columns, self.rows, strict=True)]
            residual = (noise - np.stack(fitted, axis=1)) * self.mask
            deviations = np.sqrt((residual**2).sum(axis=0) / (self.counts * (1 - self.size / self.counts.sum())))
            renewed = 1 / deviations
        return error, residual, weights, deviations, (inverse + inverse.T) / 2

    def stated(self, method, residual, weights, deviations, inverse):
        """Return standard deviations and half widths of 95 % intervals by a method."""
        if method == "spectral":
            meat = np.einsum("i,ijk->jk", weights**4 * deviations**2, self.grams)
            gains = (weights**2)[:, None, None] * inverse
            influence = Influence(gains, inverse @ meat @ inverse, np.eye(len(weights)))
            found = uncertainty_of(self.bands, residual, influence)
            return found.deviations, found.half_widths()
        factors = correlation_factors([residual], [self.mask])
        independent = np.sum(self.counts / factors)
        if method == "bootstrap":
            larger = residual / np.sqrt(max(1 - self.size / independent, FEWEST_FREE))
            draws = errors_drawn(self.stretches, self.columns, larger, weights, inverse)
            low, high = draws.interval()
            return np.sqrt(np.diag(draws.covariance)), (high - low) / 2
        meat = np.einsum("i,ijk->jk", weights**4 * deviations**2 * factors, self.grams)
        shared = (1 - self.size / self.counts.sum()) / max(1 - self.size / independent, FEWEST_FREE)
        return _normal(np.sqrt(max(shared, 1.0) * np.diag(inverse @ meat @ inverse)))


def _normal(deviations):
    return deviations, deviations * scipy.stats.norm.ppf(0.975)


def coverage(bench, memory, runs, methods=METHODS):
    """Return the figures of each method for one bench and one kind of noise."""
    generator = np.random.default_rng(5)
    errors, stated = [], {method: ([], []) for method in methods}
    for run in range(runs):
        error, *rest = bench.fit(bench.noise(generator, memory))
        errors.append(error)
        for method, (deviations, inside) in stated.items():
            if run % SLOW.get(method, 1) == 0:
                deviation, half = bench.stated(method, *rest)
                deviations.append(deviation)
                inside.append(np.abs(error) < half)
    true = np.std(errors, axis=0)
    return {
        method: {
            "pooled": round(float(np.mean(inside)), 4),
            "smallest": round(float(np.mean(inside, axis=0).min()), 3),
            "stated_over_true": round(float(np.median(np.sqrt(np.mean(np.square(deviations), axis=0)) / true)), 3),
        }
        for method, (deviations, inside) in stated.items()
    }


def posed(bench, generator, memory):
    """Return the problem of torques that are those of the model at the truth plus noise, filtered alike."""
    raw = RegressorStream(bench.model, bench.base).predict(bench.log.log, bench.truth)
    raw = raw + bench.raw_noise(generator, memory).T
    log = replace(bench.log.log, torque=bench.log.smooth(raw.T).T, raw_torque=raw)
    return make_problem(bench.model, bench.base, [replace(bench.log, log=log)])


def estimator_coverage(bench, memory, runs, name):
    """Return the figures of one estimator with the covariance that it states itself."""
    part = MAP(share=10.0) if name == "map" else ESTIMATORS.make(name)  # a prior that is flat enough
    generator = np.random.default_rng(5)
    errors, deviations, inside, start = [], [], [], time.perf_counter()
    for _ in range(runs):
        problem = posed(bench, generator, memory)
        solution = part.solve(problem)
        if solution.covariance is None:
            found = spectral_uncertainty(problem, solution.weights, solution.beta)
        else:
            degrees = np.full(len(solution.beta), np.inf) if solution.degrees is None else solution.degrees
            found = Uncertainty(solution.covariance, degrees)
        errors.append(solution.beta - bench.truth)
        deviations.append(found.deviations)
        inside.append(np.abs(errors[-1]) < found.half_widths())
    true = np.std(errors, axis=0)
    return {
        "pooled": round(float(np.mean(inside)), 4),
        "smallest": round(float(np.mean(inside, axis=0).min()), 3),
        "stated_over_true": round(float(np.median(np.sqrt(np.mean(np.square(deviations), axis=0)) / true)), 3),
        "largest_bias": round(float(np.max(np.abs(np.mean(errors, axis=0)) / true)), 2),
        "seconds_a_run": round((time.perf_counter() - start) / runs, 3),
    }


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seconds", type=float, nargs="+", default=[10.0, 30.0])
    parser.add_argument("--estimators", nargs="+", default=[], metavar="NAME")
    given = parser.parse_args()
    names = ESTIMATORS_OF_BASE if given.estimators == ["all"] else given.estimators
    arms = (read_robot("er16").locked(LOCKED), read_robot("generic-6r"), read_robot("generic-7r"))
    preparations = {"none": Preprocessing(AsGiven(), rest="keep"), "5 Hz": default_preprocessing()}
    for robot in arms[:1] if names else arms:
        for seconds in given.seconds:
            for filtered, how in preparations.items():
                bench = Bench(robot, seconds, how)
                for memory in (0.0, 0.9):
                    told = {"joints": robot.dof, "seconds": seconds, "filter": filtered, "memory": memory}
                    told |= {"runs": given.runs, "base": bench.size}
                    for name in names:
                        found = estimator_coverage(bench, memory, given.runs, name)
                        print(json.dumps({**told, "estimator": name, **found}), flush=True)
                    if not names:
                        print(json.dumps({**told, **coverage(bench, memory, given.runs)}), flush=True)


if __name__ == "__main__":
    main()
