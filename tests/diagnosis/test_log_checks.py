"""Log checks on clean logs, on logs with injected faults, and the repairs that it calls safe."""

from __future__ import annotations

import json
import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.signal
import scipy.stats

sys.path.append(str(Path(__file__).parents[2]))  # the benchmark puts the same faults into full-size arms

from benchmarks.faults import injections as put
from benchmarks.faults.figures import CleanLog, grade
from benchmarks.faults.kinds import KINDS, Kind
from benchmarks.faults.matrix import joint_of, naming
from benchmarks.faults.trials import Trial, subject_of, virtual

from dynident.api.identify import Record, identify
from dynident.case.case import Case, read_case
from dynident.case.evidence.positions import rounding_share, steps_of
from dynident.case.evidence.rows import out_of_order, sortable
from dynident.case.part_sections import PartChoice
from dynident.data.formats import ColumnMap, read_log
from dynident.data.log import smallest_step
from dynident.data.preprocessing import default_preprocessing
from dynident.diagnosis.causes.against_bodies import AgainstBodies
from dynident.diagnosis.causes.cause_search import Blame, Cause
from dynident.diagnosis.causes.column_readings import PositionReadings
from dynident.diagnosis.causes.held_out import halves
from dynident.diagnosis.causes.known_bodies import NominalBodies
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.robot_misfit import LEFT, robot_misfit
from dynident.diagnosis.causes.saturated_rows import at_limit, flat_rows
from dynident.diagnosis.causes.thin_fit import quick_fit
from dynident.diagnosis.causes.trends import Trends
from dynident.diagnosis.checks import CHECKS, readings
from dynident.diagnosis.checks.cells import held_at
from dynident.diagnosis.checks.time_order import SEVERAL
from dynident.diagnosis.examination import examine, examine_recordings
from dynident.diagnosis.finding import SEVERITIES, Finding
from dynident.diagnosis.recording import read_recording
from dynident.diagnosis.repair import repair, wraps
from dynident.diagnosis.repaired_file import write_repaired
from dynident.errors import LogFormatError, LogMismatch
from dynident.model.friction import FRICTION, default_friction
from dynident.model.friction.warm_up import WarmUp
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, JointLimits
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

#: Half the samples a second of the benchmark.
RATE = 100.0

#: Strengths of the kinds whose smallest one the benchmark looks for.
STRENGTHS = {
    "clock too fast [share]": 0.02,
    "jitter [samples]": 1.0,
    "gap in time [s]": 0.4,
    "two publishers [share]": 0.02,
    "one spike [range]": 1.0,
    "five spikes [range]": 1.0,
    "saturation [share]": 0.05,
    "coarse torque [range]": 0.05,
    "coarse position [range]": 0.01,
    "delay of torque [samples]": 1.0,
    "spring [of torque]": 0.2,
    "counterbalance [of torque]": 0.2,
    "drift [of torque]": 0.2,
    "friction warms up [of torque]": 0.05,
    "torque scale of a joint [share]": 0.1,
    "torque scale of all [share]": 0.05,
    "payload [kg]": 0.5,
    "tilt of the base [deg]": 3.0,
}


@pytest.fixture(scope="module")
def trial(case: Case) -> Trial:
    return virtual(case, rate=RATE)


@pytest.fixture(scope="module")
def clean(trial: Trial, tmp_path_factory: pytest.TempPathFactory) -> CleanLog:
    folder = tmp_path_factory.mktemp("clean")
    return CleanLog(trial, subject_of(trial, folder), trial.examined(folder).findings)


