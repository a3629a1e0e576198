"""The case file: every key, where files are looked for, and faults that are named with their line and key."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.case.case import VERSIONS, Split, case_of_robot, read_case
from dynident.case.case_values import DATA_VARIABLE
from dynident.data.formats import ColumnMap, Units
from dynident.data.log import Log
from dynident.data.log_of_robot import read_with
from dynident.data.preprocessing import Preprocessing, default_preprocessing
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.data.preprocessing.five_point import FivePoint
from dynident.errors import BadOption, DescriptionError, DynidentError, FileError, LogMismatch
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.offset import Offset
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path, spatial_3r: Robot) -> Write:
    """Write a case file beside the robot of three joints, and return its path."""
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(spatial_3r)))

    def make(*lines: str, head: tuple[str, ...] = ("case: 1", "robot: arm.json")) -> Path:
        path = tmp_path / "case.yaml"
        path.write_text("\n".join([*head, *lines]) + "\n")
        return path

    return make


def log_of(samples: int = 100, joints: int = 3) -> Log:
    time = np.arange(samples) / 10
    return Log(tuple(f"joint{k + 1}" for k in range(joints)), time, np.zeros((samples, joints)))


def test_friction_and_delay_that_are_to_be_found(write: Write) -> None:
    case = read_case(write("friction: auto", "preprocessing: {delay_s: auto}"))
    assert case.choose_friction and case.friction == (Coulomb(0.02), Viscous(), Offset())
    assert case.preprocessing.delay_s is None
    stated = read_case(write("preprocessing: {delay_s: 0.004}"))
    assert stated.preprocessing.delay_s == 0.004 and not stated.choose_friction


def test_parts_for_some_joints_and_a_bias(write: Write) -> None:
    case = read_case(
        write(
            "friction:",
            "  - coulomb: {joints: [joint1, joint3], vary: width}",
            "  - viscous: {joints: joint2}",
            "drives: {joint2: {bias: -12.5}}",
        )
    )
    assert case.friction == (Coulomb(joints=("joint1", "joint3"), vary=("width",)), Viscous(joints=("joint2",)))
    assert case.robot.bias.tolist() == [0.0, -12.5, 0.0]
    with pytest.raises(DescriptionError, match=r"friction: no joint called 'elbow'"):
        read_case(write("friction: [viscous: {joints: elbow}]"))
    with pytest.raises(DescriptionError, match="the coefficient Fv is there twice on joint1"):
        read_case(write("friction: [viscous, viscous: {joints: joint1}]"))


def test_a_case_of_two_lines_has_all_defaults(write: Write, spatial_3r: Robot) -> None:
    case = read_case(write())
    assert case.robot.joint_names == spatial_3r.joint_names
    assert case.friction == (Coulomb(0.02), Viscous(), Offset())
    assert case.preprocessing == default_preprocessing()
    assert case.columns == ColumnMap(joints=spatial_3r.joint_names)
    assert (case.estimator.name, dict(case.estimator.options)) == ("consistent", {})
    assert (case.train, case.test, case.split) == ((), (), None)
    assert case.model.robot is case.robot and case.path.endswith("case.yaml")


def test_the_stated_default_preparation() -> None:
    chosen = Butterworth(cutoff_hz=None, order=4, torque="same")
    assert default_preprocessing() == Preprocessing(
        chosen, rate_hz=None, trim_s=0.5, standstill=0.02, rest="mask", rows_per_period=8.0
    )


def test_cut_off_and_rate_are_stated_or_chosen(write: Write) -> None:
    """Stated rates hold; ``auto``, also where nothing is said, takes so many rows a period of the cut-off."""
    stated = read_case(write("preprocessing: {filter: {butterworth: {cutoff_hz: 7}}, rate_hz: 50}")).preprocessing
    assert stated.filter == Butterworth(7.0) and stated.rows_hz(1000.0) == 50.0
    assert read_case(write("preprocessing: {rate_hz: all}")).preprocessing.rows_hz(1000.0) is None
    for text in ("{filter: {butterworth: {cutoff_hz: auto}}, rate_hz: auto}", "{filter: butterworth}", "{trim_s: 0.5}"):
        assert read_case(write(f"preprocessing: {text}")).preprocessing == default_preprocessing()


def test_every_key(write: Write) -> None:
    case = read_case(
        write(
            "gravity: [0, 9.81, 0]",
            "locked: {joint3: pi/2}",
            "joints: [joint2, joint1, joint3]",
            "coupling: [[1, 0, 0], [0.5, 1, 0], [0, 0, 1]]",
            "drives:",
            "  joint1: {gear_ratio: -120, rotor_inertia: 2e-5, gain: 11.5}",
            "  joint2: {gain: 9}",
            "friction:",
            "  - coulomb: {width: 0.1}",
            "  - viscous",
            "log:",
            "  columns: {time: Time, q: 'pos{}', dq: none, torque: [ta, tb, tc]}",
            "  units: {time: ms, position: [deg, rad, deg], torque: N m}",
            "  decimal: ','",
            "  leave_out: {a.csv: [[3, 4.5], [8, 9]]}",
            "preprocessing:",
            "  filter: {five_point: {repeats: 3}}",
            "  rate_hz: 125",
            "  trim_s: 0.25",
            "  standstill: 0.1",
            "  rest: keep",
            "estimator:",
            "  wls: {iterations: 4}",
            "train: [a.csv, b.csv]",
            "test: c.csv",
            "split: first:0.7",
            "note: measured on a Monday",
        )
    )
    assert case.robot.joint_names == ("joint1", "joint2")
    np.testing.assert_array_equal(case.robot.gravity, [0, 9.81, 0])
    np.testing.assert_array_equal(np.asarray(case.robot.coupling), [[1, 0], [0.5, 1]])
    drive = case.robot.joints[0].drive
    assert (drive.gear_ratio, drive.rotor_inertia, drive.gain) == (-120, 2e-5, 11.5)
    assert (case.robot.joints[1].drive.gain, case.robot.joints[1].drive.gear_ratio) == (9, 1)
    assert case.friction == (Coulomb(0.1), Viscous())
    columns = case.columns
    assert columns.joints == ("joint2", "joint1", "joint3") and columns.time == "Time" and columns.decimal == ","
    assert columns.q == ("pos1", "pos2", "pos3") and columns.dq == () and columns.torque == ("ta", "tb", "tc")
    assert columns.units == Units(time="ms", position=("deg", "rad", "deg"), torque="N m")
    np.testing.assert_array_equal(columns.spells_left_out("logs/a.csv"), [[3, 4.5], [8, 9]])
    assert columns.spells_left_out("b.csv").shape == (0, 2)
    assert case.preprocessing == Preprocessing(FivePoint(3), 125.0, 0.25, 0.1, "keep")
    assert (case.estimator.name, dict(case.estimator.options)) == ("wls", {"iterations": "4"})
    assert (case.train, case.test, case.split) == (("a.csv", "b.csv"), ("c.csv",), Split(first=0.7))


def test_all_joints_that_the_log_lacks_can_be_locked(write: Write) -> None:
    case = read_case(write("joints: [joint2]", "locked: rest"))
    assert case.robot.joint_names == ("joint2",) and case.columns.joints == ("joint2",)


@pytest.mark.parametrize("size", [0.0, 1.62, 9.81, 24.8])
def test_any_planet_has_its_gravity(write: Write, size: float) -> None:
    assert read_case(write(f"gravity: [0, 0, -{size}]")).robot.gravity[2] == -size


def test_all_rows_can_be_kept(write: Write) -> None:
    assert read_case(write("preprocessing:", "  rate_hz: all")).preprocessing.rate_hz is None
    assert read_case(write("preprocessing:", "  rate_hz: null")).preprocessing.rows_hz(1e3) == 40  # as if left out


def test_a_stated_drive_is_kept_where_the_case_is_silent(write: Write, tmp_path: Path, coupled_arm: Robot) -> None:
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(coupled_arm)))
    drive = read_case(write("drives: {joint2: {gain: 3}}")).robot.joints[1].drive
    assert (drive.gear_ratio, drive.rotor_inertia, drive.gain) == (-120.0, 2e-5, 3.0)


FAULTS = [
    (("frictoin: [coulomb]",), "unknown key 'frictoin'", "did you mean 'friction'?"),
    (("friction: coulomb",), "line 3, friction: not a list", "write a list such as [coulomb, viscous, offset]"),
    (("friction: [coulom]",), "line 3, friction.1: no friction model called 'coulom'", "did you mean 'coulomb'?"),
    (("friction:", "  - coulomb: {widht: 1}"), "line 4, friction.1: widht = '1' is not possible", "'width'?"),
    (("friction:", "  - coulomb: {width: wide}"), "width = 'wide' is not possible", "write a value of the kind float"),
    (
        ("friction:", "  - offset: {vary: width}"),
        "line 4, friction.1: vary = 'width' is not possible",
        "can vary: nothing; leave it out",
    ),
    (
        ("friction:", "  - presliding", "  - presliding: {element: 2}"),
        "line 5, friction.2: length = 0.003 is not possible",
        "that of element 1 is 0.003, so that both have the same torque; give each a length of its own",
    ),
    (
        ("friction:", "  - presliding: {length: 0.0030001, element: 2}", "  - presliding: {choose: part}"),
        "line 5, friction.2: length = 0.003 is not possible",
        "that of element 2 is 0.0030001",
    ),
    (("friction:", "  - coulomb", "  - coulomb: {vary: speed}"), "friction.2: vary = 'speed'", "can vary: width"),
    (("friction:", "  - {coulomb: {}, viscous: {}}"), "neither a name nor one name with its options", "write name"),
    (("gravity: [0, 0, -981]",), "line 3, gravity: a gravity of 981 m/s^2", "write it in m/s^2, such as [0, 0, -9.81]"),
    (("preprocessing: {filter: {butterworth: {cutoff_hz: 5,2}}}",), "line 3: '2' is neither a key nor", "such as 5.2"),
    (("gravity: [0, 0]",), "line 3, gravity: 3 numbers are needed, not a list of 2", "write a list of 3 numbers"),
    (("gravity: [0, 0, down]",), "gravity.3: 'down' is not a number", "write one plain number"),
    (("locked: {joint9: 0}",), "locked: unknown key 'joint9'", "known keys: joint1, joint2, joint3"),
    (("locked: {joint1: 0, joint2: 0, joint3: 0}",), "locked: ", "leave at least one joint free"),
    (("joints: [joint1]", "locked: resting"), "locked: a mapping (key: value) is needed", "write 'key: value' lines"),
    (("locked: rest",), "locked: ", "leave at least one joint free"),
    (("locked: {joint1: here}",), "line 3, locked.joint1: 'here' is not a number", "write one plain number"),
    (("joints: [joint1, elbow]",), "joints: no joint called 'elbow'", "the robot has joint1, joint2, joint3"),
    (("joints: [joint1, joint1, joint2]",), "it is named twice", "docs/case-file.md"),
    (("coupling: [[1, 0], [0, 1]]",), "coupling: 3 rows are needed, not a list of 2", "write 3 lists of 3 numbers"),
    (("coupling: [[1, 1, 0], [1, 1, 0], [0, 0, 1]]",), "coupling: the coupling matrix is singular", "docs/case-file"),
    (("drives: {joint1: {gear_ratio: 0}}",), "drives.joint1: the gear ratio is 0", "docs/case-file.md"),
    (("drives: {joint1: {rotor_inertia: -1}}",), "drives.joint1: the rotor inertia is -1", "docs/case-file.md"),
    (("drives: {joint1: {gain: 0}}",), "drives.joint1: the gain is 0", "docs/case-file.md"),
    (("drives: {joint1: {gian: 1}}",), "drives.joint1: unknown key 'gian'", "did you mean 'gain'?"),
    (("drives: {joint1: {gain: '1,5'}}",), "drives.joint1.gain: '1,5' is not a number", "write a decimal point: 1.5"),
    (("log: {columns: {torqe: tau}}",), "log.columns: unknown key 'torqe'", "did you mean 'torque'?"),
    (("log: {columns: {q: [q1, q2]}}",), "2 names, elsewhere 3", "docs/case-file.md"),
    (("log: {columns: {q: angle}}",), "log.columns.q: one name 'angle' for 3 joints", "write a list, or a pattern"),
    (("log: {columns: {q: {a: b}}}",), "neither a text nor a list of texts", "write one, or a list [a, b]"),
    (("log: {units: {position: degrees}}",), "no unit of position called 'degrees'", "choose one of"),
    (("log: {units: {torque: A}}",), "no unit of torque called 'A'", "choose one of: SI, N m, mN m, N"),
    (
        ("log: {leave_out: [[1, 2]]}",),
        "log.leave_out: spells without the name of a log",
        "{run.csv: [[3, 4.5], [8, 9]]}",
    ),
    (("log: {leave_out: {a.csv: [[2, 1]]}}",), "log.leave_out: a.csv: [['2', '1']]", "starts and ends in s"),
    (("log: {leave_out: {a.csv: [1, 2]}}",), "log.leave_out: a.csv: ['1', '2']", "starts and ends in s"),
    (("log: {leave_out: {a.csv: [[1, end]]}}",), "log.leave_out: a.csv: [['1', 'end']]", "starts and ends in s"),
    (
        ("log: {leave_out: {b.csv: [[1, 2]]}}", "train: d/a.csv"),
        "no log of this case is called 'b.csv'",
        "it has a.csv",
    ),
    (("log: {decimal: ';'}",), "decimal: ';' is not known here", "choose one of: ., ,"),
    (("preprocessing: {filter: butterwort}",), "no filter called 'butterwort'", "did you mean 'butterworth'?"),
    (("preprocessing: {filter: {butterworth: {cutoff_hz: -4}}}",), "cutoff_hz = -4.0 is not possible", "above 0"),
    (("preprocessing: {rate_hz: -5}",), "rate_hz = -5.0 is not possible", "above 0"),
    (("preprocessing: {rate_hz: often}",), "rate_hz: 'often' is not a number", "write one plain number"),
    (("preprocessing: {trim_s: -1}",), "trim_s = -1.0 is not possible", "0 or more"),
    (("preprocessing: {rest: skip}",), "rest: 'skip' is not known here", "choose one of: mask, keep"),
    (("preprocessing: {cutoff_hz: 5}",), "preprocessing: unknown key 'cutoff_hz'", "known keys: filter"),
    (("estimator: [wls]",), "estimator: neither a name nor one name with its options", "write name"),
    (("split: half",), "split: split = 'half' is not possible", "write first:0.67"),
    (("train: {a: b}",), "train: neither a text nor a list of texts", "write one, or a list [a, b]"),
    (("train: []",), "train: neither a text nor a list of texts", "write one, or a list [a, b]"),
    (("case: 1",), "the key 'case' is there twice", "keep one of the two"),
    (("note: &x y",), "anchors (&name) and aliases (*name) are not read", "write the values out"),
    (("  note: y",), "not YAML", "indent with spaces"),
]


@pytest.mark.parametrize(("lines", "evidence", "step"), FAULTS, ids=lambda value: str(value)[:40])
def test_faults_name_file_place_and_step(lines: tuple[str, ...], evidence: str, step: str, write: Write) -> None:
    path = write(*lines)
    with pytest.raises(DescriptionError) as caught:
        read_case(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    assert evidence in message and step in message


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (("case: 1",), "robot: is missing; add it"),
        (("case: 99", "robot: arm.json"), f"this dynident reads versions up to {VERSIONS.current}; update dynident"),
        (
            ("case: one", "robot: arm.json"),
            f"case: case 'one' is no version; write {VERSIONS.current}, the current one",
        ),
        (("- case: 1",), "a mapping (key: value) is needed, not a list of 1; write 'key: value' lines"),
        (("# nothing",), "the file is empty; write a table, or give another file"),
    ],
)
def test_a_case_says_what_it_is(head: tuple[str, ...], message: str, write: Write) -> None:
    with pytest.raises(DescriptionError) as caught:
        read_case(write(head=head))
    assert str(caught.value).endswith(message)


def test_a_robot_that_is_not_there_is_named(write: Write) -> None:
    with pytest.raises(FileError, match=r"other\.urdf: no such file; give a file, or a built-in example robot: "):
        read_case(write(head=("case: 1", "robot: other.urdf")))


def test_a_case_that_cannot_be_read(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write()

    def refuse(self: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(FileError, match=r"case\.yaml: cannot be read \(permission denied\)"):
        read_case(path)


def test_a_robot_is_a_case_too(tmp_path: Path, spatial_3r: Robot) -> None:
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(spatial_3r)))
    case = read_case(tmp_path / "arm.json")
    assert case.path == "" and case.robot.joint_names == spatial_3r.joint_names
    assert case.columns == case_of_robot(str(tmp_path / "arm.json")).columns == ColumnMap(joints=spatial_3r.joint_names)
    assert case.friction == (Coulomb(), Viscous(), Offset())


def test_a_dh_table_is_a_robot_and_no_case(tmp_path: Path) -> None:
    row = "  - {alpha: 0, a: 0, d: 0.1}"
    (tmp_path / "table.yaml").write_text(f"name: two\nconvention: modified\njoints:\n{row}\n{row}\n")
    assert read_case(tmp_path / "table.yaml").robot.name == "two"


def test_robots_that_ship_are_cases_by_name() -> None:
    assert read_case("generic-7r").robot.dof == 7


def test_files_are_looked_for_beside_the_case_then_here_then_in_the_data_folder(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = read_case(write())
    here, data = tmp_path / "here", tmp_path / "data"
    here.mkdir()
    data.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setenv(DATA_VARIABLE, str(data))
    assert case.find("run.csv") == Path("run.csv")  # nowhere: the name as it stands, for the reader to refuse
    (data / "run.csv").touch()
    assert case.find("run.csv") == data / "run.csv"
    (here / "run.csv").touch()
    assert case.find("run.csv").resolve() == here / "run.csv"
    (tmp_path / "run.csv").touch()
    assert case.find("run.csv") == tmp_path / "run.csv"
    assert case.find(str(data / "run.csv")) == data / "run.csv"
    monkeypatch.delenv(DATA_VARIABLE)
    (here / "run.csv").unlink()
    (tmp_path / "run.csv").unlink()
    assert case.find("run.csv") == Path("run.csv")


def test_the_robot_is_found_in_the_data_folder(write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write()
    (tmp_path / "data").mkdir()
    (tmp_path / "arm.json").rename(tmp_path / "data" / "arm.json")
    with pytest.raises(FileError):
        read_case(path)
    named = ("case: 1", "robot: set/arm.json")
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    with pytest.raises(
        FileError, match=r"set/arm\.json: .*beside the case file or here; .*DYNIDENT_DATA, which is not"
    ):
        read_case(write(head=named))
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "data"))
    with pytest.raises(FileError, match=r"set/arm\.json: .* here or under .*data; check the path"):
        read_case(write(head=named))
    assert read_case(write()).robot.dof == 3


def write_csv(path: Path, names: list[str], scale: float = 1.0) -> np.ndarray:
    values = scale * np.random.default_rng(0).normal(size=(20, len(names)))
    rows = [",".join(["t", *names])]
    rows += [",".join([str(0.01 * i), *map(repr, row)]) for i, row in enumerate(values.tolist())]
    path.write_text("\n".join(rows) + "\n")
    return values


def test_a_log_is_read_as_the_case_says(write: Write, tmp_path: Path) -> None:
    case = read_case(write("joints: [joint3, joint1, joint2]", "locked: {joint2: 0.1}"))
    values = write_csv(tmp_path / "run.csv", ["q1", "q2", "q3", "tau1", "tau2", "tau3"])
    words = r"joint2 is locked at 0\.1 but up to .* away; lock it at its logged position"
    with pytest.raises(LogMismatch, match=words):
        case.read("run.csv")
    case = dataclasses.replace(case, locked={}, robot=dataclasses.replace(case.robot, held={}))
    log = case.read("run.csv")
    assert log.joints == ("joint1", "joint3")
    np.testing.assert_array_equal(log.q, values[:, [1, 0]])
    np.testing.assert_array_equal(log.torque, values[:, [4, 3]])


def test_currents_become_torques_with_the_gains_of_the_case(write: Write, tmp_path: Path) -> None:
    gains = "drives: {joint1: {gain: 10}, joint2: {gain: -5}, joint3: {gain: 2}}"
    values = write_csv(tmp_path / "run.csv", ["q1", "q2", "q3", "i1", "i2", "i3"])
    log = read_case(write(gains)).read("run.csv")
    np.testing.assert_allclose(np.asarray(log.torque), values[:, 3:] * [10, -5, 2])
    coupled = read_case(write(gains, "coupling: [[1, 0, 0], [0, 1, 0], [0, 0.5, 1]]")).read("run.csv")
    motors = values[:, 3:] * [10, -5, 2]
    np.testing.assert_allclose(np.asarray(coupled.torque), motors + np.outer(motors[:, 2], [0, 0.5, 0]))
    with pytest.raises(LogMismatch, match=r"currents but no drive gain for joint1, joint2, joint3; state 'gain'"):
        read_case(write()).read("run.csv")


def test_measured_torques_go_before_currents(write: Write, tmp_path: Path) -> None:
    case = read_case(write("log: {columns: {torque: 'm{}', current: 'i{}'}}", "drives: {joint1: {gain: 10}}"))
    values = write_csv(tmp_path / "run.csv", [f"{word}{k}" for word in ("q", "m", "i") for k in (1, 2, 3)])
    np.testing.assert_array_equal(case.read("run.csv").torque, values[:, 3:6])


def test_a_joint_that_the_log_lacks_is_named(tmp_path: Path, spatial_3r: Robot) -> None:
    write_csv(tmp_path / "run.csv", ["q1", "q2", "tau1", "tau2"])
    columns = ColumnMap(joints=("joint1", "joint2"))
    with pytest.raises(LogMismatch, match="no joint called 'joint3'; the log has joint1, joint2"):
        read_with(tmp_path / "run.csv", columns, spatial_3r)


@given(st.floats(0.01, 0.99))
def test_a_share_of_the_duration(first: float) -> None:
    assert Split.parse(f"first:{first!r}") == Split(first=first)


@pytest.mark.parametrize(
    "text",
    ["", "first", "first:", "first:0", "first:1", "first:two", "first:nan", "last:0.5", "rows:", "samples:",
     "samples:0:10", "samples:0:10,5", "samples:10:0,0:5", "samples:-1:5,5:9", "samples:0:10,10:20,20:30",
     "samples:a:b,c:d", "samples:0:1.5,2:3"],
)  # fmt: skip
def test_splits_that_are_none(text: str) -> None:
    with pytest.raises(BadOption) as caught:
        Split.parse(text)
    stated = f"split = {text!r} is not possible" if text else "split is empty"
    assert str(caught.value) == (
        f"{stated}; write first:0.67 (share of the duration) or samples:0:24750,29250:45000 (that train, that test)"
    )


def test_a_split_by_duration() -> None:
    train, test = Split.parse(" first:0.25 ").apply(log_of(101))
    assert (train.samples, test.samples) == (25, 76)
    assert train.source.steps == ("first 0.25 of the duration",) and train.source.split == "first:0.25"


@pytest.mark.parametrize("word", ["samples", "rows"])  # once it was rows
def test_a_split_by_samples(word: str) -> None:
    train, test = Split.parse(f"{word}:0:60,70:100").apply(log_of())
    assert (train.samples, test.samples, test.time[0]) == (60, 30, 7.0)
    assert train.source.split == "samples:0:60,70:100"
    assert test.source.steps == ("samples 70 to 100 of 100",) and test.source.split == ""
    with pytest.raises(
        LogMismatch, match="simulated log: 90 samples, the split ends at 100; state samples that the log has"
    ):
        Split.parse(f"{word}:0:60,70:100").apply(log_of(90))


@given(st.text(max_size=30))
def test_any_text_is_a_split_or_a_named_error(text: str) -> None:
    try:
        Split.parse(text)
    except DynidentError as error:
        assert "write first:0.67" in str(error)


def test_limits_of_the_case_take_the_place_of_the_description(tmp_path: Path) -> None:
    path = tmp_path / "case.yaml"
    path.write_text("case: 1\nrobot: er16\nlimits: {acceleration: 8, jerk: [1, 2, 3, 4, 5, 6], effort: 100}\n")
    plain, bounded = read_case("er16").robot, read_case(path).robot
    for k, (before, after) in enumerate(zip(plain.active, bounded.active, strict=True), start=1):
        expected = dataclasses.replace(before.limits, acceleration=8.0, jerk=float(k), effort=100.0)
        assert after.limits == expected and (after.name, after.kind, after.drive) == (
            before.name,
            before.kind,
            before.drive,
        )


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ("{accelleration: 8}", "acceleration"),
        ("{jerk: [1, 2]}", "6 numbers"),
        ("{velocity: -1}", "velocity limit is -1"),
        ("{lower: 9, upper: 1}", "above the upper limit"),
    ],
)
def test_limits_that_cannot_be(tmp_path: Path, limits: str, words: str) -> None:
    path = tmp_path / "case.yaml"
    path.write_text(f"case: 1\nrobot: er16\nlimits: {limits}\n")
    with pytest.raises(DescriptionError, match=words):
        read_case(path)


@pytest.mark.parametrize(
    ("speeds", "kept"),
    [
        ("[1, 2, 3, 4, 5]", {0: 1, 1: 2, 3: 3, 4: 4, 5: 5}),
        ("[1, 2, 9, 3, 4, 5]", {0: 1, 1: 2, 3: 3, 4: 4, 5: 5}),
        ("{NAME: 2}", {1: 2}),
    ],
)
def test_limits_of_joints_that_are_not_locked(tmp_path: Path, speeds: str, kept: dict[int, float]) -> None:
    robot = read_robot("er16")
    names, path = robot.joint_names, tmp_path / "case.yaml"
    head = f"case: 2\nrobot: er16\nlocked: {{{names[2]}: 0.3}}\nlimits: "
    path.write_text(f"{head}{{velocity: {speeds.replace('NAME', names[1])}}}\n")
    found = read_case(path).robot
    expected = {name: kept.get(k, robot.active[k].limits.velocity) for k, name in enumerate(names) if k != 2}
    assert {joint.name: joint.limits.velocity for joint in found.active} == expected


def test_limits_that_fit_neither_all_joints_nor_the_others(tmp_path: Path) -> None:
    names, path = read_robot("er16").joint_names, tmp_path / "case.yaml"
    for value, words in (
        ("[1, 2, 3, 4]", "a list of 4 for a robot of 6 joints, 5 of them not locked; write 5 or 6 numbers"),
        (f"{{{names[1]}x: 2}}", f"did you mean '{names[1]}'"),
    ):
        path.write_text(f"case: 2\nrobot: er16\nlocked: {{{names[2]}: 0.3}}\nlimits: {{velocity: {value}}}\n")
        with pytest.raises(DescriptionError, match=words):
            read_case(path)


def test_options_of_parts_may_be_products_with_pi(write: Write) -> None:
    lines = "friction: [coulomb, {balancer: {joints: [joint1], ratio: 2, dead_center: -pi/2}}]"
    part = read_case(write(lines)).friction[1]
    assert part.options["dead_center"] == pytest.approx(-np.pi / 2)
    with pytest.raises(DescriptionError, match="divides by zero"):
        read_case(write(lines.replace("pi/2", "pi/0")))


def test_motors_of_slides_turn(tmp_path: Path) -> None:
    """Units of turns fit the slide of a SCARA where the signal is the motor's, and are refused where it is not."""
    head = ["case: 2", "robot: generic-scara", "log:", "  units: {position: rad, torque: N m}"]
    path = tmp_path / "case.yaml"
    path.write_text("\n".join([*head, "  side: motor"]))
    assert set(read_case(path).columns.motor) >= {"q", "torque"}
    path.write_text("\n".join([*head, "  side: {q: motor}"]))
    with pytest.raises(DescriptionError, match="torque"):
        read_case(path)
    path.write_text("\n".join(head))
    with pytest.raises(DescriptionError, match="prismatic"):
        read_case(path)


