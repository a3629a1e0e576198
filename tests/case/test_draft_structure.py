"""Columns without names: what their values tell, for layouts of loggers, and what is asked where they do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drafted_logs import moved, read, write_robot
from dynident.api.given_logs import log_of
from dynident.arrays import Array
from dynident.case.case_draft import Draft, draft_case
from dynident.case.draft.structure import structure_of
from dynident.errors import BadArgument
from dynident.model.joint import Drive
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

NOISE = np.random.default_rng(3)


@pytest.fixture(scope="module", params=["generic-6r", "generic-7r", "er16"])
def arm(request: pytest.FixtureRequest) -> Robot:
    robot = read_robot(request.param)
    return robot.with_drives(dict.fromkeys(robot.joint_names, Drive()))


@pytest.fixture(scope="module")
def motion(arm: Robot) -> dict[str, Array]:
    found = dict(moved(arm))
    found["dq"] = np.gradient(found["q"], found["time"], axis=0)
    found["ddq"] = np.gradient(found["dq"], found["time"], axis=0)
    found["torque"] = found["torque"] * (1 + 0.01 * NOISE.standard_normal(found["torque"].shape))
    return found


def blocks(*signals: Array) -> Array:
    return np.column_stack(signals)


def joint_by_joint(time: Array, *signals: Array) -> Array:
    return np.column_stack([time, np.stack(signals, axis=2).reshape(len(time), -1)])


LAYOUTS = {
    "q dq tau": lambda m: blocks(m["time"], m["q"], m["dq"], m["torque"]),
    "tau dq q": lambda m: blocks(m["time"], m["torque"], m["dq"], m["q"]),
    "q dq ddq tau": lambda m: blocks(m["time"], m["q"], m["dq"], m["ddq"], m["torque"]),
    "tau ddq dq q": lambda m: blocks(m["time"], m["torque"], m["ddq"], m["dq"], m["q"]),
    "counter first": lambda m: blocks(np.arange(float(len(m["time"]))), m["time"], m["q"], m["dq"], m["torque"]),
    "two rests": lambda m: blocks(m["q"], m["dq"], m["torque"], m["time"], 0 * m["time"]),
    "joint by joint": lambda m: joint_by_joint(m["time"], m["q"], m["dq"], m["torque"]),
    "no velocities": lambda m: blocks(m["time"], m["q"], m["torque"]),
    "milliseconds": lambda m: blocks(1e3 * m["time"], m["q"], m["dq"], m["torque"]),
}


def drafted(robot: Robot, values: Array, folder: Path) -> Draft:
    path = folder / "run.csv"
    np.savetxt(path, values, delimiter=",")
    return draft_case(write_robot(folder / "arm.json", robot), str(path), folder)


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_table_of_bare_numbers_is_read_rightly(layout, arm: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    draft = drafted(arm, layout(motion), tmp_path)
    assert draft.needed == ()
    case = read(draft, tmp_path)
    log = case.read(case.train[0])
    np.testing.assert_allclose(log.time, motion["time"], atol=1e-9)
    np.testing.assert_allclose(log.q, motion["q"])
    np.testing.assert_allclose(np.asarray(log.torque), motion["torque"])
    assert "the equations of motion of the robot model explain" in draft.text


@pytest.mark.parametrize(
    ("name", "signal", "asked", "words"),
    [
        ("Current{}_%", "current", "drive gain", "the header states percent, gains are per percent"),
        ("MotStrom{}_mA", "current", "drive gain", "the header states mA, gains are per A"),
        ("Drive{}_%", "torque", "stand for by the manual", "the header states percent"),
        ("Trq{}_Nm", "torque", "", "by the numbers in their names"),
        ("tau_est{}", "", "no torques", "not read: tau_est1"),
        ("Drive{}", "torque", "the unit of Drive1", "their names do not say torque"),
    ],
)
def test_what_the_names_of_efforts_say_stands_beside_positions_without_names(
    name: str, signal: str, asked: str, words: str, arm: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    """Torques of 1.3 times the robot model's, as drives in percent or ampere may have by chance."""
    of_joints = [pattern.format(k + 1) for pattern in ("Ach{}_deg", name) for k in range(arm.dof)]
    path = tmp_path / "run.csv"
    values = blocks(motion["time"], np.degrees(motion["q"]), (1.3 if asked else 1.0) * motion["torque"])
    np.savetxt(path, values, delimiter=",", header=",".join(["time", *of_joints]), comments="")
    draft = draft_case(write_robot(tmp_path / "arm.json", arm), str(path), tmp_path)
    assert words in draft.text and "position: deg   # the header states deg" in draft.text
    said = " ".join([*(one.text for one in draft.needed), *draft.remarks])
    assert asked in said if asked else draft.needed == ()
    assert draft.recognition.effort == signal


