"""What an exporter of models is: from an identified model to the bytes of files, and back to torques from them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from dynident.exports.base import Exporter, Proof
from dynident.exports.models.proving.proof import Reloaded, proofs_of
from dynident.exports.models.subject.drives import Term
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet, states_of


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


class ModelExporter(Exporter[Identified, ModelContent]):
    """An exporter of models.

    Attributes:
        needs_bodies: Whether it takes only physically consistent standard parameters.
        edits_description: Whether it writes into the user's robot model.
        remembers: Whether friction that remembers the way to a sample does so in it.
    """

    takes: ClassVar[str] = "estimate"
    needs_bodies: ClassVar[bool] = True
    edits_description: ClassVar[bool] = False
    remembers: ClassVar[bool] = False

    @abstractmethod
    def content(self, subject: Identified, path: Path) -> ModelContent:
        """Return the files for a model, the first of them at ``path``.

        Raises:
            DynidentError: The model does not fit the target.
        """

    @abstractmethod
    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        """Load the files again in every engine that reads them and return the torques that each gives.

        Args:
            subject: The model.
            content: What :meth:`content` gave.
            folder: A folder of its own, in which the files lie under their names.
            states: The states on which torques are compared.
        """

    def prove(self, subject: Identified, content: ModelContent, path: Path) -> tuple[Proof, ...]:
        """Load the files again in every engine that reads them, and compare torques on random states.

        Raises:
            FileError: An engine cannot load them, or its torques differ by more than is allowed, a millionth as a rule.
        """
        states = states_of(subject.model)
        return proofs_of(content.files, lambda folder: self.reload(subject, content, folder, states), path)
