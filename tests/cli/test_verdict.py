"""The verdict at the surface: faults of a log leave an estimate that is not accepted, right logs one that is."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dynident
from dynident.api.identify import Record
from dynident.api.validate import compared, judged_logs
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.diagnosis.finding import Finding
from dynident.diagnosis.new_log import NewLog
from dynident.diagnosis.verdict import Verdict
from dynident.errors import NotAccepted
from dynident.exports.models import export_model
from dynident.identification.files.estimate_file import read_estimate
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.robot import Robot
from dynident.results.verdict import new_lines, new_log_line, reason_of
from real_data import DATA, real

PANDA = DATA / "panda_gaz2019" / "exciting_traj_1.csv"
CASES = Path(__file__).resolve().parents[2] / "examples" / "cases"

QUICK = ("--cross-validate", "0", "--no-sensitivity", "--quiet")
CASE = "case: 2\nrobot: arm.json\nlog: {columns: {dq: none}}\npreprocessing: {filter: {butterworth: {cutoff_hz: 8}}}\n"

Recorded = Callable[..., Log]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the test."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def recorded(exact_log: Callable[..., Log]) -> Recorded:
    """Make a noisy log of an arm with friction and write arm.json, case.yaml and run.csv; return the log."""

    def make(
        robot: Robot, change: Callable[[Log], Log] = lambda log: log, case: str = "", name: str = "run.csv"
    ) -> Log:
        model = DynamicModel(robot, tuple(dynident.FRICTION.make(part) for part in ("coulomb", "viscous", "offset")))
        assert robot.nominal is not None
        theta = np.append(robot.nominal, np.tile([0.8, 1.2, 0.1], robot.dof))
        log = exact_log(model, theta, samples=1200, rate=50.0)
        torque = np.asarray(log.torque)
        noise = np.random.default_rng(len(name)).normal(size=torque.shape)
        log = Log(log.joints, log.time, log.q, torque=torque + 0.02 * torque.std(axis=0) * noise)
        Path("arm.json").write_text(json.dumps(robot_to_dict(robot)))
        Path("case.yaml").write_text(CASE + case)
        write_log(change(log), name)
        return log

    return make


def answered(capsys: pytest.CaptureFixture[str], code: int, *words: str) -> dict[str, Any]:
    """Return the JSON of a command that ends with a code."""
    assert main([*words, "--json"]) == code, capsys.readouterr()
    found = json.loads(capsys.readouterr().out)
    assert isinstance(found, dict)
    return found


def _turned(log: Log) -> Log:
    return replace(log, torque=np.asarray(log.torque) * [1.0, -1.0, 1.0])


def _swapped(log: Log) -> Log:
    return replace(log, torque=np.asarray(log.torque)[:, [0, 2, 1]])


FAULTS = {
    "mounting": (lambda log: log, "gravity: [0, 0, 9.81]\n"),
    "torque sign": (_turned, ""),
    "torque order": (_swapped, ""),
}


@pytest.mark.parametrize("name", [pytest.param("torque order", marks=pytest.mark.battery), "mounting", "torque sign"])
def test_a_fault_leaves_an_estimate_that_is_not_accepted(
    name: str, spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    change, case = FAULTS[name]
    recorded(spatial_3r, change, case)
    words = ("identify", "case.yaml", "run.csv", "-o", "estimate.json", "--report", "report.html", *QUICK)
    assert main(words) == 4
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].startswith("NOT ACCEPTED: ") and shown[1].startswith(f"error: run.csv: {name}")
    assert len(shown) <= 25 and not [
        line for line in shown if line.startswith(("links:", "base parameters:", "warning:"))
    ]
    estimate = read_estimate("estimate.json")
    (cause,) = answered(capsys, 4, "validate", "estimate.json", "run.csv")["verdict"]["causes"]
    assert cause["name"] == name and cause["log"] == "run.csv" and cause["remedy"]
    page = Path("report.html").read_text(encoding="utf-8")
    verdict = page[page.index('id="verdict"') : page.index('id="robot"')]
    assert "Not accepted" in verdict and 'word good"' not in verdict
    assert main(["export", "estimate.json", "--to", "csv", "-o", "out.csv", "--quiet"]) == 1
    assert name in capsys.readouterr().err and not Path("out.csv").exists()
    assert main(["export", "estimate.json", "--to", "csv", "-o", "out.csv", "--quiet", "--force"]) == 0
    assert main(["report", "estimate.json", "-o", "again.html"]) == 0
    assert f"the estimate is not accepted: {name}" in capsys.readouterr().err
    with pytest.raises(NotAccepted, match=name):
        export_model(estimate, "csv", "other.csv")


@pytest.mark.parametrize("mean", [0.0, 20.0])
def test_a_fit_of_nothing_is_not_accepted(
    mean: float, spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    """Torques that have nothing to do with the motion but their mean."""
    noise = np.random.default_rng(7)
    recorded(spatial_3r, lambda log: replace(log, torque=mean + noise.normal(size=np.shape(log.torque))))
    assert main(["identify", "case.yaml", "run.csv", "-o", "e.json", "--no-check", *QUICK]) == 4
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].startswith("NOT ACCEPTED: it explains next to nothing of its own data")
    assert shown[1].startswith("error: the estimate: nothing explained: at 3 of 3 joints ")
    assert not [line for line in shown if line.startswith("links:")]
    assert main(["export", "e.json", "--to", "csv", "-o", "out.csv", "--quiet"]) == 1
    assert "nothing explained" in capsys.readouterr().err and not Path("out.csv").exists()


def test_links_that_leave_most_of_a_torque_are_not_accepted(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    """Free parameters explain a torque of the wrong sign, links of positive mass do not."""
    recorded(spatial_3r, _turned)
    assert main(["identify", "case.yaml", "run.csv", "-o", "e.json", "--no-check", *QUICK]) == 4
    shown = capsys.readouterr().out.splitlines()
    assert shown[1].startswith("error: the estimate: inconsistent links") and "residual" in shown[1]
    assert main(["export", "e.json", "--to", "csv", "-o", "out.csv", "--quiet"]) == 1


@pytest.mark.parametrize(("factor", "is_wrong"), [(1 / 9.81, True), (1.3, False)])
def test_masses_far_off_those_of_the_robot_model_are_not_accepted(
    factor: float, is_wrong: bool, spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    """Torques in kgf m had passed as links of a tenth of their mass."""
    recorded(spatial_3r, lambda log: replace(log, torque=factor * np.asarray(log.torque)))
    assert main(["identify", "case.yaml", "run.csv", "-o", "e.json", *QUICK]) == 4 * is_wrong
    shown = capsys.readouterr().out
    assert is_wrong == ("error: run.csv: torque unit: the torques are 0.1" in shown)
    assert is_wrong == ("another unit (kgf m, log: units: {torque: 9.80665 N m})" in shown)


def test_rows_far_out_that_a_robust_fit_leaves_out_do_not_speak_against_it(
    spatial_3r: Robot, recorded: Recorded
) -> None:
    def spiked(log: Log) -> Log:
        torque = np.array(log.torque)
        torque[100:1100:100, 1] += 3e3 * torque[:, 1].std()
        return replace(log, torque=torque)

    recorded(spatial_3r, spiked)
    case = dynident.read_case("case.yaml")
    estimate = dynident.identify(
        case.model, [case.read("run.csv")], "huber", case.preprocessing, record=Record(checks=False)
    )
    assert estimate.train.total_relative_error > 0.9
    assert not [one for one in dynident.verdict_of(estimate).causes if one.name == "nothing explained"]


@pytest.mark.parametrize("robot", ["sliding_arm", "scara", pytest.param("planar_3r", marks=pytest.mark.battery)])
def test_a_right_log_speaks_for_itself(
    robot: str, recorded: Recorded, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(request.getfixturevalue(robot))
    found = answered(capsys, 0, "identify", "case.yaml", "run.csv", "-o", "estimate.json", *QUICK)
    verdict = found["verdict"]
    assert (verdict["word"], verdict["causes"], verdict["log_checks_made"]) == ("no criteria", [], True)
    assert main(["export", "estimate.json", "--to", "csv", "-o", "out.csv", "--quiet"]) == 0


def test_a_unit_of_time_stops_the_fit(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(spatial_3r, lambda log: replace(log, time=1e3 * np.asarray(log.time)))
    for words in (("identify", "case.yaml", "run.csv", "-o", "e.json"), ("compare", "case.yaml", "run.csv")):
        assert main([*words, "--quiet"]) == 1
        assert "time unit: the median step is 20 s" in capsys.readouterr().err
    assert not Path("e.json").exists()


def test_without_checks_the_verdict_says_so(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(spatial_3r, lambda log: log, "accept: {log_checks: true}\n")
    assert main(["identify", "case.yaml", "run.csv", "--no-check", *QUICK]) == 3
    out = capsys.readouterr().out
    assert "CRITERIA NOT MET: log_checks" in out and "log checks: not made" in out


def test_the_library_returns_the_verdict_and_raises_where_it_is_asked_to(spatial_3r: Robot, recorded: Recorded) -> None:
    recorded(spatial_3r, _turned)
    case = dynident.read_case("case.yaml")
    logs, trust = [case.read("run.csv")], TrustOptions()
    with pytest.warns(UserWarning, match=r"not accepted: .*torque sign"):
        estimate = dynident.identify(case.model, logs, "wls", case.preprocessing, trust=trust)
    verdict = dynident.verdict_of(estimate)
    assert "NOT ACCEPTED" in repr(estimate) and "torque sign" in estimate.summary()
    assert (verdict.word, verdict.code) == ("not accepted", 4)
    assert [(cause.name, cause.joint) for cause in verdict.causes] == [("torque sign", "joint2")]
    with pytest.raises(NotAccepted, match="torque sign"):
        dynident.identify(case, logs, "wls", record=Record(strict=True))


def test_compare_shows_the_cause_first(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(spatial_3r, _turned)
    assert main(["compare", "case.yaml", "run.csv", "--estimators", "ols,wls", "--quiet"]) == 4
    assert capsys.readouterr().out.splitlines()[1].lstrip().startswith("error: run.csv: torque sign")
    found = answered(capsys, 0, "compare", "case.yaml", "run.csv", "--estimators", "wls", "--no-check", "--quiet")
    assert found["verdict"]["log_checks_made"] is False


def test_warnings_of_the_checks_stand_in_terminal_and_json(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    def spiked(log: Log) -> Log:
        torque = np.array(log.torque)
        torque[[200, 450, 850], 1] += 8 * np.ptp(torque[:, 1])
        return replace(log, torque=torque)

    recorded(spatial_3r, spiked)
    assert main(["identify", "case.yaml", "run.csv", "-o", "estimate.json", *QUICK]) == 0
    assert "warning: run.csv: spikes (joint2): 3 values of torque" in capsys.readouterr().out
    found = answered(capsys, 0, "validate", "estimate.json", "run.csv")
    assert any(text.startswith("run.csv: spikes (joint2)") for text in found["warnings"])
    about = {"severity": "warning", "name": "spikes", "evidence": "", "remedy": ""}
    quality = [{"path": "run.csv", "findings": [{**about, "joint": joint} for joint in ("joint2", "joint2, joint3")]}]
    verdict = dynident.verdict_of(read_estimate("estimate.json"), quality=quality)
    assert reason_of(verdict).endswith("found no error, but 1 warning: spikes (joint2, joint3)")


def test_criteria_are_judged_on_the_test_and_go_with_the_estimate(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(spatial_3r, case="accept: {total_error: 5 %, joint_error: 0.2, consistent: true, log_checks: true}\n")
    recorded(spatial_3r, case=Path("case.yaml").read_text().removeprefix(CASE), name="other.csv")
    words = ("identify", "case.yaml", "run.csv", "--test", "other.csv", "-o", "e.json", *QUICK)
    verdict = answered(capsys, 0, *words, "--accept", "interval=10%")["verdict"]
    assert verdict["word"] == "accepted"
    limits = {each["criterion"]: each["limit"] for each in verdict["criteria"]}
    wanted = {"total_error": 0.05, "joint_error": 0.2, "consistent": None, "log_checks": 0, "interval": 0.1}
    assert limits == wanted and all(each["is_met"] for each in verdict["criteria"])
    tight = answered(capsys, 3, "validate", "e.json", "other.csv", "--accept", "total_error=0.1%", "interval=0.001%")
    missed = {each["criterion"] for each in tight["verdict"]["criteria"] if not each["is_met"]}
    assert tight["verdict"]["word"] == "criteria not met" and missed == {"total_error", "interval"}
    (total,) = [each for each in tight["verdict"]["criteria"] if each["criterion"] == "total_error"]
    assert total["value"] == tight["test"]["total_relative_error"] and total["limit"] == 0.001
    assert total["detail"] == "test data"
    seen = answered(capsys, 0, "validate", "e.json", "run.csv")["verdict"]["criteria"]
    assert "training data" in {each["detail"] for each in seen}


def test_validate_judges_the_new_log(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first line had been about the training logs, whatever the new log was, and log_checks had counted theirs."""
    recorded(spatial_3r, name="swapped.csv", change=_swapped)
    recorded(spatial_3r, name="half.csv", change=lambda log: replace(log, torque=0.2 * np.asarray(log.torque)))
    recorded(spatial_3r, name="still.csv", change=lambda log: replace(log, q=np.repeat(log.q[:1], len(log.q), axis=0)))
    recorded(spatial_3r, name="other.csv")
    recorded(spatial_3r)
    assert main(["identify", "case.yaml", "run.csv", "-o", "e.json", *QUICK]) == 0
    capsys.readouterr()
    main(["validate", "e.json", "still.csv"])
    assert capsys.readouterr().out.startswith("still.csv: no joint moves, so that only the weight is compared (total")
    judged = ("--accept", "total_error=900%", "log_checks")
    found = answered(capsys, 4, "validate", "e.json", "swapped.csv", *judged)["verdict"]
    assert {(cause["log"], cause["name"]) for cause in found["causes"]} == {("swapped.csv", "torque order")}
    checks = next(each for each in found["criteria"] if each["criterion"] == "log_checks")
    assert (checks["value"], checks["is_met"], checks["detail"]) == (1, False, "test data")
    assert found["new_log"]["unlike"] and found["new_log"]["findings"]
    assert main(["validate", "e.json", "swapped.csv"]) == 4
    shown, told = capsys.readouterr()
    first, second = shown.splitlines()[:2]
    assert first.startswith("NOT ACCEPTED: swapped.csv: ") and second.startswith("error: swapped.csv: torque order ")
    assert "next: correct the log, or the case that reads it" in told
    assert main(["validate", "e.json", "half.csv"]) == 4
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].startswith("NOT ACCEPTED: half.csv: the estimate does not explain this log: worse than a constant")
    assert shown[1].startswith("error: half.csv: nothing explained") and "torque unit" in shown[2]

    def made(*_: object) -> None:
        raise AssertionError("the checks were made, and nothing asks for them")

    with monkeypatch.context() as without:
        without.setattr("dynident.api.validate.check_logs", made)
        assert main(["validate", "e.json", "other.csv", "--accept", "total_error=15%"]) == 0
    first, second = capsys.readouterr().out.splitlines()[:2]
    assert first == "ACCEPTED: 1 of 1 criteria met" and second.startswith("other.csv: no joint errs far beyond the tr")
    right = answered(capsys, 0, "validate", "e.json", "other.csv", *judged)["verdict"]
    assert right["word"] == "accepted" and [each["value"] for each in right["criteria"]][1] == 0


