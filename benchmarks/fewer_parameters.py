"""Drafts with fewer parameters: those that are not significant are held, bodies at the robot model, friction at zero.

A draft is identified as it is. Then, in a free fit of the same rows, the parameter that is not significant at 95 % and
whose move to the held value costs least is held, and the others are found anew (Pham and Gautier 1991), until all that
are left are significant. Taken is the shortest list with which the cost of consistent links rises by no more than
plausible bodies may cost for being near the robot model (:func:`cost_limit`: the joint 95 % region of the parameters,
of the residual 0.5 % at most). Held values are rows of large weight. Printed are the shares that are not significant,
and test errors over those of fits of all parameters of the same rows.

The rule was fixed before the real sets were looked at with it, and judged on the strangers and on random arms first;
one by cross-validation had failed on the strangers before, and how parameters of one of these go was known by then.

Real sets need the logs under the folder that DYNIDENT_DATA names.
Run: python -m benchmarks.fewer_parameters [sets | strangers [NAME...] | arms FIRST LAST]
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.faults import clean
from benchmarks.init_cases import CASES, SETS, drafted
from benchmarks.strangers.__main__ import answered, logs_of
from benchmarks.strangers.cases import STRANGERS
from benchmarks.strangers.plant import urdf
from dynident import identify, read_case
from dynident.api.init import init
from dynident.arrays import Array, BoolArray
from dynident.case.case import Case
from dynident.cli.main import main as dynident
from dynident.data.log import Log
from dynident.data.preprocessing import preprocess
from dynident.identification.build_problem import build_problem
from dynident.identification.consistency.plausible_fit import cost_limit
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.covariance import residual_factors
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.validate import validate_prepared
from dynident.model.reduction import Triangle, triangle_of
from dynident.results.short_answer import not_significant

#: Normal deviate of 95 %, weight of the rows of held values.
Z95, WEIGHT = 1.96, 30.0


@dataclass(frozen=True)
class Shorter:
    """A list of parameters: which are kept, the share of these that is not significant, and standard parameters."""

    keep: BoolArray
    share: float
    theta: Array
    beta: Array


class Reduction:
    """A free fit of a problem, and the same with some parameters held."""

    def __init__(self, problem: Problem, values: Array) -> None:
        solution, estimator = ESTIMATORS.make("wls").solve(problem), ESTIMATORS.make("consistent")
        self.problem, self.values, self.weights, self.beta = problem, values, solution.weights, solution.beta
        self.passes = RowPasses(problem)
        deviations, factors = problem.joint_deviations(self.beta), residual_factors(self.passes, self.beta)
        self.reduced = problem.reduced(self.weights)
        root = problem.reduced(self.weights**2 * deviations * np.sqrt(factors)).r
        self.r, self.z, self.meat = self.reduced.r, self.reduced.z, root.T @ root
        refit = estimator.refit(problem, estimator.solve(problem).run)
        assert refit is not None
        self._refit = refit

    def deviations(self, keep: BoolArray) -> Array:
        """Return the standard deviations of those that are kept, rows that hang together counted once."""
        own = self.r[:, keep]
        inverse = np.linalg.inv(own.T @ own)
        return np.sqrt(np.diag(inverse @ self.meat[np.ix_(keep, keep)] @ inverse))

    def fitted(self, keep: BoolArray) -> Array:
        """Return beta with those that are not kept at their values."""
        found, rest = self.values.copy(), self.z - self.r[:, ~keep] @ self.values[~keep]
        found[keep] = np.linalg.lstsq(self.r[:, keep], rest, rcond=None)[0]
        return found

    def path(self) -> list[tuple[BoolArray, float, Array]]:
        """Return the shorter and shorter lists with the share that is not significant; the first has all parameters."""
        keep, beta, found = np.ones(len(self.values), bool), self.beta, []
        while True:
            deviations = self.deviations(keep)
            open_ones = np.abs(beta[keep]) < Z95 * deviations
            found.append((keep, float(open_ones.mean()), beta))
            if not np.any(open_ones):
                return found
            cost = np.where(open_ones, np.abs(beta - self.values)[keep] / deviations, np.inf)
            keep = keep.copy()
            keep[np.flatnonzero(keep)[int(np.argmin(cost))]] = False
            beta = self.fitted(keep)

    def consistent(self, keep: BoolArray) -> Array:
        """Return the standard parameters of consistent links with some base parameters held."""
        triangles = list(self.problem.triangles)
        for k in np.flatnonzero(~keep):
            joint = next(i for i, one in enumerate(triangles) if k in one.columns)
            old = triangles[joint]
            row = np.zeros(old.factor.shape[1])
            row[np.flatnonzero(old.columns == k)[0]] = WEIGHT * np.linalg.norm(self.r[:, k]) / self.weights[joint]
            row[-1] = row.sum() * self.values[k]
            triangles[joint] = Triangle(old.columns, triangle_of(np.vstack([old.factor, row])), old.rows)
        return self._refit(replace(self.problem, triangles=tuple(triangles)).reduced(self.weights))

    def cost(self, theta: Array) -> float:
        """Return the squared residual in residual variances of the free fit."""
        squares = self.problem.residual_squares(self.problem.base.from_standard(theta))
        return float(self.weights**2 @ squares) * max(self.reduced.rows, 1) / self.reduced.rest

    def lists(self) -> tuple[Shorter, Shorter]:
        """Return all parameters, and the shortest list whose cost is within the limit."""

        def made(place: int) -> Shorter:
            keep, share, beta = path[place]
            return Shorter(keep, share, self.consistent(keep), beta)

        path = self.path()
        good, bad = 0, len(path)
        whole = best = made(0)
        factors = residual_factors(self.passes, self.problem.base.from_standard(whole.theta))
        most = self.cost(whole.theta) + cost_limit(factors, self.problem.base.count, self.cost(whole.theta))
        while bad - good > 1:
            middle = (good + bad) // 2
            one = made(middle)
            good, bad, best = (middle, bad, one) if self.cost(one.theta) <= most else (good, middle, best)
        return whole, best


def shown(name: str, case: Case, train: Sequence[Log], test: Sequence[Log]) -> str:
    """Return the line of the table for a draft."""
    estimate = identify(case.model, train, case.estimator.name, case.preprocessing)
    problem = build_problem(estimate.model, train, estimate.preprocessing)
    nominal = problem.model.nominal()
    assert nominal is not None
    held = np.where(problem.base.is_friction, 0.0, problem.base.from_standard(nominal))
    reduction = Reduction(problem, held)
    whole, best = reduction.lists()
    logs = [preprocess(log.ordered(problem.model.robot.joint_names), estimate.preprocessing) for log in test]

    def error(beta: Array) -> float:
        return validate_prepared(problem.model, problem.base, logs, beta).total_relative_error

    free = error(best.beta) / error(whole.beta)
    links = error(problem.base.from_standard(best.theta)) / error(problem.base.from_standard(whole.theta))
    rise = np.sqrt(reduction.cost(best.theta) / reduction.cost(whole.theta)) - 1.0
    unclear = len(not_significant(estimate)) / estimate.base.count
    return (
        f"| {name} | {problem.base.count} | {unclear:.0%} | {whole.share:.0%} | {best.keep.sum()} | {best.share:.0%} "
        f"| {rise:.2%} | {free:.3f} | {links:.3f} |"
    )


def of_sets(names: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the real sets."""
    data = Path(os.environ["DYNIDENT_DATA"])
    for name in names or SETS:
        with tempfile.TemporaryDirectory() as folder:
            draft = drafted(name, data, Path(folder))[1]
            train, test = (
                [draft.read(str(data / path)) for path in own] for own in (SETS[name].train, SETS[name].test)
            )
            hand = read_case(CASES / f"{name}.yaml")
            if hand.split is not None and not test:
                parts = [hand.split.apply(log) for log in train]
                train, test = [a for a, _ in parts], [b for _, b in parts]
            yield shown(name, draft, train, test)


