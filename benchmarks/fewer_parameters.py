"""Drafts with fewer parameters: those that are not significant are fixed, at the robot model's value or at zero.

The draft of each real set is identified as it is. Then, in a free fit of the same rows, the parameter that is not
significant at 95 % and whose move to the fixed value costs least is fixed, and the others are found anew (Pham and
Gautier 1991), until a third of those that are left is not significant, or a Wald test of all that are fixed rejects
them at 5 %. The reduced list is fitted freely and with consistent links, fixed values as rows of large weight. Printed
are shares that are not significant, and test errors over those of the free fit and of the draft with all parameters.

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

from benchmarks.init_cases import CASES, SETS, against_model, drafted
from dynident import identify, read_case
from dynident.arrays import Array, BoolArray
from dynident.case.case import Case
from dynident.data.log import Log
from dynident.identification.build_problem import build_problem
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.essential import wald
from dynident.identification.problem.problem import Problem
from dynident.identification.residuals.covariance import residual_factors
from dynident.identification.residuals.quantiles import chi_square_tail
from dynident.identification.residuals.row_passes import RowPasses
from dynident.model.reduction import Triangle, triangle_of
from dynident.results.short_answer import not_significant

#: Normal deviate of 95 %, share that may be left, level of the test, weight of the rows of fixed values.
Z95, LEFT, LEVEL, WEIGHT = 1.96, 1 / 3, 0.05, 30.0


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

    def fewer(self, values: Array) -> tuple[BoolArray, Array, float]:
        """Return which parameters are kept, beta, and the share of them that is not significant."""
        keep, beta, whole = np.ones(len(values), bool), self.beta, self.covariance(np.ones(len(values), bool))
        while True:
            deviations = np.sqrt(np.diag(self.covariance(keep)))
            open_ones = np.abs(beta[keep]) < Z95 * deviations
            share = float(open_ones.mean())
            cost = np.where(open_ones, np.abs(beta - values)[keep] / deviations, np.inf)
            fewer = keep.copy()
            fewer[np.flatnonzero(keep)[int(np.argmin(cost))]] = False
            gone = np.flatnonzero(~fewer)
            if share <= LEFT or chi_square_tail(wald(self.beta - values, whole, gone), len(gone)) < LEVEL:
                return keep, beta, share
            keep, beta = fewer, self.fitted(fewer, values)

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
    print("| set | parameters | not significant | fixed at | kept | not significant | free | consistent |")
    print("|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:] or SETS:
        with tempfile.TemporaryDirectory() as folder:
            draft = drafted(name, data, Path(folder))[1]
            train, test = split(name, draft, data)
            whole = identify(draft.model, train, draft.estimator.name, draft.preprocessing)

        def error(estimate: Estimate, logs: list[Log] = test) -> float:
            return against_model(estimate, logs, None).total_relative_error

        reduction = Reduction(build_problem(whole.model, train, whole.preprocessing))
        base, nominal = reduction.problem.base, whole.model.nominal()
        assert nominal is not None
        model = np.where(base.is_friction, 0.0, base.from_standard(nominal))
        for words, values in (("robot model", model), ("zero", np.zeros(base.count))):
            keep, beta, share = reduction.fewer(values)
            free = error(replace(whole, theta=None, beta=beta))
            free /= error(replace(whole, theta=None, beta=reduction.beta))
            theta = reduction.consistent(keep, values)
            links = error(replace(whole, theta=theta, beta=base.from_standard(theta))) / error(whole)
            unclear = len(not_significant(whole)) / base.count
            print(
                f"| {name} | {base.count} | {unclear:.0%} | {words} | {keep.sum()} | {share:.0%} | {free:.3f} "
                f"| {links:.3f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
