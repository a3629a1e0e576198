"""The section of the report on the quality of the logs."""

from __future__ import annotations

from dataclasses import replace

from synthetic import examined, subject_of

from dynident.results.report.sections.log_quality import LogQuality
from dynident.results.report.subject import Subject


def test_findings_stand_in_the_report_with_evidence_and_next_step() -> None:
    estimate, _ = subject_of(samples=300)
    context = LogQuality().context(Subject(estimate))
    (log,) = context["logs"]
    (remark,) = log.remarks
    assert (remark.severity, remark.name, remark.tone) == ("note", "time jitter", "plain")
    assert "8 to 13 ms" in remark.evidence and "time of the measurement" in remark.step
    assert context["sound"] == [] and log.left_out == ""


def test_findings_of_a_report_made_later_take_the_place_of_the_provenance() -> None:
    estimate, _ = subject_of(samples=300)
    later = {
        **examined("c.csv"),
        "findings": [{**examined("c.csv")["findings"][0], "severity": "error", "joint": "j2"}],
    }
    (log,) = LogQuality().context(Subject(estimate, log_quality=(later,)))["logs"]
    assert log.log == "c.csv" and (log.remarks[0].tone, log.remarks[0].name) == ("bad", "time jitter, j2")


def test_a_log_without_findings_and_one_not_examined_to_the_end_are_told() -> None:
    estimate, _ = subject_of(samples=300)
    clean = {**examined("a.csv"), "findings": []}
    stopped = {**examined("b.csv"), "left_out": "checks were left out: fix time unit"}
    told = replace(estimate, provenance={"log_quality": [clean, stopped]})
    context = LogQuality().context(Subject(told))
    assert context["sound"] == ["a.csv"]
    assert [(log.log, log.left_out) for log in context["logs"]] == [("b.csv", "checks were left out: fix time unit")]


def test_it_is_left_out_where_logs_were_not_examined() -> None:
    estimate, _ = subject_of(samples=300)
    assert LogQuality().context(Subject(replace(estimate, provenance={}))) == {}
