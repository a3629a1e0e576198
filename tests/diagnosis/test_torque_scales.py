"""The scale of one joint's torque: told with figure and interval, told as open where the log does not know it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.all_joints import SCALE
from benchmarks.faults.clean import case_of, findings_of, log, robot, written
from benchmarks.faults.moved_links import moved
from benchmarks.faults.trials import Trial, subject_of, virtual
from benchmarks.strangers.plant import urdf

from dynident.case.case import Case, read_case
from dynident.data.formats import ColumnMap
from dynident.data.preprocessing import default_preprocessing
from dynident.diagnosis.causes.body_consistency import BEYOND, inconsistency
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.thin_fit import asked_inertias, quick_fit
from dynident.diagnosis.causes.torque_scales import JointScale, is_sure, joint_scales, mixing_of, other_scales
from dynident.diagnosis.checks import CHECKS
from dynident.diagnosis.checks.base import CheckedLog
from dynident.diagnosis.checks.torque_scale import against_nominal
from dynident.diagnosis.examination import examine
from dynident.diagnosis.finding import Finding
from dynident.diagnosis.recording import read_recording
from dynident.model.friction import FRICTION, default_friction
from dynident.model.robot import Robot

LAST = 5


@pytest.fixture(scope="module")
def trial() -> Trial:
    return virtual(read_case("er16"))


def scales_of(trial: Trial, folder: Path) -> tuple[JointScale, ...]:
    fit = quick_fit(trial.case, trial.case.read(trial.written(folder)))
    assert isinstance(fit, QuickFit)
    return joint_scales(fit)


def warned(trial: Trial, folder: Path) -> list[Finding]:
    return [one for one in trial.examined(folder).findings if one.severity != "note"]


def test_a_right_log_has_right_scales_and_says_which_it_does_not_know(trial: Trial, tmp_path: Path) -> None:
    scales = scales_of(trial, tmp_path)
    assert not other_scales(scales)
    assert [scale.is_open for scale in scales] == [False] * LAST + [True]  # the last axis carries next to nothing
    for scale in scales[:LAST]:
        assert abs(np.log(scale.factor)) < 3 * max(scale.spread, 1e-3)
    (note,) = [one for one in trial.examined(tmp_path).findings if one.name == "scale not determined"]
    assert note.severity == "note" and note.joint == trial.case.robot.joint_names[LAST]
    assert "cannot be determined" in note.evidence and "masses of the robot model" in note.remedy


@pytest.mark.parametrize(
    ("robot", "times"),
    [("er16", {1: 2.0, 2: 3.0}), pytest.param("generic-7r", {3: 7.0, 4: 7.0, 5: 7.0}, marks=pytest.mark.battery)],
)
def test_several_torques_in_other_scales_are_no_other_robot(
    robot: str, times: dict[int, float], tmp_path: Path
) -> None:
    """Percent of rated torques, say: no joint alone explains the log, and the links are right."""
    trial = virtual(read_case(robot))
    columns = {key: values.copy() for key, values in trial.columns.items()}
    columns["tau"][:, list(times)] *= list(times.values())
    (error,) = warned(replace(trial, columns=columns), tmp_path)
    names = [trial.case.robot.joint_names[k] for k in times]
    assert (error.severity, error.name, error.joint) == ("error", "torque scales", ", ".join(names))
    for name, factor in zip(names, times.values(), strict=True):
        assert error.numbers[f"factor {name}"] == pytest.approx(1 / factor, rel=0.06)


@pytest.mark.parametrize("joint", [1, 2])
def test_a_gain_that_is_some_percent_off_is_a_warning(joint: int, trial: Trial, tmp_path: Path) -> None:
    """All bodies behind the joint are off by as much, while the torques fit well."""
    (found,) = warned(put.scaled(trial, -0.07, joint), tmp_path)
    assert (found.severity, found.name) == ("warning", "torque scale")
    assert found.joint == trial.case.robot.joint_names[joint]
    assert abs(found.numbers["value"] + 0.07) < max(found.numbers["half_width"], 0.003)
    assert not warned(trial, tmp_path)


@pytest.mark.parametrize("times", [[1.0] * 6, [1.0, 0.6, 2.0, 0.4, 1.5, 1.0]])
def test_torques_of_motors_before_their_gears_are_one_error(trial: Trial, times: list[float], tmp_path: Path) -> None:
    """The scale of one joint against the others and the unit of all follow from each other: one of the two is told."""
    columns = {key: values.copy() for key, values in trial.columns.items()}
    columns["tau"] /= np.multiply(80.0, times)
    (error,) = warned(replace(trial, columns=columns), tmp_path)
    assert (error.severity, error.name) == ("error", "torque unit" if times[0] == times[1] else "torque units")
    if error.name == "torque units":
        assert "before their gears" in error.remedy and len(error.numbers) > 2
        told = {
            f"ratio {name}": 0.0125 / factor for name, factor in zip(trial.case.robot.joint_names, times, strict=True)
        }
        assert all(error.numbers[name] == pytest.approx(told[name], rel=0.5) for name in error.numbers)


@pytest.mark.parametrize(
    ("joint", "times"),
    [
        pytest.param(0, 0.495, marks=pytest.mark.battery),
        pytest.param(1, 2.0, marks=pytest.mark.battery),
        (2, 1.25),
        pytest.param(2, 20.0, marks=pytest.mark.battery),
    ],
)
def test_a_wrong_scale_is_an_error_with_the_factor_that_mends_it(
    trial: Trial, joint: int, times: float, tmp_path: Path
) -> None:
    (found,) = warned(put.scaled(trial, times - 1, joint), tmp_path)
    assert (found.severity, found.name) == ("error", "torque scale")
    assert found.joint == trial.case.robot.joint_names[joint]
    assert found.numbers["factor"] * times == pytest.approx(1, abs=0.02)
    assert found.numbers["low"] < found.numbers["factor"] < found.numbers["high"]
    mended = put.scaled(trial, times * found.numbers["factor"] - 1, joint)  # the remedy, obeyed
    assert not warned(mended, tmp_path)


@pytest.mark.parametrize("times", [0.2, pytest.param(5.0, marks=pytest.mark.battery)])
def test_a_scale_that_the_log_does_not_know_gets_no_figure(trial: Trial, times: float, tmp_path: Path) -> None:
    assert not warned(put.scaled(trial, times - 1, LAST), tmp_path)
    assert scales_of(put.scaled(trial, times - 1, LAST), tmp_path)[LAST].is_open


def test_where_friction_is_chosen_the_rotors_may_have_inertia(trial: Trial) -> None:
    """Without it the torque of a light wrist seems to have another scale."""
    plain = tuple(part for part in trial.case.friction if not all(part.is_inertia))
    for choose in (False, True):
        asked = asked_inertias(replace(trial.case, friction=plain, choose_friction=choose))
        assert asked == set(trial.case.robot.joint_names if choose else ())


def test_two_joints_that_explain_a_log_alike_are_both_named() -> None:
    first = JointScale("a", 2.0, 1.98, 2.02, 4.0)
    like, other = JointScale("b", 0.5, 0.49, 0.51, 3.9), JointScale("c", 1.5, 1.4, 1.6, 1.6)
    assert other_scales([other, like, first]) == (first, like)
    assert not other_scales([JointScale("a", 1.1, 1.05, 1.15, 4.0)])  # too near one
    assert not other_scales([JointScale("a", 3.0, 0.0, np.inf, 0.9)])  # a model error without an interval
    assert JointScale("a", 3.0, 0.0, np.inf, 0.9).spread == np.inf


def test_a_scale_without_an_end_is_not_sure(trial: Trial, tmp_path: Path) -> None:
    """Such a torque has nothing to do with the bodies: the weight that a torso's effort leaves out, or noise alone."""
    subject = subject_of(put.scaled(trial, 1.0, 1), tmp_path)
    assert subject.fit is not None
    best = subject.scales[1]
    assert is_sure(subject.fit, best)
    assert not is_sure(subject.fit, replace(best, high=np.inf))


