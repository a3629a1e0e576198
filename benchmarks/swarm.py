"""Genetic algorithm, differential evolution and particle swarm on the article's case: 30 points, 50 iterations, (9).

Same rows, box, population, evaluations (1530) and number of seeds for all. Beside dynident's: differential evolution of
SciPy (vectorised, with a NumPy objective and with dynident's compiled one), and mealpy and pymoo where they happen to
be installed; their populations are evaluated in one matrix product where they can take that. Then squares through the
triangle, run to convergence, against SciPy: there the objective costs next to nothing and the moves decide. Times are
processor times of one thread. Run: python -m benchmarks.swarm
"""

from __future__ import annotations

import importlib
import logging
import time

import numpy as np
from scipy.optimize import differential_evolution
from threadpoolctl import threadpool_limits

from benchmarks.speed.rows.colony import article_problem
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.search.landscape import absolute_landscape, box_optimum, square_landscape
from dynident.identification.search.population import values
from dynident.model.reduction import least_squares

SEEDS = (0, 1, 2)
POPULATION, ITERATIONS, LONG = 30, 50, 1000
FACTOR, CROSSOVER = 0.5, 0.9  # of every differential evolution


def ours(name, norm="l1", iterations=ITERATIONS):
    size = {"colony": POPULATION} if name == "abc" else {"population": POPULATION}

    def search(land, lower, upper, seed):
        part = ESTIMATORS.make(name, {"seed": seed, "norm": norm, "iterations": iterations, **size})
        found = part.search(land, lower, upper)
        return found.x, found.evaluations

    return search


def many(land, x):
    """Return F of many points, shape (S,), by NumPy: one matrix product per block of rows that fits the cache."""
    total = np.full(len(x), land.constant)
    for i, weight in enumerate(land.weights):
        use = np.flatnonzero(land.present[:, i])
        for start in range(land.edges[i], land.edges[i + 1], 1000):
            rows = slice(start, min(start + 1000, land.edges[i + 1]))
            rest = x[:, use] @ land.columns[use, rows]
            rest -= land.target[rows]
            total += weight * (np.abs(rest, out=rest).sum(axis=1) if land.power == 1 else (rest * rest).sum(axis=1))
    return total


def scipy_de(evaluate, iterations=ITERATIONS):
    def search(land, lower, upper, seed):
        generator = np.random.default_rng(seed)
        start = lower + generator.random((POPULATION, len(lower))) * (upper - lower)
        found = differential_evolution(
            lambda x: evaluate(land, np.ascontiguousarray(x.T)),
            list(zip(lower, upper, strict=True)),
            strategy="rand1bin",
            maxiter=iterations,
            init=start,
            mutation=FACTOR,
            recombination=CROSSOVER,
            tol=0.0,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=generator,
        )
        return found.x, (found.nit + 1) * POPULATION  # it counts a generation as one call

    return search


def mealpy(module, name, **options):
    def search(land, lower, upper, seed):
        bounds = importlib.import_module("mealpy").FloatVar(lb=tuple(lower), ub=tuple(upper))
        part = getattr(importlib.import_module(f"mealpy.{module}"), name)
        logging.disable(logging.CRITICAL)
        counted, weights = [0], np.repeat(land.weights, np.diff(land.edges))

        def objective(x):  # one point a call is all it takes
            counted[0] += 1
            rest = x @ land.columns
            rest -= land.target
            return float(weights @ np.abs(rest, out=rest)) + land.constant

        problem = {"obj_func": objective, "bounds": bounds, "minmax": "min", "log_to": None}
        best = part(ITERATIONS, POPULATION, **options).solve(problem, seed=seed)
        return np.asarray(best.solution), counted[0]

    return search


