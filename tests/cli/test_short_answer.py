"""What identify prints by default: the answer of one screen."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_answers import documented

from dynident.api.identify import identify
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.estimate.plausibility import ContradictedBound, Plausibility
from dynident.identification.files.estimate_file import read_estimate
from dynident.identification.problem.method_run import recorded_run
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.documents.shape_data import shapes_to_list
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.inertia import Inertia
from dynident.model.robot import Robot
from dynident.model.shapes import Sphere
from dynident.results import short_answer
from dynident.results.plausibility import contradictions, nominal_lines
from dynident.robot_files.formats.urdf import read_urdf

Capture = pytest.CaptureFixture[str]

CASE = """\
case: 2
robot: arm.json
friction: [viscous]
preprocessing: {filter: {butterworth: {cutoff_hz: 8}}}
"""


@pytest.fixture
def folder(tmp_path: Path, planar_2r: Robot, exact_log: Callable[..., Log], monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a case of an arm of two joints and two logs."""
    monkeypatch.chdir(tmp_path)
    model = DynamicModel(planar_2r, (FRICTION.make("viscous"),))
    assert planar_2r.nominal is not None
    for name, seed in (("a.csv", 0), ("b.csv", 1)):
        truth = np.append(planar_2r.nominal, [0.3, 0.2])
        whole = exact_log(model, truth, noise=0.05, samples=1200, rate=200.0, seed=seed)
        write_log(Log(whole.joints, whole.time, whole.q, torque=whole.torque), tmp_path / name)
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    (tmp_path / "case.yaml").write_text(CASE)
    return tmp_path


def shown(capsys: Capture, *words: str) -> str:
    code = main(["identify", "case.yaml", "a.csv", *words, "--quiet", "--no-sensitivity"])
    out, err = capsys.readouterr()
    assert code == 0, err
    return out


@pytest.mark.usefixtures("folder")
def test_the_answer_takes_one_screen(capsys: Capture) -> None:
    out = shown(capsys, "--test", "b.csv")
    lines = out.splitlines()
    assert len(lines) <= 25 and lines[0].endswith("the checks of the training logs found no error")
    told = json.loads(shown(capsys, "--test", "b.csv", "--json"))
    figure = f"{100 * told['test']['total_relative_error']:.2f}".rstrip("0")[:3]
    assert any("test error" in line and figure in line for line in lines)
    count = len(told["parameters"])
    assert any(line.startswith("base parameters: ") and f"of {count} significant" in line for line in lines)
    assert "links: physically consistent" in out and "rel. std" not in out


@pytest.mark.usefixtures("folder")
def test_without_a_test_log_the_answer_says_that_its_error_is_of_the_training(capsys: Capture) -> None:
    out = shown(capsys)
    assert "training error" in out and "no test log: name one with --test" in out and "test error" not in out


@pytest.mark.usefixtures("folder")
def test_all_tables_on_request(capsys: Capture) -> None:
    assert "rel. std" in shown(capsys, "--full")