def test_masses_judge_the_torque_of_a_joint_in_its_own_scale(trial: Trial, tmp_path: Path) -> None:
    """Else the unit of all torques is blamed beside the joint."""
    subject = subject_of(put.scaled(trial, 19.0, 1), tmp_path)
    assert subject.fit is not None
    theta = subject.fit.model.nominal()
    assert theta is not None
    ratio, alike, _ = against_nominal(subject.fit, theta, mixing_of(subject.fit, other_scales(subject.scales)[0]))
    assert ratio == pytest.approx(1, abs=0.01) and alike > 0.99
    ratio, alike, _ = against_nominal(subject.fit, theta, None)
    assert ratio > 2 and alike < 0.9


@pytest.mark.battery
@pytest.mark.parametrize("robot", ["er16", "generic-6r", "generic-7r"])
def test_every_known_scale_of_every_joint_is_found(robot: str, tmp_path: Path) -> None:
    clean = virtual(read_case(robot))
    known = [not scale.is_open for scale in scales_of(clean, tmp_path)]
    for joint in np.flatnonzero(known):
        for times in (0.05, 0.2, 0.495, 0.8, 1.25, 2.0, 2.5, 4.0, 20.0):
            (best, *_) = other_scales(scales_of(put.scaled(clean, times - 1, int(joint)), tmp_path))
            assert best.joint == clean.case.robot.joint_names[joint], times
            assert best.factor * times == pytest.approx(1, abs=0.02), times


