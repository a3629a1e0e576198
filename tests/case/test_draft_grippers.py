"""Drafts of logs in which a gripper is logged beside the arm: it stands, or jumps between a few positions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drafted_logs import moved, named, numbered, read, write_log
from dynident.arrays import Array
from dynident.case.case_draft import draft_case
from dynident.case.evidence.positions import steps
from dynident.errors import NoNumbers
from dynident.robot_files import read_robot
from two_joint_arm import URDF

GRIPPER = """  <link name="finger"><inertial><origin xyz="0 0 0.02"/><mass value="0.1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="gripper" type="prismatic"><parent link="fore"/><child link="finger"/><origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.2" velocity="0.2" effort="20"/></joint>
</robot>
"""

NAMES = ("shoulder", "elbow", "gripper")

PATTERNS = {"names": "{}_position", "joint_states": "{}.position"}


@pytest.fixture
def arm(tmp_path: Path) -> str:
    path = tmp_path / "arm.urdf"
    path.write_text(URDF.replace("</robot>\n", GRIPPER))
    return str(path)


@pytest.fixture
def motion(arm: str) -> dict[str, Array]:
    return moved(read_robot(arm).locked({"gripper": 0.0}), samples=3000, rate=500.0)


def with_gripper(motion: dict[str, Array], q: Array) -> dict[str, Array]:
    """Return the motion of the arm with a gripper that pushes with 3 N."""
    efforts = np.column_stack([motion["torque"], np.full(len(q), 3.0)])
    return {"time": motion["time"], "q": np.column_stack([motion["q"], q]), "torque": efforts}


def logged(motion: dict[str, Array], kind: str) -> dict[str, Array]:
    """Return columns by the names of the joints, as a logger of one's own or as ROS has them."""
    efforts = [PATTERNS[kind].format(name).replace("position", "effort") for name in NAMES]
    return named(motion, "time", {"q": [PATTERNS[kind].format(name) for name in NAMES], "torque": efforts})


def cutoff_of(case: object) -> float:
    """Return the cut-off of a case in Hz."""
    return float(str(case.preprocessing.filter.statement()["cutoff_hz"]))  # type: ignore[attr-defined]


@pytest.mark.parametrize("kind", PATTERNS)
@pytest.mark.parametrize("at", [0.0, 0.02])
def test_a_gripper_that_stands_is_locked_and_not_asked_for_its_unit(
    arm: str, motion: dict[str, Array], tmp_path: Path, at: float, kind: str
) -> None:
    columns = logged(with_gripper(motion, np.full(3000, at)), kind)
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    case = read(draft, tmp_path)
    assert draft.needed == () and case.locked == {"gripper": at} and case.robot.joint_names == NAMES[:2]
    assert "gripper never moves" in draft.text and case.read(case.train[0]).joints == NAMES[:2]


def test_what_stands_under_the_noise_of_its_encoder_does_not_jump(
    arm: str, motion: dict[str, Array], tmp_path: Path
) -> None:
    still = 0.02 + 1e-4 * np.random.default_rng(1).integers(0, 3, 3000)
    draft = draft_case(arm, write_log(tmp_path / "run.csv", logged(with_gripper(motion, still), "names")), tmp_path)
    assert not draft.recognition.grippers and "gripper never moves" in draft.text


def test_where_the_arm_is_in_degrees_the_unit_of_what_stands_is_asked(
    arm: str, motion: dict[str, Array], tmp_path: Path
) -> None:
    turned = with_gripper({**motion, "q": np.rad2deg(motion["q"])}, np.full(3000, 0.02))
    draft = draft_case(arm, write_log(tmp_path / "run.csv", logged(turned, "names")), tmp_path)
    assert "likely [deg, deg, m]" in draft.text and not draft.recognition.still


