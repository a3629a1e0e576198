"""Every command in this process: answers, JSON, files, exit codes; progress and remarks apart from answers."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.cli.list_parts import FAMILIES
from dynident.cli.main import COMMANDS, main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.errors import UnknownChoice
from dynident.exports.models import MODEL_EXPORTERS
from dynident.identification.files.estimate_file import read_estimate
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.offset import Offset
from dynident.model.friction.viscous import Viscous
from dynident.model.joint import rotation_about
from dynident.model.robot import Robot

Capture = pytest.CaptureFixture[str]

FIGURES = {"name", "rmse", "rmse_unfiltered", "correlation", "r2", "relative_error"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, planar_2r: Robot, exact_log: Callable[..., Log]) -> Path:
    """A folder with a robot, three logs of it and a case."""
    place = tmp_path_factory.mktemp("cell")
    (place / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    model = DynamicModel(planar_2r, (Coulomb(), Viscous(), Offset()))
    assert planar_2r.nominal is not None
    theta = np.append(planar_2r.nominal, np.tile([0.5, 0.3, 0.1], 2))
    for name, seed, size in (("run", 0, 1.0), ("other", 1, 0.7), ("third", 2, 0.8)):
        log = exact_log(model, theta, noise=0.1, seed=seed, samples=2400, rate=200.0, size=size)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), place / f"{name}.csv")
    (place / "case.yaml").write_text("case: 1\nrobot: arm.json\ntrain: run.csv\ntest: other.csv\nestimator: wls\n")
    return place


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work inside the folder, as somebody at a terminal would."""
    monkeypatch.chdir(folder)
    monkeypatch.delenv("DYNIDENT_DATA", raising=False)


def answered(capsys: Capture, *words: str) -> str:
    assert main(words) == 0
    return capsys.readouterr().out


def answered_json(capsys: Capture, *words: str) -> dict[str, Any]:
    """Return the one JSON object on stdout; nothing else may be there."""
    found = json.loads(
        answered(capsys, *words, "--json"), parse_constant=lambda word: pytest.fail(f"{word} is no JSON")
    )
    assert isinstance(found, dict)
    return found


def refused(capsys: Capture, *words: str) -> str:
    """Return the one line that says why."""
    assert main(words) == 1
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and err.count("\n") == 1
    return err.removeprefix("error: ").rstrip("\n")


def test_without_a_command_there_is_help(capsys: Capture) -> None:
    assert main([]) == 2
    out = capsys.readouterr().out
    assert out.startswith("usage: dynident") and all(command in out for command in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_fits_one_screen_has_an_example_and_names_the_help_with_all_options(
    command: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    texts = []
    for flag in ("--help", "--help-all"):
        with pytest.raises(SystemExit) as caught:
            main([command, flag])
        assert caught.value.code == 0
        texts.append(capsys.readouterr().out)
    short, whole = texts
    assert len(short.splitlines()) <= 40 and re.search(rf"^ *dynident {command}", short, re.MULTILINE)
    flags = [set(re.findall(r"^  (?:-\w \S+, )?(--[a-z-]+)", text, re.MULTILINE)) for text in texts]
    hidden = re.search(r"--help-all shows (\d+) more options", short)
    assert len(flags[1] - flags[0]) == (int(hidden[1]) if hidden else 0) and flags[0] <= flags[1]
    assert len(whole.splitlines()) <= 40 or hidden


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["identify"], "missing: CASE|ROBOT\n"),
        (["list", "robos"], "FAMILY robos: no such choice; choose one of: estimators, "),
        (["list", "ROBOTS"], "; did you mean 'robots'?"),
        (["identify", "a", "--cutoff", "low"], "--cutoff low: a number is needed"),
        (["excite", "a", "--harmonics", "2.5"], "--harmonics 2.5: a whole number is needed"),
        (["export", "a", "--to"], "--to needs a value"),
    ],
)
def test_wrong_usage_is_told_in_words_and_exits_with_2(words: list[str], told: str, capsys: Capture) -> None:
    with pytest.raises(SystemExit) as caught:
        main(words)
    out, err = capsys.readouterr()
    first, second = err.splitlines()
    assert caught.value.code == 2 and out == "" and first.startswith("error: ") and told in f"{first}\n"
    assert second == f"'dynident {words[0]} --help-all' lists all options"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--verison"], "error: no option '--verison'; did you mean '--version'?"),
        (["identify", "a.yaml", "--split", ""], "error: --split is empty; give its value, or leave it out"),
        (["validate", "e.json", "a.csv", " "], "error: LOG is empty; give its value, or leave it out"),
    ],
)
def test_an_unknown_option_and_an_empty_value_are_told(words: list[str], told: str, capsys: Capture) -> None:
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.splitlines()[0] == told


