"""Which link, or which coefficient, keeps an estimate from being a possible robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.identification.consistency.certificate import deepest
from dynident.identification.consistency.conditions import conditions_of
from dynident.identification.consistency.verdicts import scale_of_base
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia


def culprit(model: DynamicModel, base: BaseParameters, beta: Array, theta: Array | None = None) -> str:
    """Return the link, or the coefficient such as ``Fv[joint2]``, that is furthest from the possible.

    With standard parameters it is the link whose pseudo-inertia, its second moments over the square of its length, has
    the lowest eigenvalue for its size, or else the coefficient that is most negative. With base parameters alone the
    links share them, and none of them is wrong by itself: it is the condition with the largest price at the point
    deepest inside all conditions with K theta = beta. Relaxing it helps most.

    Args:
        model: Robot, drives and friction.
        base: Its base parameters.
        beta: Their values, shape (b,).
        theta: Standard parameters behind beta, shape (p,); None where there are base parameters only.

    Returns:
        A name; empty where all conditions hold or no price could be found.
    """
    scale = scale_of_base(model, base, beta)
    if theta is not None:
        depths = {
            parameter.name: float((value - parameter.least) / size)
            for parameter, value, size in zip(model.parameters, theta, scale.parameters, strict=True)
            if parameter.nonnegative
        }
        for i, link in enumerate(model.robot.links):
            depths[link.name] = _depth(theta[10 * i : 10 * i + 10], float(scale.length[i]))
        worst = min(depths, key=lambda name: depths[name])
        return worst if depths[worst] < 0 else ""
    rules = conditions_of(model, scale, 0.0)
    rows = base.matrix * scale.parameters
    norms = np.linalg.norm(rows, axis=1)
    found = deepest(
        replace(rules, zero=rows / norms[:, None], zero_offset=-beta / norms, zero_words=("measured",) * base.count)
    )
    if found.depth >= 0:
        return ""
    prices = [*found.multipliers.sign, *np.einsum("lii->l", found.multipliers.cones)]
    names = [*_owners(model), *rules.links]
    return names[int(np.argmax(prices))]


def _owners(model: DynamicModel) -> list[str]:
    """Return the names of the coefficients that may not be negative, in the order of their conditions."""
    return [parameter.name for parameter in model.parameters if parameter.nonnegative]


def _depth(ten: Array, length: float) -> float:
    """Return the lowest eigenvalue of a link's pseudo-inertia in units of its mass and length, over the largest."""
    turned = np.diag([1.0 / length] * 3 + [1.0])
    values = np.linalg.eigvalsh(turned @ Inertia.from_vector(ten).pseudo @ turned)
    return float(values[0] / max(np.abs(values).max(), 1e-300))