def pymoo(module, name, **options):
    def search(land, lower, upper, seed):
        part = getattr(importlib.import_module(f"pymoo.algorithms.soo.nonconvex.{module}"), name)
        base = importlib.import_module("pymoo.core.problem").Problem

        class Fit(base):
            def _evaluate(self, x, out, *args, **kwargs):
                out["F"] = many(land, x)

        fit = Fit(n_var=len(lower), n_obj=1, xl=lower, xu=upper)
        minimise = importlib.import_module("pymoo.optimize").minimize
        end = ("n_gen", ITERATIONS + 1)  # the first generation is the random one
        found = minimise(fit, part(pop_size=POPULATION, **options), end, seed=seed, verbose=False)
        return found.X, found.algorithm.evaluator.n_eval

    return search


PEERS = (
    ("dynident abc", ours("abc")),
    ("dynident ga", ours("ga")),
    ("mealpy BaseGA", mealpy("evolutionary_based.GA", "BaseGA")),
    ("pymoo GA", pymoo("ga", "GA")),
    ("dynident de", ours("de")),
    ("SciPy DE, NumPy objective", scipy_de(many)),
    ("SciPy DE, dynident's objective", scipy_de(values)),
    ("mealpy OriginalDE", mealpy("evolutionary_based.DE", "OriginalDE", wf=FACTOR, cr=CROSSOVER, strategy=0)),
    ("pymoo DE", pymoo("de", "DE", variant="DE/rand/1/bin", F=FACTOR, CR=CROSSOVER)),
    ("dynident pso", ours("pso")),
    ("mealpy OriginalPSO", mealpy("swarm_based.PSO", "OriginalPSO")),
    ("pymoo PSO", pymoo("pso", "PSO")),
)


def report(name, runs, optimum):
    """Print the median time and objective of some runs of (seconds, objective)."""
    seconds, values = np.median([run[0] for run in runs]), np.median([run[1] for run in runs])
    print(f"  {name:44} {1e3 * seconds:9.1f} ms   {values:10.3f}   {values / optimum:6.3f} x optimum")
    return seconds


def compare(rows, land, lower, upper, optimum):
    """Print the rows; return the median time of each that is installed."""
    times = {}
    for name, search in rows:
        runs, counts = [], []
        try:
            for seed in SEEDS:
                start = time.process_time()
                x, count = search(land, lower, upper, seed)
                runs.append((time.process_time() - start, land.value(x)))
                counts.append(count)
                assert np.all((x >= lower) & (x <= upper)), name
        except ModuleNotFoundError as missing:
            print(f"  {name:44} not installed ({missing.name})")
            continue
        times[name] = report(f"{name}, {int(np.median(counts))} evaluations", runs, optimum)
    return times


def main() -> None:
    problem, _ = article_problem()
    upper = 5 * np.abs(least_squares(problem.reduced()).beta) + 2
    lower, delta = -upper, np.ones(3)
    land, flat = absolute_landscape(problem, delta), square_landscape(problem, delta)
    for name in ("abc", "ga", "de", "pso"):
        ours(name, iterations=1)(flat, lower, upper, 0)  # compile
    print(f"(9) over {len(land.target)} rows, {len(lower)} parameters, prepared; median of {len(SEEDS)} seeds")
    times = compare(PEERS, land, lower, upper, box_optimum(land, lower, upper).objective)
    print(f"squares through the triangle, {LONG} iterations")
    names = ("abc", "ga", "de", "pso")
    rows = [(f"dynident {name}", ours(name, "l2", LONG)) for name in names]
    rows.append(("SciPy DE, dynident's objective", scipy_de(values, LONG)))
    flat_times = compare(rows, flat, lower, upper, box_optimum(flat, lower, upper).objective)
    for title, found in (("(9)", times), ("squares", flat_times)):
        scipy = found["SciPy DE, dynident's objective"] / found["dynident de"]
        print(f"  SciPy's differential evolution takes {scipy:.2f} times as long as dynident's on {title}")
        if scipy < 1:
            raise SystemExit("SciPy's differential evolution was faster")


if __name__ == "__main__":
    with threadpool_limits(1, user_api="blas"):
        main()
