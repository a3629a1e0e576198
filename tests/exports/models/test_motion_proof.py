"""An identified model follows the motion of a log in simulation, and a run that diverges is told as one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynident
from dynident.data.log import Log
from dynident.errors import FileError, LogMismatch
from dynident.exports.models.proving.engines import without_log
from dynident.exports.models.proving.logged_motion import LONGEST, logged_motion
from dynident.exports.models.proving.motion_proof import MotionProof, prove_motion
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.joint import JointLimits
from dynident.model.robot import Robot

FRICTION = ("coulomb", "viscous", "rotor_inertia")


@pytest.fixture(scope="module")
def estimate(spatial_3r: Robot, exact_log: Callable[..., Log]) -> Estimate:
    model = DynamicModel(spatial_3r, FRICTION)  # type: ignore[arg-type]
    theta = model.nominal()
    assert theta is not None
    theta = theta.copy()
    theta[model.inertial_count :] = 0.2
    return identify(model, [exact_log(model, theta, noise=0.01)], "consistent")


@pytest.fixture(scope="module")
def log(estimate: Estimate, exact_log: Callable[..., Log]) -> Log:
    return exact_log(estimate.model, estimate.theta, samples=300, rate=100.0)


@pytest.fixture(scope="module")
def proof(estimate: Estimate, log: Log) -> MotionProof:
    return prove_motion(estimate, log)


def test_every_run_follows_and_computed_torque_is_nearest(proof: MotionProof, log: Log) -> None:
    assert proof.failures == () and proof.duration == pytest.approx(log.duration)
    own, own_pd, *others = proof.runs
    assert (own.controller, own_pd.controller) == ("computed_torque", "pd")
    assert own.share is not None and own_pd.share is not None
    assert own.share < 1e-3 and own.share < own_pd.share < 0.1
    assert [(run.step, run.controller) for run in others] == [
        (step, name) for step in (0.001, 0.002) for name in ("computed_torque", "pd")
    ]
    for run in others:
        assert run.why_not == "not installed" or (run.share is not None and run.share < 0.1)


def test_condition_numbers_are_those_of_the_mass_matrix(estimate: Estimate, log: Log, proof: MotionProof) -> None:
    motion = logged_motion(log)
    q = motion.evaluate(np.linspace(0.0, motion.duration, 200))[0]
    expected = np.linalg.cond(estimate.mass_matrix(q))
    assert proof.condition == pytest.approx((np.median(expected), np.max(expected)))
    assert proof.nominal_condition is not None and proof.nominal_condition != proof.condition


def test_a_robot_model_without_inertias_has_no_condition_number(estimate: Estimate, log: Log) -> None:
    robot = estimate.model.robot
    bare = replace(robot, links=tuple(replace(link, inertia=None) for link in robot.links))
    found = prove_motion(replace(estimate, model=replace(estimate.model, robot=bare)), log)
    assert found.nominal_condition is None and found.data()["nominal_condition"] is None


def test_a_run_that_loses_the_motion_is_named_and_nothing_is_written(
    estimate: Estimate, log: Log, tmp_path: Path
) -> None:
    """MuJoCo holds a joint at the end of its range, which the motion leaves by far."""
    pytest.importorskip("mujoco")
    robot = estimate.model.robot
    joints = (replace(robot.joints[0], limits=JointLimits(lower=-0.01, upper=0.01)), *robot.joints[1:])
    model = replace(estimate.model, robot=replace(robot, joints=joints))
    away = replace(log, q=np.asarray(log.q) + np.array([20.0, 0.0, 0.0]))
    narrow = replace(estimate, model=model)
    proof = prove_motion(narrow, away)
    assert {run.simulator.split()[0] for run in proof.failures} == {"MuJoCo"} and len(proof.failures) == 4
    assert proof.failures[0].failure.startswith("joint1 is further from the motion than its span at ")
    with pytest.raises(FileError, match="does not follow the motion of simulated log in MuJoCo") as refused:
        dynident.export(narrow, "mjcf", tmp_path / "arm.xml", proof=away)
    assert "--bodies plausible" in str(refused.value) and not list(tmp_path.iterdir())


def test_an_export_has_what_was_simulated(estimate: Estimate, log: Log, tmp_path: Path) -> None:
    found = dynident.export(estimate, "json", tmp_path / "arm.json", proof=log, write=False)
    assert found.motion is not None and not found.motion.failures
    assert dynident.export(estimate, "json", tmp_path / "arm.json", proof=False, write=False).motion is None


@pytest.mark.parametrize("are_there", [True, False])
def test_an_own_mjcf_whose_meshes_are_missing_is_simulated_without_them(
    estimate: Estimate, log: Log, tmp_path: Path, are_there: bool
) -> None:
    """It had been refused as a model that does not follow, with other bodies as the step."""
    pytest.importorskip("mujoco")
    own, target = tmp_path / "own.xml", tmp_path / "arm.xml"
    dynident.export(estimate, "mjcf", own)
    text = own.read_text(encoding="utf-8")
    if not are_there:
        text = text.replace("<worldbody>", '<asset><mesh name="m" file="gone.obj"/></asset><worldbody>')
        text = text.replace("<joint", '<geom type="mesh" mesh="m"/><joint', 1)
    own.write_text(text, encoding="utf-8")
    found = dynident.export(estimate, "mjcf", target, description=own, proof=log)
    assert found.motion is not None and not found.motion.failures and target.exists()
    names = {run.simulator for run in found.motion.runs[2:]}
    assert {name.endswith(" without meshes") for name in names} == {not are_there}


def test_shapes_that_touch_along_the_motion_are_named(estimate: Estimate, log: Log, tmp_path: Path) -> None:
    """Balls of 1 m about the first and the last body: MuJoCo lets only a body and its parent stand in each other."""
    pytest.importorskip("mujoco")
    own, target = tmp_path / "own.xml", tmp_path / "arm.xml"
    dynident.export(estimate, "mjcf", own)
    ball = '<geom type="sphere" size="1"/><joint'
    before, _, after = own.read_text(encoding="utf-8").replace("<joint", ball, 1).rpartition("<joint")
    own.write_text(before + ball + after, encoding="utf-8")
    with pytest.raises(
        FileError, match="shapes that touch along the motion, which MuJoCo pushes apart: link1 and link3"
    ):
        dynident.export(estimate, "mjcf", target, description=own, proof=log)


def test_sharp_friction_is_not_run_in_the_own_simulator_and_says_why(estimate: Estimate, log: Log) -> None:
    parts = (Coulomb(width=0.0), *estimate.model.friction[1:])
    sharp = replace(estimate, model=replace(estimate.model, friction=parts))
    own = prove_motion(sharp, log).runs[:2]
    assert all("width" in run.why_not and run.share is None for run in own)


def test_the_part_with_the_most_motion_is_followed() -> None:
    time = np.arange(0.0, 40.0, 0.01)
    size = np.where((time > 22.0) & (time < 33.0), 1.0, 0.05)[:, None]
    q = size * np.sin(2.0 * time[:, None] + [0.0, 1.0])
    motion = logged_motion(Log(("a", "b"), time, q))
    assert 21.5 < motion.start < 23.5 and motion.duration == pytest.approx(LONGEST, abs=0.02)


def test_the_motion_is_smooth_and_its_derivatives_agree_with_differences() -> None:
    time = np.arange(0.0, 6.0, 0.002)
    noise = 1e-3 * np.random.default_rng(0).normal(size=(len(time), 1))
    motion = logged_motion(Log(("a",), time, np.sin(time)[:, None] + noise))
    at, h = np.linspace(1.0, 5.0, 50), 1e-4
    _, dq, ddq = motion.evaluate(at)
    before, after = motion.evaluate(at - h), motion.evaluate(at + h)
    np.testing.assert_allclose(dq, (after[0] - before[0]) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(ddq, (after[1] - before[1]) / (2 * h), atol=1e-3)
    np.testing.assert_allclose(motion.jerk(at), (after[2] - before[2]) / (2 * h), atol=1.0)
    assert np.max(np.abs(dq[:, 0] - np.cos(at))) < 0.05


@pytest.mark.parametrize(
    ("time", "message"),
    [(np.arange(5) * 0.01, "only 5 samples"), (np.append(np.arange(50), [300, 301]) * 0.01, "a gap of 2.51 s")],
)
def test_logs_without_a_motion_to_follow_are_refused(time: np.ndarray, message: str) -> None:
    with pytest.raises(LogMismatch, match=message):
        logged_motion(Log(("a",), time, np.sin(time)[:, None]))


def test_mujoco_writes_no_file_of_warnings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mujoco = pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    body = '<worldbody><body><joint/><geom size="0.1"/></body></worldbody>'
    warned = f'<mujoco><compiler settotalmass="2"/>{body}</mujoco>'
    mujoco.MjModel.from_xml_string(warned)
    if not list(tmp_path.iterdir()):
        pytest.skip("this MuJoCo does not warn of it")
    (tmp_path / "MUJOCO_LOG.TXT").unlink()
    with without_log():
        mujoco.MjModel.from_xml_string(warned)
    assert not list(tmp_path.iterdir())
    mujoco.MjModel.from_xml_string(warned)  # its own way is back
    assert list(tmp_path.iterdir())
