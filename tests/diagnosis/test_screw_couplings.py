"""The spline of a SCARA: the nut of its ball screw turns with the last joint as well, m of the slide for a rad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults.trials import Trial

import dynident as di
from dynident.case.case import read_case
from dynident.diagnosis.finding import Finding
from dynident.model.dynamic_model import DynamicModel

RATE, SECONDS, LEAD = 100.0, 20.0, 0.02 / (2 * np.pi)


def told(folder: Path, seed: int, lead: float, turning: float = 6.0) -> list[Finding]:
    """Return what is said of torques of the motors, in errors and warnings; the last joint turns at some rad/s."""
    (folder / "case.yaml").write_text("case: 2\nrobot: generic-scara\nfriction: [coulomb, viscous, offset]\n")
    case = read_case(folder / "case.yaml")
    generator, t = np.random.default_rng(seed), np.arange(int(RATE * SECONDS)) / RATE
    speeds = np.array([1.5, 2.0, 0.15, turning])
    hertz, phase = generator.uniform(0.1, 0.8, (4, 5)), generator.uniform(0, 2 * np.pi, (4, 5))
    waves = 2 * np.pi * hertz[:, :, None] * t + phase[:, :, None]
    rate = 2 * np.pi * hertz[:, :, None]
    q = np.sum(np.sin(waves) / rate, axis=1) * speeds[:, None] / np.sqrt(2.5)
    dq = np.sum(np.cos(waves), axis=1) * speeds[:, None] / np.sqrt(2.5)
    ddq = np.sum(-np.sin(waves) * rate, axis=1) * speeds[:, None] / np.sqrt(2.5)
    coupling = np.eye(4)
    coupling[2, 3] = lead
    model = DynamicModel(case.robot, ())
    size = np.std(joint := model.torque(di.Motion(q.T, dq.T, ddq.T), model.nominal()), axis=0)
    motors = joint @ np.linalg.inv(coupling)
    motors += np.array([0.02, 0.05, 6.0, 2e-3]) * (ddq.T @ coupling.T)
    speed = dq.T @ coupling.T
    motors += (0.2 * size + 0.1) * (np.tanh(speed / np.array([0.01, 0.01, 0.001, 0.01])) + 0.3 * speed / speeds)
    motors += 0.005 * np.std(motors, axis=0) * generator.normal(size=motors.shape)
    log = {"t": t, "q": q.T + 1e-6 * generator.normal(size=motors.shape), "tau": motors}
    return [found for found in Trial(case, log).examined(folder).findings if found.severity != "note"]


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("turning", [6.0, 12.0])
def test_the_lead_of_a_screw_is_named(seed: int, turning: float, tmp_path: Path) -> None:
    (found,) = [one for one in told(tmp_path, seed, LEAD, turning) if one.severity == "error"]
    assert found.name == "coupling" and "mm) as well" in found.evidence and "side: {torque: motor}" in found.remedy
    assert found.numbers["entry 3, 4"] == pytest.approx(LEAD, rel=0.05)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_without_a_screw_nothing_is_told(seed: int, tmp_path: Path) -> None:
    assert "coupling" not in [found.name for found in told(tmp_path, seed, 0.0)]
