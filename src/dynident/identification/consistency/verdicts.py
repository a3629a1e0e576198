"""Verdicts on physical consistency: which conditions are broken, and whether any possible robot stands behind beta.

Conditions: P_i > 0 for every link (Wensing, Kim and Slotine 2018, (12)), friction and rotor inertia >= 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.identification.consistency.certificate import deepest
from dynident.identification.consistency.conditions import conditions_of
from dynident.identification.estimate.estimate import Consistency
from dynident.identification.problem.prior import Scale, link_lengths, parameter_sizes
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.kernels import batched

#: Reasons that are told in a line.
TOLD = 3


def broken_conditions(model: DynamicModel, theta: Array) -> tuple[str, ...]:
    """Return which conditions of physical consistency standard parameters (p,) break, in words."""
    reasons = []
    for i, link in enumerate(model.robot.links):
        inertia = Inertia.from_vector(theta[10 * i : 10 * i + 10])
        if not inertia.is_consistent():
            reasons.append(f"{link.name}: {inertia.defect() or 'the pseudo-inertia is not positive definite'}")
    for parameter, value in zip(model.parameters, theta, strict=True):
        if parameter.nonnegative and value < parameter.least - 1e-6 * abs(parameter.least):  # a bound met by rounding
            below, digits = (f"below {parameter.least:.8g}", 8) if parameter.least else ("negative", 4)
            reasons.append(f"{parameter.name} = {value:.{digits}g} {parameter.unit} is {below}")
    return tuple(reasons)


def judge(model: DynamicModel, base: BaseParameters, beta: Array, theta: Array | None) -> Consistency:
    """Say whether a possible robot stands behind an estimate; see :class:`Consistency`."""
    smallest = smallest_inertia(model, base.to_standard(beta))
    reasons = list(broken_conditions(model, theta)) if theta is not None else _unreachable(model, base, beta)
    if smallest <= 0:
        reasons.append(f"the inertia matrix M(q) has the eigenvalue {smallest:.4g}")
    return Consistency(not reasons, tuple(reasons), smallest)


def smallest_inertia(model: DynamicModel, theta: Array, samples: int = 200, seed: int = 1) -> float:
    """Return the smallest eigenvalue of M(q), rotors included, over random states, in kg m^2 (or kg)."""
    motion = model.random_motion(samples, seed)
    mass = batched.mass_matrix(model.robot.chain, theta[: model.inertial_count], motion.q, once=True)
    rotor = np.diag(model.rotors(theta))
    coupling = np.asarray(model.robot.coupling)
    total = mass + model.robot.reflected_inertia + coupling.T @ rotor @ coupling
    return float(np.min(np.linalg.eigvalsh(total)))


def _unreachable(model: DynamicModel, base: BaseParameters, beta: Array) -> list[str]:
    """Return why no consistent theta has K theta = beta; empty where one has.

    Maximises t such that the scaled pseudo-inertias exceed t I and the coefficients t, with K theta = beta.
    """
    reachable = deepest_consistent(model, base, beta)
    if reachable is not None and not broken_conditions(model, reachable):
        return []
    return ["no links with positive mass density and friction >= 0 have these base parameters"]


def deepest_consistent(model: DynamicModel, base: BaseParameters, beta: Array) -> Array | None:
    """Return the theta deepest inside the cones with K theta = beta, shape (p,); None where there is none."""
    scale = scale_of_base(model, base, beta)
    sizes, matrix = scale.parameters, base.matrix * scale.parameters
    rows = np.linalg.norm(matrix, axis=1)
    rules = replace(conditions_of(model, scale, 0.0), zero=matrix / rows[:, None], zero_offset=-beta / rows)
    found = deepest(rules)
    if found.depth <= 0 or rules.shortfall(found.phi) > 1e-7:
        return None
    theta = found.phi * sizes
    signs = np.array([p.nonnegative for p in model.parameters])
    return np.where(signs & (theta < 0) & (theta > -1e-6 * sizes), 0.0, theta)  # a rounding below zero


def scale_of_base(model: DynamicModel, base: BaseParameters, beta: Array) -> Scale:
    """Return natural sizes that go with the sizes of base parameters (b,), where nothing else is known."""
    length = link_lengths(model)
    mass = np.full(len(length), max(_mass_of(model, base, beta, float(np.max(length))), 1e-9))
    sizes = parameter_sizes(model, mass, length, _friction_of(model, base, beta))
    return Scale(mass, length, sizes, np.zeros(len(model.parameters)), "beta")


def _mass_of(model: DynamicModel, base: BaseParameters, beta: Array, length: float) -> float:
    """Return a mass that goes with the size of the inertial base parameters."""
    bodies = base.independent < model.inertial_count
    if not np.any(bodies):
        return 1.0
    sizes = np.r_[np.full(6, length**2), np.full(3, length), 1.0]
    return float(np.max(np.abs(beta[bodies]) / sizes[base.independent[bodies] % len(sizes)]))


def _friction_of(model: DynamicModel, base: BaseParameters, beta: Array) -> Array:
    """Return the largest friction coefficient of each joint, shape (n,)."""
    sizes = dict.fromkeys(model.robot.joint_names, 0.0)
    for k, value in zip(base.independent[base.is_friction], beta[base.is_friction], strict=True):
        owner = base.parameters[k].owner
        sizes[owner] = max(sizes[owner], abs(float(value)))
    return np.array(list(sizes.values()))


def describe_reasons(reasons: Sequence[str]) -> str:
    """Return the first reasons in one line."""
    more = f" and {len(reasons) - TOLD} more" if len(reasons) > TOLD else ""
    return "; ".join(reasons[:TOLD]) + more
