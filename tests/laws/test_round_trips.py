"""What goes into a file comes out of it: logs bit for bit, robots whole, exported bodies possible and the same."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pytest
from exact_arms import ExactArm, exact_arms
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from bare_estimates import bare_estimate
from dynident.arrays import Array
from dynident.data.formats import FORMATS, read_log, write_log, written_columns
from dynident.data.log import Log
from dynident.errors import LogFormatError
from dynident.exports.models import export_model
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.robot_files import read_robot

NUMBERS = st.floats(-1e12, 1e12, allow_subnormal=False)
SHARED = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@st.composite
def logs(draw: st.DrawFn) -> Log:
    """Draw a log of 10 to 40 rows and one to five joints, uneven in time, any finite numbers."""
    rows, joints = draw(st.integers(10, 40)), draw(st.integers(1, 5))
    steps = draw(arrays(float, rows, elements=st.floats(1e-4, 1e-2)))
    q, dq, torque = (draw(arrays(float, (rows, joints), elements=NUMBERS)) for _ in range(3))
    return Log(tuple(f"j{k}" for k in range(joints)), np.cumsum(steps), q, dq=dq, torque=torque)


def check_log(log: Log) -> None:
    for name in FORMATS.names():
        part = FORMATS.make(name)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"run{part.suffixes[0] if part.suffixes else '.txt'}"
            try:
                write_log(log, path, form=part)
            except LogFormatError as error:
                assert "only read" in str(error)
                continue
            found = read_log(path, written_columns(log), form=part)
        for field in ("time", "q", "dq", "torque"):
            np.testing.assert_array_equal(getattr(found, field), getattr(log, field), err_msg=f"{name}: {field}")


def bodies_in(path: Path, name: str) -> list[Inertia]:
    """Return the bodies that a file states, in its order, each about its own centre of mass."""
    if name == "mjcf":
        model = mujoco.MjModel.from_xml_path(str(path))  # type: ignore[attr-defined]
        return [
            Inertia.from_centre_of_mass(float(model.body_mass[k]), [0, 0, 0], np.diag(model.body_inertia[k]))
            for k in range(1, model.nbody)
            if model.body_mass[k] > 0
        ]
    found = []
    for inertial in ElementTree.parse(path).iter("inertial"):
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        assert mass is not None and inertia is not None
        value = float(mass.get("value") or mass.text or "nan")
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        six = [float(inertia.get(key) or inertia.findtext(key) or "nan") for key in keys]
        found.append(Inertia.from_vector([*six, 0, 0, 0, value]))
    return [body for body in found if body.mass > 0]


def invariants(body: Inertia) -> Array:
    """Return mass and principal moments about the centre of mass: the same in every frame."""
    return np.r_[body.mass, np.linalg.eigvalsh(body.about_centre)]


def check_export(arm: ExactArm, name: str) -> None:
    """Every exported body is possible, has the mass and principal moments of its link, and the torques agree."""
    robot = arm.robot
    model = DynamicModel(robot, ("viscous",))  # type: ignore[arg-type]
    assert robot.nominal is not None
    theta = np.append(robot.nominal, np.full(robot.dof, 0.3))
    suffix = {"urdf": ".urdf", "mjcf": ".xml", "sdf": ".sdf"}[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"arm{suffix}"
        done = export_model(bare_estimate(model, theta), name, path)
        assert all((proof.relative or 0.0) <= proof.allowed for proof in done.proofs)
        found = bodies_in(path, name)
        again = read_robot(path) if name == "urdf" else None
    links = [link.inertia for link in robot.links if link.inertia is not None]
    assert len(found) == len(links) and all(body.is_consistent() for body in found)
    expected = sorted(map(tuple, (invariants(body) for body in links)))
    np.testing.assert_allclose(sorted(map(tuple, map(invariants, found))), expected, rtol=1e-6)
    if again is not None:
        assert again.nominal is not None
        motion = model.random_motion(5)
        order = [robot.joint_names.index(name) for name in again.joint_names]  # a branch is read to its end
        moved = Motion(motion.q[:, order], motion.dq[:, order], motion.ddq[:, order])
        own = DynamicModel(again.with_gravity(robot.gravity)).torque(moved, again.nominal)
        expected_torque = DynamicModel(robot).torque(motion, robot.nominal)[:, order]
        assert np.abs(own - expected_torque).max() <= 1e-7 * np.abs(expected_torque).max()


@settings(max_examples=6)
@given(log=logs())
def test_logs(log: Log) -> None:
    check_log(log)


@pytest.mark.parametrize("name", ["urdf", "mjcf", "sdf"])
@settings(SHARED, max_examples=2)
@given(arm=exact_arms(2, 5))
def test_exports(name: str, arm: ExactArm) -> None:
    check_export(arm, name)


@pytest.mark.battery
@settings(max_examples=300)
@given(log=logs())
def test_many_logs(log: Log) -> None:
    check_log(log)


@pytest.mark.battery
@pytest.mark.parametrize("name", ["urdf", "mjcf", "sdf"])
@settings(SHARED, max_examples=40)
@given(arm=exact_arms(2, 8))
def test_many_exports(name: str, arm: ExactArm) -> None:
    check_export(arm, name)
