"""Sections of the report, a family: one part and one template per file."""

from dynident.plugins import Family
from dynident.results.report.sections.base import ReportSection

SECTIONS: Family[ReportSection] = Family("dynident.results.report.sections", ReportSection, "report section")  # type: ignore[type-abstract]

__all__ = ["SECTIONS", "ReportSection"]
