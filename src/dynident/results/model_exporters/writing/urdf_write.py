"""The bytes of a URDF: patched where the user's description is one, else new."""

from __future__ import annotations

from dynident.results.model_exporters.subject.drives import Drives
from dynident.results.model_exporters.subject.identified import Identified
from dynident.results.model_exporters.writing.urdf_new import new_urdf
from dynident.results.model_exporters.writing.urdf_patch import patched


def written_urdf(subject: Identified, drives: Drives, lump: bool) -> tuple[bytes, tuple[str, ...]]:
    """Return a URDF of a model and what the reader has to know about it.

    Raises:
        DescriptionError: The user's URDF is of another robot.
        BadOption: A name that XML cannot have.
    """
    source = subject.source
    if source is not None and source.is_urdf:
        found = patched(subject, drives, source, lump)
        return found.data, ((source.note,) if source.note else ()) + found.notes
    why = "no robot description was given or found" if source is None else "the robot description is no URDF"
    note = f"{why}: the URDF is new, without meshes; --description FILE changes the inertias of your own"
    return new_urdf(subject, drives), (note,)