def test_a_mistyped_command_gets_the_nearest_one(capsys: Capture) -> None:
    assert main(["idntify", "arm.yaml"]) == 2
    assert capsys.readouterr().err.startswith("error: no command called 'idntify'; did you mean 'identify'?\n")


def test_a_traceback_only_where_it_is_asked_for(capsys: Capture) -> None:
    for words in (["inspect", "no.urdf", "--debug"], ["--debug", "inspect", "no.urdf"]):
        assert main(words) == 1
        assert "Traceback" in capsys.readouterr().err
    assert "no such file" in refused(capsys, "inspect", "no.urdf")


def test_stopped_by_the_user(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("dynident.case.case.read_case", stop)
    assert main(["inspect", "arm.json"]) == 130
    assert capsys.readouterr().err == "stopped\n"


def test_identify_prints_tables_and_tells_progress_apart(capsys: Capture) -> None:
    assert main(["identify", "arm.json", "run.csv", "--test", "other.csv", "--full"]) == 0
    out, err = capsys.readouterr()
    assert "12 base parameters (6 inertial)" in out and "Izz[link1] + 0.25 m[link2]" in out
    assert "estimator consistent; filter " in out and "physically consistent: yes" in out
    assert "training data: total relative error" in out
    assert "test data: total relative error" in out
    assert all(line.startswith("  ") for line in err.splitlines()) and "estimator consistent" in err
    assert "\x1b" not in out + err  # no colours in a pipe


def test_identify_quietly(capsys: Capture, tmp_path: Path) -> None:
    target = str(tmp_path / "e.json")
    assert main(["identify", "arm.json", "run.csv", "--quiet", "-o", target]) == 0
    out, err = capsys.readouterr()
    assert out and err == "" and Path(target).exists()


def test_the_json_of_identify(capsys: Capture) -> None:
    data = answered_json(capsys, "identify", "arm.json", "run.csv", "--test", "other.csv")
    assert (data["robot"], data["estimator"], data["inertial_base_parameters"]) == ("planar-2r", "consistent", 6)
    assert data["physically_consistent"] is True
    assert isinstance(data["samples"], int) and 500 < data["samples"] <= 2400
    assert 1 < data["condition_number"] < 100
    assert len(data["parameters"]) == 12
    for parameter in data["parameters"]:
        assert set(parameter) == {"name", "value", "unit", "std", "relative_std"}
        assert parameter["relative_std"] == pytest.approx(parameter["std"] / abs(parameter["value"]))
    names = [parameter["name"] for parameter in data["parameters"]]
    assert names[0] == "Izz[link1] + 0.25 m[link2]" and {"mx[link2]", "Fc[joint1]", "F0[joint2]"} <= set(names)
    for part in ("train", "test"):
        assert 0 < data[part]["total_relative_error"] < 0.1
        assert [joint["name"] for joint in data[part]["joints"]] == ["joint1", "joint2"]
        for joint in data[part]["joints"]:
            assert set(joint) >= FIGURES
            assert 0 < joint["relative_error"] < 0.2 and 0.98 < joint["correlation"] <= 1 and 0.9 < joint["r2"] <= 1
            assert joint["rmse"] < 0.5 * joint["rmse_unfiltered"] < 0.1  # the filter takes the noise away
    assert data["filter"] | {"kind": "butterworth", "order": 4, "torque": "same"} == data["filter"]
    choice = data["extras"]["cutoff_choice"]
    assert data["filter"]["cutoff_hz"] == choice["cutoff_hz"] and choice["reason"]
    least = min(row["total"] for row in choice["candidates"])
    low, high = choice["as_good_hz"]
    within = [row["total"] for row in choice["candidates"] if low <= row["cutoff_hz"] <= high]
    assert low <= choice["cutoff_hz"] <= high and max(within) <= 1.1 * least
    assert len(choice["spectra"]["joints"]) == 2


def test_without_a_test_log_there_are_no_test_figures(capsys: Capture) -> None:
    assert answered_json(capsys, "identify", "arm.json", "run.csv")["test"] is None


def test_json_says_nothing_else(capsys: Capture) -> None:
    assert main(["identify", "arm.json", "run.csv", "--json"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("estimator", [["wls", "--option", "iterations=1"], ["wls:iterations=1"]])
def test_options_of_the_command_line(estimator: list[str], capsys: Capture) -> None:
    words = ["identify", "arm.json", "run.csv", "--cutoff", "3", "--estimator", *estimator]
    data = answered_json(capsys, *words, "--rate", "50", "--friction", "viscous")
    assert data["options"]["iterations"] == 1 and data["extras"]["iterations"] == 1
    assert data["filter"]["cutoff_hz"] == 3 and data["filter"]["rate_hz"] == 50
    assert 500 < data["samples"] < 600 and len(data["parameters"]) == 8
    every = answered_json(capsys, "identify", "arm.json", "run.csv", "--rate", "all")
    assert every["filter"]["rate_hz"] == 200 and every["samples"] > 2000  # of the rows that were used


def test_a_split_tests_on_what_was_not_fitted(capsys: Capture) -> None:
    by_share = answered_json(capsys, "identify", "arm.json", "run.csv", "--split", "first:0.67")
    assert by_share["train"]["samples"] == pytest.approx(2 * by_share["test"]["samples"], rel=0.2)
    by_rows = answered_json(capsys, "identify", "arm.json", "run.csv", "--split", "rows:0:1000,1200:2400")
    assert by_rows["test"]["samples"] > by_rows["train"]["samples"]


def test_a_case_says_what_the_command_line_does_not(capsys: Capture) -> None:
    data = answered_json(capsys, "identify", "case.yaml")
    assert data["estimator"] == "wls"
    assert data["train"]["logs"] == ["run.csv"] and data["test"]["logs"] == ["other.csv"]
    other = answered_json(capsys, "identify", "case.yaml", "other.csv", "--test", "run.csv", "--estimator", "ols")
    assert (other["train"]["logs"], other["test"]["logs"]) == (["other.csv"], ["run.csv"])
    assert other["estimator"] == "ols"
    assert answered_json(capsys, "identify", "case.yaml", "other.csv")["test"] is None


def test_several_logs(capsys: Capture) -> None:
    one = answered_json(capsys, "identify", "arm.json", "run.csv", "--cutoff", "5")
    words = ["identify", "arm.json", "run.csv", "other.csv", "--cutoff", "5", "--test", "third.csv"]
    both = answered_json(capsys, *words)
    assert both["samples"] == pytest.approx(2 * one["samples"], rel=0.1)
    assert both["test"]["logs"] == ["third.csv"]


@pytest.mark.parametrize("words", [["run.csv", "run.csv"], ["run.csv", "--test", "run.csv"]])
def test_a_log_counts_once(words: list[str], capsys: Capture) -> None:
    assert main(["identify", "arm.json", *words, "--quiet"]) == 1
    message = (
        "error: run.csv: the same content as run.csv; give each log once, and test on logs that are not trained on"
    )
    assert capsys.readouterr().err == message + "\n"


@pytest.mark.parametrize("output", [["-o", "run.csv"], ["--report", "arm.json"], ["-o", "new", "--report", "new"]])
def test_no_output_overwrites_an_input(output: list[str], capsys: Capture, tmp_path: Path) -> None:
    before = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
    assert main(["identify", "arm.json", "run.csv", "--quiet", *output]) == 1
    assert "choose another name for the output" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in Path().iterdir() if path.is_file()} == before


def test_from_estimate_to_validation_and_report(capsys: Capture, tmp_path: Path) -> None:
    saved, page = str(tmp_path / "e.json"), tmp_path / "r.html"
    words = ["identify", "arm.json", "run.csv", "-o", saved, "--report", str(page), "--test", "other.csv"]
    assert main(words) == 0
    assert f"saved {saved}; next: dynident export {saved} --to urdf" in capsys.readouterr().err
    assert page.read_text().startswith("<!") and "http" not in _sources(page.read_text())
    fresh = answered_json(capsys, "identify", "arm.json", "run.csv", "--test", "other.csv")
    data = answered_json(capsys, "validate", saved, "other.csv")
    assert set(data) == set(fresh) and data["test"] == fresh["test"] and data["parameters"] == fresh["parameters"]
    part = answered_json(capsys, "validate", saved, "other.csv", "--split", "first:0.5")
    assert part["test"]["samples"] < 0.6 * data["test"]["samples"]
    assert main(["validate", saved, "other.csv", "third.csv", "--report", str(tmp_path / "v.html")]) == 0
    out, err = capsys.readouterr()
    assert "test error" in out and "moving samples only" not in out and "validating" in err
    assert f"next: dynident export {saved} --to urdf" in err
    assert main(["validate", saved, "other.csv", "--full"]) == 0
    out, _ = capsys.readouterr()
    assert "total relative error" in out and "moving samples only" in out
    assert main(["report", saved, "--test", "other.csv", "-o", str(tmp_path / "again.html"), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "again.html").stat().st_size > 10_000 and (tmp_path / "v.html").exists()
    assert read_estimate(saved).provenance["logs"][0]["path"] == "run.csv"


def _sources(page: str) -> str:
    """Return what a browser would fetch: the values of src and href."""
    import re

    return " ".join(re.findall(r"""(?:src|href)\s*=\s*["']([^"'#][^"']*)""", page))


def test_inspect(capsys: Capture) -> None:
    out = answered(capsys, "inspect", "arm.json", "--friction", "coulomb", "viscous")
    assert "planar-2r: 2 joints, 2 links" in out
    assert "24 standard -> 10 base parameters (6 inertial, 4 friction and drive)" in out
    assert "exact count by the geometry of the joints: 10, the rank" in out
    data = answered_json(capsys, "inspect", "arm.json", "--friction")
    assert data["exact_base_parameters"] == 6
    assert data["inertial_base_parameters"] == len(data["base_parameters"]) == 6
    assert data["base_parameters"][0] == "Izz[link1] + 0.25 m[link2]"
    assert {entry["verdict"] for entry in data["standard_parameters"]} == {
        "identifiable", "only in combination", "not identifiable",
    }  # fmt: skip
    assert data["joints"][0]["lower"] is None and data["impossible_links"] == {}
    assert answered_json(capsys, "inspect", "case.yaml")["robot"] == "planar-2r"
    assert answered_json(capsys, "inspect", "generic-7r", "--friction")["inertial_base_parameters"] == 43


def test_inspect_tells_what_hardly_shows(planar_2r: Robot, tmp_path: Path, capsys: Capture) -> None:
    """An axis 1e-4 rad off the other: first moments along it appear, and are told apart from the rest."""
    turn = rotation_about(np.array([1.0, 0.0, 0.0]), 1e-4)
    robot = replace(planar_2r, joints=(planar_2r.joints[0], replace(planar_2r.joints[1], rotation=turn)))
    (tmp_path / "off.json").write_text(json.dumps(robot_to_dict(robot)))
    out = answered(capsys, "inspect", str(tmp_path / "off.json"), "--friction")
    data = answered_json(capsys, "inspect", str(tmp_path / "off.json"), "--friction")
    weak = data["weakly_identifiable"]
    assert len(weak) == len(data["base_parameters"]) - 6 > 0 and {entry["name"] for entry in weak} < set(
        data["base_parameters"]
    )
    assert all(1e-5 < entry["share"] < 1e-3 for entry in weak) and 0 < data["neglected_share"] < 1e-5
    assert "weakly identifiable parameters: axes are nearly, but not exactly, parallel" in out
    assert all(entry["name"] in out.split("weakly identifiable")[1] for entry in weak)
    assert "neglected as rounding: combinations that change the torque by a share of" in out
    clear = answered_json(capsys, "inspect", "arm.json", "--friction")
    assert clear["weakly_identifiable"] == [] and clear["neglected_share"] == 0


def test_list(capsys: Capture) -> None:
    out = answered(capsys, "list")
    assert all(family in out for family in FAMILIES)
    data = answered_json(capsys, "list")
    assert set(data) == {"schema", *FAMILIES}
    (coulomb,) = [part for part in data["friction"] if part["name"] == "coulomb"]
    assert {"name": "width", "default": 0.02}.items() <= coulomb["options"][-1].items()
    assert {"abc", "consistent", "ols", "wls"} <= {part["name"] for part in data["estimators"]}
    assert "generic-7r" in {part["name"] for part in data["robots"]}
    for family in FAMILIES:
        shown = answered(capsys, "list", family)
        assert all(part["name"] in shown and part["summary"] for part in data[family])
    assert "iterations (a whole number, default 10): How often" in answered(capsys, "list", "estimators")
    assert "(also: simulink)" in answered(capsys, "list", "model_exporters")
    with pytest.raises(UnknownChoice, match="did you mean 'simulink'"):
        MODEL_EXPORTERS.get("Simulnk")


def test_init_drafts_a_case_that_identify_takes(capsys: Capture, tmp_path: Path) -> None:
    target = tmp_path / "drafted.yaml"
    assert main(["init", "arm.json", "run.csv", "-o", str(target)]) == 0
    out, err = capsys.readouterr()
    assert out == "" and err == f"wrote {target}; next: dynident identify {target}\n"
    assert read_case(target).robot.name == "planar-2r"
    data = answered_json(capsys, "identify", str(target))
    assert data["physically_consistent"] is True and data["test"]["total_relative_error"] < 0.1
    before = target.read_text()
    assert refused(capsys, "init", "arm.json", "run.csv", "-o", str(target)) == (
        f"{target}: it is there already; choose another name with -o, or give --force"
    )
    assert target.read_text() == before
    assert main(["init", "arm.json", "other.csv", "-o", str(target), "--force"]) == 0
    assert "other.csv" in target.read_text()


def test_demo_of_the_article_leaves_files_that_the_other_commands_take(
    capsys: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "er16"
    assert main(["demo", "article", "--out", str(target), "--iterations", "20", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert err == "" and "(a) as published" in out and "(b) virtual" in out
    assert all(word in out for word in ("ABC as published", "L1 optimum", "OLS", "WLS", "consistent"))
    names = {path.name for path in target.iterdir()}
    assert {"report.html", "er16-virtual.yaml", "virtual-beta_1.csv", "virtual-consistent.json"} <= names
    assert not [name for name in names if name.endswith(".part")]
    monkeypatch.chdir(target)
    data = answered_json(capsys, "identify", "er16-virtual.yaml")
    assert data["inertial_base_parameters"] == 15 and data["physically_consistent"] is True
    assert data["test"]["total_relative_error"] < 0.3
    kept = read_estimate("virtual-consistent.json")
    np.testing.assert_allclose([p["value"] for p in data["parameters"]], kept.beta, rtol=0.05, atol=0.5)


UNUSABLE = [
    (["identify", "arm.json"], "LOG is empty; name a log on the command line, or under train:"),
    (["identify", "arm.json", "no.csv"], "no.csv: there is no such file; check the path"),
    (["identify", "no.yaml", "run.csv"], "no.yaml: no such file; give a file, or a built-in example robot"),
    (["identify", "arm.json", "run.csv", "--test", "no.csv"], "no.csv: there is no such file; check the path"),
    (["identify", "arm.json", "run.csv", "--estimator", "wsl"], "no estimator called 'wsl'; choose one of"),
    (["identify", "arm.json", "run.csv", "--option", "pull"], "--option = 'pull' is not possible; write key=value"),
    (["identify", "arm.json", "run.csv", "--option", "pul=1"], "pul = '1' is not possible; the estimator 'consistent'"),
    (["identify", "arm.json", "run.csv", "--option", "pull=x"], "pull = 'x' is not possible; write a value of"),
    (["identify", "arm.json", "run.csv", "--friction", "coulom"], "no friction model called 'coulom'; choose one of"),
    (["identify", "arm.json", "run.csv", "--friction", "coulomb", "coulomb"], "the coefficient Fc is there twice"),
    (["identify", "arm.json", "run.csv", "--split", "third"], "split = 'third' is not possible; write first:0.67"),
    (["identify", "arm.json", "run.csv", "--split", "rows:0:9,9:9999"], "2400 samples, the split ends at 9999"),
    (["identify", "arm.json", "run.csv", "--cutoff", "-1"], "cutoff_hz = -1.0 is not possible; give a frequency"),
    (["identify", "arm.json", "run.csv", "--cutoff", "500"], "run.csv: 200 samples a second cannot carry a cut-off"),
    (["identify", "arm.json", "run.csv", "--rate", "often"], "rate = 'often' is not possible; give samples a second"),
    (["identify", "arm.json", "run.csv", "--rate", "-5"], "rate_hz = -5.0 is not possible; give the samples a second"),
    (["identify", "generic-7r", "run.csv"], "run.csv:1: no column 'q3'"),
    (["validate", "no.json", "run.csv"], "no.json: there is no such file; check the path"),
    (["validate", "run.csv", "run.csv"], "run.csv: line 1 is not JSON"),
    (["validate", "case.yaml", "run.csv"], "a case file is identified first: dynident identify case.yaml -o ESTIMATE"),
    (["validate", "arm.json"], "LOG is not given; name the logs to compare with"),
    (["validate", "arm.json", "run.csv"], "arm.json: no estimate; give a file that 'dynident identify -o' has written"),
    (["report", "arm.json"], "arm.json: no estimate; give a file that 'dynident identify -o' has written"),
    (["inspect", "run.csv"], "run.csv: a log by its ending, where a robot model is wanted"),
    (["inspect", "."], ".: it is a folder; give the robot model file in it"),
    (["inspect", "generic-7"], "generic-7: no such file; give a file, or a built-in example robot"),
    (["init", "arm.json", "no.csv", "-o", "new.yaml"], "no.csv: there is no such file; check the path"),
    (["demo", "--seed", "3", "--out", "never"], "--seed = 3 is not possible; it goes with: dynident demo article"),
    (["demo", "article", "--seed", "-1", "--out", "never"], "--seed = -1 is not possible; give 0 or more"),
    (["demo", "--out", "run.csv/demo"], "run.csv/demo: cannot be made (Not a directory); choose another folder"),
]


@pytest.mark.parametrize(("words", "message"), UNUSABLE, ids=lambda value: " ".join(value)[:50])
def test_one_line_and_nothing_left_behind(words: list[str], message: str, folder: Path, capsys: Capture) -> None:
    before = sorted(folder.rglob("*"))
    quiet = ["--quiet"] if words[0] in ("identify", "validate") else []
    outputs = [*quiet, "-o", "e.json", "--report", "r.html"] if words[0] == "identify" else quiet
    assert message in refused(capsys, *words, *outputs)
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize("option", ["-o", "--report"])
@pytest.mark.parametrize(
    ("place", "message"), [("no/there", "there is no folder 'no'; create it"), (".", "this is a folder; give the name")]
)
def test_a_place_that_cannot_be_written_is_told_before_the_work(
    option: str, place: str, message: str, folder: Path, capsys: Capture
) -> None:
    other = {"-o": ["--report", "r.html"], "--report": ["-o", "e.json"]}[option]
    before = sorted(folder.rglob("*"))
    assert message in refused(capsys, "identify", "arm.json", "run.csv", option, place, *other, "--quiet")
    assert sorted(folder.rglob("*")) == before


def test_an_old_file_stays_whole_when_the_work_fails(tmp_path: Path, capsys: Capture) -> None:
    for name in ("e.json", "r.html"):
        (tmp_path / name).write_text("old")
    words = ["identify", "arm.json", "no.csv", "-o", str(tmp_path / "e.json"), "--report", str(tmp_path / "r.html")]
    refused(capsys, *words, "--quiet")
    assert [(tmp_path / name).read_text() for name in ("e.json", "r.html")] == ["old", "old"]
    assert sorted(os.listdir(tmp_path)) == ["e.json", "r.html"]


def test_decimal_commas_from_case_to_validation(folder: Path, tmp_path: Path, capsys: Capture) -> None:
    """What the case says of the files is kept with the estimate, so that other logs are read alike."""
    for name in ("run", "other"):
        text = (folder / f"{name}.csv").read_text().replace(",", ";").replace(".", ",")
        (tmp_path / f"{name}.csv").write_text(text)
    case = tmp_path / "case.yaml"
    case.write_text(f"case: 1\nrobot: {folder / 'arm.json'}\nlog: {{decimal: ','}}\ntrain: run.csv\n")
    saved, other = str(tmp_path / "e.json"), str(tmp_path / "other.csv")
    found = answered_json(capsys, "identify", str(case), "-o", saved, "--test", other)
    assert answered_json(capsys, "validate", saved, other)["test"]["joints"] == found["test"]["joints"]
    friction = ["--friction", "coulomb", "viscous", "offset"]
    plain = answered_json(capsys, "identify", "arm.json", "run.csv", "--test", "other.csv", *friction)
    assert found["test"]["total_relative_error"] == pytest.approx(plain["test"]["total_relative_error"])


def test_a_log_of_the_fit_is_no_test(capsys: Capture, tmp_path: Path) -> None:
    saved = str(tmp_path / "e.json")
    assert main(["identify", "arm.json", "run.csv", "-o", saved, "--quiet"]) == 0
    capsys.readouterr()
    found = answered_json(capsys, "validate", saved, "run.csv")
    assert found["warnings"][0] == "run.csv: this log was used for training, so its metrics are optimistic"
    warnings = answered_json(capsys, "validate", saved, "other.csv")["warnings"]
    assert not any("used for training" in text for text in warnings)
    for words in (["validate", saved, "run.csv", "--report", "r.html"], ["report", saved, "--test", "run.csv"]):
        assert main([*words, "--quiet"]) == 1
        assert "error: run.csv: the log is among the training logs; test on another log" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--cutoff-hz", "9"], "error: 'identify' has no option '--cutoff-hz'; did you mean '--cutoff'?"),
        (["--zz=3"], "error: 'identify' has no option '--zz'"),
    ],
)
def test_an_option_that_is_not_there_is_named_with_the_nearest(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", "case.yaml", *words]) == 2
    assert capsys.readouterr().err.splitlines() == [said, "'dynident identify --help-all' lists all options"]


def test_names_of_estimators_apart_are_answered_with_the_line_that_works(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", "er16", "--estimators", "wls", "consistent"]) == 2
    said = "error: 'compare' does not take 'consistent'; write names with commas: --estimators wls,consistent"
    assert capsys.readouterr().err.splitlines()[0] == said
    assert main(["compare", "er16", "a.csv", "--estimators", "wls", "b.csv"]) == 2
    assert "it takes CASE|ROBOT LOG and options" in capsys.readouterr().err


def test_a_word_too_many_is_answered_with_what_the_command_takes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", "arm.urdf", "payload=2"]) == 2
    said = "error: 'inspect' does not take 'payload=2'; it takes CASE|ROBOT|PLAN and options"
    assert capsys.readouterr().err.splitlines()[0] == said
