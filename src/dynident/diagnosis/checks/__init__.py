"""Log checks, a family: each looks at one side of a log and returns findings; `examination.py` calls them in order."""

from __future__ import annotations

from dynident.diagnosis.checks.base import Check, CheckedLog
from dynident.plugins import Family

CHECKS: Family[Check] = Family("dynident.diagnosis.checks", Check, "check")  # type: ignore[type-abstract]

__all__ = ["CHECKS", "Check", "CheckedLog"]
