"""An estimate as JSON, on the screen or in a file, with the warnings about it, and the files that it was made from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynident.data.log_places import is_address
from dynident.diagnosis.verdict import Verdict, verdict_of
from dynident.diagnosis.warnings import warnings_of
from dynident.files import check_outputs, files_behind, sha256_of
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


if TYPE_CHECKING:  # what simulates servos takes half a second to load
    from dynident.actuators.estimate import ActuatorEstimate

#: Folders above that of the estimate that are searched: results often lie in a folder beside the logs.
_ABOVE = 2


def file_of_fit(estimate: Estimate | ActuatorEstimate, facts: Mapping[str, Any]) -> str:
    """Return where a log or the case file of an estimate is, with the content that it had.

    Args:
        estimate: The estimate; one that no file holds has files by their names only.
        facts: An entry of its provenance, with ``path`` and, where it is known, ``sha256``.

    Returns:
        The first such file as :func:`places_of_fit` yields them; empty for none.
    """
    known = facts.get("sha256")
    for place in places_of_fit(estimate, str(facts.get("path", ""))):
        if place.exists() and (not known or sha256_of(place) == known):
            return str(place)
    return ""


def places_of_fit(estimate: Estimate | ActuatorEstimate, path: str) -> Iterator[Path]:
    """Yield where a file of the fit may be: as it is named, then from the folders of the estimate and its case.

    Args:
        estimate: The estimate.
        path: As its provenance names the file.
    """
    if not path or is_address(path):
        return
    yield Path(path)
    if estimate.file:
        folder = Path(estimate.file).parent
        for start in (folder, *list(folder.resolve().parents)[:_ABOVE]):
            yield start / path
        yield folder / Path(path).name
    case = estimate.provenance.get("case") or {}
    if case.get("path") and path != case["path"] and (beside := file_of_fit(estimate, case)):
        yield Path(beside).parent / path
        yield Path(beside).parent / Path(path).name
