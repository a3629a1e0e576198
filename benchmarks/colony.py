"""The article's bee colony on its own case: 25 000 x 3 rows, 21 parameters, colony 30, limit 15, 50 iterations.

Beside it, on the same objective and box: a NumPy colony that evaluates the whole objective at every trial, and the bee
colonies of beecolpy, mealpy and abcopt where they happen to be installed. Then what no colony is needed for: the
certified L1 optimum, beside HiGHS on the dual linear program. Run: python -m benchmarks.colony
"""

from __future__ import annotations

import importlib
import logging
import time

import numpy as np
import scipy.sparse
from scipy.optimize import linprog
from threadpoolctl import threadpool_limits

from dynident.estimation.problem import make_problem
from dynident.estimation.search.colony import search
from dynident.estimation.search.landscape import absolute_landscape, box_optimum, square_landscape
from dynident.experiment.log import Log
from dynident.experiment.preprocessing import Preprocessing, preprocess
from dynident.experiment.preprocessing.fourier_fit import FourierFit
from dynident.experiment.trajectories.fourier import FourierSeries
from dynident.model.base_parameters import base_parameters
from dynident.model.descriptions import read_robot
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.reduction import least_squares
from dynident.robots import er16_article as article

SEEDS = (0, 1, 2)
SETTINGS = (article.COLONY, article.LIMIT, article.ITERATIONS)


def article_problem():
    """Return Table 2's torques over beta_1 with noise of a fifth of each joint's deviation, reduced, and Table 2."""
    model = DynamicModel(read_robot("er16").locked(article.LOCKED), (Coulomb(width=0.0), Viscous()))
    base = base_parameters(model)
    time_s = np.arange(article.SAMPLES) / article.RATE
    motion = Motion(*FourierSeries.from_table(list(article.BETA_1), article.PERIOD).evaluate(time_s))
    beta = np.array([article.TABLE_2[model.parameters[k].name] for k in base.independent])
    torque = model.regressor(motion)[..., base.independent] @ beta
    noise = np.random.default_rng(0).standard_normal(torque.shape)
    torque += article.NOISE_SHARE * torque.std(axis=0) * noise
    log = Log(model.robot.joint_names, time_s, motion.q, motion.dq, motion.ddq, torque)
    how = Preprocessing(FourierFit(article.PERIOD, 5, torque_repeats=0))
    return make_problem(model, base, [preprocess(log, how)]), beta


def plain_colony(objective, lower, upper, seed):
    """Return the best value of Karaboga's colony, every trial a whole objective."""
    colony, limit, iterations = SETTINGS
    generator, half = np.random.default_rng(seed), colony // 2
    x = lower + generator.random((colony, len(lower))) * (upper - lower)
    values = np.array([objective(one) for one in x])
    order = np.argsort(values)[:half]
    x, values, trials, best = x[order], values[order], np.zeros(half, int), values.min()
    for _ in range(iterations):
        for bee in range(2 * half):
            share = 1 / (1 + values)
            i = bee if bee < half else generator.choice(half, p=share / share.sum())
            j, k = generator.integers(len(lower)), (i + generator.integers(1, half)) % half
            trial = x[i].copy()
            trial[j] = np.clip(trial[j] + generator.uniform(-1, 1) * (trial[j] - x[k, j]), lower[j], upper[j])
            value = objective(trial)
            trials[i] += 1
            if value < values[i]:
                x[i], values[i], trials[i] = trial, value, 0
        best = min(best, values.min())
        i = int(np.argmax(trials))
        if trials[i] > limit:
            x[i] = lower + generator.random(len(lower)) * (upper - lower)
            values[i], trials[i] = objective(x[i]), 0
    return best


def beecolpy(objective, lower, upper, seed):
    colony, _, iterations = SETTINGS
    box = list(zip(lower, upper, strict=True))
    hive = importlib.import_module("beecolpy").abc(
        lambda x: objective(np.asarray(x)), box, colony_size=colony, iterations=iterations, seed=seed
    )
    hive.fit()
    return objective(np.asarray(hive.get_solution()))


def mealpy(objective, lower, upper, seed):
    colony, limit, iterations = SETTINGS
    bounds = importlib.import_module("mealpy").FloatVar(lb=tuple(lower), ub=tuple(upper))
    hive = importlib.import_module("mealpy.swarm_based.ABC").OriginalABC(iterations, colony, limit)
    logging.disable(logging.CRITICAL)
    best = hive.solve({"obj_func": objective, "bounds": bounds, "minmax": "min", "log_to": None}, seed=seed)
    return best.target.fitness


def abcopt(objective, lower, upper, seed):
    colony, limit, iterations = SETTINGS
    hive = importlib.import_module("abcopt").CanonicalABCSolver(
        None, len(lower), lower, upper, colony // 2, max_evals=colony * iterations, limit=limit, random_state=seed
    )
    while not hive.done:
        x = hive.ask()
        hive.tell(x, objective(x))
    return hive.best_cost