@pytest.mark.parametrize(("share", "told"), [(0.9, "drift (elbow)"), (0.08, "name no cause")])
def test_what_explains_little_of_a_residual_is_no_cause_of_a_large_one(share: float, told: str) -> None:
    note = Finding("note", "drift", "elbow", "the torque drifts", "warm it up", {"share": share}).figures()
    new = NewLog("b.csv", 0.2, 0.01, "elbow: far", "", (0, 3), False, (), [{"path": "b.csv", "findings": [note]}], "")
    assert told in " ".join(new_lines(Verdict((), (), is_checked=True, new=new)))


def test_a_new_log_in_which_most_joints_rest_is_as_the_training(spatial_3r: Robot, recorded: Recorded) -> None:
    """What noise leaves of a torque that is constant has no R2 to speak of."""
    log = recorded(spatial_3r)
    case = dynident.read_case("case.yaml")
    estimate = dynident.identify(case.model, [log], "wls", case.preprocessing, record=Record(checks=False))
    model, q = estimate.model, np.array(log.q)
    q[:, 1:] = q[:1, 1:]  # the first axis is vertical: gravity asks nothing of it, and constant torques of the others
    noise = np.random.default_rng(3).normal(size=q.shape)
    speed = np.gradient(q, np.asarray(log.time), axis=0)
    motion = Motion(q, speed, np.gradient(speed, np.asarray(log.time), axis=0))
    torque = (
        model.torque(motion, estimate.base.to_standard(estimate.beta)) + np.asarray(estimate.joint_deviations) * noise
    )
    test = compared(estimate, [Log(log.joints, log.time, q, torque=torque)])
    found = judged_logs(estimate, test, [])
    assert found.quality is None and not found.explains_nothing and not found.unlike
    assert found.resting == log.joints[1:] and not judged_logs(estimate, compared(estimate, [log]), []).resting
    first = f"{', '.join(log.joints[1:])}, moved in the training, rest; no other joint errs far"
    assert first in new_log_line(found)


