"""The article's bee colony on its own case: 25 000 x 3 rows, 21 parameters, colony 30, limit 15, 50 iterations.

Beside it, on the same objective and box: a NumPy colony that evaluates the whole objective at every trial, and the bee
colonies of beecolpy, mealpy and abcopt. Ours prepares its rows in the time that is stated. Then what no colony is
needed for: the certified L1 optimum, beside HiGHS on the dual linear program.
"""

from __future__ import annotations

import importlib
import itertools
import logging
import statistics
from collections.abc import Callable

import numpy as np
import scipy.sparse
from scipy.optimize import linprog

from benchmarks.speed.harness import Line, Record
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.fourier_fit import FourierFit
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.identification.problem.problem import make_problem
from dynident.identification.search.colony import search
from dynident.identification.search.landscape import absolute_landscape, box_optimum, square_landscape
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.reduction import least_squares
from dynident.robot_files import read_robot
from dynident.studies import er16_article as article

REPEATS = 2
SETTINGS = (article.COLONY, article.LIMIT, article.ITERATIONS)
HERE, SQUARES, CERTIFIED = "L1, rows prepared", "L2, through the triangle, rows prepared", "certified L1 optimum"
NUMPY, DUAL = "NumPy, whole objectives", "HiGHS, interior point, on the dual"


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


def highs_dual(land, lower, upper):
    """Return the L1 optimum by HiGHS on the dual program, which has one row per parameter."""
    weights = np.repeat(land.weights, np.diff(land.edges))
    count = len(lower)
    cost = np.concatenate([-land.target, upper, -lower])  # W'y = zu - zl
    eye = scipy.sparse.identity(count)
    equality = scipy.sparse.hstack([scipy.sparse.csr_matrix(land.columns), -eye, eye]).tocsr()
    bounds = np.concatenate([np.column_stack([-weights, weights]), np.tile([0.0, np.inf], (2 * count, 1))])
    return -linprog(cost, A_eq=equality, b_eq=np.zeros(count), bounds=bounds, method="highs-ipm").fun


def measure() -> Record:
    found = Record("colony", "ER-16, joints 1-3, 25 000 x 3 rows, 21 parameters, colony 30, limit 15, 50 iterations")
    problem, _ = article_problem()
    upper, delta = 5 * np.abs(least_squares(problem.reduced()).beta) + 2, np.ones(3)
    lower, matrix, torque = -upper, np.ascontiguousarray(problem.rows.matrix), problem.rows.torque

    def objective(x):
        return float(np.abs(matrix @ x - torque).sum()) / problem.samples

    land, flat = absolute_landscape(problem, delta), square_landscape(problem, delta)
    optimum = box_optimum(land, lower, upper)
    values = {name: [] for name in (HERE, SQUARES, NUMPY)}

    def ours(name, make) -> Callable[[], object]:
        seeds = itertools.count()
        return lambda: values[name].append(search(make(problem, delta), lower, upper, *SETTINGS, next(seeds)).objective)

    def theirs(name, peer) -> Callable[[], object]:
        seeds = itertools.count()
        return lambda: values[name].append(peer(objective, lower, upper, next(seeds)))

    calls = {
        HERE: ours(HERE, absolute_landscape),
        SQUARES: ours(SQUARES, square_landscape),
        NUMPY: theirs(NUMPY, plain_colony),
        CERTIFIED: lambda: box_optimum(land, lower, upper),
        DUAL: lambda: highs_dual(land, lower, upper),
    }
    peers = []
    for peer in (beecolpy, mealpy, abcopt):
        if found.peer(peer.__name__):
            peers.append(peer.__name__)
            values[peer.__name__] = []
            calls[peer.__name__] = theirs(peer.__name__, peer)
    x = np.linspace(-1.0, 1.0, len(upper)) * upper
    found.agree("objectives at a point, relative", abs(land.value(x) / objective(x) - 1), 1e-12)
    found.agree("L1 optima, relative", abs(highs_dual(land, lower, upper) / optimum.objective - 1), 1e-6)
    found.time(calls, REPEATS)
    least = {HERE: optimum.objective, SQUARES: box_optimum(flat, lower, upper).objective}
    found.facts["objective, times the optimum, medians"] = {
        name: round(statistics.median(runs) / least.get(name, optimum.objective), 3) for name, runs in values.items()
    }
    work = "the article's bee colony, L1 over 25 000 x 3 rows"
    found.lines = [Line(work, HERE, NUMPY, 1.0)]
    found.lines += [Line(f"{work}, beside {name}", HERE, name, 1.0) for name in ("beecolpy", "mealpy", "abcopt")]
    found.lines.append(Line("the colony on squares, through the triangle", SQUARES, reach=0.020))
    found.lines.append(Line("certified L1 optimum of 75 000 rows in a box", CERTIFIED, DUAL))
    return found
