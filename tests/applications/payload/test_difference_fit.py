"""The payload's covariance where the robot's own is an estimate that the weights are made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynident import DynamicModel, Robot
from dynident.applications.payload.difference_fit import RunPrior, fit_difference
from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.problem.problem import Problem, make_problem
from dynident.model.base_parameters import base_parameters

FREEDOM, DRAWS = 60, 300


@pytest.fixture
def problem(planar_2r: Robot) -> Problem:
    model = DynamicModel(planar_2r, ("coulomb", "viscous", "offset"))  # type: ignore[arg-type]
    motion = model.random_motion(300, seed=3)
    log = Log(planar_2r.joint_names, 0.01 * np.arange(300), motion.q, motion.dq, motion.ddq, np.zeros_like(motion.q))
    torque = model.torque(motion, np.ones(len(model.parameters)))
    prepared = preprocess(replace(log, torque=torque), Preprocessing(AsGiven(), rest="keep"))
    return make_problem(model, base_parameters(model), [prepared])


def test_weights_made_of_an_estimated_covariance_are_allowed_for(problem: Problem) -> None:
    """By Monte Carlo: T of an estimate of C, on errors of the true C, against what is stated."""
    generator, weights = np.random.default_rng(5), np.ones(2)
    gram = problem.reduced(weights).r.T @ problem.reduced(weights).r
    size = len(gram)
    mixed = np.linalg.inv(gram) @ (np.eye(size) + 0.3 * generator.normal(size=(size, size)))
    truth = 4.0 * mixed @ gram @ mixed.T  # as a run of a quarter the length and of another motion would have it
    root = np.linalg.cholesky(truth)
    columns = generator.normal(size=(size, 2))

    def known(covariance: Array, degrees: float) -> RunPrior:
        none = np.zeros(2)
        return RunPrior(np.zeros(size), covariance, degrees, columns, np.ones(2), none, np.full(2, np.inf))

    actual, stated, plain = np.zeros(2), np.zeros(2), np.zeros(2)
    for _ in range(DRAWS):
        draws = root @ generator.normal(size=(size, FREEDOM))
        estimate = draws @ draws.T / FREEDOM
        found = fit_difference(problem, weights, known(estimate, FREEDOM))
        lever = found.transfer @ gram
        actual += np.diag(lever @ truth @ lever.T) / DRAWS
        stated += np.diag(found.by_robot) / DRAWS
        plain += np.diag(fit_difference(problem, weights, known(estimate, np.inf)).by_robot) / DRAWS
    assert np.all(plain < 0.85 * actual)  # what it is about
    np.testing.assert_allclose(stated, actual, rtol=0.06)
