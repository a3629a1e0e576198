"""URDF: the user's own file with the identified bodies and joint friction, or a new one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving.robot_model_proof import reload_urdf
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.document import document_bytes, friction_notes, left_out, place_beside
from dynident.exports.models.writing.urdf import written_urdf


@dataclass(frozen=True)
class UrdfModel(ModelExporter):
    """URDF: the robot model's own file with new inertias, damping and friction and every other byte as it was.

    Attributes:
        lump: Whether links fixed to a moving one lose their inertia to it, in place of keeping what the file states.
    """

    lump: bool = False

    suffix: ClassVar[str] = ".urdf"
    proof: ClassVar[str] = (
        "bodies, damping, Coulomb friction by dynident, Pinocchio and MuJoCo; with the file beside it everything"
    )
    edits_description: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        drives = drives_of(subject)
        data, notes = written_urdf(subject, drives, self.lump)
        files = {path: data, place_beside(path): document_bytes(subject, drives)}
        left = left_out(drives, armature=False, coupled=False)
        return ModelContent(files, left, (*notes, *friction_notes(drives, "URDF")))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        first, beside = (folder / file.name for file in content.files)
        return reload_urdf(subject, first, beside)