@pytest.mark.parametrize("counted", [True, False])
def test_the_rate_of_columns_whose_names_tell_all_but_the_time_follows_from_the_velocities(
    counted: bool, arm: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    """A counter of rows is no time; without velocities the time is asked for."""
    count = np.arange(float(len(motion["time"])))
    for with_velocities in (True, False):
        names = ["q{}", "dq{}", "tau{}"] if with_velocities else ["q{}", "tau{}"]
        signals = [motion["q"], *([motion["dq"]] if with_velocities else []), motion["torque"]]
        header = [*["step"] * counted, *(name.format(k + 1) for name in names for k in range(arm.dof))]
        path = tmp_path / f"run{with_velocities}.csv"
        values = blocks(*([count] if counted else []), *signals)
        np.savetxt(path, values, delimiter=",", header=",".join(header), comments="")
        draft = draft_case(write_robot(tmp_path / f"arm{with_velocities}.json", arm), str(path), tmp_path)
        if not with_velocities:
            assert "the column of the time" in draft.needed[0].text
            continue
        assert draft.needed == () and any("runs forward as a time" in one.text for one in draft.questions)
        case = read(draft, tmp_path)
        np.testing.assert_allclose(case.read(case.train[0]).time, motion["time"] - motion["time"][0], atol=1e-9)


def test_the_rate_and_torques_of_other_names_are_both_asked_for(
    arm: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    """The values are read once, and neither question takes the place of the other."""
    header = [name.format(k + 1) for name in ("q{}", "dq{}", "foo{}") for k in range(arm.dof)]
    values = blocks(motion["q"], motion["dq"], motion["torque"])
    np.savetxt(tmp_path / "run.csv", values, delimiter=",", header=",".join(header), comments="")
    draft = draft_case(write_robot(tmp_path / "arm.json", arm), str(tmp_path / "run.csv"), tmp_path)
    asked = " ".join(one.text for one in draft.questions)
    assert "no column runs forward as a time" in asked and "'foo' is not known; the equations of motion" in asked
    assert draft.recognition.sources["torque"].columns == tuple(f"foo{k + 1}" for k in range(arm.dof))


@pytest.mark.parametrize("with_velocities", [True, False])
@pytest.mark.parametrize("size", [1.0, 40.0, 0.0])
def test_torques_whose_names_are_not_known_are_proposed_by_their_values(
    size: float, with_velocities: bool, arm: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    """Right torques are offered, of another size their unit is asked for, and noise (0) is no torque of the robot."""
    effort = size * motion["torque"] if size else np.random.default_rng(1).standard_normal(motion["q"].shape)
    signals = [motion["q"], *([motion["dq"]] if with_velocities else []), effort]
    names = ["qpos{}", *(["qvel{}"] if with_velocities else []), "foo{}"]
    header = ["time", *(name.format(k + 1) for name in names for k in range(arm.dof))]
    path = tmp_path / "run.csv"
    np.savetxt(path, blocks(motion["time"], *signals), delimiter=",", header=",".join(header), comments="")
    draft = draft_case(write_robot(tmp_path / "arm.json", arm), str(path), tmp_path)
    if not size:
        assert draft.recognition.effort == "" and "the log also has foo1" in draft.needed[0].text
        return
    assert draft.recognition.sources["torque"].columns == tuple(f"foo{k + 1}" for k in range(arm.dof))
    assert any("'foo' is not known; the equations of motion" in one.text for one in draft.questions)
    assert (draft.needed == ()) == (size == 1.0)
    assert size == 1.0 or "the unit of foo1" in " ".join(one.text for one in draft.needed)


def test_without_a_time_the_rate_follows_from_the_velocities(
    arm: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    draft = drafted(arm, blocks(motion["q"], motion["dq"], motion["torque"]), tmp_path)
    (question,) = [one for one in draft.questions if "runs forward as a time" in one.text]
    assert not question.needed and draft.needed == ()
    case = read(draft, tmp_path)
    np.testing.assert_allclose(case.read(case.train[0]).time, motion["time"] - motion["time"][0], atol=1e-9)


def test_commanded_positions_are_told_by_their_lead(arm: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    ahead = np.concatenate([motion["q"][3:], np.repeat(motion["q"][-1:], 3, axis=0)])
    draft = drafted(arm, blocks(motion["time"], ahead, motion["q"], motion["dq"], motion["torque"]), tmp_path)
    (question,) = [one for one in draft.questions if "measured positions" in one.text]
    assert not question.needed and "as measured ones do" in question.text
    case = read(draft, tmp_path)
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"])


def test_torques_of_a_model_beside_measured_ones_are_asked(
    arm: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    noisy = motion["torque"] + 0.05 * motion["torque"].std(axis=0) * NOISE.standard_normal(motion["torque"].shape)
    draft = drafted(arm, blocks(motion["time"], motion["q"], motion["dq"], motion["torque"], noisy), tmp_path)
    first, *_ = draft.needed
    assert "which columns are the measured joint torques" in first.text and " or " in first.text
    assert "torques of a model are explained best" in first.text


def test_columns_that_are_no_motion_are_asked(arm: Robot, motion: dict[str, Array]) -> None:
    steps = np.random.default_rng(4).standard_normal((len(motion["time"]), 4 * arm.dof))
    for values in (steps, np.cumsum(steps, axis=0)):
        header = [f"c{k}" for k in range(1 + values.shape[1])]
        told = structure_of(arm, header, blocks(motion["time"], values))
        assert told.time == "c0" and "dq" not in told.groups


def test_torques_of_no_robot_are_not_taken(arm: Robot, motion: dict[str, Array], tmp_path: Path) -> None:
    other = np.random.default_rng(0).standard_normal(motion["torque"].shape)
    draft = drafted(arm, blocks(motion["time"], motion["q"], motion["dq"], other), tmp_path)
    assert [one.text.partition(" in N m")[0] for one in draft.needed] == ["the measured joint torques"]


def test_a_stated_rate_is_the_time_of_positions_without_velocities(
    arm: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    np.savetxt(tmp_path / "run.csv", blocks(motion["q"], motion["torque"]), delimiter=",")
    rate = 1.0 / float(np.median(np.diff(motion["time"])))
    robot = write_robot(tmp_path / "arm.json", arm)
    draft = draft_case(robot, str(tmp_path / "run.csv"), tmp_path, rate_hz=round(rate, 6))
    assert draft.needed == ()
    case = read(draft, tmp_path)
    np.testing.assert_allclose(np.asarray(case.read(case.train[0]).torque), motion["torque"])


def test_columns_of_some_joints_are_as_many_as_have_derivatives(
    arm: Robot, motion: dict[str, Array], tmp_path: Path
) -> None:
    some = {name: motion[name][:, 1:] for name in ("q", "dq", "torque")}
    draft = drafted(arm, blocks(motion["time"], some["q"], some["dq"], some["torque"]), tmp_path)
    sources = draft.recognition.sources
    count = arm.dof - 1
    assert [int(name[1:]) for name in sources["q"].columns] == list(range(2, 2 + count))
    assert [int(name[1:]) for name in sources["dq"].columns] == list(range(2 + count, 2 + 2 * count))
    last = f"c{1 + 3 * count}"
    told = sources["torque"].columns[-1] if "torque" in sources else draft.recognition.likely_effort
    assert last in told
    assert any("joints" in one.text for one in draft.questions)


def test_one_array_is_drafted_and_proposed_to_python(tmp_path: Path) -> None:
    arm = read_robot("er16")
    motion = dict(moved(arm))
    motion["dq"] = np.gradient(motion["q"], motion["time"], axis=0)
    values = blocks(motion["time"], motion["q"], motion["dq"], motion["torque"])
    np.save(tmp_path / "run.npy", values)
    draft = draft_case(write_robot(tmp_path / "arm.json", arm), str(tmp_path / "run.npy"), tmp_path)
    assert draft.needed == ()
    case = read(draft, tmp_path)
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"])
    n = arm.dof
    with pytest.raises(BadArgument, match="equations of motion of the robot model explain") as raised:
        log_of(values, arm)  # type: ignore[arg-type]
    assert f'{{"time": log[:, 0], "q": log[:, 1:{1 + n}], "torque": log[:, {1 + 2 * n}:{1 + 3 * n}]}}' in str(
        raised.value
    )
    noise = np.random.default_rng(1).standard_normal(values.shape)
    with pytest.raises(BadArgument, match="dynident init ROBOT FILE"):
        log_of(noise, arm)  # type: ignore[arg-type]
