"""What an exporter of models is: from an identified model to the bytes of files, and back to torques from them.

The proof: the files loaded again, torques compared, the largest differences told.
"""

from __future__ import annotations

import tempfile
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from dynident.arrays import Array
from dynident.errors import DynidentError, FileError
from dynident.exports.base import Exporter, Proof
from dynident.exports.models.subject.drives import Term
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet, states_of
from dynident.files import written_for_a_while


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


#: A joint whose largest torque is below this share of the robot's is compared with that share.
SMALL = 1e-6

#: Largest difference of torques, as a share of the largest torque of the joint, with which an export is written.
LARGEST = 1e-6


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


def proofs_of(
    files: Mapping[Path, bytes], reload: Callable[[Path], Iterable[Reloaded]], target: Path
) -> tuple[Proof, ...]:
    """Load files that are not written yet in every engine, and compare torques.

    Args:
        files: Bytes by place.
        reload: From a folder in which the files lie to what each engine made of them.
        target: The file that the user named.

    Raises:
        FileError: An engine cannot load them, or its torques differ by more than is allowed, a millionth as a rule.
    """
    step = "report it with the estimate: nothing was written"
    found: list[Proof] = []
    with tempfile.TemporaryDirectory(prefix="dynident-") as name:
        folder = Path(name)
        with written_for_a_while():
            for file, data in files.items():
                (folder / file.name).write_bytes(data)
        try:
            for one in reload(folder):
                found.append(_proof(one))
                last = found[-1]
                if last.relative is not None and not last.relative <= last.allowed:
                    evidence = f"{last.engine} gives torques that differ by {last.relative:.2g} ({last.what})"
                    raise FileError(target, evidence, step)
        except DynidentError:
            raise
        except Exception as error:  # an engine of others may raise anything
            reason = " ".join(str(error).split())[:200]
            raise FileError(target, f"an engine cannot load it again ({reason})", step) from error
    return tuple(found)


def _proof(one: Reloaded) -> Proof:
    if one.torque is None or one.expected is None:
        return Proof(one.engine, one.what, 0, None, None, one.why_not, one.largest)
    away = np.abs(one.torque - one.expected).max(axis=0)
    largest = np.abs(one.expected).max(axis=0)
    size = np.maximum(largest, SMALL * largest.max(initial=0.0))
    relative = np.divide(away, size, out=np.where(away > 0, np.inf, 0.0), where=size > 0)
    return Proof(one.engine, one.what, len(one.torque), float(away.max()), float(relative.max()), "", one.largest)
