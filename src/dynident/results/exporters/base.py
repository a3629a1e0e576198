"""What an exporter is: from a motion (later: an estimate) to the bytes of files, with what was printed read back."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from dynident.arrays import Array
from dynident.results.exporters._motion import DrivenMotion


@dataclass(frozen=True)
class Printed:
    """Samples as they stand in a file, read back from their text and turned into SI units.

    Attributes:
        time: Times in s, shape (M,).
        signals: q alone, or q, dq, ddq; shape (1, M, n) or (3, M, n), in rad or m and their derivatives.
        round_off: Largest error that the printed digits may make, shape (1, n) or (3, n).
    """

    time: Array
    signals: Array
    round_off: Array


@dataclass(frozen=True)
class Content:
    """The files of an export, not written yet.

    Attributes:
        files: Bytes by place.
        printed: The samples of the motion that the files hold; None where they hold no motion.
        notes: What the reader has to know, one sentence each.
        facts: Plain figures of this target, such as the deviation of thinned points.
    """

    files: Mapping[Path, bytes]
    printed: Printed | None = None
    notes: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)


class Exporter(ABC):
    """A frozen dataclass whose fields are its options; ``content`` writes nothing and keeps nothing.

    Attributes:
        takes: What it exports: ``plan`` or ``estimate``.
    """

    takes: ClassVar[str]

    @abstractmethod
    def content(self, subject: Any, path: Path) -> Content:
        """Return the files for a subject, the first of them at ``path``.

        Raises:
            DynidentError: The subject does not fit the target.
        """


class MotionExporter(Exporter):
    """An exporter of motions: its subject is a :class:`DrivenMotion`.

    Attributes:
        rate: Samples a second where none are asked for; None where the target takes points thinned to a tolerance.
        moves_itself: Whether the target goes to the first posture by a slow move of its own where no posture is stated.
        approach_in_samples: Whether a stated posture gives an approach in samples, in a file or message of its own;
            else the target drives there by its own slow move.
    """

    takes: ClassVar[str] = "plan"
    rate: ClassVar[float | None]
    moves_itself: ClassVar[bool]
    approach_in_samples: ClassVar[bool] = True

    @abstractmethod
    def content(self, subject: DrivenMotion, path: Path) -> Content:
        """Return the files for a motion, the first of them at ``path``.

        Raises:
            BadOption: Another number or kind of joints than the target has, too many points, or a rate it cannot keep.
            FileError: A name that the target cannot have.
        """
