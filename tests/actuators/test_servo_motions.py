"""'excite' of a case with servos: limits kept, files that replay, intervals that hold, and what stays unknown."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from servo_bench import PENDULUM, write_csv

from dynident.actuators.command_files import CommandFile, ServoMotions
from dynident.actuators.drive_law import preset
from dynident.actuators.estimate import write_actuators
from dynident.actuators.friction_choice import FOLDS, moves
from dynident.actuators.identify import first_logs, identify_actuators
from dynident.actuators.joint_fit import JointData
from dynident.actuators.joint_load import measured_loads, measured_motion, with_payload
from dynident.actuators.linear_start import StartRows, start_rows
from dynident.actuators.nominal_servo import of_limits
from dynident.actuators.parameters import PLACE
from dynident.actuators.rollout import JointRecord, record_of
from dynident.actuators.servo_excitation import MotionRequest, servo_excitation
from dynident.actuators.servo_log import ServoLog
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.api.servo_motions import servo_motions
from dynident.arrays import Array
from dynident.case.case import Case, read_case
from dynident.cli.main import main
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.simulation.effects import Payload

CASE = """case: 2
robot: pendulum.urdf
servo: {law: feetech_sts3215, kp: 'kp{}', enabled: torque_enable, friction: m1}
log: {columns: {time: t, q: [q1], q_ref: [q_ref1], torque: none}}
"""

#: A turntable and an arm on it, which hangs down at 0 and stands out at pi/2.
TWO_JOINTS = """<robot name="desk"><link name="base"/>
<link name="table"><inertial><mass value="0.2"/><inertia ixx="2e-4" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="4e-4"/>
</inertial></link><link name="arm"><inertial><origin xyz="0 0 -0.12"/><mass value="0.3"/>
<inertia ixx="4e-4" ixy="0" ixz="0" iyy="4e-4" iyz="0" izz="1e-4"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="table"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="2.5" velocity="5"/></joint>
<joint name="lift" type="revolute"><parent link="table"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="1.0" upper="2.2" effort="2.5" velocity="5"/></joint></robot>"""

DESK = """case: 2
robot: desk.urdf
servo: {law: feetech_sts3215, kp: 16, friction: m1, enabled: [on1, on2]}
log: {columns: {torque: none}}
"""


def fill(folder: Path) -> Path:
    for name, text in (
        ("pendulum.urdf", PENDULUM),
        ("desk.urdf", TWO_JOINTS),
        ("case.yaml", CASE),
        ("desk.yaml", DESK),
    ):
        (folder / name).write_text(text)
    return folder


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return fill(tmp_path)


@pytest.fixture(scope="module")
def of_pendulum(tmp_path_factory: pytest.TempPathFactory) -> ServoMotions:
    return servo_motions(str(fill(tmp_path_factory.mktemp("case")) / "case.yaml"), gains=(4.0,))


@pytest.fixture(scope="module")
def of_desk(tmp_path_factory: pytest.TempPathFactory) -> ServoMotions:
    return servo_motions(str(fill(tmp_path_factory.mktemp("desk")) / "desk.yaml"))


def table_of(file: CommandFile) -> tuple[list[str], Array]:
    """Return the header of a command file and its numbers."""
    header = file.text.partition("\n")[0].split(",")
    return header, np.loadtxt(io.StringIO(file.text), delimiter=",", skiprows=1)


def recorded(found: ServoMotions, robot: Robot, seed: int, true: Array | None = None) -> list[ServoLog]:
    """Return what a virtual pendulum logs of the command files, with the assumed servo or another one."""
    servo = found.joints[0].servo
    logs = []
    for k, file in enumerate(found.files):
        time, command, enabled = table_of(file)[1].T
        bench = ServoBench(robot, servo.law, found.joints[0].resolution, jitter_s=5e-4)
        own = servo.parameters if true is None else true
        log = virtual_log(bench, own, time, command, file.kp, enabled > 0.5, seed=100 * seed + k)
        logs.append(replace(log, name=file.name))
    return logs


def errors(found: ServoMotions, case: Case, seeds: range) -> dict[str, list[float]]:
    """Return how far estimates are from the truth, in promised half widths; each seed has a servo near the assumed one.

    Other servos come to rest elsewhere between two steps of the encoder.
    """
    assert case.servo is not None
    (joint,) = found.joints
    ratios: dict[str, list[float]] = {}
    for seed in seeds:
        random = np.random.default_rng(seed)
        true = joint.servo.parameters * random.normal(1.0, 0.02, len(joint.servo.parameters))
        true[PLACE["angle_offset"]] = random.uniform(-0.02, 0.02)
        true[PLACE["gain_ratio"]] = 1.0
        answer = identify_actuators(case.robot, case.servo, recorded(found, case.robot, seed, true)).joints[0]
        for one in answer.known:
            promised = joint.best(one.name)
            assert promised is not None and promised.label == "identified", one.name
            ratios.setdefault(one.name, []).append(abs(one.value - true[PLACE[one.name]]) / promised.half_width)
    return ratios


def test_estimates_lie_within_the_promised_intervals(folder: Path, of_pendulum: ServoMotions) -> None:
    """Two records of the files: every parameter is within 1.5 half widths of the truth, and some are beyond a tenth."""
    case = read_case("case.yaml")
    ratios = np.concatenate(list(errors(of_pendulum, case, range(2)).values()))
    assert len(ratios) == 14 and 0.1 < ratios.max() < 1.5


def test_half_widths_of_a_servo_near_a_bound_are_those_of_one_further_off(folder: Path) -> None:
    """Friction grows by 0.42 and 0.499 of the load, the bound is 0.5: half widths differ by less than half."""
    robot, case = read_robot("pendulum.urdf"), read_case("case.yaml")
    assert case.servo is not None
    widths = []
    for share in (0.42, 0.499):
        servo = of_limits(robot.joints[0], case.servo.laws[0], "m3", 4.0, True)
        values = servo.parameters.copy()
        values[[PLACE["load_motor"], PLACE["load_external"]]] = share
        near = replace(servo, parameters=values)
        (found,) = servo_excitation(robot, lambda *_, own=near: own, MotionRequest(gains=(4.0,)))
        known = found.best("load_motor")
        assert known is not None and known.label == "identified"
        widths.append(known.half_width)
    assert 0.67 < widths[1] / widths[0] < 1.5


@pytest.mark.battery
def test_promised_half_widths_are_those_of_the_errors(folder: Path, of_pendulum: ServoMotions) -> None:
    """Thirty records: of each parameter the half width of the errors is the promised one within a factor of 1.4."""
    case = read_case("case.yaml")
    found = errors(of_pendulum, case, range(30))
    sizes = {name: float(norm.ppf(0.975) * np.sqrt(np.mean(np.square(own)))) for name, own in found.items()}
    assert all(1 / 1.4 < size < 1.4 for size in sizes.values()), sizes
    assert np.mean(np.concatenate(list(found.values())) <= 1.0) > 0.92


def test_what_is_searched_first_has_every_motion_of_every_joint(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 36 logs, each with one joint in motion: its drive is off in one of each joint, two of each have a payload."""
    robot, law, time = read_robot("desk.urdf"), preset("feetech_sts3215"), np.arange(0.0, 6.0, 0.02)
    rows: list[list[StartRows]] = [[], []]
    records: list[list[JointRecord]] = [[], []]
    for k in range(36):
        q, enabled = np.tile([0.0, 1.5], (len(time), 1)), np.ones((len(time), 2), dtype=bool)
        q[:, k % 2] += 0.4 * np.sin(3.0 * time)
        enabled[:, k % 2] = time < 4.0 if k in (10, 21) else True
        payload = Payload(0.1, (0.05, 0.0, 0.0)) if k in (4, 7, 28, 33) else None
        log = ServoLog(
            f"{k}",
            robot.joint_names,
            time,
            q,
            q,
            0 * q,
            0 * q,
            enabled,
            np.ones(len(time)),
            q > 9,
            4.0,
            payload=payload,
        )
        smooth = measured_motion(log)
        for joint, load in enumerate(measured_loads(robot, log, smooth)):
            rows[joint].append(start_rows(log, joint, load, smooth, law))
            records[joint].append(record_of(log, joint, load, law))
    datas = [
        JointData(one[0].log.joints[k], law, tuple(own), (), tuple(one))
        for k, (one, own) in enumerate(zip(rows, records, strict=True))
    ]
    chosen = first_logs(datas)
    assert chosen == sorted(set(chosen)) and 10 <= len(chosen) <= 14
    assert {10, 21} <= set(chosen) and {4, 28} & set(chosen) and {7, 33} & set(chosen)
    monkeypatch.setattr("dynident.actuators.identify.FIRST_S", 6.0)  # few logs: each joint moves in each fold
    few, more = ([int(moves(data.train)[first_logs(datas, name)].sum()) for data in datas] for name in ("m1", "auto"))
    assert min(few) < FOLDS == min(more) and max(more) <= max(*few, FOLDS)


