"""A joint that rests against an end stop in spells, and joints that only stand at the end of their travel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import Trial, smooth_motion, virtual
from scipy.ndimage import gaussian_filter1d

from dynident.case.case import Case
from dynident.identification.identify import identify
from dynident.identification.validate import validate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion

JOINT, PLACE = 1, 0.9


@pytest.fixture(scope="module")
def trial(case: Case) -> Trial:
    return virtual(case, rate=100.0)


def stopped(trial: Trial, push: float, side: float = 1.0) -> tuple[Trial, float, np.ndarray]:
    """Return a log in which a joint stands at a stop and pushes, in deviations of its torque; the stop, the rows."""
    t, motion = smooth_motion(trial.case, 0, 100.0)
    q = motion.q.copy()
    stop = float(np.quantile(side * q[:, JOINT], PLACE))
    over = np.maximum(side * q[:, JOINT] - stop, 0.0)
    q[:, JOINT] = gaussian_filter1d(q[:, JOINT] - side * over, 4)
    dq = np.gradient(q, t, axis=0)
    model = DynamicModel(trial.case.robot, trial.case.friction)
    theta = model.nominal()
    assert theta is not None
    tau = model.torque(Motion(q, dq, np.gradient(dq, t, axis=0)), theta)
    generator, size = np.random.default_rng(3), tau.std(axis=0)
    tau += 0.02 * size * generator.normal(size=tau.shape)
    tau[:, JOINT] += side * push * size[JOINT] * (over > 0)
    noisy = q + 2e-5 * generator.normal(size=q.shape)
    return Trial(trial.case, {"t": t, "q": noisy, "tau": tau}), side * stop, over > 0


@pytest.mark.parametrize(("push", "side"), [(3.0, 1.0), (3.0, -1.0), (0.05, 1.0)])
def test_a_stop_is_named_with_its_place_and_its_spells(push: float, side: float, trial: Trial, tmp_path: Path) -> None:
    """A tenth of the samples against a stop was told as another robot, or not at all."""
    log, stop, rows = stopped(trial, push, side)
    found = [one for one in log.examined(tmp_path).findings if one.severity != "note"]
    assert [one.name for one in found] == ["end stop"] * (push > 1.0)
    for one in found:
        assert one.joint == trial.case.robot.joint_names[JOINT] and one.severity == "error"
        assert one.numbers["position"] == pytest.approx(stop, abs=0.02)
        assert ("upper" if side > 0 else "lower") in one.evidence and one.numbers["push"] > 0
        assert 0.5 * rows.mean() < one.numbers["share"] < 1.5 * rows.mean()


def test_the_rows_that_are_named_mend_the_fit(trial: Trial, tmp_path: Path) -> None:
    log, _, rows = stopped(trial, 3.0)
    near = np.convolve(rows, np.ones(41), "same") > 0  # 0.2 s on either side
    case = replace(trial.case, preprocessing=replace(trial.case.preprocessing, longest_gap_s=30.0))
    mended = replace(log, case=case).rows(np.flatnonzero(~near))
    assert "end stop" not in [one.name for one in mended.examined(tmp_path).findings]
    test = trial.case.read(virtual(trial.case, 1, 100.0).written(tmp_path, "test"))
    errors = []
    for one in (log, mended):
        found = identify(case.model, [case.read(one.written(tmp_path))], "wls", one.case.preprocessing)
        errors.append(validate(found, [test]).total_relative_error)
    assert errors[1] < 0.5 * errors[0]


def test_a_joint_that_is_held_at_the_end_of_its_travel_is_at_no_stop(trial: Trial, tmp_path: Path) -> None:
    """Dry friction holds as much as the motor asks for at rest, above the level in motion."""
    log, _, rows = stopped(trial, 0.0)
    tau = log.columns["tau"].copy()
    tau[rows, JOINT] += 1.5 * trial.case.robot.joints[JOINT].friction
    found = log.with_columns(tau=tau).examined(tmp_path).findings
    assert not [one for one in found if one.severity != "note"]