@pytest.mark.parametrize(
    ("factor", "told"), [(1.0, ""), (1.3, "torque scale"), (4.0, "torque unit"), (0.05, "torque unit")]
)
def test_an_earlier_estimate_tells_a_common_scale_where_the_robot_model_has_no_masses(
    trial: Trial, factor: float, told: str, tmp_path: Path
) -> None:
    robot = trial.case.robot
    bare = replace(robot, links=tuple(replace(link, inertia=None) for link in robot.links))
    earlier = trial.estimate(tmp_path)
    faulty = replace(trial.with_columns(tau=factor * trial.columns["tau"]), case=replace(trial.case, robot=bare))
    against = [
        one for one in faulty.examined(tmp_path, earlier).findings if one.name in ("torque scale", "torque unit")
    ]
    assert [one.name for one in against] == [told] * bool(told)
    assert all("the earlier estimate" in one.evidence for one in against)
    assert not [one for one in faulty.examined(tmp_path).findings if one.name in ("torque scale", "torque unit")]


def test_an_arm_of_one_joint_has_no_scale_and_its_sign_shows(pendulum: Robot, tmp_path: Path) -> None:
    """It shares no column with another joint; friction that drives it, and its mass, name one cause."""
    friction = tuple(FRICTION.make(name) for name in default_friction())
    joints = tuple(replace(joint, damping=2.0, friction=3.0) for joint in pendulum.joints)
    robot = replace(pendulum, joints=joints)
    right = virtual(Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing()))
    assert not warned(right, tmp_path)
    (found,) = warned(put.turned(right, ("tau",), 0), tmp_path)
    assert (found.severity, found.name) == ("error", "torque sign")


def test_links_that_no_torque_of_this_scale_can_have_are_told(trial: Trial, tmp_path: Path) -> None:
    fit = quick_fit(trial.case, trial.case.read(trial.written(tmp_path)))
    assert isinstance(fit, QuickFit) and inconsistency(fit) is None
    faulty = put.scaled(trial, -0.7, 1)
    fit = quick_fit(faulty.case, faulty.case.read(faulty.written(tmp_path)))
    assert isinstance(fit, QuickFit)
    found = inconsistency(fit)
    assert found is not None and found.rise > BEYOND * found.chance
    assert found.link in [link.name for link in trial.case.robot.links]
    names = [one.name for one in faulty.examined(tmp_path).findings]
    assert "torque scale" in names and "inconsistent links" not in names  # the cause is told, not what follows


def links_told(trial: Trial, folder: Path) -> list[str]:
    """Return what the check of the links tells of a log by itself."""
    recording = read_recording(trial.case, str(trial.written(folder)))
    subject = CheckedLog(trial.case, recording, recording)
    return [one.name for one in CHECKS.make("link_consistency").findings(subject)]


def test_links_are_told_beside_friction_that_the_case_lacks(trial: Trial, tmp_path: Path) -> None:
    columns = trial.columns
    loaded = columns["tau"] * (1.0 + 0.1 * np.sign(columns["tau"]) * np.tanh(columns["dq"] / 0.005))
    right = trial.with_columns(tau=loaded)
    assert links_told(right, tmp_path) == []
    assert links_told(put.scaled(right, -0.7, 1), tmp_path) == ["inconsistent links"]


