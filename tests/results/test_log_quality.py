"""The section of the report on the quality of the logs."""

from __future__ import annotations

from dataclasses import replace

from synthetic import examined, subject_of

from dynident.results.report.sections.log_quality import LogQuality
from dynident.results.report.subject import Subject


def test_findings_stand_in_the_report_with_evidence_and_next_step() -> None:
    estimate, _ = subject_of(samples=300)
    context = LogQuality().context(Subject(estimate))
    (row,) = context["table"].rows
    assert row[1:4] == ("note", "time jitter", "–")
    assert "8 to 13 ms" in row[4] and "time of the measurement" in row[5]
    assert context["sound"] == [] and context["unfinished"] == []


def test_a_log_without_findings_and_one_not_examined_to_the_end_are_told() -> None:
    estimate, _ = subject_of(samples=300)
    clean = {**examined("a.csv"), "findings": []}
    stopped = {**examined("b.csv"), "left_out": "checks were left out: mend time unit"}
    told = replace(estimate, provenance={"log_quality": [clean, stopped]})
    context = LogQuality().context(Subject(told))
    assert context["sound"] == ["a.csv"]
    assert context["unfinished"] == ["b.csv: checks were left out: mend time unit"]


def test_it_is_left_out_where_logs_were_not_examined() -> None:
    estimate, _ = subject_of(samples=300)
    assert LogQuality().context(Subject(replace(estimate, provenance={}))) == {}
