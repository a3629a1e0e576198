"""SDF: the model of Gazebo and Drake."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.proving.robot_model_proof import reload_own_sdf, sdf_by_drake, sdf_by_reader
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import anew_note
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.document import document_bytes, friction_notes, left_out, place_beside
from dynident.exports.models.writing.sdf_text import base_note, patched_sdf, sdf_text
from dynident.exports.models.writing.urdf import between_note, gravity_note


@dataclass(frozen=True)
class Sdf(ModelExporter):
    """SDF for Gazebo and Drake: the robot model's own file, every other byte as it was, or a new one of version 1.7.

    Bodies, damping and friction; rotor inertia by Drake's own elements.

    Attributes:
        lump: Whether links fixed to a moving one lose their inertia to it, in place of keeping what the file states.
    """

    lump: bool = False

    suffix: ClassVar[str] = ".sdf"
    proof: ClassVar[str] = (
        "bodies, armature and damping by Drake, and with Coulomb friction by dynident; not run in Gazebo"
    )
    edits_description: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        drives = drives_of(subject)
        if subject.source is not None and subject.source.kind == "sdf":
            patched = patched_sdf(subject, drives, subject.source, self.lump)
            told = (*((subject.source.note,) if subject.source.note else ()), *gravity_note(subject, "a model in SDF"))
            notes = (*told, *patched.notes)
            files = {path: patched.data, place_beside(path): document_bytes(subject, drives)}
            left = left_out(drives, armature=True, coupled=False)
            return ModelContent(files, left, (*notes, *friction_notes(drives, "SDF")))
        files = {path: sdf_text(subject, drives), place_beside(path): document_bytes(subject, drives)}
        notes = [
            *anew_note(subject.source, subject.estimate, "SDF"),
            "gravity is that of the world, not of the model; the base link is free until the world holds it",
            "Gazebo passes over Drake's rotor inertia, Drake over friction; meshes are left out",
        ]
        notes += [*gravity_note(subject, "a model in SDF"), *base_note(subject), *between_note(subject, "SDF")]
        if any(joint.mimic is not None for joint in subject.model.robot.joints):
            notes.append("joints that follow another move freely: SDF 1.7 cannot say that they follow")
        left = left_out(drives, armature=True, coupled=False)
        return ModelContent(files, left, (*notes, *friction_notes(drives, "SDF")))

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        path = folder / next(iter(content.files)).name
        if subject.source is not None and subject.source.kind == "sdf":
            patched = patched_sdf(subject, drives_of(subject), subject.source, self.lump)
            yield from reload_own_sdf(subject, subject.source, patched)
            return
        yield sdf_by_reader(subject, path, states)
        yield sdf_by_drake(subject, path, states)
        yield Reloaded("Gazebo", why_not="not a Python package; Drake reads with its parser, libsdformat")
