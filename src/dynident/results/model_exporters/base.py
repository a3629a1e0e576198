"""What an exporter of models is: from an identified model to the bytes of files, and back to torques from them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from dynident.arrays import Array
from dynident.results.model_exporters.subject.drives import Term
from dynident.results.model_exporters.subject.identified import Identified
from dynident.results.model_exporters.subject.states import States

#: Largest difference of torques, as a share of the largest torque of the joint, with which an export is written.
LARGEST = 1e-6


@dataclass(frozen=True)
class ModelContent:
    """The files of an exported model, not written yet.

    Attributes:
        files: Bytes by place, the file that the user named first.
        left_out: Coefficients that the first file cannot hold.
        notes: What the reader has to know, one sentence each.
    """

    files: Mapping[Path, bytes]
    left_out: tuple[Term, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reloaded:
    """The files loaded again by one engine.

    Attributes:
        engine: Its name with its version.
        what: What was compared, in words.
        torque: Torques by the engine on the states, shape (N, n); None where it was not asked.
        expected: Those of the identified model, as far as the format holds it, shape (N, n).
        why_not: Why the engine was not asked; empty where it was.
        largest: Largest difference allowed, as a share of the largest torque of the joint.
    """

    engine: str
    what: str = ""
    torque: Array | None = field(default=None)
    expected: Array | None = field(default=None)
    why_not: str = ""
    largest: float = LARGEST


class ModelExporter(ABC):
    """A frozen dataclass whose fields are its options; its methods write nothing and keep nothing.

    Attributes:
        needs_bodies: Whether it takes only physically consistent standard parameters.
        edits_description: Whether it writes into the user's robot description.
    """

    takes: ClassVar[str] = "estimate"
    needs_bodies: ClassVar[bool] = True
    edits_description: ClassVar[bool] = False

    @abstractmethod
    def content(self, subject: Identified, path: Path) -> ModelContent:
        """Return the files for a model, the first of them at ``path``.

        Raises:
            DynidentError: The model does not fit the target.
        """

    @abstractmethod
    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: States) -> Iterator[Reloaded]:
        """Load the files again in every engine that reads them and return the torques that each gives.

        Args:
            subject: The model.
            content: What :meth:`content` gave.
            folder: A folder of its own, in which the files lie under their names.
            states: The states on which torques are compared.
        """

    def options(self) -> dict[str, Any]:
        """Return the options as plain data."""
        return dict(vars(self))