@pytest.mark.parametrize(
    ("keys", "kp", "ratios"),
    [
        ("kp: [30, 60, 15]", 30.0, [1.0, 2.0, 0.5]),
        ("kp: 30, joints: {joint2: {kp: 60}}", 30.0, [1.0, 2.0, 1.0]),
        ("joints: {joint1: {kp: 30}, joint2: {kp: 60, error_gain: 0.2}, joint3: {kp: 30}}", 30.0, [1.0, 2.0, 1.0]),
        ("kp: 30", 30.0, [1.0, 1.0, 1.0]),
    ],
)
def test_servos_may_have_gains_of_their_own(write: Write, keys: str, kp: float, ratios: list[float]) -> None:
    columns = "log: {columns: {time: t, q: 'q{}', q_ref: 'c{}'}}"
    servo = read_case(write(columns, f"servo: {{law: feetech_sts3215, {keys}}}")).servo
    plain = read_case(write(columns, "servo: {law: feetech_sts3215, kp: 30}")).servo
    assert servo is not None and plain is not None and servo.columns.kp == kp
    gains = np.array([0.2 if "0.2" in keys and k == 1 else one.error_gain for k, one in enumerate(plain.laws)])
    assert [one.error_gain for one in servo.laws] == pytest.approx(gains * ratios)


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ("kp: [30, 60]", "3"),
        ("kp: [30, 0, 30]", "above 0"),
        ("kp: 30, joints: {joint2: {kp: -1}}", "above 0"),
        ("kp: 'kp{}', joints: {joint2: {kp: 60}}", "none that is a number"),
        ("joints: {joint2: {kp: 60}}", "none that is a number"),
        ("kp: [30, 60, 30], joints: {joint2: {kp: 60}}", "beside a list"),
    ],
)
def test_gains_of_servos_that_cannot_be_are_refused(write: Write, keys: str, told: str) -> None:
    columns = "log: {columns: {time: t, q: 'q{}', q_ref: 'c{}'}}"
    with pytest.raises(DynidentError, match=told):
        read_case(write(columns, f"servo: {{law: feetech_sts3215, {keys}}}"))