@pytest.mark.parametrize("pose", [None, (0.5, 1.3), (-1.0, 2.0)])
@pytest.mark.parametrize("margin", [0.05, 0.2])
def test_commands_and_simulated_motions_keep_the_limits(
    folder: Path, of_desk: ServoMotions, pose: tuple[float, float] | None, margin: float
) -> None:
    """Commands keep the margin in position and speed, simulated motions the limits; a free arm would pass them."""
    found = of_desk if (pose, margin) == (None, 0.05) else servo_motions("desk.yaml", margin=margin, pose=pose)
    limits = {"turn": (-2.0, 2.0, 5.0), "lift": (1.0, 2.2, 5.0)}
    assert {file.joint for file in found.files} == set(limits) and len(found.files) == 8
    for file in found.files:
        header, table = table_of(file)
        k = ["turn", "lift"].index(file.joint)
        lower, upper, speed = limits[file.joint]
        reserve = 0.5 * margin * (upper - lower)
        command = table[:, header.index(f"q_ref{k + 1}")]
        other = table[:, header.index(f"q_ref{2 - k}")]
        assert np.all(other == other[0]) and other[0] == pytest.approx(found.pose[1 - k])
        assert lower + reserve - 1e-9 <= command.min() and command.max() <= upper - reserve + 1e-9
        jumps = np.abs(np.diff(command)) / np.diff(table[:, 0])
        if file.kind in ("chirp", "ramps"):
            assert jumps.max() <= (1.0 - margin) * speed
            assert command[[0, -1]] == pytest.approx(found.pose[k], abs=1e-8)
        off = table[:, header.index(f"on{k + 1}")] == 0
        assert off.any() == (file.kind == "release") and not np.any(table[:, header.index(f"on{2 - k}")] == 0)
    for joint in found.joints:
        lower, upper, speed = limits[joint.joint]
        for one in joint.motions:
            assert lower <= one.lowest < one.highest <= upper and one.fastest <= speed
        assert max(one.fastest for one in joint.motions) > 0.5 * speed


