"""Library and command line are the same verbs with the same defaults."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import dynident
from dynident.api.compare import compare
from dynident.api.estimate_output import summary
from dynident.api.identify import Record
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.diagnosis.warnings import warnings_of
from dynident.errors import BadOption
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.robot import Robot

CASE = """case: 1
robot: arm.json
friction: [viscous, offset]
log: {columns: {time: t}}
preprocessing: {filter: {butterworth: {cutoff_hz: 8}}, trim_s: 0.2}
estimator: {huber: {bound: 3}}
train: run.csv
test: other.csv
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, planar_2r: Robot, exact_log: Callable[..., Log], monkeypatch: pytest.MonkeyPatch) -> None:
    """A case with two logs."""
    monkeypatch.chdir(tmp_path)
    Path("arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    Path("case.yaml").write_text(CASE)
    model = dynident.DynamicModel(planar_2r, ("viscous", "offset"))  # type: ignore[arg-type]
    assert planar_2r.nominal is not None
    for seed, name in enumerate(("run.csv", "other.csv")):
        theta = np.append(planar_2r.nominal, [0.3, 0.1, 0.2, -0.1])
        log = exact_log(model, theta, noise=0.1, seed=seed, samples=1200, rate=200.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), name)


def _without_seconds(figures: dict[str, object]) -> dict[str, object]:
    extras = figures["extras"]
    assert isinstance(extras, dict)
    return {**figures, "extras": {name: value for name, value in extras.items() if name != "seconds"}}


def test_the_library_answers_as_the_command_does(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "case.yaml", "--json", "-o", "estimate.json"]) == 0
    told = json.loads(capsys.readouterr().out)
    case = dynident.read_case("case.yaml")
    estimate = dynident.identify(case)
    found = json.loads(json.dumps(summary(estimate, dynident.validate(estimate, case.test))))
    assert _without_seconds({"schema": 2, **found}) == _without_seconds(told)
    assert found["estimator"] == "huber" and found["diagnostics"] is not None
    named = dynident.validate(estimate)  # the test logs of its case file
    assert named.total_relative_error == dynident.validate(estimate, case.test).total_relative_error
    Path("case.yaml").write_text(CASE.replace("test: other.csv\n", ""))
    with pytest.raises(
        dynident.DynidentError, match=r"case\.yaml names no test logs; write di\.validate\(estimate, log\)"
    ):
        dynident.validate(estimate)
    written = json.loads(Path("estimate.json").read_text())["provenance"]
    assert json.loads(json.dumps({**estimate.provenance, "command": written["command"]})) == written


def test_a_model_with_logs_has_the_defaults_of_a_case_of_its_robot() -> None:
    case = dynident.read_case("case.yaml")
    logs, trust, record = [case.read("run.csv")], TrustOptions(), Record(columns=case.columns)
    by_model = dynident.identify(case.model, logs, "wls", case.preprocessing, trust=trust, record=record)
    by_case = dynident.identify(case, logs, "wls", trust=trust)
    np.testing.assert_array_equal(by_model.beta, by_case.beta)
    assert by_model.columns == by_case.columns and by_model.diagnostics is None
    assert "case" in by_case.provenance and "case" not in by_model.provenance
    with pytest.raises(BadOption, match="give logs with a model"):
        dynident.identify(case.model)


def test_an_estimate_is_written_with_its_warnings() -> None:
    case = dynident.read_case("case.yaml")
    estimate = dynident.identify(case, [case.read("run.csv").rows(slice(0, 300), "cut")], "wls", trust=TrustOptions())
    warnings = list(warnings_of(estimate))
    dynident.write_estimate(estimate, "estimate.json")
    assert json.loads(Path("estimate.json").read_text())["summary"]["warnings"] == warnings


def test_methods_are_compared_on_the_logs_of_a_case() -> None:
    outcomes = list(compare(dynident.read_case("case.yaml"), "wls,huber"))
    assert [outcome.method for outcome in outcomes] == ["wls", "huber"]
    assert all(outcome.test is not None for outcome in outcomes)


def test_a_draft_names_each_log_once() -> None:
    draft = dynident.init("arm.json", "run.csv", test=["other.csv"])
    assert "train: run.csv" in draft.text and not draft.needed
    with pytest.raises(BadOption, match=r"it is the same file as run\.csv"):
        dynident.init("arm.json", ["run.csv", "./run.csv"])
