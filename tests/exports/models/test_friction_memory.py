"""Exports of friction that remembers: their memory along a motion against the states that this package finds there.

The proof of an export walks a random motion; here is a motion with reversals, the functions without a proof of their
own (observer, compensation), steps that a simulator takes back, and the same on a real log.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib.util import find_spec
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from compiled_header import Header, needs_compiler
from test_c_header import bare
from test_fmu import instance, put, unit_of, value

from dynident import read_case
from dynident.arrays import Array
from dynident.data.preprocessing import preprocess
from dynident.exports.models import export_model
from dynident.identification.estimate.estimate import Estimate
from dynident.model.friction import Motion
from dynident.model.friction.presliding import Presliding
from dynident.model.robot import Robot
from real_data import real

PARTS = ("coulomb", "viscous", "load", "presliding", Presliding(6e-3, 0.4, 2))

#: A memory that is carried from row to row, beside the functions that take one.
MEMORY = """
static arm_memory memory;
void begin(void) { arm_memory_reset(&memory); }
void torque(const double *q, const double *dq, const double *ddq, double *out)
{ arm_memory_step(&memory, q); arm_inverse_dynamics(q, dq, ddq, &memory, out); }
void compensation(const double *q, const double *dq, const double *ddq, double *out)
{ arm_memory_step(&memory, q); arm_friction_compensation(q, dq, ddq, &memory, out); }
"""


def turning(joints: int, samples: int = 600, step: float = 2e-3) -> Motion:
    """Return a motion that turns back every few milliradians on its way to and fro."""
    time = np.arange(samples)[:, None] * step
    rates = np.array([2.0, 31.0])[:, None] * (1.0 + 0.3 * np.arange(joints))
    sizes = np.array([0.05, 4e-3])
    angles = [rate * time + k for k, rate in enumerate(rates)]
    q = sum(a * np.sin(angle) for a, angle in zip(sizes, angles, strict=True))
    dq = sum(a * rate * np.cos(angle) for a, rate, angle in zip(sizes, rates, angles, strict=True))
    ddq = sum(-a * rate**2 * np.sin(angle) for a, rate, angle in zip(sizes, rates, angles, strict=True))
    return Motion(q, dq, ddq)  # type: ignore[arg-type]


def by_numpy(estimate: Estimate, motion: Motion, folder: Path) -> Array:
    export_model(estimate, "numpy", folder / "arm.py", proof=False)
    space: dict[str, Any] = {"__name__": "arm"}
    exec(compile((folder / "arm.py").read_text("ascii"), "arm.py", "exec"), space)
    memory = space["Memory"]()
    return space["inverse_dynamics"](motion.q, motion.dq, motion.ddq, np.array([memory.step(q) for q in motion.q]))


def by_casadi(estimate: Estimate, motion: Motion, folder: Path) -> Array:
    """Return the torques by the functions that CasADi has; by their formulas where it is not installed."""
    export_model(estimate, "casadi", folder / "arm.py", proof=False)
    space: dict[str, Any] = {"__name__": "arm"}
    exec(compile((folder / "arm.py").read_text("ascii"), "arm.py", "exec"), space)
    has = space["build"]() if find_spec("casadi") else None

    def step(*given: Array) -> Array:
        found = has["next_state"](*given) if has else space["_next_state"](np, *given)
        return np.asarray(found, dtype=np.float64).ravel()

    size = sum(len(part.states) for part in estimate.model.friction) * motion.q.shape[1]
    states = accumulate(pairwise(motion.q), lambda state, pair: step(state, *pair), initial=np.zeros(size))
    columns = [motion.q.T, motion.dq.T, motion.ddq.T, np.array(list(states)).T]
    if has:
        return np.asarray(has["inverse_dynamics"].map(len(motion.q))(*columns)).T
    return np.stack(np.broadcast_arrays(*space["_inverse_dynamics"](np, *columns)), axis=1)


def by_header(estimate: Estimate, motion: Motion, folder: Path) -> Array:
    export_model(estimate, "c_header", folder / "arm.h", proof=False)
    header = Header(folder / "arm.h", [], more=MEMORY)
    header.library.begin()
    return header.rows("torque", motion.q.shape[1], motion.q, motion.dq, motion.ddq)


def by_unit(estimate: Estimate, motion: Motion, folder: Path) -> Array:
    joints = motion.q.shape[1]
    unit = unit_of(estimate, folder)
    arm = instance(unit)
    inputs, outputs = unit.of(("q", "dq", "ddq"), joints), unit.of(("tau",), joints)
    given, asked = (ctypes.c_uint32 * len(inputs))(*inputs), (ctypes.c_uint32 * joints)(*outputs)
    row, out, found = (ctypes.c_double * len(inputs))(), (ctypes.c_double * joints)(), []
    for state in np.hstack([motion.q, motion.dq, motion.ddq]):
        row[:] = state.tolist()
        arm.torque(given, row, asked, out)
        found.append(list(out))
    return np.array(found)


WAYS = [by_numpy, by_casadi, pytest.param(by_header, marks=needs_compiler), pytest.param(by_unit, marks=needs_compiler)]


@pytest.mark.parametrize("way", WAYS)
def test_torques_along_a_motion_are_those_of_the_model(
    coupled_arm: Robot, way: Callable[[Estimate, Motion, Path], Array], tmp_path: Path
) -> None:
    estimate = bare(coupled_arm, PARTS)
    model, theta = estimate.model, np.asarray(estimate.theta)
    motion = turning(coupled_arm.dof)
    expected = model.torque(model.with_states(motion, 2e-3), theta)
    found = way(estimate, motion, tmp_path)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert np.abs(model.torque(motion, theta) - expected).max() > 0.05  # what an element that has slipped would give


@pytest.mark.battery
@pytest.mark.parametrize("way", WAYS)
def test_torques_along_a_real_log_are_those_of_the_model(
    way: Callable[[Estimate, Motion, Path], Array], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = real("panda_gaz2019", monkeypatch)
    case = read_case(Path(__file__).parents[3] / "examples" / "cases" / "panda.yaml")
    log = preprocess(case.read(str(folder / "exciting_traj_1.csv")), case.preprocessing).log
    assert log.dq is not None and log.ddq is not None
    estimate = bare(case.model.robot, PARTS)
    motion = Motion(log.q, log.dq, log.ddq)
    expected = estimate.model.torque(estimate.model.with_states(motion, 1.0 / log.rate), np.asarray(estimate.theta))
    np.testing.assert_allclose(way(estimate, motion, tmp_path), expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@needs_compiler
def test_compensation_and_observer_keep_a_memory(coupled_arm: Robot, tmp_path: Path) -> None:
    estimate = bare(coupled_arm, ("viscous", "presliding"))
    model, theta, motion = estimate.model, np.asarray(estimate.theta), turning(coupled_arm.dof, 6000, 2e-4)
    export_model(estimate, "c_header", tmp_path / "arm.h", proof=False)
    header = Header(tmp_path / "arm.h", [], observer=True, more=MEMORY)
    header.library.begin()
    known = model.with_states(motion, 2e-4)
    bodies = np.r_[theta[: model.inertial_count], np.zeros(len(theta) - model.inertial_count)]
    expected = model.torque(known, theta) - model.torque(known, bodies) - model.robot.bias
    found = header.rows("compensation", coupled_arm.dof, motion.q, motion.dq, motion.ddq)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    header.library.reset()
    gain, step = np.full_like(motion.q, 50.0), np.full((len(motion.q), 1), 2e-4)
    residual = header.rows("observe", coupled_arm.dof, motion.q, motion.dq, model.torque(known, theta), gain, step)
    assert np.abs(residual).max() < 0.15 * np.abs(expected).max()


@needs_compiler
def test_a_simulator_takes_a_step_back(pendulum: Robot, tmp_path: Path) -> None:
    """Between two steps the torque follows from the position alone; a state that is put back holds the memory."""
    unit = unit_of(bare(pendulum, ("presliding",)), tmp_path)
    q, friction = unit.references["q[1]"], unit.references["friction[1]"]
    arm = instance(unit, exchange=True)
    flags = [ctypes.byref(ctypes.c_bool()) for _ in range(2)]

    def accepted(position: float) -> float:
        put(arm, q, position)
        arm.call("fmi3CompletedIntegratorStep", ctypes.c_bool(True), *flags)
        return value(arm, friction)

    assert accepted(1.0) == 0.0 and accepted(1.01) > 0.0
    held, kept = value(arm, friction), ctypes.c_void_p(None)
    arm.call("fmi3GetFMUState", ctypes.byref(kept))
    put(arm, q, 1.004)  # tried, not taken
    assert value(arm, friction) == pytest.approx(-held)
    put(arm, q, 1.01)
    assert value(arm, friction) == held
    assert accepted(1.004) == pytest.approx(-held)
    assert accepted(1.0055) == pytest.approx(-held / 2)
    arm.call("fmi3SetFMUState", kept)
    assert value(arm, friction) == held and accepted(1.007) == pytest.approx(0.0, abs=1e-12)
    arm.call("fmi3FreeFMUState", ctypes.byref(kept))


@needs_compiler
def test_a_unit_begins_where_its_initialization_puts_it(pendulum: Robot, tmp_path: Path) -> None:
    unit = unit_of(bare(pendulum, ("presliding",)), tmp_path)
    q, friction = unit.references["q[1]"], unit.references["friction[1]"]
    for begins in (True, False):
        arm = instance(unit)
        arm.call("fmi3Terminate")
        arm.call("fmi3Reset")
        if begins:
            put(arm, q, 1.0)
        arm.call(
            "fmi3EnterInitializationMode",
            *(ctypes.c_bool(False), ctypes.c_double(0), ctypes.c_double(0), ctypes.c_bool(False), ctypes.c_double(0)),
        )
        arm.call("fmi3ExitInitializationMode")
        put(arm, q, 1.0015)
        assert (value(arm, friction) > 0.0) is begins
