"""Log checks of an arm with the finger of a gripper: a slide of 15 mm, slow or at rest; torques by Pinocchio."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.trials import Trial
from benchmarks.strangers.plant import waves
from sliding_arms import torques, trial_of, with_slide

from dynident.diagnosis.causes.couplings import CoupledRows
from dynident.diagnosis.causes.thin_fit import quick_fit
from dynident.diagnosis.finding import Finding

RATE, SECONDS, TRAVEL = 100.0, 20.0, 0.015

#: Name, place, axis, mass and length of the links of the arm; the finger slides across the last one.
LINKS = (
    ("base", (0.0, 0.0, 0.0), (0, 0, 1), 6.0, 0.3),
    ("shoulder", (0.0, 0.1, 0.3), (0, 1, 0), 5.0, 0.4),
    ("elbow", (0.0, 0.0, 0.4), (0, 1, 0), 3.0, 0.3),
    ("wrist", (0.0, 0.02, 0.3), (0, 0, 1), 1.0, 0.1),
    ("finger", (0.03, 0.0, 0.1), (1, 0, 0), 0.3, 0.05),
)


def strokes(t: np.ndarray, starts: tuple[float, ...], lasts: float = 0.3) -> np.ndarray:
    """Return the position of a finger that opens and closes in strokes, with its two derivatives, shape (3, N)."""
    found, opens = np.zeros((3, len(t))), 1.0
    found[0] = 0.01
    for start in starts:
        x = np.clip((t - start) / lasts, 0, 1)
        way = (x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x))
        found += opens * TRAVEL * np.stack([way[0], way[1] / lasts, way[2] / lasts**2])
        opens = -opens
    return found


def recorded(folder: Path, seed: int, starts: tuple[float, ...] = (), first: float = 0.08) -> Trial:
    """Return a log of the arm; the finger moves in strokes, or without them with the slow waves of the others."""
    generator = np.random.default_rng(seed)
    bodies = with_slide(LINKS, "finger", (0.0, 0.04), 0.2)
    t = np.arange(int(RATE * SECONDS)) / RATE
    q, dq, ddq = waves(bodies, first, 5, seed, [1.2, 1.2, 1.2, 1.2, TRAVEL / 2], [0.0, 0.0, 0.0, 0.0, 0.02], 0.8)(t)
    still = np.zeros(len(t), bool)
    if starts:
        q[:, -1], dq[:, -1], ddq[:, -1] = strokes(t, starts)
        still = dq[:, -1] == 0
    tau = torques(bodies, seed, q, dq, ddq)
    size = tau.std(axis=0)
    dry = np.append(0.2 * size[:-1], 2.0)
    tau += dry * np.tanh(dq / np.array([0.005] * 4 + [0.0005])) + np.append(0.1 * size[:-1], 10.0) * dq
    tau[still, -1] += 5.0  # the grip
    tau += np.append(0.01 * size[:-1], 0.1) * generator.normal(size=tau.shape)
    return trial_of(bodies, {"t": t, "q": q + 1e-6 * generator.normal(size=q.shape), "tau": tau}, folder)


def told(trial: Trial, folder: Path) -> list[Finding]:
    """Return errors and warnings, but that the finger's 15 mm excite its parameters poorly, which is true."""
    found = [one for one in trial.examined(folder).findings if one.severity != "note"]
    assert all(one.severity == "warning" for one in found if one.name == "poor excitation")
    return [one for one in found if one.name != "poor excitation"]


@pytest.mark.parametrize(
    "seed", [0, pytest.param(1, marks=pytest.mark.battery), pytest.param(2, marks=pytest.mark.battery)]
)
@pytest.mark.parametrize("starts", [(), (5.0,), (2.0, 3.0, 12.0, 13.0)], ids=["slow", "one stroke", "four strokes"])
def test_nothing_is_said_of_a_right_log(seed: int, starts: tuple[float, ...], tmp_path: Path) -> None:
    assert [one.line() for one in told(recorded(tmp_path, seed, starts), tmp_path)] == []


def test_swapped_torques_are_named(tmp_path: Path) -> None:
    (found,) = told(put.swapped(recorded(tmp_path, 0, (2.0, 3.0, 12.0, 13.0)), ("tau",), 1), tmp_path)
    assert (found.severity, found.name, found.joint) == ("error", "torque order", "shoulder, elbow")


def test_another_robot_is_named(tmp_path: Path) -> None:
    (found,) = told(put.other_arm(recorded(tmp_path, 0, (2.0, 3.0, 12.0, 13.0)), 0), tmp_path)
    assert (found.severity, found.name) == ("error", "another robot")


def test_a_motor_has_the_friction_of_its_own_kind(tmp_path: Path) -> None:
    trial = recorded(tmp_path, 0)
    fit = quick_fit(trial.case, trial.case.read(str(trial.written(tmp_path))))
    assert fit is not None
    rows, parts = CoupledRows(fit), fit.model.friction
    for drive, row in enumerate(rows.stated):
        acts = [drive in fit.model.drives_of(part) for part in parts for _ in part.coefficients]
        assert 3 <= sum(acts) < len(acts)
        assert np.any(rows.friction(drive, row), axis=0).tolist() == acts


def test_the_scale_of_a_slow_slide_is_open(tmp_path: Path) -> None:
    right = recorded(tmp_path, 0, (5.0,))
    (note,) = [one for one in right.examined(tmp_path).findings if one.name == "scale not determined"]
    assert "finger" in note.joint.split(", ")


def test_a_joint_that_rests_is_named_where_its_parameters_are_not_determined(tmp_path: Path) -> None:
    trial = recorded(tmp_path, 0, (5.0,))
    q = trial.columns["q"].copy()
    q[:, -1] = 0.01 + 0.2 * TRAVEL * np.linspace(0, 1, len(q))  # 3 mm in 20 s
    (found,) = [
        one
        for one in replace(trial, columns={**trial.columns, "q": q}).examined(tmp_path).findings
        if one.name == "poor excitation"
    ]
    assert found.severity == "error"
    assert "nearly all samples of finger are at rest" in found.evidence and "locked" in found.remedy
