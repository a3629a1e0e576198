"""Drafts with fewer parameters: those that are not significant are fixed, bodies at the robot model, friction at zero.

The draft of each real set is identified as it is. Then, in a free fit of the same rows, the parameter that is not
significant at 95 % and whose move to the fixed value costs least is fixed, and the others are found anew (Pham and
Gautier 1991), until a third of those that are left is not significant, or a Wald test of all that are fixed rejects
them at 5 %. The reduced list is fitted freely and with consistent links, fixed values as rows of large weight; and the
longest list after it whose weighted training residual with consistent links is at most 1 % above that of all
parameters. Printed are shares that are not significant, and test errors over those of fits of all parameters of the
same rows, freely and with consistent links.

Needs the logs under the folder that DYNIDENT_DATA names.
Run: python -m benchmarks.fewer_parameters [CASE...]
"""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.init_cases import CASES, SETS, drafted
from dynident import identify, read_case
from dynident.arrays import Array, BoolArray
from dynident.case.case import Case
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, preprocess
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.essential import wald
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.covariance import residual_factors
from dynident.identification.residuals.quantiles import chi_square_tail
from dynident.identification.residuals.row_passes import RowPasses
from dynident.identification.validate import validate_prepared
from dynident.model.reduction import Triangle, triangle_of
from dynident.results.short_answer import not_significant

#: Normal deviate of 95 %, share that may be left, level of the test, weight of the rows of fixed values, rise of the
#: training residual.
Z95, LEFT, LEVEL, WEIGHT, RISE = 1.96, 1 / 3, 0.05, 30.0, 0.01


class Reduction:
    """A free fit of a problem, and the same with some parameters fixed."""

    def __init__(self, problem: Problem) -> None:
        solution = ESTIMATORS.make("wls").solve(problem)
        self.problem, self.weights, self.beta = problem, solution.weights, solution.beta
        reduced, deviations = problem.reduced(self.weights), problem.joint_deviations(self.beta)
        factors = residual_factors(RowPasses(problem), self.beta)
        root = problem.reduced(self.weights**2 * deviations * np.sqrt(factors)).r
        self.r, self.z, self.meat = reduced.r, reduced.z, root.T @ root

    def covariance(self, keep: BoolArray) -> Array:
        own = self.r[:, keep]
        inverse = np.linalg.inv(own.T @ own)
        return inverse @ self.meat[np.ix_(keep, keep)] @ inverse

    def fitted(self, keep: BoolArray, values: Array) -> Array:
        """Return beta with those that are not kept at the values."""
        rest = self.z - self.r[:, ~keep] @ values[~keep]
        found = values.copy()
        found[keep] = np.linalg.lstsq(self.r[:, keep], rest, rcond=None)[0]
        return found

    def path(self, values: Array) -> list[tuple[BoolArray, Array, float]]:
        """Return the shorter and shorter lists: which parameters are kept, beta, and the share that is not significant.

        The first has all parameters.
        """
        keep, beta, whole = np.ones(len(values), bool), self.beta, self.covariance(np.ones(len(values), bool))
        found = []
        while True:
            deviations = np.sqrt(np.diag(self.covariance(keep)))
            open_ones = np.abs(beta[keep]) < Z95 * deviations
            found.append((keep, beta, float(open_ones.mean())))
            cost = np.where(open_ones, np.abs(beta - values)[keep] / deviations, np.inf)
            fewer = keep.copy()
            fewer[np.flatnonzero(keep)[int(np.argmin(cost))]] = False
            gone = np.flatnonzero(~fewer)
            if found[-1][-1] <= LEFT or chi_square_tail(wald(self.beta - values, whole, gone), len(gone)) < LEVEL:
                return found
            keep, beta = fewer, self.fitted(fewer, values)

    def as_good(self, path: list[tuple[BoolArray, Array, float]], values: Array) -> int:
        """Return the place of the shortest list whose training residual with consistent links hardly rises."""

        def residual(place: int) -> float:
            beta = self.problem.base.from_standard(self.consistent(path[place][0], values))
            return float(np.sqrt(self.weights**2 @ self.problem.residual_squares(beta)))

        most, good, bad = (1.0 + RISE) * residual(0), 0, len(path)
        while bad - good > 1:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if residual(middle) <= most else (good, middle)
        return good

    def consistent(self, keep: BoolArray, values: Array) -> Array:
        """Return the standard parameters of consistent links with some base parameters fixed."""
        triangles = list(self.problem.triangles)
        for k in np.flatnonzero(~keep):
            joint = next(i for i, one in enumerate(triangles) if k in one.columns)
            old = triangles[joint]
            row = np.zeros(old.factor.shape[1])
            row[np.flatnonzero(old.columns == k)[0]] = WEIGHT * np.linalg.norm(self.r[:, k]) / self.weights[joint]
            row[-1] = row.sum() * values[k]
            triangles[joint] = Triangle(old.columns, triangle_of(np.vstack([old.factor, row])), old.rows)
        solution = ESTIMATORS.make("consistent").solve(replace(self.problem, triangles=tuple(triangles)))
        assert solution.theta is not None
        return solution.theta


def split(name: str, draft: Case, data: Path) -> tuple[list[Log], list[Log]]:
    """Return the logs to train and to test on of a set."""
    train, test = ([draft.read(str(data / path)) for path in own] for own in (SETS[name].train, SETS[name].test))
    hand = read_case(CASES / f"{name}.yaml")
    if hand.split is None or test:
        return train, test
    parts = [hand.split.apply(log) for log in train]
    return [a for a, _ in parts], [b for _, b in parts]


def main() -> None:
    """Print the table."""
    data = Path(os.environ["DYNIDENT_DATA"])
    print("| set | parameters | not significant | until | kept | not significant | free | consistent |")
    print("|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or SETS:
        with tempfile.TemporaryDirectory() as folder:
            draft = drafted(name, data, Path(folder))[1]
            train, test = split(name, draft, data)
            whole = identify(draft.model, train, draft.estimator.name, draft.preprocessing)

        reduction = Reduction(build_problem(whole.model, train, whole.preprocessing))
        base, nominal = reduction.problem.base, reduction.problem.model.nominal()
        assert nominal is not None
        held = [preprocess(log.ordered(whole.model.robot.joint_names), whole.preprocessing) for log in test]
        model = np.where(base.is_friction, 0.0, base.from_standard(nominal))

        def error(beta: Array, of: Problem = reduction.problem, logs: list[Prepared] = held) -> float:
            return validate_prepared(of.model, of.base, logs, beta).total_relative_error

        whole_theta = reduction.consistent(np.ones(base.count, bool), model)
        with_all = error(base.from_standard(whole_theta))
        free_all = error(reduction.beta)
        unclear = len(not_significant(whole)) / whole.base.count
        path = reduction.path(model)
        for way, place in (("a third", len(path) - 1), ("residual within 1 %", reduction.as_good(path, model))):
            keep, beta, share = path[place]
            theta = reduction.consistent(keep, model)
            free, links = error(beta) / free_all, error(base.from_standard(theta)) / with_all
            print(
                f"| {name} | {base.count} | {unclear:.0%} | {way} | {keep.sum()} | {share:.0%} | {free:.3f} "
                f"| {links:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
