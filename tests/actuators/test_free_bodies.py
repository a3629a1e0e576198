"""Bodies found beside the drives: a robot model whose bodies are off, and what logs without torque tell of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from servo_bench import CASE_OF_LOGS, PENDULUM, TRUE, fill, parameters, virtual_logs

from dynident.actuators.drive_law import preset
from dynident.actuators.estimate import ActuatorEstimate, JointActuator, read_actuators, write_actuators
from dynident.actuators.free_bodies import FreeBodies, bodies_data, read_bodies, with_bodies
from dynident.actuators.identify import identify_actuators
from dynident.actuators.joint_load import with_payload
from dynident.actuators.servo_log import ServoColumns, ServoSetup
from dynident.cli.main import main
from dynident.exports.actuator_bodies import robot_of
from dynident.model.robot import Robot
from dynident.results.actuator_text import bodies_warnings
from dynident.robot_files import read_robot
from dynident.simulation.effects import Payload

mujoco: Any = pytest.importorskip("mujoco")

#: The robot model of the pendulum with a mass, a centre of mass and inertias that are off.
OFF = (
    PENDULUM.replace('mass value="0.8"', 'mass value="1.0"')
    .replace("0 0 -0.15", "0.01 0 -0.13")
    .replace('ixx="0.002"', 'ixx="0.0026"')
)

CASE = f"{CASE_OF_LOGS}train: [chirp_kp4.csv, steps_kp4.csv, drop_kp4.csv]\n"


@pytest.fixture
def folder(tmp_path: Path, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the logs of a pendulum and a robot model that is off."""
    monkeypatch.chdir(tmp_path)
    fill(tmp_path, robot, OFF, CASE)
    return tmp_path


