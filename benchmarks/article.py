"""The article's case over many seeds: the bee colony beside all estimators, its convergence, its three settings.

Builds docs/reproducing-the-article.md from its own figures. Every result is kept in the folder --out: the command goes
on where it was stopped. Run: python -m benchmarks.article [--seeds 100] [--out DIR] [--write FILE]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.article_page import convergence, page
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.fourier_fit import FourierFit
from dynident.files import write_atomically
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators import ESTIMATORS
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.simulation.virtual_robot import Noise, Timing, simulate
from dynident.studies import er16_article as article
from dynident.studies.benchmark.possible_robots import told
from dynident.studies.benchmark.runner import Records, run_tasks
from dynident.studies.comparison.contest import Contest, Method
from dynident.studies.reproduction import (
    CONVERGED,
    POSITION_NOISE,
    as_published,
    by_name,
    er16_three_joints,
    trajectories,
    virtual_er16,
)

#: Karaboga's limit: sources times dimensions.
KARABOGA = article.COLONY // 2 * 21

#: Iterations at which the curves are told.
CURVE = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 4000)

#: The figure of the curves, beside the page.
FIGURE = "figures/article-convergence.svg"

#: Settings of the colony: size, limit, iterations. The published ones first.
PUBLISHED = (article.COLONY, article.LIMIT, article.ITERATIONS)
SETTINGS = (
    PUBLISHED,
    *((size, article.LIMIT, article.ITERATIONS) for size in (10, 20, 60, 120, 240)),
    *((size, article.LIMIT, 1500 // size) for size in (10, 60, 120, 240)),
    *((article.COLONY, limit, article.ITERATIONS) for limit in (5, 50, KARABOGA, 10_000)),
    *((article.COLONY, limit, 1000) for limit in (5, 15, 50, 150, KARABOGA, 10_000)),
    *((article.COLONY, article.LIMIT, count) for count in (100, 200, 500, CONVERGED)),
    (article.COLONY, KARABOGA, CONVERGED),
)

#: Searches of more trials than MANY are made with FEW seeds of the colony.
MANY, FEW = 50_000, 5

#: What takes part on every seed of part (a), whose truth no simulation can move, and of part (b).
LINEAR = (
    "ols",
    "wls",
    "irls",
    "huber",
    "tukey",
    "l1",
    "tls",
    "ridge",
    "essential",
    "rls",
    "ml",
    "two_step",
    "consistent",
)
MAIN = ("ols", "wls", "l1", "consistent")
SEARCHES = ("ga", "de", "pso")
SIMULATING = ("iv", "didim")


@dataclass(frozen=True)
class ArticleTask:
    """One method on the data of one seed; ``settings`` are those of the colony, None for another method."""

    part: str
    seed: int
    name: str
    settings: tuple[int, int, int] | None = None

    @property
    def label(self) -> str:
        return f"({self.part}) seed {self.seed}: {self.name}"

    @property
    def facts(self) -> Mapping[str, Any]:
        settings = None if self.settings is None else list(self.settings)
        return {"version": version("dynident"), **asdict(self), "settings": settings, "format": 1}


class ArticleWork:
    """Does the tasks; the data of the last seed is kept."""

    def result(self, task: ArticleTask) -> dict[str, Any]:
        contest, tests, box = data_of(task.part, 0 if task.name == "settings" else task.seed)
        outcome = contest.attempt(Method(task.name, part_of(task, box)))
        if outcome.estimate is None:
            return {"failure": outcome.failure, "seconds": outcome.seconds}
        assert contest.truth is not None
        estimate, truth = outcome.estimate, contest.problem.base.from_standard(contest.truth)
        model = estimate.model
        found = model.torque(tests[0], estimate.base.to_standard(estimate.beta))
        result = {
            "failure": None,
            "objective": float(np.abs(estimate.train.residual).sum() / estimate.train.samples),
            "parameter_error": float(np.linalg.norm(estimate.beta - truth) / np.linalg.norm(truth)),
            "torque_error": float(np.linalg.norm(found - tests[1]) / np.linalg.norm(tests[1])),
            "correlation": [fit.correlation for fit in estimate.train.joints],
            "consistent": bool(estimate.consistency.consistent),
            "covered": int(np.sum(np.abs(estimate.beta - truth) <= estimate.half_widths())),
            "parameters": len(truth),
            "seconds": outcome.seconds,
            "optimum": estimate.run.optimum,
        }
        trace = estimate.run.trace
        if task.settings is not None and trace is not None:
            result["curve"] = {str(k): float(trace[k - 1]) for k in CURVE if k <= len(trace)}
        return result


def part_of(task: ArticleTask, box: np.ndarray) -> Any:
    """Return the estimator of a task; searches have the box of the part and the published number of evaluations."""
    half = tuple(float(value) for value in box)
    bounds = {"lower": tuple(-value for value in half), "upper": half}
    if task.settings is not None:
        colony, limit, iterations = task.settings
        return ESTIMATORS.make(
            "abc", {"colony": colony, "limit": limit, "iterations": iterations, "seed": task.seed, **bounds}
        )
    if task.name in SEARCHES:
        return ESTIMATORS.make(
            task.name, {"population": article.COLONY, "iterations": article.ITERATIONS, "seed": task.seed, **bounds}
        )
    return ESTIMATORS.make(task.name)


@lru_cache(maxsize=2)
def data_of(part: str, seed: int) -> tuple[Contest, tuple[Motion, np.ndarray], np.ndarray]:
    """Return the problem of a seed with its truth, the states and true torques of beta_2, and the box."""
    return published_data(seed) if part == "a" else virtual_data(seed)


def states(trajectory) -> Motion:
    return Motion(*trajectory.evaluate(np.arange(article.SAMPLES) / article.RATE))


def published_data(seed: int) -> tuple[Contest, tuple[Motion, np.ndarray], np.ndarray]:
    """Return part (a): the torques of Table 2 with noise."""
    model = DynamicModel(er16_three_joints(), (Coulomb(0.0), Viscous()))
    base = base_parameters(model)
    theta = base.to_standard(by_name(base, article.TABLE_2))
    train, test = (states(trajectory) for trajectory in trajectories())
    clean = model.torque(train, theta)
    noise = article.NOISE_SHARE * clean.std(axis=0) * np.random.default_rng(seed).normal(size=clean.shape)
    time = np.arange(len(clean)) / article.RATE
    log = Log(model.robot.joint_names, time, train.q, train.dq, train.ddq, clean + noise)
    contest = Contest(build_problem(told(model, None), [log], Preprocessing(AsGiven(), rest="keep")), (), theta)
    _ = contest.least
    return contest, (test, model.torque(test, theta)), by_name(base, article.TABLE_3)


def virtual_data(seed: int) -> tuple[Contest, tuple[Motion, np.ndarray], np.ndarray]:
    """Return part (b): the consistent ER-16 in closed loop."""
    model = DynamicModel(er16_three_joints(), (Coulomb(0.02), Viscous()))
    base = base_parameters(model)
    theta = model.nominal()
    assert theta is not None
    excitation, validation = trajectories()
    noise = article.NOISE_SHARE * np.std(model.torque(states(excitation), theta), axis=0)
    sensors = Noise(position=POSITION_NOISE, torque=noise)
    log = simulate(model, theta, excitation, timing=Timing(duration=article.PERIOD), noise=sensors, seed=seed).log
    filtering = Preprocessing(FourierFit(period_s=article.PERIOD, harmonics=5), rest="keep")
    contest = Contest(build_problem(told(model, None), [log], filtering), (), theta)
    _ = contest.least
    box = 2.0 * np.maximum(by_name(base, article.TABLE_3), np.abs(base.from_standard(theta)))
    test = states(validation)
    return contest, (test, model.torque(test, theta)), box


def tasks(seeds: int, colonies: int) -> list[ArticleTask]:
    """Return the tasks: the colony beside the main methods, its settings on the data of seed 0, then all others."""
    found = []
    for seed in range(seeds):
        found += [ArticleTask(part, seed, "abc as published", PUBLISHED) for part in "ab"]
        found += [ArticleTask(part, seed, name) for part in "ab" for name in (*MAIN, *SEARCHES)]
    for settings in SETTINGS:
        count = min(colonies, FEW) if settings[0] * settings[2] > MANY else colonies
        found += [ArticleTask("a", seed, "settings", settings) for seed in range(count)]
    few = range(min(seeds, FEW))
    found += [
        ArticleTask(part, seed, "abc converged", (article.COLONY, KARABOGA, CONVERGED)) for seed in few for part in "ab"
    ]
    others = [name for name in LINEAR if name not in MAIN]
    for seed in range(seeds):
        found += [ArticleTask(part, seed, name) for part in "ab" for name in others]
        found += [ArticleTask("b", seed, name) for name in SIMULATING]
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100, help="seeds of the noise (100)")
    parser.add_argument("--colonies", type=int, default=20, help="seeds of the colony for each of its settings (20)")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", default="out/benchmarks/article", help="folder of the results")
    parser.add_argument("--write", metavar="FILE", help="write the page here; default: print it")
    parser.add_argument("--only-kept", action="store_true", help="the page of what is there, nothing new computed")
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    asked, records = tasks(options.seeds, options.colonies), Records(options.out)
    parts = (as_published(), virtual_er16())
    if options.only_kept:
        results = [(task, kept) for task in asked if (kept := records.read(task)) is not None]
    else:
        results = list(run_tasks(ArticleWork(), asked, records, jobs=options.jobs))
    text = page(results, parts, version("dynident"), FIGURE)
    if options.write:
        write_atomically(Path(options.write), text)
        if (drawing := convergence(results)) is not None:
            place = Path(options.write).parent / FIGURE
            place.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(place, drawing)
    else:
        print(text)


if __name__ == "__main__":
    main()