def test_a_wrong_nominal_model_is_worse_and_the_true_one_is_not(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(spatial_3r)
    true = answered(capsys, 3, "identify", "case.yaml", "run.csv", "--accept", "total_error=0.001%", *QUICK)
    nominal = true["train"]["nominal"]
    assert nominal["friction_fitted"] == pytest.approx(true["train"]["total_relative_error"], rel=0.06)
    assert nominal["nothing_fitted"] > 1.5 * nominal["friction_fitted"]
    assert len(nominal["joints_friction_fitted"]) == len(nominal["joints_nothing_fitted"]) == 3
    assert [link.name for link in spatial_3r.links] == [link["link"] for link in true["links"]]
    half = tuple(
        replace(
            link, inertia=None if link.inertia is None else type(link.inertia).from_vector(0.5 * link.inertia.vector)
        )
        for link in spatial_3r.links
    )
    Path("arm.json").write_text(json.dumps(robot_to_dict(replace(spatial_3r, links=half))))
    found = answered(capsys, 0, "identify", "case.yaml", "run.csv", "--accept", "better_than_nominal", *QUICK)
    (criterion,) = found["verdict"]["criteria"]
    assert criterion["value"] < 0.2 * criterion["limit"] and criterion["is_met"]
    last = found["links"][-1]
    assert last["mass"]["nominal"] == pytest.approx(1.5) and last["inertia_change"] > 0.2


def test_plausible_links_are_a_criterion(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    """Met within all bounds, not with one relaxed (a mass ten times too large) nor without any."""

    def scaled(robot: Robot, factors: tuple[float, ...]) -> Robot:
        bodies = [(link, link.inertia) for link in robot.links if link.inertia is not None]
        links = [
            replace(link, inertia=type(body).from_vector(factor * body.vector))
            for (link, body), factor in zip(bodies, factors, strict=True)
        ]
        return replace(robot, links=tuple(links))

    dense = scaled(spatial_3r, (10.0, 10.0, 10.0))
    recorded(dense)
    answered(capsys, 0, "identify", "case.yaml", "run.csv", "--accept", "plausible", *QUICK)
    free = answered(capsys, 3, "identify", "case.yaml", "run.csv", "--bodies", "free", "--accept", "plausible", *QUICK)
    assert "--bodies plausible" in free["verdict"]["criteria"][0]["detail"]
    Path("arm.json").write_text(json.dumps(robot_to_dict(scaled(dense, (1.0, 1.0, 10.0)))))
    found = answered(capsys, 3, "identify", "case.yaml", "run.csv", "--accept", "plausible", *QUICK)
    assert "relaxed: " in found["verdict"]["criteria"][0]["detail"]


def test_a_robot_model_without_inertias_says_so(
    spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(spatial_3r)
    bare = replace(spatial_3r, links=tuple(replace(link, inertia=None) for link in spatial_3r.links))
    Path("arm.json").write_text(json.dumps(robot_to_dict(bare)))
    assert main(["identify", "case.yaml", "run.csv", "--accept", "better_than_nominal", *QUICK]) == 3
    out = capsys.readouterr().out
    assert "the robot model states no inertias for every link" in out and "CRITERIA NOT MET: better_than_nominal" in out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("accept: {totl_error: 0.1}\n", "line 5, accept: unknown key 'totl_error'"),
        ("accept: {total_error: 5}\n", "accept.total_error: '5' is not possible; write a share above 0"),
        ("accept: {total_error: small}\n", "accept.total_error: 'small' is not possible"),
        ("accept: {consistent: 3}\n", "write consistent: true"),
        ("accept: total_error\n", "accept"),
    ],
)
def test_a_criterion_that_cannot_be_is_named(
    text: str, message: str, spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(spatial_3r, case=text)
    assert main(["identify", "case.yaml", "run.csv", "--quiet"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: case.yaml: ") and message in error


@pytest.mark.parametrize("word", ["totl_error=1%", "total_error", "total_error=-1", "consistent=3"])
def test_a_criterion_of_the_command_line_that_cannot_be_is_named(
    word: str, spatial_3r: Robot, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded(spatial_3r)
    assert main(["identify", "case.yaml", "run.csv", "--quiet", "--accept", word]) == 1
    assert f"error: --accept = '{word}' is not possible; " in capsys.readouterr().err


def _panda(change: Callable[[np.ndarray, list[str]], None], gravity: str = "") -> None:
    """Write the log of the Panda with a change of its columns, and its case."""
    header = PANDA.read_text(encoding="utf-8").partition("\n")[0].split(",")
    values = np.loadtxt(PANDA, delimiter=",", skiprows=1)
    change(values, header)
    np.savetxt("run.csv", values, "%.9g", ",", header=",".join(header), comments="")
    text = (CASES / "panda.yaml").read_text(encoding="utf-8")
    Path("case.yaml").write_text(text.replace("panda_gaz2019/exciting_traj_1.csv", "run.csv") + gravity)


def _negate(values: np.ndarray, header: list[str]) -> None:
    values[:, header.index("tau2")] *= -1


def _exchange(values: np.ndarray, header: list[str]) -> None:
    columns = [header.index("tau2"), header.index("tau4")]
    values[:, columns] = values[:, columns[::-1]]


@pytest.mark.battery
@pytest.mark.parametrize(
    ("change", "gravity", "code"),
    [
        (lambda values, header: None, "", 0),
        (lambda values, header: None, "gravity: [0, 0, 9.81]\n", 4),
        (_negate, "", 4),
        (_exchange, "", 4),
    ],
    ids=["right", "gravity", "sign", "order"],
)
def test_the_panda(
    change: Any, gravity: str, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real("panda_gaz2019", monkeypatch)
    _panda(change, gravity)
    assert main(["identify", "case.yaml", "-o", "estimate.json", *QUICK]) == code
    assert capsys.readouterr().out.startswith("NOT ACCEPTED") is (code == 4)
    assert main(["export", "estimate.json", "--to", "csv", "-o", "out.csv", "--quiet"]) == (1 if code else 0)


def test_the_library_compares_after_the_checks(recorded: Recorded, spatial_3r: Robot) -> None:
    recorded(spatial_3r, _turned, name="turned.csv")
    recorded(spatial_3r)
    right, turned = (dynident.read_case("case.yaml"), dynident.read_case("case.yaml"))
    right, turned = replace(right, train=("run.csv",)), replace(turned, train=("turned.csv",))
    with pytest.warns(UserWarning, match="not accepted: .*torque sign"):
        list(dynident.compare(turned, "wls"))
    with pytest.raises(NotAccepted, match="torque sign"):
        list(dynident.compare(turned, "wls", strict=True))
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        assert len(list(dynident.compare(right, "wls"))) == 1
        assert len(list(dynident.compare(turned, "wls", checks=False))) == 1