@pytest.mark.parametrize("kind", [*PATTERNS, "numbers"])
def test_a_gripper_that_jumps_is_locked_and_sets_no_cut_off(
    arm: str, motion: dict[str, Array], tmp_path: Path, kind: str
) -> None:
    """Also where it opens wider than a locked joint may stray: its columns are not read."""
    jumps = with_gripper(motion, np.where(motion["time"] % 2.0 < 1.0, 0.0, 0.16))
    columns = numbered(jumps) if kind == "numbers" else logged(jumps, kind)
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    case = read(draft, tmp_path)
    alone = draft_case(arm, write_log(tmp_path / "still.csv", logged(with_gripper(motion, np.zeros(3000)), "names")))
    assert draft.needed == () and case.locked == {"gripper": 0.08}
    assert draft.recognition.band_hz == alone.recognition.band_hz < 1.5 and cutoff_of(case) < 15
    assert "# CHECK: gripper jumps between 2 positions" in draft.text and case.preprocessing.rate_hz == 200
    np.testing.assert_allclose(case.read(case.train[0]).q, motion["q"])


@pytest.mark.parametrize(("mass", "effort", "is_read"), [(0.005, 0.0, False), (0.5, 0.0, True), (0.005, None, True)])
def test_fingers_without_a_measured_torque_are_locked(
    motion: dict[str, Array], tmp_path: Path, mass: float, effort: float | None, is_read: bool
) -> None:
    """Drivers write one effort for fingers; the draft had read them, and `identify` refused the log.

    A slide of 0.5 kg moves the centre of mass of the fore arm too far; a finger whose effort is measured is read.
    """
    arm = tmp_path / "arm.urdf"
    arm.write_text(URDF.replace("</robot>\n", GRIPPER.replace('mass value="0.1"', f'mass value="{mass}"')))
    opens = with_gripper(motion, 0.05 + 0.05 * np.sin(2 * np.pi * 0.4 * motion["time"]))
    opens["torque"][:, 2] = np.random.default_rng(2).normal(0, 0.2, 3000) if effort is None else effort
    draft = draft_case(str(arm), write_log(tmp_path / "run.csv", logged(opens, "names")), tmp_path)
    case = read(draft, tmp_path)
    assert ("gripper" in case.robot.joint_names) == is_read and ("gripper" in draft.recognition.grippers) != is_read
    if not is_read:
        assert case.locked["gripper"] == pytest.approx(0.05, abs=1e-3) and "hardly moves a mass" in draft.text


def test_the_rate_of_a_draft_is_at_most_that_of_the_log(arm: str, motion: dict[str, Array], tmp_path: Path) -> None:
    quick = 0.05 + 0.04 * np.sin(2 * np.pi * 30 * motion["time"])  # a motion, and not of a few values
    driven = with_gripper(motion, quick)
    driven["torque"][:, 2] += quick
    draft = draft_case(arm, write_log(tmp_path / "run.csv", logged(driven, "names")), tmp_path)
    assert draft.recognition.grippers == {} and draft.recognition.joints.names == NAMES
    assert read(draft, tmp_path).preprocessing.rate_hz == pytest.approx(500.0)


def test_what_steps_and_what_is_coarse() -> None:
    time = np.arange(4000) / 100.0
    smooth = 0.05 * np.sin(0.7 * time)
    assert not steps(smooth) and not steps(np.round(smooth / 2e-3) * 2e-3)  # 50 values, one after another
    assert steps(np.where(time % 8 < 4, 0.0, 0.05)) and not steps(np.zeros(4000))
    assert not steps(np.where(np.arange(4000) == 700, 3.0, smooth))  # a wrong sample


@pytest.mark.parametrize("units", [("deg", "deg", "mm"), ("rad", "rad", "m")])
def test_units_of_each_axis_in_the_names_are_read(
    tmp_path: Path, arm: str, motion: dict[str, Array], units: tuple[str, ...]
) -> None:
    wide = with_gripper(motion, 0.1 + 0.05 * np.sin(motion["time"]))
    factors = [{"deg": 180 / np.pi, "mm": 1000.0}.get(unit, 1.0) for unit in units]
    names = [f"{name}.ActPos [{unit}]" for name, unit in zip(NAMES, units, strict=True)]
    efforts = [f"{name}.ActTorque [{unit}]" for name, unit in zip(NAMES, ("N m", "N m", "N"), strict=True)]
    columns = named({**wide, "q": wide["q"] * factors}, "Time", {"q": names, "torque": efforts})
    draft = draft_case(arm, write_log(tmp_path / "log.csv", columns, ";"), tmp_path)
    assert draft.recognition.joints.names == NAMES and draft.recognition.joints.certain
    assert not any("no positions" in remark for remark in draft.remarks)
    columns_of = read(draft, tmp_path, {"unit of": "[N m, N m, N]"}).columns
    assert (columns_of.q, columns_of.torque) == (tuple(names), tuple(efforts))
    assert columns_of.units.position == units