@pytest.mark.battery
@pytest.mark.parametrize("seed", [122, 410])
def test_links_are_not_told_for_friction_that_the_case_lacks(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Right logs whose free fit takes load friction for bodies: the rise falls where the friction is taken off."""
    pytest.importorskip("pinocchio")
    from benchmarks.faults.clean import told

    found, _ = told(seed, tmp_path)
    assert "inconsistent links" not in [one.name for one in found]
    monkeypatch.setattr(QuickFit, "explained_by", lambda fit, torque: fit)  # nothing is taken off
    found, _ = told(seed, tmp_path)
    assert "inconsistent links" in [one.name for one in found]


@pytest.mark.parametrize(
    ("gears", "name"), [((80.0, -100.0, 121.0), "torque side"), ((100.0, 100.0, 100.0), "torque unit")]
)
def test_torques_of_the_other_side_of_the_gears_are_told_with_the_line_that_mends_it(
    gears: tuple[float, ...], name: str, case: Case, tmp_path: Path
) -> None:
    """Gears that are all alike are no other than a unit, whose finding has the side as well."""
    active = {joint.name: joint.drive for joint in case.robot.active}
    drives = {
        name: replace(drive, gear_ratio=turns) for (name, drive), turns in zip(active.items(), gears, strict=True)
    }
    joints = replace(case, robot=case.robot.with_drives(drives))
    motors = replace(joints, columns=replace(joints.columns, motor=("torque",)))
    log = virtual(joints)
    turned = log.with_columns(tau=log.columns["tau"] / gears)
    for stated, one, line in ((joints, turned, "{torque: motor}"), (motors, log, "{torque: link}")):
        (found,) = warned(replace(one, case=stated), tmp_path)
        assert (found.name.removesuffix("s"), found.severity) == (name, "error")
        assert (line if name == "torque side" else "log: side") in found.remedy
    assert not warned(log, tmp_path) and not warned(replace(turned, case=motors), tmp_path)


@pytest.mark.parametrize("seed", [5, 7])
def test_a_factor_of_all_torques_is_told_by_the_masses_of_the_robot_model(seed: int, tmp_path: Path) -> None:
    """No residual shows it: twice the torque had been silent, and four times a warning. Each mass is off by 15 %."""
    bodies = robot(np.random.default_rng([24, seed]))
    columns, side = log(np.random.default_rng([25, seed]), bodies, urdf("arm", bodies, seed))
    for factor, severity, name in (
        (1.0, "", ""),
        (0.5, "warning", SCALE),
        (2.0, "warning", SCALE),
        (4.0, "error", "torque unit"),
    ):
        made = findings_of({**columns, "tau": factor * columns["tau"]}, urdf("arm", bodies), side, tmp_path)
        found = [one for one in made if one.name in (SCALE, "torque unit") and not one.joint]
        assert [(one.severity, one.name) for one in found] == [(severity, name)] * (factor != 1.0)
        if severity == "warning":
            assert abs(found[0].numbers["value"] + 1.0 - factor) < found[0].numbers["half_width"] < 0.2 * factor
            assert "cannot tell this from masses" in found[0].evidence
        if severity == "error":
            assert abs(found[0].numbers["ratio"] - factor) < found[0].numbers["half_width"] < 0.5 * factor
            assert f"{found[0].numbers['ratio']:.3g} (+- " in found[0].evidence


@pytest.mark.parametrize(("seed", "factor"), [(1, 2.6), (13, 2.2)])
def test_another_unit_is_told_once(seed: int, factor: float, tmp_path: Path) -> None:
    """`torque scale` had told the inverse of its figure beside it."""
    right = moved(seed, "right")
    case = right.case(tmp_path)
    written({**right.columns, "tau": factor * right.columns["tau"]}, tmp_path / "run.csv")
    found = [one for one in examine(case, str(tmp_path / "run.csv")).findings if not one.joint]
    (unit,) = [one for one in found if one.name in (SCALE, "torque unit")]
    assert unit.name == "torque unit" and f"{unit.numbers['ratio']:.3g} (+- " in unit.evidence


def test_a_base_that_leans_is_an_error_where_the_remedy_predicts_unseen_samples(tmp_path: Path) -> None:
    """Beside so much noise the residual falls by less than a reading must: a warning until then, and exit code 0."""
    bodies, generator = robot(np.random.default_rng([24, 7])), np.random.default_rng(7)
    columns, side = log(np.random.default_rng([25, 7]), bodies, urdf("arm", bodies, 7))
    columns["tau"] += 0.3 * columns["tau"].std(axis=0) * generator.normal(size=columns["tau"].shape)
    written(columns, tmp_path / "run.csv")
    upright = case_of(urdf("arm", bodies), side, tmp_path)
    leaning = replace(upright, robot=replace(upright.robot, gravity=9.81 * np.array([0.0471, 0.0733, -0.9962])))
    (error,) = [one for one in examine(leaning, str(tmp_path / "run.csv")).findings if one.severity != "note"]
    assert (error.severity, error.name) == ("error", "tilt") and "is tilted by 5" in error.evidence
    stated = np.array(re.findall(r"-?[0-9.]+", error.remedy.partition("gravity:")[2]), float)[:3]
    for gravity in (upright.robot.gravity, stated):
        mended = examine(replace(upright, robot=replace(upright.robot, gravity=gravity)), str(tmp_path / "run.csv"))
        assert not [one for one in mended.findings if one.severity != "note"]
