"""The envelope of a fit, logs that stay inside, and logs that leave it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.diagnosis.warnings import warnings_of
from dynident.identification.build_problem import build_problem
from dynident.identification.estimate.envelope import envelope_of, torque_bands
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.files.estimate_file import read_estimate, summary, write_estimate
from dynident.identification.identify import identify
from dynident.identification.validate import validate
from dynident.model.robot import Robot
from noisy_arms import GIVEN, Bench

MakeLog = Callable[..., Log]


@pytest.fixture(scope="module")
def bench(planar_2r: Robot, exact_log: MakeLog) -> Bench:
    return Bench(planar_2r, exact_log, samples=600)


@pytest.fixture(scope="module")
def estimate(bench: Bench) -> Estimate:
    log = replace(bench.log, torque=np.asarray(bench.log.torque) + bench.white(0))
    return identify(bench.model, [log], "wls", GIVEN)


def faster(bench: Bench, factor: float) -> Log:
    """Return the same path, run faster, with its torque."""
    log = bench.log
    motion = replace(log, time=log.time / factor, dq=factor * np.asarray(log.dq), ddq=factor**2 * np.asarray(log.ddq))
    from dynident.identification.problem.regressor_stream import motion_of

    return replace(motion, torque=bench.model.torque(motion_of(motion), bench.theta))


def test_the_log_of_the_fit_stays_inside(bench: Bench, estimate: Estimate) -> None:
    found = validate(estimate, [bench.log])
    assert found.departure is not None and not found.departure.leaves()
    assert np.all(found.departure.beyond == 0) and found.departure.far == 0.0
    np.testing.assert_allclose(found.departure.growth, 1.0, rtol=1e-9)
    assert estimate.envelope is not None and found.departure.sentence(estimate.envelope) == ""
    assert not any("leaves" in warning for warning in warnings_of(estimate, found))


@pytest.mark.parametrize(("degrees", "is_told"), [(44.0, False), (45.0, False), (58.0, True)])
def test_drives_warmer_than_in_the_fit_are_an_extrapolation(bench: Bench, degrees: float, is_told: bool) -> None:
    """Trained up to 44 degrees, tested at 58, and nothing had been said."""
    log, warm = bench.log, np.linspace(24.0, 44.0, bench.log.samples)[:, None] * np.ones(2)
    estimate = identify(bench.model, [replace(log, temperature=warm)], "wls", GIVEN)
    own = replace(log, temperature=np.full_like(warm, degrees))
    departure, envelope = validate(estimate, [own]).departure, estimate.envelope
    assert departure is not None and envelope is not None and departure.leaves() is is_told
    said = departure.sentence(envelope)
    assert ("temperature of 2 joints (joint1 58 to 58, in training 24 to 44)" in said) is is_told
    assert ("include such motions and temperatures" in said) is is_told
    without = validate(estimate, [log]).departure  # a log that does not state them
    assert without is not None and not without.leaves() and np.shape(without.low) == (3, 2)


def test_rounding_is_not_extrapolation(bench: Bench, estimate: Estimate) -> None:
    """The same log, filtered on another processor, differs in its last digits and stays inside."""
    log = bench.log
    rounded = replace(log, q=log.q * (1 + 1e-13), dq=np.asarray(log.dq) * (1 + 1e-13))
    departure = validate(estimate, [rounded]).departure
    assert departure is not None and departure.far == 0.0
    np.testing.assert_array_equal(departure.outside, 0.0)


def test_twice_as_fast_is_an_extrapolation_with_numbers(bench: Bench, estimate: Estimate) -> None:
    found = validate(estimate, [faster(bench, 2.0)])
    departure, envelope = found.departure, estimate.envelope
    assert departure is not None and envelope is not None and departure.leaves()
    np.testing.assert_array_equal(departure.beyond[0], 0.0)  # the positions are the same
    span = envelope.high - envelope.low
    expected = np.maximum(envelope.high[1], -envelope.low[1]) / span[1]  # 2 v - v
    np.testing.assert_allclose(departure.beyond[1], expected)
    assert departure.far > 0.3 and np.all(departure.growth > 1.5)
    (warning,) = [text for text in warnings_of(estimate, found) if "extrapolation" in text]
    assert "velocity of 2 joints" in warning and "position of" not in warning
    facts = summary(estimate, found)["extrapolation"]
    assert facts["beyond_training_range"] and facts["joints"][0]["velocity"]["beyond"] == pytest.approx(expected[0])


def test_bands_are_those_of_the_rows(bench: Bench, estimate: Estimate) -> None:
    problem = build_problem(bench.model, [bench.log], GIVEN)
    rows = problem.rows
    variance = np.einsum("rb,bc,rc->r", rows.matrix, estimate.covariance, rows.matrix)
    expected = [np.sqrt(variance[rows.joint == i].mean()) for i in range(2)]
    np.testing.assert_allclose(torque_bands(problem.triangles, estimate.covariance), expected)


def test_distances_are_those_of_mahalanobis(bench: Bench) -> None:
    problem = build_problem(bench.model, [bench.log], GIVEN)
    found = envelope_of([bench.log], problem.triangles, np.eye(problem.base.count))
    states = np.concatenate([bench.log.q, np.asarray(bench.log.dq), np.asarray(bench.log.ddq)], axis=1)
    away = states - states.mean(axis=0)
    square = np.einsum("ri,ij,rj->r", away, np.linalg.inv(np.cov(states, rowvar=False, bias=True)), away)
    assert found.furthest == pytest.approx(np.sqrt(square.max()), rel=1e-6)


def test_the_envelope_is_kept_in_the_file(estimate: Estimate, bench: Bench, tmp_path: Path) -> None:
    write_estimate(estimate, tmp_path / "e.json")
    again = read_estimate(tmp_path / "e.json")
    assert again.envelope is not None and estimate.envelope is not None and again.degrees is not None
    np.testing.assert_allclose(again.envelope.whitener, estimate.envelope.whitener)
    np.testing.assert_allclose(again.half_widths(), estimate.half_widths())
    first, second = (validate(e, [faster(bench, 2.0)]).departure for e in (estimate, again))
    assert first is not None and second is not None and first.figures() == second.figures()
