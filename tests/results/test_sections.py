"""What each section of the report says about its subject."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from synthetic import arm, examined, predicted, recorded, subject_of

from dynident.arrays import Array
from dynident.data.log import Source
from dynident.errors import LogMismatch
from dynident.identification.consistency.labels import labels_of
from dynident.identification.estimate.estimate import Consistency, Estimate
from dynident.identification.estimate.validation import NominalErrors, Validation
from dynident.identification.problem.choices import Choices, CutoffRecord, CutoffSensitivity, CutoffTrial
from dynident.identification.problem.method_run import MethodRun, recorded_run
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.inertia import TEN, Inertia
from dynident.model.joint import Mimic
from dynident.model.robot import Link
from dynident.results.report.sections import SECTIONS, friction
from dynident.results.report.sections.verdict import grade, tone
from dynident.results.report.subject import Comparison, Subject
from dynident.results.text import format_percent


@pytest.fixture(scope="module")
def case() -> tuple[Estimate, Validation]:
    return subject_of(samples=600)


@pytest.fixture(scope="module")
def subject(case: tuple[Estimate, Validation]) -> Subject:
    return Subject(case[0], (case[1],))


def context(name: str, subject: Subject) -> dict[str, Any]:
    """Return the context of one section."""
    return SECTIONS.make(name).context(subject)


def with_errors(case: tuple[Estimate, Validation], train: float, tests: Sequence[float]) -> Subject:
    """Return a subject with given total relative errors, the same in motion."""

    def erring(found: Validation, error: float) -> Validation:
        moving = tuple(replace(fit, relative_error=error) for fit in found.moving)
        return replace(found, total_relative_error=error, moving=moving)

    estimate, test = case
    fitted = replace(estimate, train=erring(estimate.train, train))
    return Subject(fitted, tuple(erring(test, error) for error in tests))


def known_to(subject: Subject, relative: Sequence[float]) -> Subject:
    """Return the subject with given relative deviations of its first base parameters, the others known exactly."""
    estimate = subject.estimate
    deviations = np.zeros(estimate.base.count)
    deviations[: len(relative)] = np.asarray(relative) * np.abs(estimate.beta[: len(relative)])
    return replace(subject, estimate=replace(estimate, covariance=np.diag(deviations**2)))


@pytest.mark.parametrize(
    ("error", "word", "colour"),
    [(0.01, "very good", "good"), (0.1, "good", "good"), (0.2, "usable", "fair"), (0.3, "poor", "bad")],
)
def test_words_for_errors(error: float, word: str, colour: str) -> None:
    assert (grade(error), tone(error)) == (word, colour)
    assert (grade(float("nan")), tone(float("nan"))) == ("not known", "bad")


def test_a_small_figure_keeps_its_error_beside_a_long_name_and_draws_three_logs() -> None:
    names = [f"left_arm_shoulder_{k}_lift_joint" for k in range(3)]
    estimate, test = subject_of(arm(names), samples=300)
    quarters = replace(test, starts=(0, 100, 150, 200), logs=test.logs * 4)
    found = context("verdict", Subject(estimate, (quarters,)))
    assert "the first 3 of 4 logs" in found["caption"]
    for plot, fit in zip(found["plots"], test.joints, strict=True):
        assert f">left_arm…{fit.name[18:]}, {format_percent(fit.relative_error)}<" in str(plot)
    assert "logs" not in context("verdict", Subject(estimate, (test,)))["caption"]


def test_the_verdict_on_a_good_model(case: tuple[Estimate, Validation]) -> None:
    found = context("verdict", known_to(with_errors(case, 0.03, [0.04, 0.042]), []))
    prediction, consistency, knowledge = found["answers"]
    assert (prediction.value, prediction.tone) == ("4.2 %", "good")
    assert prediction.meaning == "test error of the torque, largest of 2 tests"
    assert prediction.detail == "training error: 3.0 %"
    assert (consistency.value, consistency.tone) == ("Yes", "good")
    assert (knowledge.value, knowledge.tone) == ("24 of 24", "good")
    assert found["sentences"] == [
        "The test error is 4.2 % of the measured torque: very good.",
        "The parameters are physically consistent: the mass matrix is positive definite in every posture.",
        "Warning: 'five_point' filters the torque and not the regressor: the intervals contain the random "
        "error, not the bias of this and of noisy accelerations; compare with butterworth.",
        "Every base parameter is significant at 95 %.",
    ]


def test_base_parameters_that_are_zero_are_counted_apart(case: tuple[Estimate, Validation]) -> None:
    """A relative deviation of zero says nothing, however large: the largest is that of the others."""
    estimate, _ = case
    worst = int(np.argmax(estimate.relative_std))
    detail = context("verdict", Subject(estimate, ()))["answers"][2].detail
    assert detail.startswith("largest: ") and "at 0" not in detail
    beta = np.where(np.arange(len(estimate.beta)) == worst, 0.0, estimate.beta)
    answer = context("verdict", Subject(replace(estimate, beta=beta), ()))["answers"][2]
    assert f"; 1 at 0, such as {estimate.base.names[worst].split()[0]}" in answer.detail and "inf" not in answer.detail
    known = int(np.sum(np.delete(estimate.relative_std, worst) <= 0.1))
    assert answer.value == f"{known} of {len(beta)}"


@pytest.mark.parametrize(("limit", "tones"), [(0.5, ["good"] * 3), (0.01, ["fair"] * 3)])
def test_an_estimate_that_misses_its_criteria_is_not_praised(
    case: tuple[Estimate, Validation], limit: float, tones: list[str]
) -> None:
    subject = known_to(with_errors(case, 0.03, [0.04]), [])
    stated = {**subject.estimate.provenance, "accept": {"total_error": limit}}
    found = context("verdict", replace(subject, estimate=replace(subject.estimate, provenance=stated)))
    assert [answer.tone for answer in found["answers"]] == tones
    assert ("very good" in found["sentences"][0]) == (tones[0] == "good")


def test_an_estimate_with_warnings_is_not_praised(case: tuple[Estimate, Validation]) -> None:
    """A report had said "very good" under a verdict of which the first word is "Warnings"."""
    subject = known_to(with_errors(case, 0.03, [0.04]), [])
    finding = {"name": "time jitter", "severity": "warning", "joint": "", "evidence": "e", "remedy": "r"}
    quality = [{"path": "run.csv", "findings": [finding]}]
    known = {**subject.estimate.provenance, "log_quality": quality}
    found = context("verdict", replace(subject, estimate=replace(subject.estimate, provenance=known)))
    assert found["word"] == "Warnings" and "very good" not in found["sentences"][0]
    assert [answer.tone for answer in found["answers"]] == ["fair"] * 3


def test_the_verdict_says_what_the_rows_at_rest_do(case: tuple[Estimate, Validation]) -> None:
    subject = with_errors(case, 0.03, [0.3])
    (test,) = subject.tests
    moving = tuple(replace(fit, samples=fit.samples // 2, relative_error=0.036) for fit in test.moving)
    found = context("verdict", replace(subject, tests=(replace(test, moving=moving),)))
    full = "counts samples at rest in full"
    assert found["sentences"][1] == f"It {full}; without them it is 3.6 %."
    held = (test.predicted - 100.0, test.predicted + 100.0)
    found = context("verdict", replace(subject, tests=(replace(test, moving=moving, held=held),)))
    assert found["sentences"][1].startswith("It counts of samples at rest only the torque that static friction")
    assert found["sentences"][1].split("; ")[0].endswith("cannot hold")


def test_the_verdict_on_a_bad_model(case: tuple[Estimate, Validation]) -> None:
    subject = known_to(with_errors(case, 0.1, [0.31]), [0.05, 0.2, 0.6, float("nan"), 3.0, 0.7])
    reasons = tuple(f"link{k}: the mass is -{k} kg" for k in range(1, 6))
    subject = replace(subject, estimate=replace(subject.estimate, consistency=Consistency(False, reasons, -1.0)))
    found = context("verdict", subject)
    assert [answer.tone for answer in found["answers"]] == ["bad", "bad", "fair"]
    assert found["answers"][1].detail == "5 conditions broken"
    assert found["answers"][2].value == "19 of 24"
    assert found["sentences"] == [
        "The test error is 31 % of the measured torque: poor.",
        "That is 3.1 times the training error: see in the residuals whether the tests leave the training range, "
        "or only have smaller torques or more noise.",
        "The parameters are physically inconsistent (link1: the mass is -1 kg; link2: the mass is -2 kg; link3: the "
        "mass is -3 kg and 2 more): use the model to predict torques near the recorded motions, not to simulate, or "
        "identify with a physically consistent estimator.",
        "4 of 24 base parameters are not significant at 95 %: Iyy[link of joint2] + …, Iyz[link of joint2], "
        "Izz[link of joint2] + … and 1 more. They have little effect on the recorded torques, and on those of similar "
        "motions. Do not rely on their values.",
    ]


def test_the_verdict_without_a_test_says_so(case: tuple[Estimate, Validation]) -> None:
    subject = with_errors(case, 0.03, [])
    found = context("verdict", subject)
    answer = found["answers"][0]
    assert (answer.value, answer.detail, answer.tone) == ("3.0 %", "no test on other data", "fair")
    flatters = "training error is optimistic"
    assert found["sentences"][:2] == [
        "The training error is 3.0 % of the measured torque.",
        f"No log was held out, and {flatters}: record a second, different motion and test on it with --test LOG.",
    ]
    gone = context("verdict", replace(subject, why_no_test="run.csv is gone"))["sentences"][1]
    assert gone.startswith(f"No test can be repeated (run.csv is gone), and {flatters}")


def test_the_first_screen_has_errors_beside_those_of_the_robot_model_and_torques_of_the_worst_test(
    case: tuple[Estimate, Validation],
) -> None:
    subject = with_errors(case, 0.03, [0.04, 0.06])
    nominal = NominalErrors(0.5, 0.9, (0.41, 0.42, 0.43), (0.9, 0.9, 0.9), {})
    tests = (subject.tests[0], replace(subject.tests[1], nominal=nominal, logs=("worst.csv",)))
    found = context("verdict", replace(subject, tests=tests))
    assert (found["data"].name, found["data"].logs) == ("Test 2", "worst.csv")
    assert "joint2 robot model, friction fitted 42 %, identified" in found["errors"]
    assert "total robot model, friction fitted 50 %, identified 6.0 %" in found["errors"]
    assert [plot.stem for plot in found["plots"]] == ["overview-joint1", "overview-joint2", "overview-joint3"]
    alone = context("verdict", with_errors(case, 0.03, []))
    assert alone["data"].name == "Training" and "robot model" not in alone["errors"]


def test_the_word_of_the_verdict_and_its_reason(case: tuple[Estimate, Validation]) -> None:
    def said(limit: float | None, quality: Sequence[dict[str, Any]] = ()) -> tuple[str, str, str]:
        subject = replace(with_errors(case, 0.03, [0.04]), log_quality=tuple(quality))
        stated = {**subject.estimate.provenance, "accept": {} if limit is None else {"total_error": limit}}
        found = context("verdict", replace(subject, estimate=replace(subject.estimate, provenance=stated)))
        return found["word"], found["reason"], found["tone"]

    assert said(None) == ("Log checks passed", "the checks of the training logs found no error", "fair")
    assert said(0.05) == ("Accepted", "1 of 1 criteria met", "good")
    assert said(0.01) == ("Criteria not met", "total_error", "bad")
    wrong = examined("run.csv")
    wrong["findings"][0]["severity"] = "warning"
    word, reason, tone = said(None, [wrong, examined("other.csv")])
    name = wrong["findings"][0]["name"]
    assert (word, tone) == ("Warnings", "fair") and f"found no error, but 1 warning: {name}" in reason
    wrong["findings"][0]["severity"] = "error"
    word, reason, tone = said(0.05, [wrong])
    assert (word, tone) == ("Not accepted", "bad") and reason.startswith("the log checks have 1 finding at error level")


def test_samples_that_the_fit_kept_apart_are_named(case: tuple[Estimate, Validation]) -> None:
    subject, split = with_errors(case, 0.03, []), "samples:0:300,300:700"
    logs = [{"path": "run.csv", "split": split}]
    parted = replace(subject, estimate=replace(subject.estimate, provenance={"logs": logs}))
    said = context("verdict", parted)["sentences"][1]
    assert f"test on it with --test LOG --split {split}, since" in said and "kept a part of its log apart" in said


def test_the_verdict_on_a_test_without_torque(case: tuple[Estimate, Validation]) -> None:
    found = context("verdict", with_errors(case, 0.03, [float("nan")]))
    assert found["answers"][0].value == "–"
    assert found["sentences"][0].endswith("is – of the measured torque: not known.")


def test_the_robot_and_what_is_wrong_with_its_description(subject: Subject) -> None:
    robot = arm(["a", "b", "c", "d"], sliding=True)
    flat = Inertia.from_centre_of_mass(2.0, [0, 0, 0], np.diag([0.1, 0.1, 0.3]))
    links = (Link("bare"), Link("flat", flat, ("camera", "")), *robot.links[2:])
    joints = (*robot.joints[:2], replace(robot.joints[2], mimic=Mimic("b")), robot.joints[3])
    strange = replace(robot, links=links, joints=joints, coupling=np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]))
    model = DynamicModel(strange, subject.estimate.model.friction)
    only_the_model = SimpleNamespace(estimate=SimpleNamespace(model=model))
    found = context("robot", cast(Subject, only_the_model))
    assert ("Joints and links", "3 joints that move on their own, 4 links") in found["facts"]
    assert ("Friction model", "coulomb (width 0.02), viscous, offset") in found["facts"]
    assert found["joints"].rows[2][1] == "revolute, follows b"
    assert found["joints"].rows[3] == ("d", "prismatic", "-3.14159", "3.14159", "m", "3", "–", "200", "N")
    assert found["drives"].note == "Motor speed = [[1 0.5 0] [0 1 0] [0 0 1]] times joint speed."
    assert found["links"].rows[0] == ("bare", "–", "–", "–", "–", "not stated")
    assert found["links"].rows[1][0] == "flat (with camera, (no name))"
    assert found["links"].rows[1][-1] == (
        "no: the principal moments 0.1, 0.1, 0.3 kg m^2 break the triangle inequality"
    )


def test_logs_filters_and_files(case: tuple[Estimate, Validation]) -> None:
    estimate, test = subject_of(samples=600, logs=("a.csv", "b.csv"))
    other = replace(test, filter={"kind": "butterworth", "cutoff_hz": 5.0, "rate_hz": None})
    found = context("data", Subject(estimate, (test, other), sources=(Source("t.csv", "", 0, ("first half",)),)))
    assert found["logs"].rows == (
        ("Training", "a.csv", "600", "5.990", "100.0"),
        ("Training", "b.csv", "600", "5.990", "100.0"),
        ("Test 1", "runs/test.csv", "600", "5.990", "100.0"),
        ("Test 2", "runs/test.csv", "600", "5.990", "100.0"),
    )
    assert list(found["filters"]) == ["Training", "Test 1", "Test 2"]
    assert found["filters"]["Test 2"] == [("kind", "butterworth"), ("cut-off [Hz]", "5")]
    files = [(file.use, file.path, file.rows, file.sha256[-2:], file.steps) for file in found["sources"]]
    smoothing = ("five-point cubic smoothing, 10 times",)
    assert files == [
        ("Training", "a.csv", "600", "00", smoothing),
        ("Training", "b.csv", "600", "01", smoothing),
        ("Test", "t.csv", "–", "–", ("first half",)),
    ]
    assert list(context("data", Subject(estimate, (test,)))["filters"]) == [""]
    simulated = replace(estimate, provenance={"logs": [vars(Source())]})
    assert context("data", Subject(simulated))["sources"][0].path == "simulated"


def test_names_of_logs_in_short(case: tuple[Estimate, Validation]) -> None:
    estimate, test = case

    def called(*names: str) -> str:
        starts = tuple(range(len(names)))
        return Subject(estimate, (replace(test, logs=names, starts=starts),)).held_out[0].logs

    assert called("/data/a.csv", "C:\\data\\b.csv", "c.csv") == "a.csv, b.csv, c.csv"
    assert called("one/a.csv", "two/a.csv") == "one/a.csv, two/a.csv"
    assert called("a/1", "a/2", "a/3", "a/4", "a/5") == "1, 2, 3 and 2 more"
    assert called("", "simulated log") == "(no name), simulated log"


def test_thinned_signals_are_told_apart(case: tuple[Estimate, Validation]) -> None:
    estimate, test = case
    some = {
        name: getattr(estimate.train, name)[::3] for name in ("time", "q", "dq", "measured", "unfiltered", "predicted")
    }
    subject = Subject(replace(estimate, train=replace(estimate.train, **some)), (test,))
    training, held_out = subject.datasets
    assert (training.thinned, held_out.thinned) == (True, False)
    assert training.remark == "Drawn from 200 of 600 rows, as the estimate file keeps them."
    assert held_out.remark == ""
    assert context("data", subject)["logs"].rows[0] == ("Training", "runs/train.csv", "600", "5.970", "–")
    assert context("torques", subject)["captions"][0][1].endswith(training.remark)
    residuals = context("residuals", subject)
    assert [row[7] for row in residuals["table"].rows[:3]] == ["–"] * 3
    assert [len(figures) for _, figures in residuals["groups"]] == [3, 4]  # no spectrum of thinned rows


def test_base_parameters_are_shown_by_unit_from_the_largest(subject: Subject) -> None:
    found = context("parameters", known_to(subject, [0.3, 0.1, float("nan"), 0.7]))
    assert (found["count"], found["standard"], found["inertial"]) == (24, 39, 15)
    assert found["significant"] == 22
    estimate = subject.estimate
    assert len(found["charts"]) == len(set(estimate.base.units)) > 2
    for chart, unit in zip(found["charts"], dict.fromkeys(estimate.base.units), strict=True):
        own = [k for k in np.argsort(-np.abs(estimate.beta), kind="stable") if estimate.base.units[k] == unit]
        assert f"{len(own)} values in" in chart and f"the largest: {estimate.base.names[own[0]]} " in chart


def test_bodies_have_the_values_of_their_inertia_and_the_worst_verdict(subject: Subject) -> None:
    estimate = subject.estimate
    assert estimate.theta is not None
    found = context("bodies", subject)
    for i, (name, cells, remark) in enumerate(found["bodies"].rows):
        inertia = Inertia.from_vector(np.asarray(estimate.theta)[10 * i : 10 * i + 10])
        about = inertia.about_centre
        expected = [inertia.mass, *inertia.centre_of_mass, *np.diag(about), about[0, 1], about[0, 2], about[1, 2]]
        assert [float(cell.text) for cell in cells] == pytest.approx(expected, rel=1e-3, abs=1e-12)
        assert (name, remark) == (f"link of joint{i + 1}", "yes")
    ten = found["ten"].rows
    assert [column.heading for column in found["ten"].columns] == list(TEN)
    for i, (_, cells, _) in enumerate(ten):
        assert [cell.verdict for cell in cells] == [label.word for label in labels_of(estimate)[10 * i : 10 * i + 10]]
    assert [cell.sign for cell in ten[0][1]].count("○") == 9  # a first link that turns about z shows Izz only
    assert {cell.verdict for cell in found["bodies"].rows[0][1]} == {"not determined"}


def test_an_impossible_link_is_called_so(subject: Subject) -> None:
    theta = np.array(subject.estimate.theta)
    theta[9] = -2.0
    found = context("bodies", replace(subject, estimate=replace(subject.estimate, theta=theta)))
    assert found["bodies"].rows[0][2] == "no: the mass is -2 kg"


def test_both_tables_of_a_validation(subject: Subject) -> None:
    found = context("validation", subject)["found"]
    assert [entry.dataset.name for entry in found] == ["Training", "Test"]
    assert [row[1] for row in found[0].all_rows.rows] == ["600"] * 3
    assert [row[1] for row in found[0].moving.rows] == [str(fit.samples) for fit in subject.estimate.train.moving]
    assert found[0].all_rows.note.startswith("kind five_point, order 3, repeats 10")


def test_figures_of_residuals(subject: Subject) -> None:
    rows = context("residuals", subject)["table"].rows
    residual = subject.tests[0].residual[:, 1]
    data, joint, unit, mean, deviation, largest, at, memory, factor = rows[4]
    assert (data, joint, unit, factor) == ("Test", "joint2", "N·m", "–")
    assert float(mean) == pytest.approx(residual.mean(), abs=6e-4)
    assert float(deviation) == pytest.approx(residual.std(), abs=6e-4)
    assert float(largest) == pytest.approx(residual[np.argmax(np.abs(residual))], abs=6e-4)
    assert float(at) == pytest.approx(subject.tests[0].time[np.argmax(np.abs(residual))], abs=0.006)
    assert float(memory) == pytest.approx(np.corrcoef(residual[1:], residual[:-1])[0, 1], abs=0.01)
    assert rows[0][-1] == "1.70"


def test_a_perfect_fit_has_figures_too(case: tuple[Estimate, Validation]) -> None:
    estimate, test = case
    subject = Subject(estimate, (replace(test, predicted=test.measured),))
    found = context("residuals", subject)
    assert found["table"].rows[3][3:] == ("0", "0", "0", "0.00", "–", "–")
    assert len(found["groups"][1][1]) == 3  # no spectrum of nothing


@pytest.mark.parametrize("coupled", [False, True])
def test_friction_is_the_torque_that_friction_adds_to_the_model(coupled: bool) -> None:
    robot = arm(sliding=True)
    if coupled:
        robot = replace(robot, coupling=np.array([[1.0, 0, 0], [0.3, 1, 0], [0, -0.5, 2]]))
    model = DynamicModel(robot, ("coulomb", "viscous", "offset", "rotor_inertia"))  # type: ignore[arg-type]
    generator = np.random.default_rng(2)
    theta = generator.normal(size=len(model.parameters))
    q, dq = generator.normal(size=(2, 50, 3))
    still = Motion(q, dq, np.zeros_like(dq))
    without = theta.copy()
    without[model.inertial_count :] = 0.0
    at_joints = model.torque(still, theta) - model.torque(still, without)
    at_drives = friction.friction_torque(model, theta, q, dq)
    assert at_drives @ np.asarray(robot.coupling) == pytest.approx(at_joints)


def test_friction_coefficients_and_their_deviations(subject: Subject) -> None:
    estimate = subject.estimate
    rows = context("friction", subject)["table"].rows
    assert [row[:2] for row in rows[:4]] == [("joint1", "Fc"), ("joint1", "Fv"), ("joint1", "F0"), ("joint2", "Fc")]
    names = list(estimate.base.names)
    assert float(rows[0][3]) == pytest.approx(estimate.std[names.index("Fc[joint1]")], rel=0.06)
    bare = replace(subject, estimate=replace(estimate, theta=None))
    for row in context("friction", bare)["table"].rows:
        place = names.index(f"{row[1]}[{row[0]}]")
        assert float(row[2]) == pytest.approx(estimate.beta[place], abs=0.51 * estimate.std[place])


def test_friction_that_needs_more_than_speeds_has_no_curve(subject: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> Array:
        raise LogMismatch("run.csv", "no temperatures", "record them")

    monkeypatch.setattr(friction, "friction_torque", refuse)
    found = context("friction", subject)
    assert found["refused"] == "No curves: run.csv: no temperatures; record them."
    assert found["figures"] == []
    assert found["table"].rows


def test_more_data_sets_than_are_drawn(case: tuple[Estimate, Validation]) -> None:
    estimate, test = case
    subject = Subject(estimate, (test,) * 6)
    assert len(context("validation", subject)["found"]) == 7
    for name, key in (("torques", "captions"), ("residuals", "groups"), ("motion", "groups")):
        found = context(name, subject)
        assert len(found[key]) == 4
        assert found["left_out"] == "Figures show the first 4 of 7 data sets; the tables have all."


def test_convergence_of_searches(subject: Subject) -> None:
    traces = {"other": [30.0, 3.0], "broken": [], "strange": [1.0, float("nan")]}
    found = context("convergence", replace(subject, comparison=Comparison(traces=traces)))
    assert found["optimum"] == "1.90000"
    assert [row[:2] for row in found["table"].rows] == [("other", "2"), ("abc", "50")]
    assert found["table"].rows[0][2:] == ("30.0000", "3.00000", "58")
    alone = replace(subject.estimate, run=MethodRun(trace=[]))
    assert context("convergence", replace(subject, estimate=alone)) == {}


def test_provenance_in_words(subject: Subject) -> None:
    estimate = replace(
        subject.estimate,
        run=recorded_run(
            {"trace": [1.0], "box": {"lower": list(range(20)), "source": "Table 3"}, "gap": None, "polished": True}
        ),
        provenance={"versions": {"numpy": "2.4.6"}, "case": "a.yaml", "command": ["dynident", "identify"], "logs": []},
    )
    found = context("provenance", replace(subject, estimate=estimate))
    groups = dict(found["groups"])
    assert groups["Estimator"] == [("method", "abc"), ("colony", "30"), ("limit", "15"), ("seed", "0")]
    assert groups["What the method reports"] == [
        ("box lower", "20 values"),
        ("box source", "Table 3"),
        ("gap", "–"),
        ("polished", "yes"),
    ]
    assert groups["Origin"] == [("versions numpy", "2.4.6"), ("case", "a.yaml")]
    assert found["command"] == ["dynident identify"]
    both = context("provenance", replace(subject, estimate=estimate, command="dynident report a.json"))
    assert both["command"] == ["dynident identify", "dynident report a.json"]


def test_a_chosen_cut_off_stands_with_what_was_found_and_not_in_the_provenance(subject: Subject) -> None:
    first = subject.estimate.base.names[0]
    rows = [(4.0, first), (8.0, first), (16.0, "x")]
    table = tuple(CutoffTrial(hertz, 0.012345, 0.5, name, 0.5, name, ()) for hertz, name in rows)
    chosen = CutoffRecord(8.0, (4.0, 16.0), "8 Hz, the middle of 4 to 16 Hz", 1.0, (), {})
    found = Choices(cutoff_choice=chosen, cutoff_sensitivity=CutoffSensitivity(8.0, 5, table))
    given = replace(subject, estimate=replace(subject.estimate, run=MethodRun(), choices=found))
    said = context("choices", given)
    assert said["reason"] == "8 Hz, the middle of 4 to 16 Hz" and said["tables"] == ()
    rows = said["cutoff"].rows
    assert [row[0] for row in rows] == ["4", "8", "16"] and {row[1] for row in rows} == {"1.23"}
    assert "<var>" in rows[0][2] and rows[1][2:] == ("the fit's own", "–") and rows[2][2:] == ("x", "0.50")
    assert "What the method reports" not in dict(context("provenance", given)["groups"])


def test_what_a_solver_leaves_of_a_zero_is_shown_as_zero(case: tuple[Estimate, Validation]) -> None:
    """Interior points stop at about 1e-8 of what they find; a centre of mass is small beside the body, too."""
    theta = np.array(case[0].theta)
    inertia = Inertia.from_centre_of_mass(
        4.0, [2e-9, -3e-9, 0.0], [[0.05, 1e-10, 0], [1e-10, 0.06, 2e-4], [0, 2e-4, 0.02]]
    )
    theta[:10] = inertia.vector
    first = context("bodies", Subject(replace(case[0], theta=theta), (case[1],)))
    said = {
        c.heading: cell.text.strip()
        for c, cell in zip(first["bodies"].columns, first["bodies"].rows[0][1], strict=True)
    }
    assert [said[name] for name in ("centre x", "y", "z", "Ixy", "Ixz")] == ["0"] * 5
    assert float(said["Iyz"]) == 2e-4 and float(said["Ixx"]) == 0.05


def test_a_sliding_robot_has_its_own_units() -> None:
    estimate, test = subject_of(arm(sliding=True), samples=400)
    subject = Subject(estimate, (test,))
    assert [row[2] for row in context("validation", subject)["found"][0].all_rows.rows] == ["N·m", "N·m", "N"]
    _, figures = context("residuals", subject)["groups"][0]
    assert len(figures) == 5  # three joints, a spectrum in N m and one in N
    assert "speed [m/s]" in figures[2]
    logs = [recorded(estimate.model, np.asarray(estimate.theta), 200, 50.0, 4, "more.csv", 0.1)]
    assert predicted(estimate, logs).samples == 200
    assert base_parameters(estimate.model).count == estimate.base.count
