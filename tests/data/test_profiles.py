"""Profiles: what the columns of makers' logs are, what is refused, and what the user states in their place."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.case.log_section import profile_columns
from dynident.data.formats import ColumnMap, read_log
from dynident.data.formats._column_map import NUMBERED, QUANTITY
from dynident.data.formats._units import UNITS
from dynident.data.profiles import PROFILES, Channel, pattern_names, unmeasured
from dynident.errors import BadOption, DescriptionError, LogFormatError, UnknownChoice

ROWS = 20
JOINTS = tuple(f"j{k}" for k in range(1, 7))
SEVEN = tuple(f"panda_joint{k}" for k in range(1, 8))


def write(path: Path, header: list[str], separator: str, seed: int = 0, time: float = 0.002) -> dict[str, np.ndarray]:
    """Write a log under a header whose first name is the time, and return its columns."""
    values = np.random.default_rng(seed).normal(size=(ROWS, len(header)))
    values[:, 0] = np.arange(ROWS) * time
    lines = [separator.join(header), *(separator.join(map(repr, row)) for row in values.tolist())]
    path.write_text("\n".join(lines) + "\n")
    return dict(zip(header, values.T, strict=True))


def stacked(columns: dict[str, np.ndarray], word: str, joints: int) -> np.ndarray:
    return np.column_stack([columns[word.replace("#", str(k))] for k in range(joints)])


def test_a_log_of_the_rtde_client(tmp_path: Path) -> None:
    """The header is that of record_configuration.xml of the RTDE client, as its csv_writer spells it."""
    six = ["target_q", "target_qd", "target_qdd", "target_current", "target_moment", "actual_q", "actual_qd"]
    six += ["actual_current", "joint_control_output"]
    header = ["timestamp", *(f"{name}_{k}" for name in six for k in range(6)), "speed_scaling"]
    path = tmp_path / "robot_data.csv"
    true = write(path, header, " ")
    log = read_log(path, profile_columns("ur_rtde", JOINTS))
    assert log.joints == JOINTS and log.torque is None and log.temperature is None and log.ddq is None
    for found, word in (
        (log.q, "actual_q_#"),
        (log.dq, "actual_qd_#"),
        (log.current, "actual_current_#"),
        (log.q_ref, "target_q_#"),
        (log.dq_ref, "target_qd_#"),
    ):
        np.testing.assert_array_equal(found, stacked(true, word, 6))


def test_a_log_of_libfranka(tmp_path: Path) -> None:
    """The header is that of logToCSV of libfranka, its time in milliseconds."""
    names = ["state.q", "state.q_d", "state.dq", "state.dq_d", "state.tau_J", "state.tau_ext_hat_filtered"]
    names += ["cmd.q_d", "cmd.dq_d"]
    header = ["time", "success_rate", *(f"{name}[{k}]" for name in names for k in range(7))]
    header += [f"{name}[{k}]" for name, many in (("cmd.O_T_EE_d", 16), ("cmd.O_dP_EE_d", 6)) for k in range(many)]
    header += [f"cmd.tau_J_d[{k}]" for k in range(7)]
    path = tmp_path / "log.csv"
    true = write(path, header, ", ", time=1.0)
    log = read_log(path, profile_columns("franka", SEVEN))
    np.testing.assert_array_equal(log.torque, stacked(true, "state.tau_J[#]", 7))  # type: ignore[arg-type]
    np.testing.assert_array_equal(log.q, stacked(true, "state.q[#]", 7))
    np.testing.assert_allclose(log.time, np.arange(ROWS) / 1e3)
    assert log.source.steps[-1] == "time from ms"


@pytest.mark.parametrize("name", PROFILES.names())
def test_every_profile_is_sound(name: str) -> None:
    """Signals, units and patterns exist; its columns are found again; what is not measured is not read as measured."""
    profile = PROFILES.make(name)
    assert profile.time_unit in UNITS["time"] and profile.source and PROFILES.summary(name)
    for channel in profile.channels:
        assert channel.signal in NUMBERED and (not channel.unit or channel.unit in UNITS[QUANTITY[channel.signal]])
        columns = channel.names(JOINTS)
        assert len(set(columns)) == len(JOINTS) and all(map(channel.matches, columns))
        assert channel.kind == "measured" or not channel.read or channel.signal in ("q_ref", "dq_ref")
        if channel.kind != "measured" and channel.signal not in ("q_ref", "dq_ref"):
            assert all(unmeasured(column) for column in columns)
    assert "q" in profile.read_channels()


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        (
            "target_moment_{0}",
            "it is computed by a model, not measured (ur_rtde: the controller's own dynamic model computes it)",
        ),
        ("target_current_{0}", "in ur_rtde it is a current"),
        ("cmd.tau_J_d[{0}]", "it is commanded, not measured (franka: commanded, without gravity)"),
        ("tau_J_d_{0}", "it is commanded, not measured (franka: commanded, without gravity)"),
        ("tau_des{}", "it is commanded, not measured (common use: 'tau_des' is the usual name of a commanded torque)"),
        ("actual_current_{0}", "in ur_rtde it is a current; map another column, or say force: [torque]"),
    ],
)
def test_what_is_no_measured_torque_is_refused_as_one(columns: str, reason: str) -> None:
    names = pattern_names(columns, JOINTS)
    with pytest.raises(BadOption, match=re.escape(reason)) as caught:
        profile_columns("ur_rtde", JOINTS, stated={"torque": names, "current": ()})
    assert "force: [torque]" in str(caught.value)
    assert (
        profile_columns("ur_rtde", JOINTS, stated={"torque": names, "current": (), "force": ("torque",)}).torque
        == names
    )


def test_the_refusal_holds_without_a_profile_and_only_for_measurements() -> None:
    with pytest.raises(BadOption, match="'target_moment_0' is not possible; it is computed by a model, not measured"):
        ColumnMap(torque=pattern_names("target_moment_{0}", JOINTS))
    with pytest.raises(BadOption, match="'target_q_0' is not possible; it is commanded"):
        ColumnMap(q=pattern_names("target_q_{0}", JOINTS))
    assert ColumnMap(q_ref=pattern_names("target_q_{0}", JOINTS)).q_ref
    assert ColumnMap(torque=("tau1", "tau2"), force=()).torque
    with pytest.raises(BadOption, match="the signals are q, dq"):
        ColumnMap(force=("effort",))


def test_what_the_user_states_stands_in_place_of_the_profile(tmp_path: Path) -> None:
    header = ["timestamp", *(f"{w}_{k}" for w in ("actual_q", "actual_current_as_torque") for k in range(6))]
    true = write(tmp_path / "a.csv", header, " ")
    columns = profile_columns(
        "ur_rtde",
        JOINTS,
        {"position": "deg"},
        {"torque": pattern_names("actual_current_as_torque_{0}", JOINTS), "current": ()},
    )
    log = read_log(tmp_path / "a.csv", columns)
    np.testing.assert_array_equal(log.torque, stacked(true, "actual_current_as_torque_#", 6))  # type: ignore[arg-type]
    np.testing.assert_allclose(log.q, np.deg2rad(stacked(true, "actual_q_#", 6)))
    with pytest.raises(LogFormatError, match="no column 'actual_current_0'"):
        read_log(tmp_path / "a.csv", profile_columns("ur_rtde", JOINTS))


def test_half_of_an_optional_signal_is_a_fault(tmp_path: Path) -> None:
    header = ["timestamp", *(f"{w}_{k}" for w in ("actual_q", "actual_current") for k in range(6)), "actual_qd_0"]
    write(tmp_path / "a.csv", header, " ")
    with pytest.raises(LogFormatError, match="no column 'actual_qd_1'"):
        read_log(tmp_path / "a.csv", profile_columns("ur_rtde", JOINTS))


def test_units_that_only_the_user_knows_must_be_stated() -> None:
    with pytest.raises(BadOption, match=r"state it \(units: \{position: ...\}\): lerobot does not state it"):
        profile_columns("lerobot", JOINTS)
    found = profile_columns("lerobot", JOINTS, {"position": "deg"})
    assert found.q == tuple(f"observation.state{k}" for k in range(1, 7)) and found.torque == ()
    with pytest.raises(UnknownChoice, match="did you mean 'ur_rtde'"):
        profile_columns("ur_rdte", JOINTS)


def test_patterns_of_columns() -> None:
    assert pattern_names("a{}b{0}", ("x", "y")) == ("a1b0", "a2b1")
    assert pattern_names("{joint}.position", ("{0}", "b")) == ("{0}.position", "b.position")
    with pytest.raises(BadOption, match="write a list, or a pattern"):
        pattern_names("q", ("x",))
    assert Channel("q[{0}]", "q").matches("q[10]") and not Channel("q[{0}]", "q").matches("q0")
    with pytest.raises(ValueError, match="no channel"):
        Channel("q", "q")


# --- shares of rated torque ------------------------------------------------------------------------------------------


def test_shares_of_the_rated_torque_need_it(tmp_path: Path) -> None:
    true = write(tmp_path / "a.csv", ["t", "q1", "q2", "tau1", "tau2"], ",")
    columns = {"q": ("q1", "q2"), "torque": ("tau1", "tau2")}
    with pytest.raises(BadOption, match="state the rated torque of each joint"):
        case(tmp_path, columns, ("percent", "SI"))
    log = read_log(tmp_path / "a.csv", case(tmp_path, columns, ("percent", "permille"), rated=(80.0, 50.0)))
    np.testing.assert_allclose(log.torque, np.column_stack([true["tau1"], true["tau2"]]) * [0.8, 0.05])  # type: ignore[arg-type]
    mixed = read_log(tmp_path / "a.csv", case(tmp_path, columns, ("N m", "percent"), rated=(80.0, 50.0)))
    np.testing.assert_allclose(mixed.torque[:, 0], true["tau1"])  # type: ignore[index]
    np.testing.assert_allclose(mixed.torque[:, 1], true["tau2"] / 2)  # type: ignore[index]
    with pytest.raises(BadOption, match="one number for each of the 2 joints"):
        case(tmp_path, columns, ("percent", "SI"), rated=(80.0,))


def case(
    folder: Path, columns: dict[str, tuple[str, ...]], torque: tuple[str, ...], **more: tuple[float, ...]
) -> ColumnMap:
    from dynident.data.formats import Units

    return ColumnMap(**columns, units=Units(torque=torque), **more)  # type: ignore[arg-type]


# --- case file -------------------------------------------------------------------------------------------------------

URDF = """<robot name="two"><link name="base"/>
<link name="a"><inertial><origin xyz="0 0 0.1"/><mass value="2"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0"
 izz="0.02"/></inertial></link>
