"""An estimate as JSON, on the screen or in a file, with the warnings about it, and the files that it was made from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dynident.diagnosis.verdict import Verdict, verdict_of
from dynident.diagnosis.warnings import warnings_of
from dynident.files import check_outputs, files_behind
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.identification.files import estimate_file
from dynident.results.nominal import link_changes


def summary(
    estimate: Estimate,
    test: Validation | None = None,
    verdict: Verdict | None = None,
    warnings: Sequence[str] | None = None,
) -> dict[str, Any]:
    """Return what ``--json`` prints: documented plain data, relative figures as fractions.

    Args:
        estimate: The estimate.
        test: Its figures on data that had no part in the fit.
        verdict: What is made of both, where it is known already.
        warnings: The warnings, where they are known already.
    """
    found = estimate_file.summary(estimate, test, warnings_of(estimate, test) if warnings is None else warnings)
    links = [change.figures() for change in link_changes(estimate)]
    return {"verdict": (verdict or verdict_of(estimate, test)).figures(), **found, "links": links or None}


def write_estimate(estimate: Estimate, path: str | Path, test: Validation | None = None) -> None:
    """Write an estimate as JSON with the warnings about it; the old file or the new one is there, never half of one.

    Args:
        estimate: The estimate.
        path: The file.
        test: Its figures on data that had no part in the fit; they go into the summary.

    Raises:
        FileError: The file cannot be written, or the estimate was made from it.
    """
    check_outputs((str(path),), files_behind(estimate.provenance))
    estimate_file.write_estimate(estimate, path, warnings_of(estimate), test)