@pytest.mark.usefixtures("folder")
def test_of_many_joints_those_with_the_largest_errors_are_shown(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(short_answer, "JOINTS", 1)
    out = shown(capsys, "--test", "b.csv")
    told = json.loads(shown(capsys, "--test", "b.csv", "--json"))["test"]["joints"]
    worst, other = sorted((each["name"] for each in told), key=lambda name: -errors(told)[name])
    rows = [line.split()[0] for line in out.splitlines() if line and line.split()[0] in (worst, other)]
    assert rows == [worst] and "and 1 joint with smaller errors" in out


def errors(joints: list[dict[str, object]]) -> dict[str, float]:
    return {str(each["name"]): float(str(each["relative_error"])) for each in joints}


def test_a_warning_ends_at_a_whole_clause() -> None:
    text = "joint2: the model explains 40 % of its variance (R2, mean): check torque signal and friction"
    assert short_answer.warning_lines([text], 110) == [f"warning: {text}"]
    whole = [
        "warning: joint2: the model explains 40 % of its variance (R2, mean): check",
        "  torque signal and friction",
    ]
    assert short_answer.warning_lines([text], 80) == whole
    short = ["warning: joint2: the model", "  explains 40 % of its", "  variance (R2, mean) …"]
    assert short_answer.warning_lines([text], 30) == short
    assert short_answer.warning_lines([80 * "x"], 20) == ["warning: xxxxxxxxxx…"]


def test_a_warning_that_is_cut_keeps_what_to_do() -> None:
    """The half with the cause had been cut at 80 columns."""
    more = 40 * "some evidence "
    text = f"joint2: the test residual is 97 times that of the training; {more}; 'dynident check' looks for it"
    for width in (80, 120):
        shown = short_answer.warning_lines([text], width)
        assert len(shown) <= 3 and all(len(line) <= width for line in shown)
        assert shown[0].startswith("warning: joint2: the test residual is 97 times")
        assert " ".join(" ".join(shown).split()).endswith("training … 'dynident check' looks for it")


def test_warnings_are_a_few_lines_each_at_most_and_the_rest_is_counted() -> None:
    lines = short_answer.warning_lines([f"warning number {k} " + 50 * "x" for k in range(7)], 40)
    assert 5 <= len(lines) <= 13 and all(len(line) <= 40 for line in lines)
    assert lines[-1] == "and 3 more warnings"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("how", ["flag", "key"])
def test_plausible_links_and_what_they_cost(folder: Path, capsys: Capture, how: str) -> None:
    if how == "key":
        (folder / "case.yaml").write_text(CASE + "bodies: plausible\n")
    words = ("--bodies", "plausible") if how == "flag" else ()
    out = shown(capsys, "--test", "b.csv", *words, "-o", "e.json")
    assert "links: physically consistent and plausible" in out and "\nplausible links: test error " in out
    told = json.loads(shown(capsys, "--test", "b.csv", *words, "--json"))
    free = json.loads(shown(capsys, "--test", "b.csv", "--bodies", "free", "--json"))
    assert told["test"]["free_bodies_error"] == pytest.approx(free["test"]["total_relative_error"], rel=1e-9)
    assert "free_bodies_error" not in free["test"] and "plausibility" not in free["extras"]
    kept = Plausibility.of(read_estimate(folder / "e.json").run)
    assert (
        kept == Plausibility.of(recorded_run(told["extras"])) and kept is not None and kept.cost_rise <= kept.cost_limit
    )
    keys = {key.split(".")[0].rstrip("[]") for key in documented("plausibility")}
    assert keys == set(told["extras"]["plausibility"])


@pytest.mark.usefixtures("folder")
def test_a_mass_that_the_data_contradict_is_named(folder: Path, capsys: Capture) -> None:
    robot = json.loads((folder / "arm.json").read_text())
    robot["links"][1]["inertia"] = np.multiply(8.0, robot["links"][1]["inertia"]).tolist()
    (folder / "arm.json").write_text(json.dumps(robot))
    out = shown(capsys, "--test", "b.csv", "--bodies", "plausible", "--report", "r.html")
    line = next(line for line in out.splitlines() if re.match("mass of .*link2.*: the data contradict", line))
    assert re.search("(its bound is|their bounds are) relaxed$", line)
    assert line.split(" (")[0] in (folder / "r.html").read_text()
    links = next(line for line in out.splitlines() if line.startswith("links: "))
    assert re.match(r"links: physically consistent and plausible but for .*mass of link2.* \(bound relaxed\)", links)


def test_a_size_that_the_data_contradict_names_shapes_and_inertia() -> None:
    link2, link3 = (
        ContradictedBound(name, "size", 40.0, 20.0, gain, True) for name, gain in (("link2", 0.1), ("link3", 0.2))
    )
    (words,) = contradictions([link2])
    assert words.startswith("size of link2: the data contradict it (chi-square 40")
    assert "its bound is relaxed; check inertia and shapes in the robot model" in words
    (words,) = contradictions([link2, link3])
    assert words.startswith("size of link2, link3: the data contradict them (chi-square 40")
    assert "20 % lower without the bound, most by link3); their bounds are relaxed" in words
    assert len(contradictions([link2, replace(link3, bound="mass")])) == 2


def test_bodies_are_for_the_estimator_consistent(folder: Path, capsys: Capture) -> None:
    assert main(["identify", "case.yaml", "a.csv", "--estimator", "wls", "--bodies", "free"]) == 1
    assert "--bodies" in capsys.readouterr().err
    (folder / "case.yaml").write_text(CASE + "bodies: plausibel\n")
    assert main(["identify", "case.yaml", "a.csv"]) == 1
    assert "plausible" in capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_a_link_without_size_or_possible_inertia_is_named(folder: Path, capsys: Capture) -> None:
    out = shown(capsys, "--bodies", "plausible")
    assert "no size known for link2: taken from the nominal centre of mass; give shapes" in out
    assert "impossible" not in out and "no inertia of" not in out and "masses of" not in out
    stated = (folder / "arm.json").read_text()
    robot = json.loads(stated)
    robot["links"][1]["inertia"] = [0.0, *robot["links"][1]["inertia"][1:]]
    (folder / "arm.json").write_text(json.dumps(robot))
    assert re.search(r"impossible inertia in the robot model: link2, .*: a uniform body", shown(capsys))
    assert "no size known" not in shown(capsys, "--bodies", "free")
    robot["links"][1]["inertia"] = None
    (folder / "arm.json").write_text(json.dumps(robot))
    assert "masses of link2 are not known: the log does not determine them, and the robot model states none" in shown(
        capsys
    )


@pytest.mark.usefixtures("folder")
def test_a_right_inertia_is_no_fault_of_a_ball_to_touch_with(folder: Path, capsys: Capture) -> None:
    robot = json.loads((folder / "arm.json").read_text())
    robot["links"][1]["shapes"] = shapes_to_list([Sphere(0.02)])
    (folder / "arm.json").write_text(json.dumps(robot))
    out = shown(capsys)
    assert "the robot model's inertia of link2 reaches beyond the link's shapes: its size holds both" in out
    assert not re.search("impossible|data contradict|inertia of link2 is", out)


def test_an_inertia_outside_its_bounds_is_not_called_impossible(planar_2r: Robot) -> None:
    first, last = planar_2r.links
    ball = replace(planar_2r, links=(first, replace(last, shapes=(Sphere(0.3),))))
    facts = Plausibility(1.0, 1.0, 1.0, (), (), fitted=("link2",))
    (thin,), (assumed,) = nominal_lines(ball, facts), nominal_lines(planar_2r, facts)
    assert "inertia of link2 is thinner than links of its size are" in thin and "correct it" in thin
    assert "outside the size and thickness assumed from frames and mass, as there are no shapes" in assumed
    assert "impossible" not in thin + assumed and "give shapes in the robot model" in assumed
    assert nominal_lines(planar_2r, replace(facts, fitted=())) == []
    assert last.inertia is not None
    placeholder = Inertia.from_centre_of_mass(3.6, last.inertia.centre_of_mass, np.eye(3))
    (large,) = nominal_lines(replace(planar_2r, links=(first, replace(last, inertia=placeholder))), facts)
    assert "too large for the mass, as a placeholder is: link2 (1.5 kg/m³ at equal density)" in large


def test_the_mass_of_all_links_stands_with_what_the_data_say_of_it(
    planar_2r: Robot, exact_log: Callable[..., Log]
) -> None:
    """A vertical slide at the base lifts them all; the base carries a part of the mass of an arm that turns."""
    slides = tuple(replace(joint, kind="prismatic") for joint in planar_2r.joints)
    for robot, is_told in ((planar_2r, False), (replace(planar_2r, joints=slides), True)):
        model = DynamicModel(robot, (FRICTION.make("viscous"),))
        assert robot.nominal is not None
        log = exact_log(model, np.append(1.1 * robot.nominal, [0.3, 0.2]), noise=0.05)
        estimate = identify(model, [log], "consistent", Preprocessing(AsGiven(), rest="keep"))
        half, line = short_answer.total_mass_half_width(estimate), short_answer.bodies_line(estimate)
        assert (half is not None) is is_told and ("kg in all (not determined by the data)" in line) is not is_told
        if half is not None and estimate.theta is not None:
            masses = np.array([estimate.theta[9:20:10].sum(), 1.1 * robot.nominal[9:20:10].sum()])
            assert 0 < half < 0.1 * masses[1] and abs(masses[0] - masses[1]) < 2 * half
            assert f"kg in all (± {half:.2g}, 95 %)" in line
            wide = replace(estimate, standard_deviations=np.full(len(estimate.theta), 10.0))
            assert short_answer.bodies_line(wide).endswith(
                "beyond its interval, though no single link's mass is beyond its own"
            )


@pytest.mark.parametrize("stated", [0.02, 0.0])
def test_rotor_inertias_beside_stated_ones_are_said_to_be_so(
    stated: float, planar_2r: Robot, exact_log: Callable[..., Log]
) -> None:
    joints = [replace(own, drive=replace(own.drive, rotor_inertia=stated)) for own in planar_2r.joints]
    robot = replace(planar_2r, joints=tuple(joints))
    model = DynamicModel(robot, tuple(map(FRICTION.make, ("viscous", "rotor_inertia"))))
    assert robot.nominal is not None
    log = exact_log(model, np.append(robot.nominal, [0.3, 0.2, 0.05, 0.05]), noise=0.05)
    lines = short_answer.summary_lines(identify(model, [log], "wls", Preprocessing(AsGiven(), rest="keep")), None)
    told = [line for line in lines if "beside what the robot model states" in line]
    assert told == (
        [
            "rotor inertias are those beside what the robot model states, which may be less than 0: "
            "Ia[joint1] 0.02, Ia[joint2] 0.02"
        ]
        if stated
        else []
    )


def test_the_furthest_mass_stands_with_its_interval_and_only_where_that_does_not_hold_the_nominal_one(
    planar_2r: Robot, exact_log: Callable[..., Log]
) -> None:
    model = DynamicModel(planar_2r, (FRICTION.make("viscous"),))
    assert planar_2r.nominal is not None
    log = exact_log(model, np.append(1.3 * planar_2r.nominal, [0.3, 0.2]), noise=0.05)
    estimate = identify(model, [log], "consistent", Preprocessing(AsGiven(), rest="keep"))
    assert estimate.theta is not None
    masses, nominal = estimate.theta[9:20:10], planar_2r.nominal[9:20:10]
    stds, away = np.full(len(estimate.theta), np.nan), np.abs(masses - nominal)
    for share, is_told in ((0.1, True), (2.0, False)):
        stds[9:20:10] = share * away / 1.96
        line = short_answer.bodies_line(replace(estimate, standard_deviations=stds))
        assert ("; furthest: " in line) is is_told
        assert ("determine no mass of a link alone: they stay near the robot model's" in line) is not is_told
    stds[[9, 19]] = 2.0 * away[0] / 1.96, 0.1 * away[1] / 1.96  # the other one does, however small its change
    line = short_answer.bodies_line(replace(estimate, standard_deviations=stds))
    assert f"furthest: link2 {masses[1]:.3g} ± {0.1 * away[1]:.2g} kg for {nominal[1]:.3g}" in line
    assert "±" not in short_answer.bodies_line(replace(estimate, standard_deviations=None)).partition("furthest")[2]


def test_masses_that_the_data_determine_alone_are_counted(planar_2r: Robot, exact_log: Callable[..., Log]) -> None:
    """A slide tells its mass, whatever carries it does not."""
    text = (
        '<robot name="lift"><link name="base"/><link name="car"><inertial><mass value="60"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="z" type="prismatic"><parent link="base"/><child link="car"/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="1" effort="900" velocity="2"/></joint></robot>'
    )
    lift = read_urdf("lift.urdf", text.encode())
    model = DynamicModel(lift, (FRICTION.make("viscous"),))
    assert lift.nominal is not None
    log = exact_log(model, np.append(lift.nominal, 20.0), noise=5.0)
    line = short_answer.bodies_line(identify(model, [log], "consistent", Preprocessing(AsGiven(), rest="keep")))
    assert "no mass of a link differs from the robot model's beyond its 95 % interval" in line


@pytest.mark.parametrize("name", ["friction curve", "spring"])
def test_friction_beyond_the_parts_is_said_of_its_intervals(
    name: str, planar_2r: Robot, exact_log: Callable[..., Log]
) -> None:
    model = DynamicModel(planar_2r, (FRICTION.make("viscous"),))
    assert planar_2r.nominal is not None
    log = exact_log(model, np.append(planar_2r.nominal, [0.3, 0.2]), noise=0.05)
    estimate = identify(model, [log], "wls", Preprocessing(AsGiven(), rest="keep"))
    finding = {"severity": "note", "name": name, "joint": "joint1, joint2", "evidence": "", "remedy": ""}
    quality = [{"log": "a", "findings": [finding, finding]}]
    told = short_answer.friction_line(replace(estimate, provenance={**estimate.provenance, "log_quality": quality}))
    assert told.startswith("friction of 2 joints is more than the parts of the model") == (name == "friction curve")
    assert bool(told) == (name == "friction curve")