def of_strangers(names: Sequence[str]) -> Iterator[str]:
    """Yield the lines of the strangers, by their answered drafts."""
    for name in names or STRANGERS:
        stranger = STRANGERS[name]
        with tempfile.TemporaryDirectory() as where, contextlib.redirect_stderr(io.StringIO()):
            folder = Path(where)
            *train, test = (str(folder / one) for one in logs_of(name, stranger, folder, 1.0))
            file = folder / "case.yaml"
            words = ["init", str(folder / "robot.urdf"), *train, "--test", test, "-o", str(file), *stranger.options]
            with contextlib.redirect_stdout(io.StringIO()):
                dynident(words)
            file.write_text(answered(file.read_text(), stranger))
            case = read_case(file)
            yield shown(name, case, [case.read(one) for one in train], [case.read(test)])


def of_arms(first: int, last: int) -> Iterator[str]:
    """Yield the lines of random arms, with one log to learn from and another motion to test on."""
    for seed in range(first, last):
        generator = np.random.default_rng([24, seed])
        bodies = clean.robot(generator)
        logs, _ = clean.recorded(generator, bodies, urdf(f"arm_{seed}", bodies, seed), 2)
        with tempfile.TemporaryDirectory() as where:
            folder = Path(where)
            (folder / "arm.urdf").write_text(urdf(f"arm_{seed}", bodies))
            for k, columns in enumerate(logs):
                clean.written(columns, folder / f"run{k}.csv")
            with contextlib.redirect_stdout(io.StringIO()):
                draft = init(str(folder / "arm.urdf"), [str(folder / "run0.csv")], folder)
            (folder / "case.yaml").write_text(draft.text)
            case = read_case(folder / "case.yaml")
            yield shown(f"arm {seed}", case, *([case.read(str(folder / f"run{k}.csv"))] for k in range(2)))


def main() -> None:
    """Print the table."""
    kind, *rest = sys.argv[1:] or ["sets"]
    print(
        "| set | parameters | not significant | in the free fit | kept | not significant | rise | free | consistent |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    lines = {
        "sets": lambda: of_sets(rest),
        "strangers": lambda: of_strangers(rest),
        "arms": lambda: of_arms(*(int(word) for word in rest)),
    }
    for line in lines[kind]():
        print(line, flush=True)


if __name__ == "__main__":
    main()
