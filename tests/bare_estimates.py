"""Estimates of known parameters without a log: what an export and an application of a model read."""

from __future__ import annotations

import numpy as np

from dynident.arrays import Array
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.estimate.estimate import Consistency, Estimate
from dynident.identification.estimate.validation import Validation
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel


def bare_estimate(model: DynamicModel, theta: Array) -> Estimate:
    """Return the estimate of standard parameters (p,): variances of one, no figures of a fit."""
    base, ones = base_parameters(model), np.ones(model.robot.dof)
    none = np.zeros((0, model.robot.dof))
    return Estimate(
        model, base, base.from_standard(theta), np.eye(base.count), theta, ones, ones, 1.0, 1, 0, "consistent", {},
        Consistency(True, (), 1.0),
        Validation((), (), np.nan, 1, 0.0, {}, (), np.zeros(0), (0,), none, none, none, none, none),
        Preprocessing(AsGiven()),
    )  # fmt: skip
