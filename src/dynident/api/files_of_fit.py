"""Where the files of a fit are now: provenance names them from the folder in which the command ran."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynident.data.log_places import is_address
from dynident.files import sha256_of
from dynident.identification.estimate.estimate import Estimate

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