def test_without_a_payload_ratios_are_found_and_the_scale_is_the_robot_models(
    folder: Path, robot: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """Torque over weight is the true one; intervals hold the scale, which takes a payload; MuJoCo has the bodies."""
    assert main(["identify", "case.yaml", "--bodies", "plausible", "-o", "a.json", "--quiet"]) == 0
    answer = capsys.readouterr().out
    assert "as a ratio" in answer and "known as a ratio" in answer and "no log without a known payload" in answer
    found = read_actuators("a.json")
    joint, bodies = found.joints[0], found.bodies
    assert bodies is not None and not bodies.is_scaled and bodies.scale > 0.3
    weight = float(np.hypot(*bodies.theta[0, [6, 8]]))
    scale = weight / (0.8 * 0.15)
    known = {one.name: one for one in joint.known}
    for name in ("full_torque", "back_emf", "coulomb"):
        assert joint.value(name) / scale == pytest.approx(TRUE[name], rel=0.03), name
        assert (known[name].ratio or np.inf) < 0.2 * known[name].half_width
        assert abs(joint.value(name) - TRUE[name]) < known[name].half_width
    inertia = float(bodies.theta[0, 3]) + joint.value("armature")  # of both together, about the axis
    assert inertia / scale == pytest.approx(0.8 * 0.15**2 + 0.002 + TRUE["armature"], rel=0.01)
    assert max(joint.train.values()) < 1.5e-3
    assert main(["export", "a.json", "--to", "mjcf", "-o", "robot.xml", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["mujoco_difference_rad"]["joint1"] < 1e-3
    model = mujoco.MjModel.from_xml_path("robot.xml")
    assert model.body_mass[1] == pytest.approx(bodies.theta[0, 9], rel=1e-5)
    assert main(["export", "a.json", "--to", "urdf", "-o", "robot.urdf", "--quiet"]) == 0
    np.testing.assert_allclose(np.asarray(read_robot("robot.urdf").nominal), bodies.theta[0], rtol=1e-9, atol=1e-12)
    assert main(["validate", "a.json", "chirp_kp4.csv"]) == 0
    assert main(["report", "a.json", "-o", "a.html", "--quiet"]) == 0
    assert "Bodies" in Path("a.html").read_text()


@pytest.mark.parametrize(
    ("more", "words", "said"),
    [
        ("constraints: {total_mass: {max: 1.0}}", (), "bodies: plausible"),
        ("", ("--bodies", "sound"), "sound"),
        ("bodies: plausible\nconstraints: {fixed: {'m[arm]': 0.8}}", (), "constraints.fixed"),
    ],
)
def test_what_says_nothing_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], more: str, words: tuple[str, ...], said: str
) -> None:
    Path("case.yaml").write_text(f"{CASE}{more}\n")
    try:
        code = main(["identify", "case.yaml", *words])
    except SystemExit as stop:
        code = int(str(stop.code))
    assert code in (1, 2) and said in capsys.readouterr().err


def test_a_link_without_inertia_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("pendulum.urdf").write_text(OFF.replace('izz="0.001"', 'izz="0.01"'))
    assert main(["identify", "case.yaml", "--bodies", "free"]) == 1
    assert "no possible inertia of arm" in capsys.readouterr().err


@pytest.mark.battery
def test_a_known_payload_gives_the_scale(robot: Robot, tmp_path: Path) -> None:
    """Torque, friction and mass are found though all that the robot model states is off."""
    (tmp_path / "off.urdf").write_text(OFF)
    off, true, load = read_robot(str(tmp_path / "off.urdf")), parameters(), Payload(0.2, (0.0, 0.0, -0.2))
    logs = virtual_logs(robot, true, gains=(4.0,))
    more = virtual_logs(with_payload(robot, load), true, gains=(4.0,), seed=1)
    logs += [replace(log, name=f"{log.name} load", payload=load) for log in more]
    setup = ServoSetup((preset("feetech_sts3215"),), ServoColumns(("joint1",)), "m1", "plausible")
    found = identify_actuators(off, setup, logs)
    assert found.bodies is not None and found.bodies.is_scaled
    known = {one.name: one for one in found.joints[0].known}
    for name in ("full_torque", "back_emf", "coulomb"):
        assert known[name].label == "identified" and known[name].value == pytest.approx(TRUE[name], rel=0.03), name
    assert float(np.hypot(*found.bodies.theta[0, [6, 8]])) == pytest.approx(0.8 * 0.15, rel=0.03)
    assert found.bodies.bounds == ()
    light = identify_actuators(with_bodies(robot, np.asarray(robot.nominal).reshape(-1, 10) / 1.8), setup, logs)
    assert light.bodies is not None and light.bodies.bounds == (f"total mass <= {1.5 * 0.8 / 1.8:g} kg",)


def test_masses_that_end_at_a_bound_are_named() -> None:
    """With the link or the total, the bound, and the key that states another."""
    rows = np.ones((1, 10))
    bounds = ("total mass <= 0.67 kg", "arm: mass >= 0.1 kg")
    bodies = FreeBodies(("arm",), rows, rows, rows, (("identified",) * 10,), 0.01, True, bounds)
    assert read_bodies(bodies_data(bodies)).bounds == bounds
    total, link = bodies_warnings(bodies)
    assert "bound total mass <= 0.67 kg" in total and "too light" in total and "total_mass: ..." in total
    assert "mass of arm" in link and "too heavy" in link and "links: {arm: {mass: ...}}" in link


ARM = """<mujoco><worldbody><body name="a" pos="0 0 0.1"><joint name="j1" axis="0 1 0" range="-90 90"/>
<inertial pos="0 0 0.1" mass="0.3" diaginertia="2e-3 2e-3 1e-4"/><body name="b" pos="0 0 0.2">
<joint name="j2" pos="0 0 0.01" axis="0 1 0" range="-90 90"/>
<inertial pos="0.01 0 0.1" mass="0.2" diaginertia="1e-3 1e-3 1e-4"/>
<body name="tip" pos="0 0 0.2"><inertial pos="0 0 0" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/></body>
</body></body></worldbody></mujoco>"""


def test_bodies_go_back_into_an_mjcf_with_parts_fixed_to_a_link(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fixed part keeps its own inertia; the file read again has the bodies that were found."""
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(ARM)
    robot = read_robot("arm.xml")
    nominal = np.asarray(robot.nominal).reshape(-1, 10)
    theta = nominal * np.array([[1.3], [0.8]])
    names = tuple(link.name for link in robot.links)
    bodies = FreeBodies(names, nominal, theta, 0.1 * np.abs(nominal), (("identified",) * 10,) * 2, 0.1, True)
    values, empty = parameters(angle_offset=0.0), dict[str, float]()
    joints = tuple(
        JointActuator(
            name,
            preset("feetech_sts3215"),
            (8.0,),
            "m1",
            values,
            (),
            (),
            values,
            values,
            empty,
            empty,
            empty,
            empty,
            0.0,
        )
        for name in robot.joint_names
    )
    write_actuators(ActuatorEstimate("arm", joints, {"robot": {"path": "arm.xml"}}, bodies), "a.json")
    assert main(["export", "a.json", "--to", "mjcf", "-o", "new.xml", "--quiet"]) == 0
    again = np.asarray(read_robot("new.xml").nominal).reshape(-1, 10)
    np.testing.assert_allclose(again, theta, rtol=1e-5, atol=1e-8)
    assert np.array_equal(np.asarray(robot_of(read_actuators("a.json")).nominal), theta.ravel())
    model = mujoco.MjModel.from_xml_path("new.xml")
    assert model.body("tip").mass[0] == pytest.approx(0.05)
    assert np.array_equal(np.asarray(with_bodies(robot, nominal).nominal), nominal.ravel())


@pytest.mark.battery
def test_bodies_and_drives_of_arms_are_found_together(tmp_path: Path) -> None:
    """Three joints, all bodies of the robot model off: ratios of the drives and identified parameters are held."""
    pytest.importorskip("pinocchio", reason="the virtual arms need Pinocchio")
    from benchmarks.servos import one

    lines: list[Any] = [one(seed, 3, tmp_path, bodies="free")["bodies"] for seed in range(4)]
    ratios = np.array([ratio for line in lines for _, ratio in line["ratios"]])
    assert np.mean(ratios <= 1.0) > 0.88 and np.sqrt(np.mean(ratios**2)) < 0.8
    held = np.sum([line["parameters"]["identified"] for line in lines], axis=0)
    assert held[0] >= 0.85 * held[1]
    assert all(abs(np.log(line["scale"])) < 1.96 * line["scale_deviation"] for line in lines)