def test_a_slide_has_steps_and_units_of_its_own(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A lift of 20 mm: the encoder of a preset counts turns, and says nothing of it."""
    lift = '<joint name="lift" type="prismatic"><parent link="table"/><child link="arm"/><axis xyz="0 0 1"/>'
    first, _, rest = TWO_JOINTS.partition('<joint name="lift"')
    limit = '<limit lower="0" upper="0.02" effort="50" velocity="0.2"/></joint></robot>'
    assert rest and Path("desk.urdf").write_text(first + lift + limit)
    slow = DESK.replace("kp: 16", "kp: 16, joints: {lift: {law: position_servo, error_gain: 100}}")
    for case, step in (
        (slow, 0.02 / 4096),
        (slow.replace("error_gain: 100", "error_gain: 100, resolution: 2e-6"), 2e-6),
    ):
        Path("desk.yaml").write_text(case)
        turn, slide = servo_motions("desk.yaml").joints
        assert (turn.slides, slide.slides) == (False, True)
        assert turn.resolution == pytest.approx(2.0 * np.pi / 4096) and slide.resolution == pytest.approx(step)
    assert main(["excite", "desk.yaml"]) == 0
    shown = capsys.readouterr().out
    assert "lift: encoder in steps of 0.002 mm" in shown and "limits (rad, rad/s or m, m/s)" in shown
    Path("desk.yaml").write_text(slow.replace("error_gain: 100", "error_gain: 100, resolution: 0.005"))
    assert main(["excite", "desk.yaml"]) == 1
    assert "20 steps of the encoder (5 mm)" in capsys.readouterr().err


def test_without_weight_only_ratios_are_known_until_a_payload_sets_the_scale(
    folder: Path, of_desk: ServoMotions
) -> None:
    """K u - d v - c sign(v) = (J + armature) a: any multiple of all five solves it where no weight acts."""
    turn, lift = of_desk.joints
    for name in ("full_torque", "back_emf", "viscous", "coulomb", "armature"):
        assert turn.best(name) is None and lift.best(name) is not None, name
    assert turn.best("delay") is not None
    Path("desk.yaml").write_text(DESK.replace("kp: 16", "kp: 16, payloads: {load: {mass: 0.2, centre: [0, 0, -0.2]}}"))
    turn, lift = servo_motions("desk.yaml").joints
    assert turn.of("armature", "all") is None
    assert turn.of("armature", "payload").half_width < 0.02 * turn.servo.value("armature")  # type: ignore[union-attr]


def test_what_no_motion_separates_and_what_does(folder: Path, of_pendulum: ServoMotions) -> None:
    """Back-EMF needs a release; an unknown gain needs torque at its limit."""
    (joint,) = of_pendulum.joints
    assert joint.separated_by("back_emf") == ("release",) and joint.of("damping", "chirp") is not None
    Path("case.yaml").write_text(CASE.replace(", enabled: torque_enable", ""))
    found = servo_motions("case.yaml", gains=(4.0,))
    assert found.joints[0].best("back_emf") is None and found.joints[0].best("damping") is not None
    assert "release" not in {file.kind for file in found.files} and "servo: {enabled" in found.remarks[0]
    unknown = CASE.replace("feetech_sts3215, kp: 'kp{}'", "position_servo")
    Path("case.yaml").write_text(unknown)
    (joint,) = servo_motions("case.yaml").joints
    assert {"steps", "chirp"} >= set(joint.separated_by("full_torque")) and joint.best("full_torque") is not None
    assert joint.of("stiffness", "ramps") is not None and joint.of("full_torque", "ramps") is None
    Path("case.yaml").write_text(unknown + "limits: {lower: -0.1, upper: 0.1}\n")
    (joint,) = servo_motions("case.yaml").joints
    assert joint.best("full_torque") is None and joint.best("stiffness") is not None


@pytest.mark.parametrize(
    ("stated", "step"),
    [("counts: feetech", 2.0 * np.pi / 4096), ("counts: dynamixel_xl320", 300.0 / 1024 * np.pi / 180), ("", 1e-8)],
)
def test_files_have_the_columns_and_units_of_the_logs(folder: Path, stated: str, step: float) -> None:
    """What the case reads from the column of the command is the motion, to half a count."""
    log = "log: {columns: {q: [pos], q_ref: [goal], torque: none}, zero: [0.3]%s}"
    text = CASE[: CASE.index("log:")] + log % ("" if stated else ", units: {position: deg}") + "\n"
    Path("case.yaml").write_text(text.replace("friction: m1", f"friction: m1, {stated}" if stated else "friction: m1"))
    case = read_case("case.yaml")
    assert case.servo is not None
    plain = servo_motions(case, gains=(4.0,))
    file = next(file for file in plain.files if file.kind == "chirp")
    header, table = table_of(file)
    assert header == ["t", "goal", "torque_enable"]
    scale = {"counts: feetech": step, "counts: dynamixel_xl320": step}.get(stated, np.pi / 180)
    middle = {"counts: feetech": 2048, "counts: dynamixel_xl320": 512}.get(stated, 0)
    command = next(one.motion.command for one in plain.joints[0].motions if one.motion.kind == "chirp")
    assert np.max(np.abs((table[:, 1] - middle) * scale + 0.3 - command)) <= 0.5 * step * 1.001


def test_a_payload_adds_its_mass_to_the_load_of_its_logs(folder: Path) -> None:
    """Closed form: m r^2 to the inertia, m g r sin q to the weight; logs by a word in their names."""
    Path("case.yaml").write_text(
        CASE.replace("kp: 'kp{}'", "kp: 4, payloads: {m02: {mass: 0.2, centre: [0, 0, -0.25]}}")
    )
    case = read_case("case.yaml")
    assert case.servo is not None
    found = servo_motions(case)
    names = [file.name for file in found.files]
    assert "joint1_steps.csv" in names and "joint1_steps_m02.csv" in names
    loaded = with_payload(case.robot, Payload(0.2, (0.0, 0.0, -0.25)))
    log = recorded(found, loaded, 0)[names.index("joint1_steps.csv")]
    loads = []
    from dynident.actuators.servo_files import read_servo_logs

    for name in ("joint1_steps.csv", "joint1_steps_m02.csv"):
        (read,) = read_servo_logs(write_csv(log, Path(name)), case.servo.columns)
        loads.append(measured_loads(case.robot, read)[0])
    assert np.allclose(loads[1].inertia - loads[0].inertia, 0.2 * 0.25**2)
    q = log.q[:, 0]
    heavier = loads[1].torque(log.time, q) - loads[0].torque(log.time, q)
    assert np.allclose(heavier, 0.2 * 9.81 * 0.25 * np.sin(q), atol=1e-9)


def test_the_command_writes_files_and_a_table_of_80_columns(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", "case.yaml", "--kp", "4", "8", "-o", "motions", "--rate", "50", "--period", "4"]) == 0
    answer = capsys.readouterr().out
    assert max(map(len, answer.splitlines())) <= 80 and "separated by release alone" in answer
    assert "not checked: floor, obstacles" in answer
    assert "dynident identify case.yaml LOGS" in " ".join(answer.split())
    files = {path.name for path in Path("motions").iterdir()}
    assert files == {f"joint1_{kind}_kp{kp}.csv" for kind in ("chirp", "steps", "ramps", "release") for kp in (4, 8)}
    assert len(Path("motions/joint1_steps_kp4.csv").read_text().splitlines()) == 202
    assert main(["excite", "desk.yaml", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [joint["name"] for joint in data["joints"]] == ["turn", "lift"] and len(data["files"]) == 8
    page = (Path(__file__).parents[2] / "docs" / "json-output.md").read_text(encoding="utf-8")
    table = page.partition("<!-- json: excite servos -->")[2].partition("\n## ")[0]
    listed = {key.removesuffix("[]") for key in re.findall(r"^\| `([^`]*)`", table, re.MULTILINE)}
    assert set(data) - {"schema"} == listed
    turn = {one["name"]: one for one in data["joints"][0]["known"]["all"]}
    assert turn["armature"]["half_width"] is None and turn["armature"]["label"] == "not separable"
    assert main(["excite", "desk.yaml"]) == 0
    answer = capsys.readouterr().out
    assert max(map(len, answer.splitlines())) <= 80 and "turn: full torque, back emf" in answer


def test_an_earlier_estimate_takes_the_place_of_the_nominal_servo(folder: Path, of_pendulum: ServoMotions) -> None:
    case = read_case("case.yaml")
    assert case.servo is not None
    estimate = identify_actuators(case.robot, case.servo, recorded(of_pendulum, case.robot, 0)[:2])
    write_actuators(estimate, "earlier.json")
    again = servo_motions(case, gains=(4.0,), model="earlier.json")
    assert again.joints[0].servo.value("armature") == estimate.joints[0].value("armature")


@pytest.mark.parametrize(
    ("old", "new", "words", "said"),
    [
        ("", "", [], "--kp is not given; the case reads kp from logs ('kp{}')"),
        ("", "", ["--kp", "0"], "give position gains of the drive, above 0"),
        ("", "", ["--kp", "4", "--rate", "5"], "--rate = 5"),
        ("", "", ["--kp", "4", "--period", "0.5"], "--period = 0.5"),
        ("", "", ["--kp", "4", "--pose", "0,1"], "give 1 numbers, one for each joint"),
        ("", "", ["--kp", "4", "--pose", "4"], "pose of joint1 = 4"),
        ("", "", ["--kp", "4", "--pose", "zero"], "--pose"),
        ("", "", ["--kp", "4", "--criterion", "a_optimal"], "--criterion"),
        ("", "", ["--kp", "4", "--csv", "a.csv"], "--csv"),
        ("", "", ["--kp", "4", "--model", "case.yaml"], "case.yaml"),
        ("log:", "limits: {effort: 0}\nlog:", ["--kp", "4"], "effort of joint1 = 0"),
        ("log:", "limits: {lower: -0.0001, upper: 0.0001}\nlog:", ["--kp", "4"], "of joint1"),
        ("friction: m1", "payloads: {m: {mass: -1, centre: [0, 0, 0]}}", ["--kp", "4"], "servo.payloads.m.mass"),
        ("friction: m1", "payloads: {m: {mass: 1}}", ["--kp", "4"], "servo.payloads.m"),
        ("friction: m1", "payloads: 0.2", ["--kp", "4"], "servo.payloads"),
    ],
)
def test_what_cannot_be_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, words: list[str], said: str
) -> None:
    Path("case.yaml").write_text(CASE.replace(old, new, 1) if old else CASE)
    assert main(["excite", "case.yaml", *words, "-o", "motions"]) == 1
    assert said in capsys.readouterr().err and not Path("motions").exists()


def test_options_for_servos_are_refused_without_servos(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["excite", "pendulum.urdf", "--kp", "4"]) == 1
    assert "--kp = [4.0] is not possible" in capsys.readouterr().err


def test_a_workspace_refuses_motions_that_come_too_near(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The floor is 0.25 m below the axis of the turntable; the arm of 0.12 m and more passes it, or not."""
    capsule = "{start: [0, 0, 0], end: [0, 0, -0.2], radius: 0.02}"
    places = f"workspace: {{floor: %s, joint_radius: 0.02, shapes: {{arm: [{capsule}]}}}}\n"
    Path("desk.yaml").write_text(DESK + places % "-0.3")
    assert main(["excite", "desk.yaml", "--quiet"]) == 0
    assert "more than the workspace asks for" in capsys.readouterr().out
    Path("desk.yaml").write_text(DESK + places % "-0.1")
    assert main(["excite", "desk.yaml", "--quiet"]) == 1
    assert "nearer than the workspace allows" in capsys.readouterr().err


def test_the_robot_of_the_tests_is_read(folder: Path) -> None:
    assert read_robot("desk.urdf").joint_names == ("turn", "lift")
