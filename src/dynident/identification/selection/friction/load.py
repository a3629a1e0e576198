"""Friction that depends on the load: the linear problem is posed again with the torque of its own solution.

The column |torque| tanh(dq / width) asks for the torque of the bodies that are to be found. Starting from a fit without
that column, each pass takes the torque of the last one. Where two passes agree, the estimate predicts with its own
torque what it was fitted with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Prepared
from dynident.identification.problem.problem import Problem, make_problem
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.reduction import least_squares

#: Two passes agree when the torque changes by less than this share.
AGREED = 1e-4

#: Passes at most.
PASSES = 8


def without_load(model: DynamicModel) -> DynamicModel:
    """Return the model without the friction parts that need the torque."""
    return replace(model, friction=tuple(part for part in model.friction if "torque" not in part.needs))


def problem_of(model: DynamicModel, logs: Sequence[Prepared]) -> Problem:
    """Return the problem of a model; where its friction depends on the load, with that of a fit without those parts.

    Raises:
        LogMismatch: See :func:`make_problem`.
        PoorExcitation: The rows do not determine all base parameters.
    """
    base = base_parameters(model)
    if "torque" not in model.needs:
        return make_problem(model, base, logs)
    simple = without_load(model)
    first, standard = _first_fit(simple, logs)
    known = dict(zip((p.name for p in simple.parameters), standard.tolist(), strict=True))
    load = base.from_standard(np.array([known.get(p.name, 0.0) for p in model.parameters]))
    return make_problem(model, base, logs, load, first.kept)


def default_load(model: DynamicModel, logs: Sequence[Prepared]) -> Array:
    """Return inertial standard parameters (10 l,) with the torque of a fit without parts that need it."""
    return _first_fit(without_load(model), logs)[1][: model.inertial_count]


def _first_fit(model: DynamicModel, logs: Sequence[Prepared]) -> tuple[Problem, Array]:
    """Return the problem and standard parameters (p,), zero outside the base ones, of its weighted least squares."""
    problem = make_problem(model, base_parameters(model), logs)
    deviations = problem.joint_deviations(least_squares(problem.reduced()).beta)
    return problem, problem.base.to_standard(least_squares(problem.reduced(1.0 / deviations)).beta)


def agrees(problem: Problem, beta: Array) -> bool:
    """Return whether the load in a problem is that of ``beta`` (b,), or nothing asks for one."""
    if problem.load is None:
        return True
    change = np.where(problem.base.is_friction, 0.0, beta - problem.load)
    reduced = problem.reduced()
    return bool(np.linalg.norm(reduced.r @ change) <= AGREED * np.hypot(np.linalg.norm(reduced.z), reduced.rest**0.5))


def with_load(problem: Problem, beta: Array) -> Problem:
    """Return the problem with the load of ``beta`` (b,), as it is where nothing asks for one."""
    if problem.load is None or problem.load is beta:
        return problem
    found = make_problem(problem.model, problem.base, problem.logs, beta, problem.kept)
    found = replace(found, choices=problem.choices, constraints=problem.constraints, prior=problem.prior)
    return found if problem.bias is None else found.without(problem.bias)
