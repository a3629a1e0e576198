"""Intervals of a coefficient where the model lacks something that depends on the state, and where it lacks nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.trials import virtual

from dynident.arrays import Array
from dynident.case.case import read_case
from dynident.diagnosis.causes.model_error import INDEPENDENT, ModelError
from dynident.diagnosis.causes.quick_fit import quick_fit
from dynident.diagnosis.causes.torque_scales import joint_scales
from dynident.model.friction import Motion

ROWS, COLUMNS, DRAWS = 120, 6, 200


def held(error: float, noise: float) -> tuple[float, float]:
    """Return the share of 95 % intervals that hold the last coefficient of a fit, and their median widening."""
    generator = np.random.default_rng(3)
    state = 2.0 * np.sin(np.linspace(0.0, 20.0, ROWS))[:, None] * [1.0, 0.4] + generator.normal(0, 0.3, (ROWS, 2))
    columns = np.column_stack([np.sin(state @ generator.normal(size=2) + k) for k in range(COLUMNS)])
    covariance = np.exp(-0.5 * np.sum((state[:, None] - state) ** 2, axis=2))
    root = np.linalg.cholesky(covariance + 1e-9 * np.eye(ROWS))
    hat, inverse = np.linalg.pinv(columns), np.linalg.inv(columns.T @ columns)
    model, inside, widenings = ModelError(INDEPENDENT, [covariance]), [], []
    for _ in range(DRAWS):
        target = error * root @ generator.normal(size=ROWS) + noise * generator.normal(size=ROWS)
        residual = target - columns @ (hat @ target)
        deviation = float(np.sqrt(np.mean(residual**2)))
        widening = model.of_rows([columns / deviation], [residual / deviation]).widening(-1, np.ones(1))
        spread = deviation * np.sqrt(inverse[-1, -1] * widening / INDEPENDENT)
        inside.append(abs(hat[-1] @ target) < 1.96 * spread)
        widenings.append(widening / INDEPENDENT)
    return float(np.mean(inside)), float(np.median(widenings))


def test_intervals_hold_where_the_error_follows_the_state_and_stay_narrow_where_it_is_noise() -> None:
    share, wide = held(1.0, 0.1)
    assert share > 0.9 and wide > 3.0
    share, wide = held(0.0, 1.0)
    assert share > 0.9 and wide < 1.5


@pytest.mark.parametrize("state", [lambda motion: 3.0 * motion.q, lambda motion: motion.ddq / motion.ddq.std(axis=0)])
def test_an_error_of_positions_or_accelerations_widens_the_interval_of_a_scale_that_noise_does_not(
    state: Callable[[Motion], Array], tmp_path: Path
) -> None:
    right = virtual(read_case("generic-6r"))
    more = 0.03 * right.columns["tau"].std(axis=0) * np.sin(state(put.smoothed(right)))
    bent = right.with_columns(tau=right.columns["tau"] + more)
    spreads = []
    for trial in (right, bent):
        fit = quick_fit(trial.case, trial.case.read(trial.written(tmp_path)))
        assert fit is not None
        elbow = joint_scales(fit)[2]
        assert elbow.low <= 1.0 <= elbow.high
        spreads.append(elbow.spread)
    assert spreads[0] < 0.005 and spreads[1] > 3 * spreads[0]
