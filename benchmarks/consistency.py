"""The consistent fit: time on the triangle of a 6R arm for each metric and path, and violations over noisy problems.

Problems: the 6R arm that ships with 12,000 rows and noise of 5 N m (78 parameters, six pseudo-inertias), and
forty with noise of 0.1 to 100 N m. Run: python -m benchmarks.consistency
"""

from __future__ import annotations

import json
import statistics
import time

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.speed.rows.consistent_fit import ROWS, noisy_triangle
from dynident import DynamicModel, base_parameters, read_robot
from dynident.identification.consistency.barrier import inside, solve_barrier
from dynident.identification.consistency.conic import solve_conic
from dynident.identification.consistency.consistent_fit import METRICS, consistent_fit, pose_program
from dynident.identification.consistency.log_cholesky_fit import descend
from dynident.identification.consistency.verdicts import broken_conditions
from dynident.identification.problem.prior import natural_scale

REPEATS, PROBLEMS = 15, 40


def median_ms(function):
    """Return the median time of some calls after one that is not counted, in ms."""
    function()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times)


def main() -> None:
    model = DynamicModel(read_robot("generic-6r"), ("coulomb", "viscous", "rotor_inertia"))
    base = base_parameters(model)
    scale = natural_scale(model, np.full(6, 10.0), np.ones(6))
    posed = (model, base, noisy_triangle(model, base, 5.0, 0), scale)
    result: dict[str, object] = {"parameters": len(model.parameters), "rows": ROWS}
    with threadpool_limits(1, user_api="blas"):
        program = pose_program(*posed)
        start = inside(program)
        result["paths_ms"] = {
            "Clarabel": median_ms(lambda: solve_conic(program)),
            "log-det barrier": median_ms(lambda: solve_barrier(program, start)),
            "log-Cholesky": median_ms(lambda: descend(program, 100)),
        }
        result["fit_with_proof_ms"] = {
            metric: median_ms(lambda metric=metric: consistent_fit(*posed, metric=metric)) for metric in METRICS
        }
        broken, gaps = 0, []
        for seed in range(PROBLEMS):
            reduced = noisy_triangle(model, base, 10.0 ** (seed % 4 - 1), seed)
            fit = consistent_fit(model, base, reduced, scale)
            broken += bool(broken_conditions(model, fit.theta))
            gaps.append(fit.optimality.gap)
    result |= {"problems": PROBLEMS, "violations": broken, "largest_gap": max(gaps)}
    print(json.dumps(result, indent=1))
    if broken:
        raise SystemExit("a fit broke its conditions")


if __name__ == "__main__":
    main()
