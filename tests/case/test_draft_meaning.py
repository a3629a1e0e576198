"""What a draft asks or refuses in place of a guess: topics, counters, forces, pressures, long tables, moving bases."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage

from drafted_logs import joints_called, moved, named, numbered, read, write_log, write_robot
from dynident.arrays import Array
from dynident.case.case import read_case
from dynident.case.case_draft import Draft, draft_case, draft_summary
from dynident.diagnosis.examination import examine
from dynident.errors import DescriptionError, LogFormatError
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

RAIL = ("rail", "shoulder", "elbow", "wrist")


@pytest.fixture(scope="module")
def scara() -> Robot:
    return joints_called(read_robot("generic-scara"), *RAIL)


@pytest.fixture(scope="module")
def motion(scara: Robot) -> dict[str, Array]:
    return moved(scara)


def drafted(folder: Path, robot: Robot, columns: dict[str, Array]) -> Draft:
    return draft_case(write_robot(folder / "robot.json", robot), write_log(folder / "run.csv", columns), folder)


def topic(motion: dict[str, Array], name: str, joints: tuple[str, ...]) -> dict[str, Array]:
    places = [RAIL.index(joint) for joint in joints]
    own = {signal: values[:, places] for signal, values in motion.items() if values.ndim == 2} | {
        "time": motion["time"]
    }
    signals = {"q": "position", "torque": "effort"}
    return named(own, "t", {key: [f"{name}:{j}.{word}" for j in joints] for key, word in signals.items()})


def test_joints_of_several_topics_are_one_set(tmp_path: Path, scara: Robot, motion: dict[str, Array]) -> None:
    arm = topic(motion, "/arm/joint_states", RAIL[1:])
    draft = drafted(tmp_path, scara, arm | topic(motion, "/rail/joint_states", RAIL[:1]))
    found = draft.recognition
    assert found.joints.names == RAIL and "locked" not in draft.text and not found.rivals
    assert found.sources["q"].columns[:2] == ("/rail/joint_states:rail.position", "/arm/joint_states:shoulder.position")
    assert found.sources["torque"].columns[0] == "/rail/joint_states:rail.effort"
    answers = {"rad, deg": "[rad, rad, m, rad]", "N m, mN m": "[N m, N m, N, N m]"}
    log = read(draft, tmp_path, answers).read(str(tmp_path / "run.csv"))
    np.testing.assert_allclose(log.q, motion["q"])


def test_a_joint_in_two_topics_is_asked_for(tmp_path: Path, scara: Robot, motion: dict[str, Array]) -> None:
    columns = topic(motion, "/arm/joint_states", RAIL[1:]) | topic(motion, "/rail/joint_states", RAIL[:1])
    draft = drafted(tmp_path, scara, columns | topic(motion, "/filtered/joint_states", RAIL[1:]))
    names = [group.names for group in draft.recognition.rivals["q"]]
    assert len(names) == 2 and all(own[0] == "/rail/joint_states:rail.position" for own in names)
    assert any("which columns are the measured positions" in question.text for question in draft.needed)


@pytest.mark.parametrize("column", ["linear_rail_mm", "/rail/state:rail.data"])
def test_a_joint_that_the_log_holds_is_not_locked_without_a_question(
    tmp_path: Path, scara: Robot, motion: dict[str, Array], column: str
) -> None:
    arm = topic(motion, "/arm/joint_states", RAIL[1:])
    draft = drafted(tmp_path, scara, arm | {column: motion["q"][:, 0]})
    assert any("where does rail stand" in question.text and column in question.text for question in draft.needed)
    without = drafted(tmp_path, scara, arm)
    assert not any("rail" in question.text for question in without.needed) and "locked: rest" in without.text


def with_velocities(motion: dict[str, Array], q: str, dq: str, scale: float = 1.0) -> dict[str, Array]:
    count = range(1, motion["q"].shape[1] + 1)
    names = {"q": [q.format(k) for k in count], "dq": [dq.format(k) for k in count]}
    own = motion | {"q": scale * motion["q"], "dq": scale * motion["dq"], "time": np.arange(float(len(motion["time"])))}
    return named(own, "t", names | {"torque": [f"tau{k}" for k in count]})


def six() -> tuple[Robot, dict[str, Array]]:
    robot = read_robot("generic-6r")
    return robot, moved(robot)


def test_a_counter_of_rows_tells_no_rate(tmp_path: Path) -> None:
    robot, motion = six()
    counted = numbered(motion | {"time": np.arange(600.0)})
    draft = drafted(tmp_path, robot, counted)
    question, torque = draft.needed
    assert "the unit of tau1 to tau6" in torque.text  # masses are weighed by the motion
    assert "tells no rate" in question.text and "likely" not in question.text
    assert "cutoff_hz: auto" in draft.text and "no rate is known" in draft.text
    assert [log["rate_hz"] for log in draft_summary(draft)["logs"]] == [None]
    case = read(draft, tmp_path, {"tells no rate": "10 ms", "the unit of tau1": "N m"})
    assert case.read(str(tmp_path / "run.csv")).rate == pytest.approx(100)
    timed = drafted(tmp_path, robot, numbered(motion))
    assert not timed.needed and timed.recognition.units["time"].text == "s" and "cutoff_hz: auto" not in timed.text
    stated = drafted(tmp_path, robot, numbered(motion | {"time": np.arange(600.0)}, time="t_ms"))
    assert stated.recognition.units["time"].text == "ms" and not any("rate" in q.text for q in stated.needed)


def test_velocities_tell_the_time_of_a_counted_row(tmp_path: Path) -> None:
    robot, motion = six()
    turns = 180 / np.pi
    stated = drafted(tmp_path, robot, with_velocities(motion, "q{} [deg]", "dq{} [deg/s]", turns))
    unit = stated.recognition.units["time"]
    assert unit.certain and unit.text == "10 ms" and "dq" in stated.recognition.sources
    bare = drafted(tmp_path, robot, with_velocities(motion, "q{}", "dq{}")).recognition.units["time"]
    assert not bare.certain and bare.text == "10 ms" and "if both have the same unit" in bare.why
    rows = np.arange(len(motion["time"])) // 2 * 2
    held = {key: values if key == "time" else values[rows] for key, values in motion.items()}
    twice = drafted(tmp_path, robot, with_velocities(held, "q{}", "dq{}")).recognition.units["time"]
    assert twice.text == "10 ms"  # each reading in two rows had been taken for 14.1 ms
    noise = motion | {"dq": np.random.default_rng(2).standard_normal(motion["dq"].shape)}
    other = drafted(tmp_path, robot, with_velocities(noise, "q{}", "dq{}")).recognition.units["time"]
    assert not other.words and "tells no rate" in other.why


def test_torques_of_a_model_are_not_taken_for_measured_ones(tmp_path: Path) -> None:
    """What controllers log beside the measured torques has a plainer name and is explained best: it is the model."""
    robot, motion = six()
    model = DynamicModel(robot)
    ddq = np.gradient(motion["dq"], motion["time"], axis=0)
    computed = model.torque(Motion(motion["q"], motion["dq"], ddq), model.nominal())
    friction = np.array([8.0, 8.0, 6.0, 3.0, 2.0, 2.0]) * np.tanh(motion["dq"] / 0.01)
    columns = {"t": motion["time"]}
    for name, values in {"q": motion["q"], "Torque": computed, "TorqueSm": computed + friction}.items():
        columns |= {f"{name}{k + 1}": values[:, k] for k in range(6)}
    columns |= {f"TorqueOffset{k + 1}": np.zeros(len(motion["time"])) for k in range(6)}
    found = drafted(tmp_path, robot, columns).recognition
    assert found.sources["torque"].columns[0] == "TorqueSm1" and not found.rivals
    assert "torques of a model" in found.unread["Torque1"] and not {"TorqueSm1", "q1"} & found.unread.keys()
    same = drafted(tmp_path, robot, columns | {f"TorqueSm{k + 1}": 1.01 * computed[:, k] for k in range(6)}).recognition
    assert same.sources["torque"].columns[0] == "Torque1" and not same.unread  # a filtered copy is no other torque
    smooth = scipy.ndimage.gaussian_filter1d(computed, 10.0, axis=0)
    without = {
        f"{name}{k + 1}": own[:, k] for name, own in (("Torque", computed), ("TorqueSm", smooth)) for k in range(6)
    }
    simulated = drafted(
        tmp_path, robot, columns | without
    ).recognition  # of a simulation without friction, and filtered
    assert simulated.sources["torque"].columns[0] == "Torque1" and not simulated.unread
    noise = np.random.default_rng(0).normal(0.0, 0.2 * computed.std(axis=0), computed.shape)
    raw = {f"Torque{k + 1}": (computed + friction + noise)[:, k] for k in range(6)}
    filtered = drafted(tmp_path, robot, columns | raw)
    assert filtered.recognition.sources["torque"].columns[0] == "Torque1" and "measured torques" not in filtered.text
    both = {f"Torque{k + 1}": (computed + 0.5 * friction)[:, k] for k in range(6)}
    draft = drafted(tmp_path, robot, columns | both)
    (question,) = [one.text for one in draft.needed if "measured torques" in one.text]
    assert "Torque1 to Torque6 or TorqueSm1 to TorqueSm6" in question and "Bodies without friction leave" in question


@pytest.mark.parametrize(("cutoff", "fault"), [("51", True), ("20", False), ("auto", False)])
def test_a_cut_off_above_half_the_rate_is_an_error(tmp_path: Path, cutoff: str, fault: bool) -> None:
    robot, motion = six()
    write_robot(tmp_path / "robot.json", robot)
    write_log(tmp_path / "run.csv", numbered(motion))
    text = f"case: 2\nrobot: robot.json\npreprocessing: {{filter: {{butterworth: {{cutoff_hz: {cutoff}}}}}}}\n"
    (tmp_path / "case.yaml").write_text(text + "train: run.csv\n")
    found = examine(read_case(tmp_path / "case.yaml"), "run.csv").findings
    errors = [finding for finding in found if finding.name == "cut-off frequency"]
    assert bool(errors) == fault and all("below 50 Hz" in one.remedy and one.severity == "error" for one in errors)


@pytest.mark.parametrize(
    ("torque", "why"),
    [("F{} [N]", "the header states N"), ("force{}", "their names say force"), ("tau{}", ""), ("torque{} [Nm]", "")],
)
def test_forces_are_no_torques_of_joints_that_turn(tmp_path: Path, torque: str, why: str) -> None:
    robot, motion = six()
    draft = drafted(tmp_path, robot, numbered(motion, torque=torque))
    unit = draft.recognition.units.get("torque")
    if not why:
        assert unit is not None and unit.certain and unit.text == "N m"
        return
    text = " ".join(question.text for question in draft.needed)
    assert unit is None or (not unit.certain and not unit.words and why in unit.why and "lever arm" in text)
    assert draft.needed


def test_forces_of_slides_stay(tmp_path: Path) -> None:
    robot = read_robot("generic-scara")
    slide = robot.locked({joint.name: 0.0 for joint in robot.active if joint.kind == "revolute"})
    draft = drafted(tmp_path, slide, numbered(moved(slide), torque="force{} [N]"))
    assert draft.recognition.units["torque"].certain and draft.recognition.units["torque"].text == "N"


@pytest.mark.parametrize("hinges", [(), ("shoulder",), ("rail", "shoulder", "wrist")])
def test_only_joints_that_turn_and_say_force_are_asked(
    tmp_path: Path, scara: Robot, motion: dict[str, Array], hinges: tuple[str, ...]
) -> None:
    torque = [f"{joint}_{'force' if joint in ('elbow', *hinges) else 'torque'}" for joint in RAIL]
    columns = named(motion, "t", {"q": [f"{joint}_pos" for joint in RAIL], "torque": torque})
    unit = drafted(tmp_path, scara, columns).recognition.units["torque"]
    if hinges:
        assert not unit.certain and f"names say force, and {', '.join(hinges)} turn" in unit.why
    else:
        assert unit.certain and unit.text == "[N m, N m, N, N m]"


def test_a_force_at_a_hinge_is_refused_in_a_case(tmp_path: Path) -> None:
    write_robot(tmp_path / "robot.json", read_robot("generic-6r"))
    for unit, fault in (("N", True), ("N m", False)):
        (tmp_path / "case.yaml").write_text(
            f"case: 2\nrobot: robot.json\nlog: {{units: {{torque: {unit}}}}}\ntrain: a.csv\n"
        )
        if not fault:
            assert read_case(tmp_path / "case.yaml").columns.units.torque == unit
            continue
        with pytest.raises(DescriptionError, match="lever arm that changes with the position"):
            read_case(tmp_path / "case.yaml")


@pytest.mark.parametrize("name", ["EgmTime_ms", "ctrlTime [ms]", "systime", "sim_time", "cycle_time_ms", "delta_time"])
def test_clocks_of_something_are_the_time_and_durations_are_not(tmp_path: Path, name: str) -> None:
    robot, motion = six()
    is_clock, factor = not name.startswith(("cycle", "delta")), 1e3 if "ms" in name else 1.0
    time = motion["time"] + 5.0 if is_clock else np.full(600, 0.01)
    columns = {"SeqNo": np.arange(600.0) + 7, name: factor * time, **numbered(motion)}
    del columns["t"]
    found = drafted(tmp_path, robot, columns).recognition
    assert found.time == (name if is_clock else "")
    if is_clock:
        assert found.units["time"].certain and found.units["time"].text == ("ms" if "ms" in name else "s")


@pytest.mark.parametrize("where", ["", "motor_"])
def test_torques_in_percent_ask_for_the_rated_ones_of_their_side(tmp_path: Path, where: str) -> None:
    robot, motion = six()
    columns = numbered(motion, torque=f"{where}torque{{}}_pct")
    draft = drafted(tmp_path, robot, columns)
    text = next(question.text for question in draft.needed if "rated torque" in question.text)
    assert ("of each motor, before its gear" in text) == bool(where) and f"100 percent of {where}torque1_pct" in text
    assert "torque: percent   # the header states percent" in draft.text and "zero:" not in draft.text
    log = read(draft, tmp_path, {"rated torque": str([50.0] * 6)}).read(str(tmp_path / "run.csv"))
    gears = [joint.drive.gear_ratio if where else 1.0 for joint in robot.active]
    np.testing.assert_allclose(np.asarray(log.torque), 0.5 * motion["torque"] * gears)
    del columns["t"]
    unread = drafted(tmp_path, robot, {name: values.round(2) for name, values in columns.items()})
    assert any("could not be looked at; likely percent" in question.text for question in unread.needed)


def test_pressures_are_no_torques(tmp_path: Path, scara: Robot, motion: dict[str, Array]) -> None:
    columns = named(motion, "t", {"q": [f"{joint}_angle" for joint in RAIL]})
    for k, joint in enumerate(RAIL):
        columns |= {f"{joint}_pA": 50 + motion["torque"][:, k], f"{joint}_pB": 20 - 0.5 * motion["torque"][:, k]}
    draft = drafted(tmp_path, scara, columns)
    text = " ".join(question.text for question in draft.needed)
    assert (
        "torque" not in draft.recognition.sources
        and "are pressures by their names" in text
        and "likely [rail_p" not in text
    )


def test_a_long_table_says_how_it_is_reshaped(tmp_path: Path) -> None:
    robot, motion = six()
    wide = numbered(motion)
    names = [name for name in wide if name != "t"]
    rows = [f"{t:.3f},{name},{wide[name][k]:.6f}" for k, t in enumerate(wide["t"][:40]) for name in names]
    (tmp_path / "long.csv").write_text("\n".join(["t,signal,value", *rows]) + "\n")
    model = write_robot(tmp_path / "robot.json", robot)
    with pytest.raises(LogFormatError, match=r"a row for each signal at each time.*columns='signal', values='value'"):
        draft_case(model, str(tmp_path / "long.csv"), tmp_path)
    rows = [f"{t:.3f},{j + 1},{motion['q'][k, j]:.6f},1" for k, t in enumerate(wide["t"][:40]) for j in range(6)]
    (tmp_path / "joints.csv").write_text("\n".join(["time,joint,position,torque", *rows]) + "\n")
    with pytest.raises(LogFormatError, match=r"a row for each joint .*values=\['position', 'torque'\]"):
        draft_case(model, str(tmp_path / "joints.csv"), tmp_path)
    coarse = wide | {"t": np.round(wide["t"], 1), "mode": np.ones(600)}  # a clock of tenths repeats its time
    small = {name: coarse[name] for name in ("t", "q1", "q2", "tau1", "tau2", "mode")}
    draft = draft_case(model, write_log(tmp_path / "coarse.csv", small), tmp_path)
    assert draft.recognition.header == tuple(small)


def test_one_sensor_of_temperature_serves_all_joints(tmp_path: Path) -> None:
    robot, motion = six()
    warm = {"temp_gear": 25 + 0.02 * np.arange(600)}
    draft = drafted(tmp_path, robot, numbered(motion) | warm)
    assert "temperature: temp_gear " in draft.text and "- temperature: {choose: part}" in draft.text
    case = read(draft, tmp_path)
    log = case.read(str(tmp_path / "run.csv"))
    assert log.temperature is not None
    np.testing.assert_allclose(log.temperature, np.repeat(warm["temp_gear"][:, None], 6, axis=1))
    np.testing.assert_allclose(log.q, motion["q"])
    assert not any(finding.severity == "error" for finding in examine(case, "run.csv").findings)
    assert (
        drafted(tmp_path, robot, numbered(motion) | {"temp_gear": np.full(600, 25.0)}).recognition.temperature is None
    )
    two = {"temp_a": warm["temp_gear"], "temp_b": warm["temp_gear"]}
    assert "name one column per joint, or one for all" in drafted(tmp_path, robot, numbered(motion) | two).text
    case_file = (tmp_path / "case.yaml").read_text().replace("temperature: temp_gear", "temperature: [temp_gear, q1]")
    (tmp_path / "case.yaml").write_text(case_file)
    with pytest.raises(DescriptionError, match="2 names, elsewhere 6"):
        read_case(tmp_path / "case.yaml")


@pytest.mark.parametrize(("reach", "moves"), [(0.4, True), (0.004, False)])
def test_a_base_that_moves_is_named(tmp_path: Path, reach: float, moves: bool) -> None:
    robot, motion = six()
    base = {
        "base_x": reach * np.sin(motion["time"]),
        "odom_yaw": reach * np.cos(motion["time"]),
        "base_current": 9 * motion["time"],
    }
    draft = drafted(tmp_path, robot, numbered(motion) | base)
    assert any("base at rest" in remark for remark in draft.remarks) == moves
    tool = {f"base.tool_pose_{axis}": 0.4 * np.sin(motion["time"]) for axis in "xyz"}  # as Kortex has it, in the base
    assert not any("base at rest" in remark for remark in drafted(tmp_path, robot, numbered(motion) | tool).remarks)
    named_base = replace(
        robot, joints=tuple(replace(j, name="base_yaw") if k == 0 else j for k, j in enumerate(robot.joints))
    )
    turned = drafted(tmp_path, named_base, numbered(motion) | {"base_yaw": motion["q"][:, 0]})
    assert not any("base at rest" in remark for remark in turned.remarks)


@pytest.mark.parametrize("is_signed", [False, True])
def test_currents_without_a_sign_leave_a_case_of_servos(tmp_path: Path, is_signed: bool) -> None:
    """As hobby servos log them: they tell no torque, while commands and positions tell the actuators."""
    robot, motion = six()
    goals = motion["q"] + 0.3 * np.sin(5.0 * motion["time"])[:, None]
    currents = np.round(50.0 * motion["torque"] / np.abs(motion["torque"]).max(axis=0))
    columns = named(
        {**motion, "goal": goals, "current": currents if is_signed else np.abs(currents)},
        "timestamp",
        {
            signal: [f"{name}.{word}" for name in robot.joint_names]
            for signal, word in (("q", "Present_Position"), ("goal", "Goal_Position"), ("current", "Present_Current"))
        },
    )
    found = drafted(tmp_path, robot, columns)
    if is_signed:
        assert found.recognition.effort == "current" and "becomes a case of servos" in found.text
        return
    assert "servo:" in found.text and not found.recognition.effort
    assert "Present_Current, ... (6 in all): currents without a sign, 0 to 50 while" in found.remarks[0]