def write(trial: Trial, path: Path) -> None:
    """Write the columns as text, whose lines findings name."""
    columns = trial.columns
    names = ["t", *(f"{name}{k + 1}" for name in columns if name != "t" for k in range(columns[name].shape[1]))]
    values = np.column_stack([columns["t"], *(columns[name] for name in columns if name != "t")])
    np.savetxt(path, values, "%.9g", ",", header=",".join(names), comments="")


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_clean_log_has_neither_errors_nor_warnings(case: Case, seed: int, tmp_path: Path) -> None:
    found = virtual(case, seed, RATE).examined(tmp_path)
    assert found.sound and not found.left_out
    assert not [finding for finding in found.findings if finding.severity != "note"]
    assert found.repaired is not None and found.repaired.repairs == ()


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_fault_is_named_with_direction_and_figure(kind: Kind, trial: Trial, clean: CleanLog, tmp_path: Path) -> None:
    strength = STRENGTHS[kind.name] if kind.between else kind.fixed[len(kind.fixed) // 2]
    faulty = kind.inject(trial, strength, np.random.default_rng(1))
    found = faulty.examined(tmp_path).findings
    right = naming(kind, joint_of(kind, trial, strength), found, clean.findings)
    assert right, [finding.line() for finding in found]
    wanted = None if kind.states is None else kind.states(trial, strength)
    assert "exact" in {grade(one, wanted, faulty, clean) for one in right}, (wanted, [one.line() for one in right])


@pytest.mark.parametrize(("clock", "told"), [(2.5, True), (0.5, True), (1.0, False)])
def test_a_clock_that_is_far_off_shows_as_the_size_of_gravity(
    clock: float, told: bool, trial: Trial, tmp_path: Path
) -> None:
    off = trial.without("dq").with_columns(t=clock * trial.columns["t"])
    off = replace(off, case=replace(trial.case, columns=replace(trial.case.columns, dq=())))
    found = [one for one in off.examined(tmp_path).findings if one.severity == "error"]
    assert [one.name for one in found] == ["size of gravity"] * told
    assert all(one.numbers["clock"] == pytest.approx(clock, rel=0.05) for one in found)


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_the_joint_whose_torque_is_turned_is_named(trial: Trial, joint: int, tmp_path: Path) -> None:
    (finding,) = put.turned(trial, ("tau",), joint).examined(tmp_path).findings
    assert (finding.name, finding.joint) == ("torque sign", trial.case.robot.joint_names[joint])


@pytest.mark.parametrize(
    ("names", "finding"), [(("tau",), "torque order"), (("q", "dq", "tau"), "joint order")], ids=["torques", "joints"]
)
@pytest.mark.parametrize("order", [(2, 0, 1), (2, 1, 0)])
def test_columns_in_another_order_are_named_with_the_right_one(
    trial: Trial, names: tuple[str, ...], finding: str, order: tuple[int, ...], tmp_path: Path
) -> None:
    columns = {name: trial.columns[name][:, list(order)] for name in names if name in trial.columns}
    found = trial.with_columns(**columns).examined(tmp_path).findings[0]
    joints = trial.case.robot.joint_names
    assert found.name == finding
    moved = [i for i in range(3) if order[i] != i]
    assert found.joint == ", ".join(joints[i] for i in moved)
    if finding == "joint order":
        assert f"write joints: [{', '.join(joints[k] for k in order)}], or name the columns" in found.remedy
    if len(moved) == 3:
        assert f"read as those of {', '.join(joints[k] for k in order)}" in found.evidence


@pytest.mark.parametrize(("moved", "words"), [("i", "with their currents exchanged"), ("both", "currents and gains")])
def test_currents_of_unlike_gains_in_another_order_are_named(
    trial: Trial, moved: str, words: str, tmp_path: Path
) -> None:
    """The torques are then in no order: each current is multiplied by the gain of the other joint."""
    names, gains, order = trial.case.robot.joint_names, np.array([9.0, 2.5, 0.8]), [0, 2, 1]
    given = gains[order] if moved == "both" else gains
    drives = {name: Drive(gain=float(gain)) for name, gain in zip(names, given, strict=True)}
    columns = {key: values for key, values in trial.columns.items() if key != "tau"}
    right = Trial(
        replace(trial.case, robot=trial.case.robot.with_drives(drives)),
        {**columns, "i": (trial.columns["tau"] / gains)[:, order]},
    )
    found = right.examined(tmp_path).findings[0]
    assert (found.severity, found.name, found.joint) == ("error", "torque order", ", ".join(names[1:]))
    assert words in found.evidence and "log: columns: current" in found.remedy
    mended = right.with_columns(i=right.columns["i"][:, order])
    if moved == "i":
        assert "torque order" not in [one.name for one in mended.examined(tmp_path).findings]


@pytest.mark.parametrize("stated", [1.0, 0.0])
def test_gains_that_are_all_stated_as_one_are_told_as_such(stated: float, trial: Trial, tmp_path: Path) -> None:
    """The ratio of two of them was told, with a false link frame beside it; stated rightly nothing is said."""
    names, gains = trial.case.robot.joint_names, np.array([9.0, 4.0, 6.0])
    drives = {name: Drive(gain=stated or float(gain)) for name, gain in zip(names, gains, strict=True)}
    columns = {key: values for key, values in trial.columns.items() if key != "tau"} | {
        "i": trial.columns["tau"] / gains
    }
    found = Trial(replace(trial.case, robot=trial.case.robot.with_drives(drives)), columns).examined(tmp_path).findings
    grave = [one for one in found if one.severity != "note"]
    assert [(one.name, one.joint) for one in grave] == [("torque units", ", ".join(names))] * bool(stated)
    assert all("all drive gains are stated as 1" in one.evidence for one in grave)
    assert all(
        one.numbers[f"ratio {names[k]}"] == pytest.approx(1 / gains[k], rel=0.1) for one in grave for k in range(3)
    )


@pytest.mark.parametrize(("arm", "order"), [("", (1, 0, 2)), ("", (2, 0, 1)), ("er16", (0, 2, 1, 3, 4, 5))])
def test_columns_of_motors_in_another_order_are_named(
    trial: Trial, arm: str, order: tuple[int, ...], tmp_path: Path
) -> None:
    """The torques of the joints are then in no order: each is turned by the gear of another. It was told as delays."""
    own = virtual(read_case(arm)) if arm else trial
    names, ratios = own.case.robot.joint_names, np.array([80.0, 25.0, 6.0, 50.0, 40.0, 30.0])[: len(order)]
    stated = [(joint.name, joint.drive.reflected_inertia) for joint in own.case.robot.active]
    drives = {name: Drive(float(r), inertia / r**2) for (name, inertia), r in zip(stated, ratios, strict=True)}
    columns = replace(own.case.columns, motor=("torque",))
    case = replace(own.case, robot=own.case.robot.with_drives(drives), columns=columns)
    right = Trial(case, {**own.columns, "tau": own.columns["tau"] / ratios})
    assert [one for one in right.examined(tmp_path).findings if one.severity != "note"] == []
    found = right.with_columns(tau=right.columns["tau"][:, list(order)]).examined(tmp_path).findings[0]
    joints = ", ".join(name for i, name in enumerate(names) if order[i] != i)
    assert (found.severity, found.name, found.joint) == ("error", "torque order", joints)


@pytest.mark.parametrize("order", [(3, 0, 1, 2, 5, 4), (4, 3, 5, 0, 1, 2)])
def test_torques_of_many_joints_in_another_order_are_named_at_once(order: tuple[int, ...], tmp_path: Path) -> None:
    """Of a driver that sorts its names. Three at most were named, and obeying left the others with no error."""
    right = virtual(read_case("er16"))
    found = right.with_columns(tau=right.columns["tau"][:, list(order)]).examined(tmp_path).findings[0]
    names = right.case.robot.joint_names
    assert (found.severity, found.name, found.joint) == ("error", "torque order", ", ".join(names))
    assert f"read as those of {', '.join(names[k] for k in order)}" in found.evidence


def test_orders_of_currents_with_and_without_their_gains_are_one_finding(trial: Trial, tmp_path: Path) -> None:
    """Of gains that hardly differ: the same finding was listed as not distinguishable from itself."""
    names, gains, order = trial.case.robot.joint_names, np.array([9.0, 2.5, 2.499]), [0, 2, 1]
    drives = {name: Drive(gain=float(gain)) for name, gain in zip(names, gains, strict=True)}
    case = replace(trial.case, robot=trial.case.robot.with_drives(drives))
    columns = {**trial.without("tau").columns, "i": (trial.columns["tau"] / gains)[:, order]}
    found = Trial(case, columns).examined(tmp_path).findings[0]
    assert found.name == "torque order" and "torque order" not in found.evidence
    assert "not distinguishable from the same with their currents" in found.evidence


@pytest.mark.parametrize("gains", [[9.0, 2.5, 0.8], [0.2, 0.2, 0.2]], ids=["unlike", "alike"])
def test_drive_gains_that_are_stated_as_their_inverses_are_named(
    trial: Trial, gains: list[float], tmp_path: Path
) -> None:
    """Where all are alike the torques are right but for a common scale, which no fit tells."""
    names, true = trial.case.robot.joint_names, np.array(gains)
    columns = {**trial.without("tau").columns, "i": trial.columns["tau"] / true}

    def told(stated: np.ndarray) -> list[Finding]:
        drives = {name: Drive(gain=float(gain)) for name, gain in zip(names, stated, strict=True)}
        case = replace(trial.case, robot=trial.case.robot.with_drives(drives))
        return [one for one in Trial(case, columns).examined(tmp_path).findings if one.severity != "note"]

    assert told(true) == []
    (found,) = told(1.0 / true)
    if len(set(gains)) == 1:
        assert (found.severity, found.name) == ("error", "torque unit")
        return
    assert (found.severity, found.name, found.joint) == ("error", "torque scales", ", ".join(names))
    assert "state the inverses" in found.remedy
    for name, gain in zip(names, gains, strict=True):
        assert f"{name}: {{gain: {gain:.6g}}}" in found.remedy


def test_torques_that_no_body_makes_are_no_other_order(case: Case, tmp_path: Path) -> None:
    """Five seconds with torques that repeat with position: other columns fit them better, and predict no better."""
    generator = np.random.default_rng(34)
    clean = virtual(case, 34, RATE).rows(np.arange(generator.choice([500, 1000, 2000])))
    torque = clean.columns["tau"].copy()
    for joint in range(3):
        cycles, size = generator.choice([1, 2, 3]), 10 ** generator.uniform(-1.5, 1.0) * torque[:, joint].std()
        torque[:, joint] += size * np.sin(cycles * clean.columns["q"][:, joint] + generator.uniform(0, 6))
    found = clean.with_columns(tau=torque).examined(tmp_path).findings
    assert not [finding for finding in found if finding.name in ("joint order", "torque order")]


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_a_wrong_gravity_is_named_with_the_right_one(trial: Trial, kind: int, tmp_path: Path) -> None:
    finding = put.mounted(trial, kind).examined(tmp_path).findings[0]
    assert finding.name == "mounting"
    assert "[0, 0, -9.81]" in finding.remedy


@pytest.mark.parametrize("angle", [5.0, 21.6, 70.0])
def test_a_base_on_a_slope_is_named_with_its_own_direction(case: Case, angle: float, tmp_path: Path) -> None:
    """Between the axes: the log of an arm on a slope, declared upright."""
    lean = np.radians(angle)
    truth = 9.81 * np.array([0.2 * np.sin(lean), -np.sqrt(0.96) * np.sin(lean), -np.cos(lean)])
    made = virtual(replace(case, robot=case.robot.with_gravity(truth)), rate=RATE)
    finding = replace(made, case=case).examined(tmp_path).findings[0]
    assert finding.name == "mounting"
    told = re.search(r"gravity: \[([-\d., e]+)\]", finding.remedy)
    assert told is not None
    found = np.array([float(value) for value in told[1].split(",")])
    assert found @ truth > np.cos(np.radians(0.3)) * np.linalg.norm(found) * 9.81
    assert np.linalg.norm(found) == pytest.approx(9.81, rel=0.01)


@pytest.mark.parametrize("entry", [-0.8, 0.55, 1.1])
@pytest.mark.parametrize("at_motors", [False, True])
def test_a_motor_that_turns_with_another_joint_is_named(
    case: Case, at_motors: bool, entry: float, tmp_path: Path
) -> None:
    """The log holds torques of the joints, or those of the motors as if they were the joints'; any entry is found."""
    matrix = np.eye(3)
    matrix[2, 1] = entry
    coupled = virtual(replace(case, robot=case.robot.with_drives({}, matrix)), rate=RATE)
    tau = coupled.columns["tau"]
    log = replace(coupled.with_columns(tau=tau @ np.linalg.inv(matrix) if at_motors else tau), case=case)
    (found,) = (one for one in log.examined(tmp_path).findings if one.severity == "error")
    assert (found.name, found.joint) == ("coupling", ", ".join(case.robot.joint_names[1:]))
    assert found.numbers["entry 3, 2"] == pytest.approx(entry, abs=0.02)
    assert ("torque: motor" in found.remedy) == at_motors


def test_no_coupling_is_told_where_rounding_makes_the_acceleration(case: Case, tmp_path: Path) -> None:
    """Steps of 0.02 rad: below 5 Hz they make less acceleration than the motion, below 30 Hz many times as much."""
    matrix = np.eye(3)
    matrix[2, 1] = 1.1
    for cutoff, names in ((5.0, ["coupling"]), (30.0, [])):
        how = replace(case.preprocessing, filter=case.preprocessing.filter.with_cutoff(cutoff))
        filtered = replace(case, preprocessing=how)
        coupled = virtual(replace(filtered, robot=case.robot.with_drives({}, matrix)), rate=RATE)
        coarse = coupled.with_columns(q=np.round(coupled.columns["q"] / 0.02) * 0.02)
        found = replace(coarse, case=filtered).examined(tmp_path).findings
        assert [one.name for one in found if one.severity == "error"] == names


def test_a_coupling_that_is_stated_transposed_is_an_error(case: Case, tmp_path: Path) -> None:
    """The search comes to entries on both sides of the diagonal whose product is 1, under which C has no inverse."""
    matrix = np.eye(3)
    matrix[2, 1] = 1.0
    log = virtual(replace(case, robot=case.robot.with_drives({}, matrix)), rate=RATE)
    stated = replace(case, robot=case.robot.with_drives({}, matrix.T))
    found = replace(log, case=stated).examined(tmp_path).findings
    (error,) = (one for one in found if one.severity == "error")
    assert error.name == "coupling" and "coupling: [[1, 0, 0], [0, 1, 0], [0, 1, 1]]" in error.remedy


def test_motors_of_a_differential_are_named(case: Case, tmp_path: Path) -> None:
    matrix = np.eye(3)
    matrix[1:, 1:] = [[1, 1], [-1, 1]]
    coupled = virtual(replace(case, robot=case.robot.with_drives({}, matrix)), rate=RATE)
    tau = coupled.columns["tau"] @ np.linalg.inv(matrix)
    (found,) = replace(coupled.with_columns(tau=tau), case=case).examined(tmp_path).findings
    assert found.name == "coupling" and "[0, 1, 1], [0, -1, 1]" in found.remedy


@pytest.mark.parametrize("late", [0.0, 0.04])
def test_a_log_without_the_delay_that_is_taken_off_is_told(case: Case, late: float, tmp_path: Path) -> None:
    trial = virtual(case, rate=RATE, delay=late)
    stated = replace(trial, case=replace(case, preprocessing=replace(case.preprocessing, delay_s=0.04)))
    found = [one for one in stated.examined(tmp_path).findings if one.severity != "note"]
    assert [one.name for one in found] == ["torque delay"] * (not late)
    assert all("no delay" in one.evidence and "40 ms are taken off" in one.evidence for one in found)


@pytest.mark.parametrize("samples", [0.3, 1.2, 3.0, 20.0])
def test_the_delay_is_right_to_a_tenth_of_a_sample(case: Case, samples: float, tmp_path: Path) -> None:
    found = virtual(case, rate=RATE, delay=samples / RATE).examined(tmp_path).findings
    (late,) = [finding for finding in found if finding.name == "torque delay"]
    assert late.numbers["delay_s"] * RATE == pytest.approx(samples, abs=0.1)


@pytest.mark.parametrize("samples", [0.0, 3.0])
def test_the_other_search_is_left_out_only_where_it_would_lose(case: Case, samples: float, tmp_path: Path) -> None:
    """With the delay taken out or without: where one search is made, no causes could make the other one better."""
    subject = subject_of(virtual(case, rate=RATE, delay=samples / RATE), tmp_path)
    fit, trends = subject.fit, subject.trends
    assert fit is not None and trends is not None
    both = [Trends(fit), Trends(fit.delayed(samples / RATE or 0.01), Trends(fit))]
    assert all(one.least_criterion <= one.criterion for one in both)
    if samples:
        assert trends.fit.late_s == pytest.approx(samples / RATE, abs=1e-4)
        assert both[1].criterion < both[0].least_criterion


def test_positions_read_otherwise_are_made_once(case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a log with one position turned, what a second look finds is what the first one found."""
    subject = subject_of(put.turned(virtual(case, rate=RATE), ("q",), 1), tmp_path)
    fit = subject.fit
    assert fit is not None
    readings, feeds, made = PositionReadings(fit), np.zeros(3, bool), Counter[str]()
    products = QuickFit.products_of
    monkeypatch.setattr(QuickFit, "products_of", lambda *a: (made.update(["products"]), products(*a))[1])
    wrong = np.array([False, True, True])
    first = list(readings.found(wrong, feeds))
    count = made["products"]
    turned = (case.robot.joint_names[1],)
    assert [(one.name, one.joints) for one in first] == [("position sign", turned), ("axis sign", turned)]
    assert first[0].gain > first[1].gain
    again = list(readings.found(wrong, feeds))
    assert [one.gain for one in again] == [one.gain for one in first] and made["products"] == count


def test_gravity_upside_down_on_a_small_arm_shows_against_the_description(planar_2r: Robot, tmp_path: Path) -> None:
    """A motion so slow that inertia says nothing: a body on the other side of its joint explains the torque as well."""
    joints = tuple(replace(joint, damping=0.1, friction=0.05) for joint in planar_2r.joints)
    robot = replace(planar_2r, joints=joints)
    friction = tuple(FRICTION.make(name) for name in default_friction())
    case = Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing())
    found = Trial(
        replace(case, robot=robot.with_gravity(-np.asarray(robot.gravity))), virtual(case, rate=RATE).columns
    ).examined(tmp_path)
    (finding,) = [finding for finding in found.findings if finding.name == "mounting"]
    assert "gravity: [0, 0, -9.81]" in finding.remedy or "gravity: [0, -9.81, 0]" in finding.remedy


@pytest.mark.parametrize("width", [0.005, 0.1])
def test_another_width_of_the_sign_is_no_wrong_clock(width: float, tmp_path: Path) -> None:
    scara = read_robot("generic-scara")
    robot = replace(scara, joints=tuple(replace(joint, damping=2.0, friction=3.0) for joint in scara.joints))
    friction = tuple(FRICTION.make(name) for name in default_friction())
    case = Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing())
    other = (FRICTION.make("coulomb", {"width": width}), *friction[1:])
    trial = virtual(replace(case, friction=other), rate=RATE)
    found = replace(trial, case=case).examined(tmp_path).findings
    curves = [finding for finding in found if finding.name != "scale not determined"]
    assert {finding.name for finding in curves} == {"friction curve"}
    assert all(finding.severity == "note" for finding in found)
    assert all(finding.numbers["torque"] < 0.5 for finding in curves)


@pytest.mark.parametrize(
    ("mass", "severity", "words"),
    [
        (0.8, "note", "remove the payload or tool, or add it to the robot model"),
        (2.0, "warning", "remove the payload or tool, or add it to the robot model"),
        (-1.0, "note", "take a tool that is not mounted out of the robot model"),
    ],
)
def test_a_payload_is_weighed(trial: Trial, mass: float, severity: str, words: str, tmp_path: Path) -> None:
    """The last link has 3 kg, of which a tenth may be an error of the robot model."""
    found = put.loaded(trial, mass, np.random.default_rng(0)).examined(tmp_path).findings
    (load,) = [finding for finding in found if finding.name == "load at the flange"]
    assert load.severity == severity and words in load.remedy
    assert ("kg) less at the flange" in load.evidence) == (mass < 0)
    assert load.numbers["mass_kg"] == pytest.approx(mass, abs=0.04)
    assert load.numbers["std_kg"] == pytest.approx(0.3, rel=0.1)


def test_a_load_is_told_with_the_errors_of_the_robot_model(case: Case, trial: Trial, tmp_path: Path) -> None:
    """Masses of the robot model 20 % off: no warning without a load, and an interval that holds a large one."""
    off = []
    for seed in range(4):
        shares = np.exp(np.random.default_rng(seed).normal(0, 0.2, len(case.robot.links)))
        links = [
            replace(link, inertia=Inertia.from_vector(share * link.inertia.vector))  # type: ignore[union-attr]
            for link, share in zip(case.robot.links, shares, strict=True)
        ]
        rough = replace(trial, case=replace(case, robot=replace(case.robot, links=tuple(links))))
        assert not [one.line() for one in rough.examined(tmp_path).findings if one.severity != "note"]
        found = put.loaded(rough, 8.0, np.random.default_rng(0)).examined(tmp_path).findings
        for load in (finding for finding in found if finding.name == "load at the flange"):
            assert load.numbers["std_kg"] > 0.04  # noise alone: below 0.01
            off.append((load.numbers["mass_kg"] - 8.0) / load.numbers["std_kg"])
    assert len(off) >= 3 and np.max(np.abs(off)) < 3.0, off


def test_a_tilt_is_measured_and_the_right_gravity_stated(trial: Trial, tmp_path: Path) -> None:
    found = put.tilted(trial, 2.0, np.random.default_rng(0)).examined(tmp_path).findings
    (tilt,) = [finding for finding in found if finding.name == "tilt"]
    assert "tilted by 2" in tilt.evidence
    text = tilt.remedy.split("gravity: [")[1].split("]")[0]
    assert np.allclose([float(word) for word in text.split(",")], [0, 0, -9.81], atol=0.05)


def test_a_cause_is_told_once(trial: Trial, tmp_path: Path) -> None:
    for faulty, name in (
        (put.sprung(trial, 0.3, 0), "spring"),
        (put.drifting(trial, 0.3, np.random.default_rng(0)), "drift"),
        (put.scaled(trial, 0.15, 1), "torque scale"),
    ):
        found = faulty.examined(tmp_path).findings
        assert [finding.name for finding in found] == [name], [finding.line() for finding in found]


@pytest.mark.parametrize(("late", "severity"), [(0.008, "warning"), (0.06, "error")])
def test_a_late_torque_of_one_joint_is_no_mere_note_and_its_shift_helps(
    late: float, severity: str, trial: Trial, tmp_path: Path
) -> None:
    t, tau = trial.columns["t"], trial.columns["tau"]

    def shifted(columns: np.ndarray, by: float) -> np.ndarray:
        return np.column_stack([columns[:, 0], np.interp(t - by, t, columns[:, 1]), columns[:, 2]])

    found = trial.with_columns(tau=shifted(tau, late)).examined(tmp_path).findings
    (told,) = [one for one in found if one.severity != "note"]
    assert (told.severity, told.name, told.joint) == (severity, "torque delay", trial.case.robot.joint_names[1])
    assert abs(told.numbers["value"] - late) < told.numbers["half_width"] + 1e-3
    mended = shifted(shifted(tau, late), -told.numbers["value"])
    assert "torque delay" not in [one.name for one in trial.with_columns(tau=mended).examined(tmp_path).findings]


def test_friction_that_turns_before_the_velocity_is_a_friction_curve(trial: Trial, tmp_path: Path) -> None:
    """As in simulators whose friction looks at the velocity of the next moment: no spring, no counterbalance."""
    t, q = trial.columns["t"], trial.columns["q"]
    dq = np.gradient(q, t, axis=0)
    early = dq + 0.01 * np.gradient(dq, t, axis=0)
    level = 0.3 * np.std(trial.columns["tau"], axis=0)
    tau = trial.columns["tau"] + level * (np.tanh(early / 0.005) - np.tanh(dq / 0.005))
    found = trial.with_columns(tau=tau).examined(tmp_path).findings
    assert {finding.name for finding in found} <= {"friction curve", "spikes"}, [finding.line() for finding in found]
    curves = [finding for finding in found if finding.name == "friction curve"]
    assert len(curves) == 3 and all("turns" in finding.evidence for finding in curves)
    for k, name in enumerate(trial.case.robot.joint_names):  # both figures are of what the curve takes off
        (curve,) = [finding for finding in curves if finding.joint == name]
        share = float(re.search(r"([\d.]+) % of its torque", curve.evidence)[1]) / 100.0  # type: ignore[index]
        whole = float(np.sqrt(np.mean(tau[:, k] ** 2)))
        assert curve.numbers["torque"] == pytest.approx(share * whole, rel=0.2)


def test_a_change_shows_against_an_earlier_estimate_where_the_description_is_wrong(
    case: Case, trial: Trial, tmp_path: Path
) -> None:
    scales = (1.3, 0.8, 1.2)  # each body wrong by another share, so that no one cause explains it
    links = []
    for link, scale in zip(case.robot.links, scales, strict=True):
        assert link.inertia is not None
        links.append(replace(link, inertia=Inertia.from_vector(scale * link.inertia.vector)))
    rough = replace(trial, case=replace(case, robot=replace(case.robot, links=tuple(links))))
    earlier = virtual(case, seed=3, rate=RATE).estimate(tmp_path)
    assert not [one.line() for one in rough.examined(tmp_path, earlier).findings if one.severity != "note"]
    faulty = put.loaded(rough, 0.05, np.random.default_rng(0))
    (load,) = [one for one in faulty.examined(tmp_path, earlier).findings if one.name == "load at the flange"]
    assert "against the earlier estimate" in load.evidence
    assert load.numbers["mass_kg"] == pytest.approx(0.05, abs=4 * load.numbers["std_kg"])
    told = [one for one in faulty.examined(tmp_path).findings if one.name == "load at the flange"]
    assert all(abs(one.numbers["mass_kg"] - 0.05) > 0.1 for one in told)  # that of the wrong bodies


def test_an_earlier_estimate_of_a_clean_log_changes_nothing_and_one_of_another_robot_is_told(
    trial: Trial, clean: CleanLog, tmp_path: Path
) -> None:
    earlier = virtual(trial.case, seed=4, rate=RATE).estimate(tmp_path)
    said = [[one.line() for one in found] for found in (trial.examined(tmp_path, earlier).findings, clean.findings)]
    assert said[0] == said[1]  # figures as told: the last bits of sums depend on where arrays lie
    (found,) = [one for one in put.other_arm(trial, 0).examined(tmp_path, earlier).findings if one.severity == "error"]
    assert found.name == "another robot" and "or its axis is turned by 120 degrees" in found.evidence


def test_findings_are_plain_data(trial: Trial, tmp_path: Path) -> None:
    found = put.drifting(trial, 0.3, np.random.default_rng(0)).examined(tmp_path)
    figures = json.loads(json.dumps(found.figures(), allow_nan=False))
    assert figures["sound"] and figures["findings"][0]["name"] == "drift"
    assert figures["findings"][0]["numbers"]["t"] > 5.0


def test_degrees_explain_what_follows_from_them(trial: Trial, tmp_path: Path) -> None:
    found = trial.with_columns(q=np.rad2deg(trial.columns["q"])).examined(tmp_path)
    assert [finding.name for finding in found.findings] == ["positions in degrees"]
    assert "units: {position: " in found.findings[0].remedy
    assert found.left_out


def test_slides_in_millimetres_have_their_units_stated(scara: Robot, tmp_path: Path) -> None:
    limits = JointLimits(-0.3, 0.4)
    joints = tuple(replace(one, limits=limits) if one.kind == "prismatic" else one for one in scara.joints)
    friction = tuple(FRICTION.make(name) for name in default_friction())
    case = Case(replace(scara, joints=joints), friction, ColumnMap(joints=scara.joint_names), default_preprocessing())
    trial = virtual(case, rate=RATE)
    q, names = trial.columns["q"].copy(), case.robot.joint_names
    q[:, 2] = 0.15 + 0.1 * (q[:, 2] - q[:, 2].mean()) / np.ptp(q[:, 2])
    assert not [one for one in trial.with_columns(q=q).examined(tmp_path).findings if "millimetres" in one.name]
    q[:, 2] *= 1e3
    (error,) = [one for one in trial.with_columns(q=q).examined(tmp_path).findings if one.severity == "error"]
    assert (error.name, error.joint) == ("positions in millimetres", names[2])
    assert "(log: units: {position: [rad, rad, mm, rad]})" in error.remedy


def test_the_line_of_a_fault_is_that_of_the_file(trial: Trial, tmp_path: Path) -> None:
    tau = trial.columns["tau"].copy()
    tau[40, 1] = np.nan
    write(trial.with_columns(tau=tau), tmp_path / "run.csv")
    (finding,) = examine(trial.case, str(tmp_path / "run.csv")).findings
    assert finding.severity == "error" and "line 42" in finding.evidence


def test_a_file_that_is_no_table_is_a_finding(case: Case, tmp_path: Path) -> None:
    (tmp_path / "run.csv").write_text("t,q1\n0,one\n", encoding="utf-8")
    found = examine(case, str(tmp_path / "run.csv"))
    assert not found.sound and [finding.name for finding in found.findings] == ["unreadable"]


def test_repairs_give_the_clean_log_back(trial: Trial, tmp_path: Path) -> None:
    generator = np.random.default_rng(3)
    case = trial.case
    broken = put.disorder(put.duplicates(trial, 0.01, generator), 0.002, generator)
    broken = put.wrap(broken, 0.5, generator)
    clean = read_recording(case, str(trial.written(tmp_path, "clean"))).log
    repaired = repair(read_recording(case, str(broken.written(tmp_path, "broken"))), case.robot)
    log = repaired.recording.log
    assert len(repaired.repairs) >= 3
    assert np.array_equal(log.time, clean.time)
    assert np.array_equal(log.torque, clean.torque)
    turns = (log.q - clean.q) / (2 * np.pi)
    assert np.allclose(turns, np.round(turns).mean(axis=0), atol=1e-8)


@pytest.mark.parametrize(("count", "is_repaired"), [(2, True), (400, False)])
def test_a_few_rows_of_one_time_are_left_out_and_many_are_not(
    trial: Trial, count: int, is_repaired: bool, tmp_path: Path
) -> None:
    """Check, --fix and the reader of the logs name the same step."""
    time = np.array(trial.columns["t"])
    time[1 : 2 * count : 2] = time[0 : 2 * count : 2]
    path = trial.with_columns(t=time).written(tmp_path)
    recording = read_recording(trial.case, str(path))
    found = examine_recordings(trial.case, [recording])[0]
    (told,) = [one for one in found.findings if one.name == "equal time stamps"]
    repaired, out = repair(recording, trial.case.robot), tmp_path / "out.csv"
    with pytest.raises(LogFormatError, match=f"repeats.*{'--fix OUT.csv' if is_repaired else 'more digits'}"):
        read_log(path, trial.case.columns)
    if is_repaired:
        assert "--fix OUT.csv' writes the log without them" in told.remedy
        write_repaired(repaired, str(out))
        assert read_log(out, trial.case.columns).samples == len(time) - count
        return
    assert told.remedy == SEVERAL and repaired.recording.log.samples == len(time)
    with pytest.raises(LogMismatch, match=f"{count} rows have the time of the row before.*{SEVERAL}"):
        write_repaired(repaired, str(out))


def test_what_is_not_safe_is_not_repaired(trial: Trial, tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    for broken in (put.lost(trial, 0.2, generator), put.restart(trial, 0.5, generator)):
        recording = read_recording(trial.case, str(broken.written(tmp_path)))
        assert repair(recording, trial.case.robot).recording.log.samples == recording.log.samples
        assert not examine_recordings(trial.case, [recording])[0].sound


def test_sorting_is_for_rows_out_of_order_only() -> None:
    time = np.arange(1000) / 100.0
    swapped = time.copy()
    swapped[[10, 11]] = swapped[[11, 10]]
    assert sortable(swapped)
    assert not sortable(np.concatenate([time, time + 0.001]))
    for back in (0.35, 0.354, 0.0537):  # a clock that is set back runs through the same time twice
        assert not sortable(np.concatenate([time[:500], time[500:] - back]))
    late = np.concatenate([time[:500], time[505:520], time[500:505], time[520:]])  # five messages that arrived late
    assert sortable(late)
    assert np.flatnonzero(out_of_order(late)).tolist() == [515, 516, 517, 518, 519]
    far = time.copy()
    far[[100, 700]] = far[[700, 100]]  # two rows out of order, though 600 are earlier than one before them
    assert np.flatnonzero(out_of_order(far)).tolist() == [100, 700] and sortable(far)
    assert not out_of_order(time).any()
    stamped, values = np.insert(time, 100, time[700]), np.insert(np.sin(time), 100, np.sin(time[700]))
    assert sortable(stamped, [values])  # a message sent twice
    values[100] += 1.0
    assert not sortable(stamped, [values])


@pytest.mark.parametrize("scale", [1.0, 1.5])
def test_a_torque_that_is_cut_off_has_its_scale_by_the_other_samples(
    scale: float, trial: Trial, tmp_path: Path
) -> None:
    tau = trial.columns["tau"] * [1.0, scale, 1.0]
    tau[:, 1] = np.minimum(tau[:, 1], np.quantile(tau[:, 1], 0.8))
    found = trial.with_columns(tau=tau).examined(tmp_path).findings
    names = ["torque saturation", "torque scale"] if scale != 1.0 else ["torque saturation"]
    assert {one.name for one in found if one.severity != "note"} == {*names}
    scales = [one for one in found if one.name == "torque scale"]
    assert [one.joint for one in scales] == [trial.case.robot.joint_names[1]] * (scale != 1.0)
    assert all(one.numbers["low"] < 1.0 / scale < one.numbers["high"] for one in scales)


def test_a_torque_beyond_the_described_limit_is_not_at_it() -> None:
    torque = 100.0 * np.sin(np.linspace(0.0, 60.0, 4000))
    assert at_limit(np.clip(torque, -80.0, 80.0), 80.0).mean() == pytest.approx(np.mean(np.abs(torque) >= 79.6))
    assert not at_limit(torque, 80.0).any()
    assert not at_limit(torque, 120.0).any() and not at_limit(torque, np.inf).any()
    assert not at_limit(torque, 1.002 * float(np.abs(torque).max())).any()  # a peak that just gets there


def test_a_joint_that_turns_fast_does_not_wrap(trial: Trial, tmp_path: Path) -> None:
    assert wraps(read_recording(trial.case, str(trial.written(tmp_path))).log, trial.case.robot) == {}


def test_a_step_of_friction_at_a_reversal_is_no_spike(trial: Trial, tmp_path: Path) -> None:
    tau = trial.columns["tau"].copy()
    row = int(np.argmin(np.abs(np.diff(tau[100:-100, 1])))) + 100
    size = 0.5 * float(np.ptp(tau[:, 1]))
    tau[row:, 1] += size * (0.3 + 0.7 * np.exp(-np.arange(len(tau) - row) / 2.0))
    told = [one.name for one in trial.with_columns(tau=tau).examined(tmp_path).findings]
    assert "spikes" not in told
    tau[row + 20, 1] += size
    assert "spikes" in [one.name for one in trial.with_columns(tau=tau).examined(tmp_path).findings]


@pytest.mark.parametrize("width", [1.5, 2.5])
def test_the_turn_of_a_smooth_torque_is_no_spike(width: float, trial: Trial, tmp_path: Path) -> None:
    """As where a stiff drive is let go after it stuck, in a log that is quiet otherwise."""
    tau = trial.columns["tau"].copy()
    rows, size = np.arange(len(tau)), float(np.ptp(tau[:, 1]))
    tau[:, 1] += size * np.exp(-(((rows - len(tau) // 2) / width) ** 2))
    assert "spikes" not in [one.name for one in trial.with_columns(tau=tau).examined(tmp_path).findings]


def test_flat_tops_and_levels() -> None:
    time = np.linspace(0, 10, 2001)
    wave = np.sin(time)
    assert not flat_rows(wave).any()
    assert flat_rows(np.minimum(wave, 0.9)).mean() == pytest.approx(np.mean(wave >= 0.9))
    assert steps_of(np.round(wave * 10) / 10) == pytest.approx(20, abs=1)
    assert steps_of(wave) == np.inf
    assert steps_of(np.zeros(50)) == 0.0


@pytest.mark.parametrize("step", [1e-3, 2 * np.pi / 4096])
def test_levels_show_where_few_values_come_twice(step: float) -> None:
    """A short log over a wide range: more levels than a quarter of the samples."""
    time = np.arange(3000) / 100.0
    wave = 2.0 * np.sin(1.3 * time) + 0.6 * np.sin(1.1 * time)
    counted = np.round(wave / step) * step
    assert smallest_step(counted) == pytest.approx(step, rel=1e-6)
    assert smallest_step(np.round(counted, 4)) == pytest.approx(step, rel=1e-3)  # as text has it
    for smooth in (wave, np.round(wave, 6), wave + 1e-4 * np.random.default_rng(0).normal(size=len(wave))):
        assert smallest_step(smooth) == 0.0


@pytest.mark.parametrize("is_described", [False, True])
def test_friction_that_warms_up_is_told_unless_the_case_has_it(is_described: bool, tmp_path: Path) -> None:
    robot = read_robot("generic-6r")
    friction = tuple(FRICTION.make(name) for name in default_friction())
    case = Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing())
    trial = virtual(case, rate=RATE)
    time, speed = (np.asarray(trial.columns[name]) for name in ("t", "dq"))
    warm = -np.expm1(-(time - time[0]) / 15.0)[:, None] * np.tanh(speed / 0.02)
    trial = trial.with_columns(tau=trial.columns["tau"] - 0.05 * np.std(trial.columns["tau"], axis=0) * warm)
    case = replace(case, friction=(*friction, WarmUp(15.0))) if is_described else case
    told = [one.name for one in replace(trial, case=case).examined(tmp_path).findings]
    assert ("friction drift" in told) != is_described


def test_friction_that_is_chosen_follows_what_warms_up_where_the_log_is_long_enough(tmp_path: Path) -> None:
    robot = read_robot("generic-6r")
    friction = tuple(FRICTION.make(name) for name in default_friction())
    case = Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing())
    subject = subject_of(virtual(case, rate=RATE), tmp_path)
    log, warms = subject.sound.log, WarmUp(choose=("part", "time_constant"))
    for longer, is_warm, told in ((1.0, False, False), (1.0, True, True), (120.0 / log.duration, False, True)):
        temperature = np.full(log.q.shape, 20.0) if is_warm else None
        sound = replace(subject.sound, log=replace(log, time=longer * np.asarray(log.time), temperature=temperature))
        auto = replace(case, choose_friction=True)
        assert ("friction drift" in replace(subject, case=auto, sound=sound).described) == told
        open_part = replace(case, friction=(*friction, warms))
        assert ("friction drift" in replace(subject, case=open_part, sound=sound).described) == (told and not is_warm)


def test_rounding_of_positions_counts_as_it_shows_in_the_acceleration() -> None:
    """Beside the filtered error of rounding, within the slope of the filter at its cut-off."""
    time = np.arange(4000) / 200.0
    wave = np.sin(1.3 * time) + 0.4 * np.sin(2.9 * time + 1.0)
    rounded = np.round(wave / 3e-3) * 3e-3
    sections = scipy.signal.butter(3, 5.0, fs=200.0, output="sos")
    error = np.diff(scipy.signal.sosfiltfilt(sections, rounded - wave), 2)[200:-200] * 200.0**2
    share = np.std(error) / np.std(np.diff(wave, 2) * 200.0**2)
    assert share < rounding_share(time, rounded, steps_of(rounded), 5.0) < 2.0 * share


def test_every_check_says_what_it_looks_at() -> None:
    assert len(CHECKS.names()) >= 12
    assert all(CHECKS.get(name).stage in (0, 1, 2) and CHECKS.summary(name) for name in CHECKS.names())
    assert SEVERITIES == ("error", "warning", "note")


@pytest.mark.parametrize(("freedom", "exact"), [(4.9, True), (40.0, True), (np.inf, False)])
def test_intervals_against_a_robot_model_are_those_of_student(freedom: float, exact: bool) -> None:
    one = np.ones(1)
    blame = Blame(
        Cause("load at the flange", "", one[None, None]), 6.4 * one, np.eye(1), 6, 1, 1, 1, one, one, (), freedom
    )
    law = scipy.stats.t(freedom) if exact else scipy.stats.norm()
    np.testing.assert_allclose(blame.half_widths, law.ppf(0.975), rtol=1e-4)
    assert blame.score(6.4) == pytest.approx(scipy.stats.norm.isf(law.sf(6.4)), rel=1e-4)


def test_bodies_that_the_torques_do_not_tell_leave_no_freedom() -> None:
    known = NominalBodies(np.arange(3), np.eye(3), np.zeros(3), np.ones(3), np.zeros((3, 0)))
    prior = np.array([1.0, 0.25, 0.1])
    assert known.freedom(prior, prior) == 1.0  # the log adds nothing
    assert known.freedom(prior, 1e-9 * prior) == pytest.approx(3.0)


@pytest.mark.parametrize(("samples", "places"), [(8, 10), (20, 2)])
def test_positions_that_are_held_and_catch_up_are_told(trial: Trial, samples: int, places: int, tmp_path: Path) -> None:
    q = trial.columns["q"].copy()
    for begin in np.linspace(100, 1800, places, dtype=int):
        q[begin : begin + samples, 1] = q[begin, 1]
    found = [one for one in trial.with_columns(q=q).examined(tmp_path).findings if one.name == "positions held"]
    assert [(one.severity, one.joint) for one in found] == [("warning", trial.case.robot.joint_names[1])]
    assert abs(found[0].numbers["places"] - places) <= 2  # a joint that hardly moves there is none


def test_positions_of_another_rate_a_coarse_encoder_and_a_stop_are_not_held(trial: Trial) -> None:
    t, q = trial.columns["t"], trial.columns["q"][:, 1]
    stop = np.interp(t, [t[0], t[600], t[700], t[-1]], [0.0, 1.0, 1.0, 2.5])
    lost = np.delete(np.arange(len(t)), slice(500, 520))
    for time, column in (
        (t, np.repeat(q[::10], 10)[: len(t)]),
        (t, np.round(q / 0.02) * 0.02),
        (t, np.round(q + 3e-4 * np.random.default_rng(0).normal(size=len(t)), 3)),
        (t, stop),
        (t[lost], q[lost]),
    ):
        assert not len(held_at(time, column)[0])


def test_errors_of_known_bodies_have_the_unit_of_the_torques(trial: Trial, tmp_path: Path) -> None:
    """A log times a factor is one with torques of another scale: all else is as likely as before."""
    surprises, factors = [], []
    for times in (1.0, 1.5):
        faulty = trial.with_columns(tau=times * trial.columns["tau"])
        subject = subject_of(faulty, tmp_path)
        earlier = virtual(trial.case, 1, RATE).estimate(tmp_path)
        known = replace(subject, earlier=earlier).known
        assert subject.trends is not None and known is not None
        off = replace(known, values=known.values + 0.05 * np.abs(known.values))  # bodies that the log contradicts
        search = AgainstBodies(subject.trends, off).search
        (scale,) = [k for k, one in enumerate(search.causes) if (one.name, one.joint) == ("torque scale", "")]
        solved = search.fit([scale])
        surprises.append(solved.surprise)
        factors.append(1.0 + solved.beta[-1])
    assert factors[1] == pytest.approx(1.5 * factors[0], rel=1e-3)
    assert surprises[1] == pytest.approx(surprises[0], rel=0.02)


def test_two_wrong_scales_are_told_together_and_one_alone(tmp_path: Path) -> None:
    arm = virtual(read_case("generic-6r"), rate=RATE)
    both, one = np.array([1.0, 2.0, 1.0, 0.5, 1.0, 1.0]), np.array([1.0, 2.0, 1.0, 1.0, 1.0, 1.0])
    for times, name, joints in ((both, "torque scales", [1, 3]), (one, "torque scale", [1])):
        found = arm.with_columns(tau=times * arm.columns["tau"]).examined(tmp_path).findings
        (told,) = [finding for finding in found if finding.severity != "note"]
        names = [arm.case.robot.joint_names[k] for k in joints]
        assert (told.name, told.joint) == (name, ", ".join(names))
        factors = [told.numbers.get("factor", told.numbers.get(f"factor {joint}")) for joint in names]
        np.testing.assert_allclose(factors, 1.0 / times[joints], rtol=0.02)


@pytest.mark.parametrize("swapped", [False, True])
def test_joints_of_a_wrist_that_friction_hides_are_told_apart(swapped: bool, tmp_path: Path) -> None:
    arm = virtual(read_case("generic-6r"), rate=RATE)
    tau, order = arm.columns["tau"], [0, 1, 2, 4, 3, 5] if swapped else list(range(6))
    friction = 3.0 * tau.std(axis=0) * np.tanh(arm.columns["dq"] / 0.02)  # all are explained to a tenth
    arm = arm.with_columns(tau=tau + friction * np.array([0.1, 0.1, 0.1, 1.0, 1.0, 1.0]))
    arm = arm.with_columns(**{name: arm.columns[name][:, order] for name in ("q", "dq", "tau")})
    told = [(one.name, one.joint) for one in arm.examined(tmp_path).findings if one.severity != "note"]
    assert told == [("joint order", "wrist_1, wrist_2")] * swapped


def test_a_position_of_the_wrong_sign_is_no_other_robot(
    trial: Trial, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the columns of other joints explain most of it, positions are read otherwise only in the second place."""
    monkeypatch.setattr(readings, "POOR", 10.0)
    (found,) = [one for one in put.turned(trial, ("q", "dq"), 2).examined(tmp_path).findings if one.severity == "error"]
    assert (found.name, found.joint) == ("position sign", trial.case.robot.joint_names[2])


@pytest.mark.parametrize("joint", [1, 2])
def test_an_axis_that_counts_the_other_way_is_named(case: Case, tmp_path: Path, joint: int) -> None:
    """Position, velocity and torque of a joint turned together: no other robot, clock or spring."""
    told = put.turned(virtual(case), ("q", "dq", "tau"), joint).examined(tmp_path).findings
    (found,) = [one for one in told if one.severity != "note"]
    assert (found.name, found.joint) == ("axis sign", case.robot.joint_names[joint])
    assert "its position and torque" in found.remedy


def test_causes_are_taken_in_where_they_predict_unseen_samples(trial: Trial, tmp_path: Path) -> None:
    tau = trial.columns["tau"].copy()
    size = 2.0 * tau[:, 1].std()
    tau[:, 1] += size * np.sin(3.0 * trial.columns["q"][:, 1])
    faulty = trial.with_columns(tau=tau)
    fit = quick_fit(faulty.case, faulty.case.read(faulty.written(tmp_path)))
    assert isinstance(fit, QuickFit)
    plain = robot_misfit(fit)
    assert plain.left > LEFT
    q = np.asarray(fit.rows.prepared.log.q)[fit.rows.prepared.keep, 1]
    true, other = np.zeros((2, 1, len(q), 3))
    true[0, :, 1] = np.sin(3.0 * q)
    other[0, :, 1] = np.where(halves(len(q))[0], 1e3, 1.0) * np.random.default_rng(0).normal(size=len(q))
    good, bad = (Cause("any", "", own) for own in (true, other))
    assert robot_misfit(fit, known=[bad]).left == plain.left  # learned from the half where it is small
    assert robot_misfit(fit, known=[bad, good]).left < 0.2 * plain.left


def test_the_last_digit_of_a_joint_at_rest_is_told_once(trial: Trial, tmp_path: Path) -> None:
    q, dq, generator = trial.columns["q"].copy(), trial.columns["dq"].copy(), np.random.default_rng(2)
    q[:, 1] = 0.4 + 1e-4 * (generator.random(len(q)) < 0.02)  # an encoder that ticks now and then
    dq[:, 1] = 1e-3 * generator.normal(size=len(q))
    told = [(one.name, one.joint) for one in trial.with_columns(q=q, dq=dq).examined(tmp_path).findings]
    joint = trial.case.robot.joint_names[1]
    assert [name for name, joints in told if joint in joints.split(", ")] == ["joint never moved"]
    q[:, 1] = trial.columns["q"][:, 1]
    q[500, 1] += 1.0  # a joint that moves has its spike told
    assert ("spikes", joint) in [(one.name, one.joint) for one in trial.with_columns(q=q).examined(tmp_path).findings]


@pytest.mark.parametrize(("back", "told"), [(86400.0, "starts again at midnight"), (80000.0, "the clock was set back")])
def test_a_time_of_day_that_starts_again_is_midnight(trial: Trial, tmp_path: Path, back: float, told: str) -> None:
    time = trial.columns["t"] + 86395.0
    found = trial.with_columns(t=np.where(np.arange(len(time)) < len(time) // 2, time, time - back)).examined(tmp_path)
    (finding,) = [one for one in found.findings if one.name == "time runs back"]
    assert told in finding.remedy


@pytest.mark.parametrize("joints", [(1,), (2,), (0, 1, 2)])
def test_torques_whose_sign_was_lost_are_named(joints: tuple[int, ...], trial: Trial, tmp_path: Path) -> None:
    tau = trial.columns["tau"].copy()
    assert np.all(np.mean(tau < 0.0, axis=0) > 0.05)
    tau[:, joints] = np.abs(tau[:, joints])
    found = trial.with_columns(tau=tau).examined(tmp_path).findings
    names = trial.case.robot.joint_names
    assert [(one.severity, one.name, one.joint) for one in found] == [
        ("error", "torque without sign", ", ".join(names[k] for k in joints))
    ]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_torque_that_is_right_on_one_side_alone_has_its_sign(sign: float, trial: Trial, tmp_path: Path) -> None:
    """As of an axis that always holds weight; and one that is negated as a whole has the wrong sign."""
    tau = trial.columns["tau"].copy()
    tau[:, 1] = sign * (tau[:, 1] - 1.2 * tau[:, 1].min())
    found = trial.with_columns(tau=tau).examined(tmp_path).findings
    assert "torque without sign" not in [one.name for one in found]
    assert ("torque sign" in [one.name for one in found]) == (sign < 0.0)


@pytest.mark.parametrize(("seconds", "severity"), [(0.3, "error"), (1.2, "error"), (1.9, "warning"), (6.0, "")])
def test_a_log_too_short_for_a_fit_is_told_and_nothing_else(
    seconds: float, severity: str, trial: Trial, tmp_path: Path
) -> None:
    tau = trial.columns["tau"] * [1.0, -1.0, 1.0]  # which a short log does not tell
    part = {name: values[: int(seconds * RATE)] for name, values in (trial.columns | {"tau": tau}).items()}
    found = trial.with_columns(**part).examined(tmp_path).findings
    if severity:
        assert [(one.severity, one.name) for one in found] == [(severity, "short log")]
        assert found[0].numbers["needed_s"] < 6.0
    else:
        assert "short log" not in [one.name for one in found] and any(one.name == "torque sign" for one in found)


@pytest.mark.parametrize("size", [3.0, 0.1, 0.0])
def test_a_contact_is_named_with_its_time_and_huber_goes_without_it(size: float, trial: Trial, tmp_path: Path) -> None:
    tau, time = trial.columns["tau"].copy(), trial.columns["t"] - trial.columns["t"][0]
    pulse = np.where((time > 4.0) & (time < 4.4), np.sin(np.pi * (time - 4.0) / 0.4), 0.0)
    weak = np.where((time > 7.0) & (time < 7.25), 0.018, 0.0)  # as of braking: beside the contact it is none
    struck = trial.with_columns(tau=tau + np.abs(tau).max(axis=0) * (size * pulse + weak)[:, None])
    found = struck.examined(tmp_path).findings
    contacts = [one for one in found if one.name == "contact"]
    assert len(contacts) == bool(size)
    for one in contacts:
        assert one.severity == "error" and one.joint == ", ".join(trial.case.robot.joint_names)
        assert 3.5 < one.numbers["first"] < 4.1 and 4.2 < one.numbers["last"] < 4.9
        assert [each.name for each in found if each.severity != "note"] == ["contact"]
        (line,) = re.findall(r"leave_out: \{(.*): (\[\[.*\]\])\}", one.remedy)
        columns = replace(struck.case.columns, leave_out=((line[0], tuple(map(tuple, json.loads(line[1])))),))
        mended = replace(struck, case=replace(struck.case, columns=columns)).examined(tmp_path).findings
        assert not [each for each in mended if each.severity != "note"]
        robust = replace(struck, case=replace(struck.case, estimator=PartChoice("huber")))
        assert [one.severity for one in robust.examined(tmp_path).findings if one.name == "contact"] == ["note"]


@pytest.mark.parametrize(("size", "starts"), [(0.1, (4.0,)), (0.1, (2.0, 4.5, 7.0, 9.5)), (0.02, (4.0,))])
def test_contacts_at_one_joint_are_told_though_the_fit_bends_little_for_them(
    size: float, starts: tuple[float, ...], trial: Trial, tmp_path: Path
) -> None:
    """80 N m for 0.4 s on a UR10 left the other samples as they were but for a half, and nothing was told."""
    tau, time = trial.columns["tau"].copy(), trial.columns["t"] - trial.columns["t"][0]
    for start in starts:
        tau[:, 1] += size * np.abs(tau[:, 1]).max() * ((time > start) & (time < start + 0.3))
    struck = trial.with_columns(tau=tau)
    found = [one for one in struck.examined(tmp_path).findings if one.name == "contact"]
    assert len(found) == (size > 0.05) and all(one.severity == "error" for one in found)
    assert all(one.numbers["fall"] < 2.0 for one in found if len(starts) == 1)
    assert all(one.joint == trial.case.robot.joint_names[1] for one in found)
    assert all(one.evidence.count(",") >= len(starts) - 1 for one in found)  # each with its time
    if found:
        log = trial.case.read(struck.written(tmp_path))
        judged = identify(trial.case, [log], "huber", record=Record(checks=True)).provenance["log_quality"]
        assert [one["severity"] for one in judged[0]["findings"] if one["name"] == "contact"] == ["note"]


@pytest.mark.parametrize(("last", "told"), [(8.0, True), (13.0, False)])
def test_a_contact_of_seconds_is_one_and_half_of_a_log_is_not(
    last: float, told: bool, trial: Trial, tmp_path: Path
) -> None:
    tau, time = trial.columns["tau"], trial.columns["t"] - trial.columns["t"][0]
    held = (
        np.where((time > 5.0) & (time < last), 1.0, 0.0)[:, None] * np.abs(tau).max(axis=0) * np.cos(trial.columns["q"])
    )
    found = trial.with_columns(tau=tau + held).examined(tmp_path).findings
    assert [one.name for one in found if one.severity == "error"][:1] == ["contact"] * told
    for one in (each for each in found if each.name == "contact"):
        assert abs(one.numbers["first"] - 5.0) < 0.6 and abs(one.numbers["last"] - last) < 0.6


def test_the_motion_of_a_log_that_rests_is_no_contact(trial: Trial, tmp_path: Path) -> None:
    count, step = 12 * len(trial.columns["t"]), np.median(np.diff(trial.columns["t"]))
    held = {name: np.concatenate([v, np.repeat(v[-1:], count, axis=0)]) for name, v in trial.columns.items()}
    held["t"][-count:] = trial.columns["t"][-1] + step * np.arange(1, count + 1)
    assert "contact" not in [one.name for one in trial.with_columns(**held).examined(tmp_path).findings]


@pytest.mark.parametrize("shift", [np.pi, -np.pi / 2, 0.0, 0.4])
def test_encoders_whose_zeros_are_half_a_turn_away_are_told_by_the_limits(
    shift: float, trial: Trial, tmp_path: Path
) -> None:
    q = trial.columns["q"]
    joints = tuple(
        replace(joint, limits=replace(joint.limits, lower=float(own.min() - 0.05), upper=float(own.max() + 0.05)))
        for joint, own in zip(trial.case.robot.joints, q.T, strict=True)
    )
    case = replace(trial.case, robot=replace(trial.case.robot, joints=joints))
    found = replace(trial, case=case).with_columns(q=q + shift).examined(tmp_path).findings
    told = [one for one in found if one.name == "position zero" and "shift" in one.numbers]
    assert len(told) == (shift in (np.pi, -np.pi / 2))
    assert all(("[-pi, -pi, -pi]" if shift > 0 else "[pi/2, pi/2, pi/2]") in one.remedy for one in told)
    assert not told or "mounting" not in [one.name for one in found]
