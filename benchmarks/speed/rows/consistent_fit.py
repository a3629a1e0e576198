"""The physically consistent fit on the reduced triangle: Clarabel on the program itself, and the same through cvxpy.

6R arm, 78 standard parameters, 12,000 rows with noise of 5 N m, which breaks bodies of the free fit. Both sides get the
posed program; cvxpy builds its problem at every call, as the fit of a new log does. The whole of ``consistent_fit``
poses the program, solves it, proves the gap of the answer and finds the conditions that hold it.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import numpy as np

from benchmarks.speed.harness import Line, Record
from dynident.arrays import Array
from dynident.identification.consistency.conic import solve_conic
from dynident.identification.consistency.consistent_fit import consistent_fit, pose_program
from dynident.identification.consistency.program import Program
from dynident.identification.problem.prior import natural_scale
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import PSEUDO_BASIS
from dynident.model.reduction import Reduced, triangle_of
from dynident.robot_files import read_robot

ROWS, NOISE, REPEATS = 12_000, 5.0, 7
SOLVER, WHOLE, CVXPY = (
    "Clarabel on the program",
    "consistent_fit, with its proof",
    "cvxpy with Clarabel, built and solved",
)


def noisy_triangle(model: DynamicModel, base: BaseParameters, noise: float, seed: int) -> Reduced:
    """Return the triangle of random states with white noise in the torques."""
    theta = model.nominal()
    assert theta is not None
    states = model.random_motion(ROWS // model.robot.dof, seed)
    regressor = model.regressor(states).reshape(-1, len(theta))[:, base.independent]
    torque = regressor @ base.from_standard(theta)
    torque = torque + noise * np.random.default_rng(seed).normal(size=len(torque))
    factor, size = triangle_of(np.column_stack([regressor, torque])), base.count
    return Reduced(factor[:size, :size], factor[:size, size], float(factor[size, size] ** 2), len(torque))


def measure() -> Record:
    found = Record("consistent_fit", f"6R arm, triangle of {ROWS} rows, 78 parameters, six pseudo-inertias")
    model = DynamicModel(read_robot("generic-6r"), ("coulomb", "viscous", "rotor_inertia"))
    base = base_parameters(model)
    posed = (model, base, noisy_triangle(model, base, NOISE, 0), natural_scale(model, np.full(6, 10.0), np.ones(6)))
    program = pose_program(*posed)
    fit = consistent_fit(*posed)
    calls: dict[str, Callable[[], object]] = {
        SOLVER: lambda: solve_conic(program),
        WHOLE: lambda: consistent_fit(*posed),
    }
    if found.peer("cvxpy"):
        theirs = program.objective(through_cvxpy(program))
        apart = abs(program.objective(solve_conic(program).phi) - theirs) / (0.5 + theirs)
        found.agree("objectives, relative", apart, 1e-6)
        calls[CVXPY] = lambda: through_cvxpy(program)
        found.facts["import cvxpy, s of the processor"] = _import_time("cvxpy")
        found.facts["import clarabel, s of the processor"] = _import_time("clarabel")
    found.agree("proven gap of the fit", fit.optimality.gap, 1e-6)
    found.time(calls, REPEATS)
    found.facts["parameters"] = len(model.parameters)
    found.lines = [
        Line("consistent fit on the triangle, solver alone", SOLVER, CVXPY),
        Line("consistent fit on the triangle, posed, solved and proved", WHOLE, CVXPY),
        Line("the same, in time", WHOLE, reach=0.010),
    ]
    return found


def through_cvxpy(program: Program) -> Array:
    """Return the solution of the same program, stated in cvxpy."""
    import cvxpy

    rules, phi = program.conditions, cvxpy.Variable(program.data.shape[1])
    rest = cvxpy.sum_squares(program.data @ phi - program.target)
    rest += cvxpy.sum_squares(program.pull @ phi - program.pull_target)
    held = []
    if len(rules.zero):
        held.append(rules.zero @ phi + rules.zero_offset == 0)
    if len(rules.sign):
        held.append(rules.sign @ phi + rules.sign_offset >= 0)
    for i in range(program.links):
        basis = np.asarray(PSEUDO_BASIS).reshape(10, 16).T
        body = cvxpy.reshape(basis @ phi[10 * i : 10 * i + 10], (4, 4), order="C")
        held.append(body >> rules.margin * np.eye(4))
    cvxpy.Problem(cvxpy.Minimize(0.5 * rest), held).solve(solver=cvxpy.CLARABEL)
    assert phi.value is not None
    return phi.value


def _import_time(module: str) -> float:
    """Return the time of the processor that an import takes in a fresh process with NumPy and SciPy, in s."""
    code = f"import time, numpy, scipy.sparse; s = time.process_time(); import {module}; print(time.process_time() - s)"
    times = [float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout) for _ in "abc"]
    return sorted(times)[1]