def timed(function):
    start = time.perf_counter()
    result = function()
    return time.perf_counter() - start, result


def report(name, runs, optimum):
    """Print the median time and objective of some runs of (seconds, objective)."""
    seconds, values = np.median([run[0] for run in runs]), np.median([run[1] for run in runs])
    print(f"  {name:44} {1e3 * seconds:9.1f} ms   {values:10.3f}   {values / optimum:6.3f} x optimum")
    return seconds


def highs_dual(land, lower, upper):
    """Return the L1 optimum by HiGHS on the dual program, which has one row per parameter."""
    weights = np.repeat(land.weights, np.diff(land.edges))
    count = len(lower)
    cost = np.concatenate([-land.target, upper, -lower])  # W'y = zu - zl
    eye = scipy.sparse.identity(count)
    equality = scipy.sparse.hstack([scipy.sparse.csr_matrix(land.columns), -eye, eye]).tocsr()
    bounds = np.concatenate([np.column_stack([-weights, weights]), np.tile([0.0, np.inf], (2 * count, 1))])
    return -linprog(cost, A_eq=equality, b_eq=np.zeros(count), bounds=bounds, method="highs-ipm").fun


def best(function, repeats=5):
    """Return the shortest of a few times in s, and the result."""
    runs = [timed(function) for _ in range(repeats)]
    return min(run[0] for run in runs), runs[0][1]


def main() -> None:
    problem, truth = article_problem()
    fit = least_squares(problem.reduced()).beta
    upper = 5 * np.abs(fit) + 2
    lower, delta = -upper, np.ones(3)
    matrix = np.ascontiguousarray(problem.rows.matrix)
    torque = problem.rows.torque

    def objective(x):
        return float(np.abs(matrix @ x - torque).sum()) / problem.samples

    land = absolute_landscape(problem, delta)
    search(land, lower, upper, 4, 5, 1, 0)  # compile
    rows, land = best(lambda: absolute_landscape(problem, delta))
    certify, optimum = best(lambda: box_optimum(land, lower, upper))
    calls, _ = best(lambda: objective(fit), 20)
    print(
        f"{problem.samples} x 3 rows, {len(fit)} parameters, box +-(5 |least squares| + 2), median of {len(SEEDS)} runs"
    )
    print(
        f"  L1 optimum {optimum.objective:.6f} N m, least squares {objective(fit):.6f}, Table 2 {objective(truth):.6f}"
    )
    print(f"  one NumPy objective {1e3 * calls:.2f} ms; preparing the rows {1e3 * rows:.1f} ms, in the next line")

    def ours(seed):
        start = time.perf_counter()
        found = search(absolute_landscape(problem, delta), lower, upper, *SETTINGS, seed=seed)
        return time.perf_counter() - start, found.objective

    mine = report("dynident, L1, from the prepared log", [ours(seed) for seed in SEEDS], optimum.objective)
    ratios = {}
    for name, peer in (
        ("NumPy, whole objectives", plain_colony),
        *((p.__name__, p) for p in (beecolpy, mealpy, abcopt)),
    ):
        try:
            runs = [timed(lambda s=seed, p=peer: p(objective, lower, upper, s)) for seed in SEEDS]
        except ModuleNotFoundError as missing:
            print(f"  {name:44} not installed ({missing.name})")
            continue
        ratios[name] = report(name, runs, optimum.objective) / mine
    print("  ratio to dynident: " + ", ".join(f"{name} {ratio:.1f}" for name, ratio in ratios.items()))

    flat = square_landscape(problem, delta)
    smallest = box_optimum(flat, lower, upper).objective

    def squares(seed):
        start = time.perf_counter()
        found = search(square_landscape(problem, delta), lower, upper, *SETTINGS, seed=seed)
        return time.perf_counter() - start, found.objective

    report("dynident, L2, through the triangle", [squares(seed) for seed in SEEDS], smallest)
    report("least squares", [best(lambda: flat.value(least_squares(problem.reduced()).beta))], smallest)
    solver, value = best(lambda: highs_dual(land, lower, upper), 1)
    print(
        f"  certified L1 optimum {1e3 * certify:.1f} ms, gap proven {1 - optimum.lower_bound / optimum.objective:.1e}"
    )
    print(f"  HiGHS, interior point, on the dual {1e3 * solver:.0f} ms, ratio {solver / certify:.1f}")
    if not abs(value - optimum.objective) < 1e-6 * value or min(ratios.values()) < 1:
        raise SystemExit("the optima differ, or another colony was faster")


if __name__ == "__main__":
    with threadpool_limits(1, user_api="blas"):
        main()