@pytest.mark.parametrize("signal", ["current", "effort", "tau_est"])
def test_a_gripper_without_torques_or_currents_of_its_own_is_locked(
    arm: str, motion: dict[str, Array], tmp_path: Path, signal: str
) -> None:
    """The currents of all other joints were not seen: nothing could be identified."""
    columns = logged(with_gripper(motion, 0.02 + 0.001 * np.sin(motion["time"])), "names")
    efforts = {f"{name}_{signal}": columns[f"{name}_effort"] for name in NAMES[:2]}
    columns = {name: values for name, values in columns.items() if "effort" not in name} | efforts
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    case = read(draft, tmp_path) if signal != "current" else None
    told = "gripper has positions and neither torques nor currents: locked in the middle of the positions"
    assert any(remark.startswith(told) for remark in draft.remarks)
    assert any("drives estimate" in remark for remark in draft.remarks) == (signal == "tau_est")
    assert "joints: [shoulder, elbow]" in draft.text and "locked: {gripper: 0.02" in draft.text
    if case is not None:
        log = case.read(case.train[0])
        np.testing.assert_allclose(np.asarray(log.torque), motion["torque"])
        assert log.joints == NAMES[:2]


@pytest.mark.parametrize(("others", "chosen"), [("effort", "effort"), ("tau_ext_est", ""), ("tau_est", "tau_est")])
def test_estimated_torques_are_read_where_no_measured_ones_are(
    arm: str, motion: dict[str, Array], tmp_path: Path, others: str, chosen: str
) -> None:
    """What a drive takes for its torque, not what a controller takes for that of a contact."""
    columns = logged(with_gripper(motion, 0.02 + 0.01 * np.sin(motion["time"])), "names")
    efforts = {name: values for name, values in columns.items() if "effort" in name}
    columns = {name: values for name, values in columns.items() if "effort" not in name}
    for word in dict.fromkeys((others, "tau_est")) if others != "tau_ext_est" else (others,):
        columns |= {name.replace("effort", word): values for name, values in efforts.items()}
    text = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path).text
    assert (f"torque: '{{joint}}_{chosen}'" in text) == bool(chosen)
    assert ("what the drives estimate" in text) == (chosen == "tau_est")
    assert ("torque: ask" in text) == (not chosen)


@pytest.mark.parametrize("kind", PATTERNS)
def test_columns_of_nan_are_no_signal(arm: str, motion: dict[str, Array], tmp_path: Path, kind: str) -> None:
    """ROS 2 writes nan for a signal that a joint lacks: a gripper that moves without a torque is locked."""
    opens = with_gripper(motion, 0.05 + 0.03 * np.sin(motion["time"]))
    opens["torque"][5:, 2] = np.nan
    columns = logged(opens, kind)
    draft = draft_case(arm, write_log(tmp_path / "run.csv", columns), tmp_path)
    case = read(draft, tmp_path)
    name = PATTERNS[kind].format("gripper").replace("position", "effort")
    assert draft.needed == () and f"CHECK: {name}: no numbers in these columns" in draft.text
    assert case.robot.joint_names == NAMES[:2] and case.locked["gripper"] == pytest.approx(0.05, abs=0.01)
    np.testing.assert_allclose(case.read(case.train[0]).torque, motion["torque"])
    later = with_gripper(motion, 0.05 + 0.03 * np.sin(motion["time"]))
    later["torque"][:, 0] = np.nan
    later_log = write_log(tmp_path / "later.csv", logged(later, kind))
    with pytest.raises(NoNumbers, match=r"later.csv:1: shoulder.effort: not finite in 3000 of 3000 rows"):
        draft_case(arm, [str(tmp_path / "run.csv"), later_log], tmp_path)
