"""The CasADi module: its formulas with NumPy, its functions with CasADi where that is installed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_c_header import EVERYTHING, bare, states

from dynident.exports.models import export_model
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot


def module(path: Path) -> dict[str, Any]:
    space: dict[str, Any] = {"__name__": "arm"}
    exec(compile(path.read_text("ascii"), path.name, "exec"), space)
    return space


def test_a_scale_smooths_every_sign(coupled_arm: Robot, tmp_path: Path) -> None:
    estimate = bare(coupled_arm, EVERYTHING)
    found = export_model(estimate, "casadi", tmp_path / "arm.py")
    assert any("forward_dynamics is left out" in note for note in found.notes)
    model, motion = estimate.model, states(estimate.model)
    wide = tuple(replace(part, width=0.3) if hasattr(part, "width") else part for part in model.friction)  # type: ignore[call-arg]
    expected = DynamicModel(model.robot, wide).torque(motion, np.asarray(estimate.theta))
    torque = module(tmp_path / "arm.py")["_inverse_dynamics"](np, motion.q.T, motion.dq.T, motion.ddq.T, 0.3)
    np.testing.assert_allclose(np.stack(torque, axis=1), expected, atol=1e-10)


def test_the_functions_are_those_that_it_names(spatial_3r: Robot, tmp_path: Path) -> None:
    casadi = pytest.importorskip("casadi", reason="CasADi is not installed")
    estimate = bare(spatial_3r, ("coulomb", "viscous"))
    export_model(estimate, "casadi", tmp_path / "arm.py")
    space, motion = module(tmp_path / "arm.py"), states(estimate.model, 1)
    functions = space["build"](0.1, casadi.MX.sym)
    assert all(f'["{name}"]' in space["__doc__"] for name in functions)
    q, dq, ddq = motion.q[0], motion.dq[0], motion.ddq[0]
    tau = np.asarray(functions["inverse_dynamics"](q, dq, ddq))
    parts = np.asarray(functions["mass_matrix"](q)) @ ddq[:, None]
    for value in (functions["gravity"](q), functions["coriolis"](q, dq), functions["friction"](q, dq, ddq)):
        parts = parts + np.asarray(value)
    np.testing.assert_allclose(parts, tau, atol=1e-11)
    np.testing.assert_allclose(np.asarray(functions["forward_dynamics"](q, dq, tau))[:, 0], ddq, atol=1e-10)
