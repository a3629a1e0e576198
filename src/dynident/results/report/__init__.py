"""The report: one self-contained page, a section per file."""

from dynident.results.report.builder import build_plan_page, build_report, write_plan_page, write_report
from dynident.results.report.subject import Comparison, Subject

__all__ = ["Comparison", "Subject", "build_plan_page", "build_report", "write_plan_page", "write_report"]