<link name="b"><inertial><origin xyz="0 0 0.1"/><mass value="1"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0"
 izz="0.02"/></inertial></link>
<joint name="one" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="3" effort="200"/></joint>
<joint name="two" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="3" effort="200"/></joint></robot>
"""


def read(folder: Path, log: str, before: str = "") -> ColumnMap:
    (folder / "robot.urdf").write_text(URDF)
    (folder / "case.yaml").write_text(f"case: 1\nrobot: robot.urdf\n{before}log: {log}\n")
    return read_case(folder / "case.yaml").columns


def test_a_case_file_with_a_profile(tmp_path: Path) -> None:
    found = read(tmp_path, "{profile: ur_rtde, columns: {temperature: none}, units: {current: mA}}")
    assert found.q == ("actual_q_0", "actual_q_1") and found.time == "timestamp" and found.temperature == ()
    assert found.units.current == "mA" and "dq" in found.optional and found.motor == ()
    by_name = read(tmp_path, "{profile: joint_states, format: {rosbag: {topics: [/a, /b], stamps: receive}}}")
    assert by_name.torque == ("one.effort", "two.effort")
    assert by_name.form == "rosbag" and dict(by_name.form_options) == {"topics": "/a,/b", "stamps": "receive"}


@pytest.mark.parametrize(
    ("log", "message"),
    [
        ("{profile: ur_rtde, columns: {torque: 'target_moment_{0}'}}", "it is computed by a model, not measured"),
        ("{columns: {torque: 'tau_des{}'}}", "it is commanded, not measured"),
        ("{profile: kuka}", "no log profile called 'kuka'"),
        ("{format: {rosbag: {topic: [/a]}}}", "the log format 'rosbag' has the options: topics"),
        ("{format: xlsx}", "no log format called 'xlsx'"),
        ("{units: {torque: percent}}", "state the rated torque of each joint"),
        ("{side: both}", "choose one of: link, motor"),
        ("{side: {current: motor}}", "known keys: q, dq"),
        ("{zero: [1]}", "2 numbers are needed"),
        ("{force: [effort]}", "the signals are q, dq"),
    ],
)
def test_faults_in_the_log_section_name_their_place(tmp_path: Path, log: str, message: str) -> None:
    with pytest.raises(DescriptionError, match=re.escape(message)) as caught:
        read(tmp_path, log)
    assert "case.yaml" in str(caught.value) and "log" in caught.value.where


def test_forcing_is_remembered(tmp_path: Path) -> None:
    found = read(tmp_path, "{columns: {torque: 'tau_des{}'}, force: torque}")
    assert found.torque == ("tau_des1", "tau_des2") and found.force == ("torque",)
