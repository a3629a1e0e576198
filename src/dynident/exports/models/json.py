"""JSON: the whole model with its covariance, exact to the last bit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.models.writing.document import base_torque, document_bytes, read_document


@dataclass(frozen=True)
class Json(ModelExporter):
    """JSON of a stated format: robot, friction, base parameters with covariance, standard parameters, drives."""

    suffix: ClassVar[str] = ".json"
    proof: ClassVar[str] = "everything by dynident"
    needs_bodies: ClassVar[bool] = False
    remembers: ClassVar[bool] = True

    def content(self, subject: Identified, path: Path) -> ModelContent:
        return ModelContent({path: document_bytes(subject, drives_of(subject))}, (), ())

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        model, values, standard = read_document(folder / next(iter(content.files)).name)
        own, motion = subject.estimate, states.motion
        if standard:
            expected = subject.model.torque(motion, subject.theta)
            yield Reloaded("dynident", "everything", model.torque(motion, values), expected)
            return
        expected = base_torque(own, own.beta, motion)
        yield Reloaded("dynident", "base parameters", base_torque(own, values, motion), expected)
