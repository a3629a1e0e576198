"""'validate' and 'report' of actuators: roll-outs over logs, beside the linear start and the robot model."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_bench import PENDULUM, parameters, virtual_logs, write_csv

from dynident.actuators.drive_law import DriveLaw, preset
from dynident.actuators.estimate import ActuatorEstimate, Combination, JointActuator, read_actuators, write_actuators
from dynident.actuators.followed_log import followed, friction_of
from dynident.actuators.parameters import PLACE
from dynident.actuators.verdict import Known
from dynident.cli.main import main
from dynident.files import sha256_of
from dynident.model.robot import Robot
from dynident.results.actuator_report import actuator_page
from dynident.results.actuator_text import joint_lines, joint_warnings, parameter_table, scale_lines
from dynident.results.figures.signals import line_chart

CASE = """case: 2
robot: pendulum.urdf
servo: {law: feetech_sts3215, kp: 'kp{}', enabled: torque_enable, friction: m1}
log: {columns: {time: t, q: [q1], q_ref: [q_ref1], torque: none}}
train: [chirp_kp4.csv, drop_kp4.csv]
test: [steps_kp4.csv]
"""


def estimate(law: DriveLaw) -> ActuatorEstimate:
    """Return the true actuator, with a linear start of twice the armature."""
    true, rough = parameters(), parameters()
    rough[PLACE["armature"]] *= 2.0
    joint = JointActuator("joint1", law, (4.0,), "m1", true, (), (), rough, true, {}, {}, {}, {}, 0.0)
    return ActuatorEstimate("pendulum", (joint,))


@pytest.fixture
def folder(tmp_path: Path, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("pendulum.urdf").write_text(PENDULUM)
    names = ("chirp", "steps", "drop")
    for kp in (4.0, 8.0):
        for name, log in zip(names, virtual_logs(robot, parameters(), gains=(kp,)), strict=True):
            write_csv(log, Path(f"{name}_kp{kp:g}.csv"))
    Path("case.yaml").write_text(CASE)
    provenance = {
        "case": {"path": "case.yaml", "sha256": sha256_of("case.yaml")},
        "robot": {"path": "pendulum.urdf", "sha256": sha256_of("pendulum.urdf")},
        "logs": [{"path": f"{name}_kp4.csv", "sha256": sha256_of(f"{name}_kp4.csv")} for name in names],
        "train": ["chirp_kp4.csv", "drop_kp4.csv"],
    }
    write_actuators(replace(estimate(preset("feetech_sts3215")), provenance=provenance), "a.json")
    return tmp_path


def test_a_right_actuator_follows_and_says_what_a_log_is(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "a.json", "steps_kp4.csv", "chirp_kp4.csv", "steps_kp8.csv", "--json"]) == 0
    runs = json.loads(capsys.readouterr().out)["roll_outs"]
    assert [run["extrapolates"] for run in runs] == [False, False, True]
    assert [run["trained_on"] for run in runs] == [False, True, False]
    assert all(run["error_rad"] < 2e-3 < run["linear_error_rad"] for run in runs)
    assert all(run["robot_model_error_rad"] is None for run in runs)
    assert main(["validate", "a.json", "chirp_kp8.csv"]) == 0
    answer = capsys.readouterr().out
    assert "1 roll-out at a kp outside that of the training logs" in answer and "kp not trained" in answer
    assert max(map(len, answer.splitlines())) <= 80


def test_the_actuator_of_the_robot_model_is_followed_beside_it(robot: Robot) -> None:
    found = estimate(preset("feetech_sts3215"))
    logs = virtual_logs(robot, parameters(), gains=(4.0,))
    (joint,) = robot.joints
    true = parameters()
    viscous = float(true[PLACE["viscous"]] + true[PLACE["back_emf"]])
    right = replace(joint, damping=viscous, friction=float(true[PLACE["coulomb"]]))
    right = replace(right, drive=replace(right.drive, rotor_inertia=float(true[PLACE["armature"]]), gear_ratio=1.0))
    wrong = replace(right, friction=10.0 * float(true[PLACE["coulomb"]]))
    errors = [[run.nominal for run in followed(found, replace(robot, joints=(own,)), logs)] for own in (right, wrong)]
    assert max(errors[0][:2]) < 5e-3 < min(errors[1])  # the third lets the joint swing with the drive off


def test_the_report_has_the_actuator_of_the_robot_model_beside_the_identified_one(robot: Robot) -> None:
    """Armature, damping and friction in a table; its friction and its roll-outs in the figures."""
    (joint,) = robot.joints
    stated = replace(joint, damping=0.5, friction=0.3)
    stated = replace(stated, drive=replace(stated.drive, rotor_inertia=0.03, gear_ratio=1.0))
    found, logs = estimate(preset("feetech_sts3215")), virtual_logs(robot, parameters(), gains=(4.0,))
    page = actuator_page(found, followed(found, replace(robot, joints=(stated,)), logs))
    text = " ".join(re.sub(r"<[^>]*>", " ", page).split())
    assert "armature 0.0120 0.0300" in text and "Coulomb friction 0.0400 0.300" in text
    assert "damping, back-EMF with it 0.260 0.500" in text and "robot model, back-EMF with it" in text
    plain = actuator_page(found, followed(found, robot, logs))
    assert "back-EMF with it" not in plain and page.count("robot model") > plain.count("robot model") + 3


def test_half_widths_say_what_they_take_for_exact(robot: Robot) -> None:
    """Torques stand on the masses of the robot model; tables with half widths of 1 % did not say so."""
    plain = estimate(preset("feetech_sts3215"))
    (joint,) = plain.joints
    found = replace(plain, joints=(replace(joint, known=(Known("full_torque", 2.0, 0.1, "identified"),)),))
    (line,) = scale_lines(found)
    assert line.endswith("masses 10 % larger make torque, armature and friction 10 % larger")
    page = actuator_page(found, followed(found, robot, virtual_logs(robot, parameters(), gains=(4.0,))))
    assert line.partition(":")[0] in page
    assert scale_lines(plain) == []  # no half width of a torque


def test_the_friction_curve_ends_at_the_speed_of_the_logs(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    found, logs = estimate(preset("feetech_sts3215")), virtual_logs(robot, parameters(), gains=(4.0,))
    drawn: dict[str, float] = {}

    def chart(title: str, curves: list[tuple[str, np.ndarray, np.ndarray]], across: str, up: str) -> object:
        drawn[title] = float(curves[0][1][-1])
        return line_chart(title, curves, across, up)

    monkeypatch.setattr("dynident.results.actuator_report.line_chart", chart)
    runs = followed(found, robot, logs)
    actuator_page(found, runs)
    fastest = max(float(np.max(np.abs(np.gradient(run.predicted, run.time)))) for run in runs)
    assert 0.8 * fastest < drawn["Friction at even speed"] <= 1.01 * fastest


def test_torque_and_armature_of_a_joint_of_little_weight_ask_for_a_payload() -> None:
    """Each is known only with the other; where one of them is known by itself nothing is asked for."""
    (joint,) = estimate(preset("feetech_sts3215")).joints
    pairs = (("full_torque", "armature"), ("armature", "full_torque"), ("coulomb", "armature"))
    weak = tuple(Known(name, 0.1, 0.05, "weak", other) for name, other in pairs)
    (told,) = joint_warnings(replace(joint, known=weak, combinations=()))
    assert told.startswith("full torque and armature are weak") and "servo: payloads" in told
    others = joint_warnings(
        replace(joint, known=(weak[0], replace(weak[1], label="identified", together="")), combinations=())
    )
    assert not any("servo: payloads" in text for text in others)


def test_a_weak_friction_beside_free_swings_asks_for_more_of_them() -> None:
    (joint,) = estimate(preset("feetech_sts3215")).joints
    weak, swings = (Known(name, 0.1, 0.05, "weak", "") for name in ("viscous", "back_emf"))
    alone = joint_warnings(replace(joint, known=(weak,)))
    beside = joint_warnings(replace(joint, known=(weak, swings)))
    assert ["switch the torque off" in text for text in alone] == [True]
    assert ["more free swings" in text for text in beside] == [True, True]


def test_a_joint_that_slides_has_units_of_force_and_length(tmp_path: Path) -> None:
    """In tables and lines, and in the file, which remembers it."""
    names = ("full_torque", "back_emf", "coulomb", "armature", "angle_offset")
    known = tuple(Known(name, 1.0, 0.1, "identified") for name in names)
    damping, errors = Combination("damping", 1.0, "N m s/rad", "together"), {"a": 1e-3}
    own = {"known": known, "combinations": (damping,), "train": errors, "linear_test": errors}
    turning = replace(estimate(preset("feetech_sts3215")).joints[0], **own)
    for joint, units, error in (
        (turning, ["N·m", "N·m·s/rad", "N·m", "kg·m²", "rad", "N·m·s/rad"], "1 mrad"),
        (turning.of_slide(), ["N", "N·s/m", "N", "kg", "m", "N·s/m"], "1 mm"),
    ):
        write_actuators(ActuatorEstimate("lift", (joint,)), tmp_path / "a.json")
        (read,) = read_actuators(tmp_path / "a.json").joints
        assert read.slides == joint.slides and [row[-2] for row in parameter_table(read).rows] == units
        assert f"training error of the roll-outs: {error}" in joint_lines(read)


def test_the_report_has_every_log_and_the_friction(folder: Path) -> None:
    assert main(["report", "a.json", "--quiet"]) == 0
    page = Path("report.html").read_text()
    assert "steps_kp4.csv" in page and "Friction at even speed" in page and "chirp_kp4.csv" not in page
    assert main(["report", "a.json", "--test", "drop_kp8.csv", "-o", "own.html", "--quiet"]) == 0
    assert "drop_kp8.csv" in Path("own.html").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["validate", "a.json", "steps_kp4.csv", "--split", "first:0.5"], "a.json holds actuators"),
        (["validate", "a.json", "steps_kp4.csv", "--case", "case.yaml"], "a.json holds actuators"),
        (["report", "a.json", "--prove"], "a.json holds actuators"),
        (["report", "a.json", "-o", "a.json"], "a.json"),
        (["validate", "a.json", "none.csv"], "none.csv"),
    ],
)
def test_what_does_not_go_with_actuators_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert main(words) == 1
    assert said in capsys.readouterr().err


def test_another_robot_model_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("pendulum.urdf").write_text(PENDULUM.replace("<robot", "<!-- heavier --><robot"))
    assert main(["validate", "a.json", "steps_kp4.csv"]) == 1
    assert "has changed since these actuators were identified" in capsys.readouterr().err


def test_friction_at_even_speed_is_what_the_roll_out_settles_at() -> None:
    values = parameters()
    for name, value in (("load_motor", 0.1), ("load_external", 0.2), ("coulomb_stribeck", 0.05)):
        values[PLACE[name]] = value
    joint = replace(estimate(preset("feetech_sts3215")).joints[0], parameters=values)
    speed = np.array([0.0, 0.2, 50.0])
    steady = values[PLACE["coulomb"]] + 0.3 * 2.0 + values[PLACE["viscous"]] * speed
    fade = np.exp(-((speed / values[PLACE["stribeck_velocity"]]) ** values[PLACE["stribeck_exponent"]]))
    np.testing.assert_allclose(friction_of(joint, speed, 2.0), steady + 0.05 * fade, rtol=1e-12)
