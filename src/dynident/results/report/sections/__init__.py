"""Sections of the report, a family: one part and one template per file."""

from dynident.plugins import Family
from dynident.results.report.sections.base import Section

SECTIONS: Family[Section] = Family("dynident.results.report.sections", Section, "report section")  # type: ignore[type-abstract]

__all__ = ["SECTIONS", "Section"]
