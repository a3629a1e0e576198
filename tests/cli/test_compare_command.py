"""dynident compare: the table, its order, JSON as documented, the report, Ctrl-C, and what is refused."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_answers import documented

from dynident.api.compare import jobs_that_pay, methods_of, split_names
from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.estimators.wls import WLS
from dynident.identification.files.estimate_file import write_estimate
from dynident.identification.identify import identify
from dynident.identification.problem.problem import Problem
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory, planar_2r: Robot, exact_log: Callable[..., Log]) -> Path:
    """A robot with friction in its robot model, the same without inertias, two logs, and a case."""
    place = tmp_path_factory.mktemp("cell")
    joints = tuple(replace(joint, damping=0.3, friction=0.5) for joint in planar_2r.joints)
    robot = replace(planar_2r, joints=joints)
    blind = replace(robot, links=tuple(replace(link, inertia=None) for link in robot.links))
    (place / "true.json").write_text(json.dumps(robot_to_dict(robot)))
    (place / "arm.json").write_text(json.dumps(robot_to_dict(blind)))
    model = DynamicModel(robot, (Coulomb(), Viscous()))
    theta = model.nominal()
    assert theta is not None
    for name, seed, size in (("run", 0, 1.0), ("other", 1, 0.7)):
        log = exact_log(model, theta, noise=0.1, seed=seed, samples=1200, rate=100.0, size=size)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), place / f"{name}.csv")
    lines = ["case: 1", "robot: arm.json", "friction: [coulomb, viscous]", "train: run.csv", "test: other.csv"]
    (place / "case.yaml").write_text("\n".join([*lines, "estimator:", "  huber: {bound: 2}", ""]))
    return place


@pytest.fixture(autouse=True)
def inside(cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(cell)
    monkeypatch.delenv("DYNIDENT_DATA", raising=False)


def test_the_table_is_in_the_order_of_the_test_error(capsys: Capture) -> None:
    words = ["case.yaml", "--estimators", "ols,wls,map,consistent,de:iterations=3", "--truth", "true.json"]
    assert main(["compare", *words]) == 0
    shown, said = capsys.readouterr()
    assert shown.startswith("planar-2r: 2 joints, ") and "to test on\nfilter kind butterworth" in shown
    head, _, *rows = shown.split("\n\n")[1].splitlines()
    for heading in ("test error [%]", "training error [%]", "above wls [%]", "parameter error [%]", "consistent"):
        assert heading in head
    names = [row.split()[0] for row in rows]
    assert sorted(names) == ["consistent", "de:iterations=3", "map", "ols", "wls"]
    assert names[-2:] == ["de:iterations=3", "map"]  # map asks for inertias that the robot model does not state
    errors = [float(row.split()[1]) for row in rows[:-1]]
    assert errors == sorted(errors)
    assert re.search(r"^map: .*; .*$", shown, re.MULTILINE)
    assert "the known truth has a test error of " in shown
    assert "  wls (2 of 5)\n" in said


def test_json_is_documented_and_true(capsys: Capture) -> None:
    assert main(["compare", "case.yaml", "--estimators", "wls,map", "--truth", "true.json", "--json"]) == 0
    shown, said = capsys.readouterr()
    data: dict[str, Any] = json.loads(shown)
    assert data.pop("schema") == 2 and data.pop("verdict")["causes"] == data.pop("warnings") == []
    first, failed = data["methods"]
    produced = {key for key in data if key not in ("methods", "base_parameters")}
    produced |= {f"base_parameters[].{key}" for key in data["base_parameters"][0]}
    assert produced | {f"methods[].{key}" for key in first} == documented("compare") and said == ""
    assert (first["method"], first["failure"], first["options"]) == ("wls", None, {"iterations": 10, "tolerance": 1e-3})
    case = read_case("case.yaml")
    estimate = identify(case.model, [case.read("run.csv")], "wls", case.preprocessing)
    assert first["training_error"] == estimate.train.total_relative_error
    np.testing.assert_array_equal(first["values"], estimate.beta)
    assert [parameter["name"] for parameter in data["base_parameters"]] == list(estimate.base.names)
    assert 0 < first["parameter_error"] < 0.05 and [joint["name"] for joint in first["joints"]] == ["joint1", "joint2"]
    assert first["as_the_best"] is True and 0 < data["truth_error"] < 2 * first["test_error"]
    assert failed["failure"] and failed["test_error"] is None and failed["values"] == []
    assert data["stopped"] is False


def test_an_estimate_can_be_the_truth(capsys: Capture) -> None:
    case = read_case("case.yaml")
    write_estimate(identify(case.model, [case.read("run.csv")], "consistent", case.preprocessing), "known.json")
    assert main(["compare", "case.yaml", "--estimators", "consistent", "--truth", "known.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["methods"][0]["parameter_error"] < 1e-6
    assert main(["compare", "case.yaml", "--truth", "known.json", "--friction", "coulomb", "viscous", "offset"]) == 1
    assert "known.json: no parameter" in capsys.readouterr().err


def test_the_report_is_about_the_estimator_of_the_case(capsys: Capture) -> None:
    words = ["case.yaml", "--estimators", "wls,huber,map,ga:iterations=2,pso:iterations=2", "--report", "page.html"]
    assert main(["compare", *words, "--quiet"]) == 0
    page = Path("page.html").read_text(encoding="utf-8")
    assert "Comparison of estimators" in page and "failed: " in page and "Convergence" in page
    verdict, _, _ = page.partition("Comparison of estimators")
    assert "huber" in verdict
    assert capsys.readouterr().err == ""


def test_without_test_logs_the_order_is_that_of_the_fit(capsys: Capture) -> None:
    assert main(["compare", "arm.json", "run.csv", "--estimators", "wls,ols", "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert "no test logs: the order is that of the training error" in shown and "held-out" not in shown


def test_ctrl_c_shows_what_is_done(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    ols = ESTIMATORS.get("ols")

    def interrupted(self: object, problem: Problem) -> Iterator[None]:
        raise KeyboardInterrupt

    monkeypatch.setattr(ols, "solve", interrupted)
    assert main(["compare", "case.yaml", "--estimators", "wls,ols,huber", "--report", "none.html"]) == 130
    shown, said = capsys.readouterr()
    assert "\nwls " in shown and "huber " not in shown
    assert said.endswith("stopped: 1 of 3 methods done\n") and not Path("none.html").exists()


def test_each_method_is_told_as_it_ends_and_quick_ones_come_first(capsys: Capture) -> None:
    assert main(["compare", "case.yaml", "--estimators", "wls,ols", "--no-check"]) == 0
    lines = capsys.readouterr().err.splitlines()
    told = [
        line.split(": test error")[0].strip() for line in lines if re.search(r": test error [\d.]+ %, [\d.]+ s$", line)
    ]
    assert told == ["wls", "ols"]
    assert lines.index("  ols (2 of 2)") > next(k for k, line in enumerate(lines) if line.startswith("  wls: test"))
    assert main(["compare", "case.yaml", "--estimators", "wls", "--no-check", "--quiet"]) == 0
    assert capsys.readouterr().err == ""
    case = read_case("case.yaml")
    quick, every = ([method.label for method in methods_of(case, word)] for word in ("quick", "all"))
    searches, simulated = {"abc", "de", "ga", "pso"}, {"clie", "cloe", "didim", "iv", "kalman"}
    assert set(every) == set(ESTIMATORS.names()) and every[: len(quick)] == quick
    assert set(every[-4:]) == searches and set(every[-9:-4]) == simulated and not {*quick} & (searches | simulated)
    assert {"wls", "ols", "consistent"} < set(quick[:5])


def test_names_and_options_are_told_apart() -> None:
    assert split_names("wls, huber:bound=2,abc:lower=-1,-2,.5:seed=1,ols") == [
        "wls",
        "huber:bound=2",
        "abc:lower=-1,-2,.5:seed=1",
        "ols",
    ]
    assert split_names("tls:exact=[a,b],wls") == ["tls:exact=[a,b]", "wls"]
    case = read_case("case.yaml")
    found = {method.label: method.part for method in methods_of(case, "all,huber:bound=3,wls", seed=5)}
    assert list(found)[-1] == "huber:bound=3" and sorted(list(found)[:-1]) == sorted(ESTIMATORS.names())
    assert found["wls"] == WLS() and found["huber"] == ESTIMATORS.make("huber", {"bound": 2.0})  # as the case states
    assert found["huber:bound=3"] == ESTIMATORS.make("huber", {"bound": 3.0})
    assert found["abc"] == ESTIMATORS.make("abc", {"seed": 5})
    (stated,) = methods_of(case, "abc:seed=7", seed=5)
    assert stated.part == ESTIMATORS.make("abc", {"seed": 7})


@pytest.mark.parametrize(
    ("names", "processors", "jobs"),
    [("quick", 8, 1), ("wls,clie", 8, 1), ("wls,clie,abc", 8, 2), ("clie,abc,ga:iterations=2", 2, 2)],
)
def test_methods_that_take_long_run_side_by_side(
    names: str, processors: int, jobs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dynident.api.compare.usable_processors", lambda: processors)
    assert jobs_that_pay(methods_of(read_case("case.yaml"), names)) == jobs


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--estimators", "wls,hubber"], "no estimator called 'hubber'; choose one of: abc"),
        (["--estimators", "wls,,ols"], "--estimators = 'wls,,ols' is not possible; write names with commas"),
        (["--estimators", "wls:steps=3"], "steps = '3' is not possible; the estimator 'wls' has the options"),
        (["--estimators", "wls:3"], "--estimators = 'wls:3' is not possible; write options behind a name"),
        (["--seed", "-1"], "--seed = -1 is not possible; give 0 or more"),
        (["--time-limit", "0", "--estimators", "wls"], "time limit = 0.0 is not possible"),
        (["--jobs", "0", "--estimators", "wls"], "jobs = 0 is not possible"),
        (["--truth", "arm.json", "--estimators", "wls"], "arm.json: link 'link1': no inertia"),
        (["--report", "run.csv"], "run.csv: it is an input of this command"),
        (["run.csv", "--test", "run.csv"], "the same content as run.csv"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(words: list[str], message: str, capsys: Capture) -> None:
    assert main(["compare", "case.yaml", *words, "--quiet"]) == 1
    shown, said = capsys.readouterr()
    assert shown == "" and said.startswith("error: ") and message in said and said.count("\n") == 1
