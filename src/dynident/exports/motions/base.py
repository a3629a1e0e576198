"""What an exporter of motions is: from a driven plan to the bytes of files, with what was printed read back."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from dynident.exports.base import Exporter, Proof
from dynident.exports.motions._motion import DrivenMotion
from dynident.exports.motions._printed import Printed, check_printed


@dataclass(frozen=True)
class MotionFigures:
    """Figures of a target; none here."""

    def data(self) -> dict[str, Any]:
        """Return them as plain data: ``facts`` of ``dynident export --json``."""
        return asdict(self)


@dataclass(frozen=True)
class ThinnedPoints(MotionFigures):
    """Points that a controller joins by its own curve.

    Attributes:
        tolerance: Largest deviation from the motion that was asked for, in printed units.
        deviation: Of the points' curve from the motion, by joint, in printed units.
        point_distance_s: Time from point to point, in s.
    """

    tolerance: float
    deviation: Mapping[str, float]
    point_distance_s: float


@dataclass(frozen=True)
class MotionContent:
    """The files of an exported motion, not written yet.

    Attributes:
        files: Bytes by place, in the order of their use.
        printed: The samples of the motion that the files hold.
        notes: What the reader has to know, one sentence each.
        figures: Of this target, such as the deviation of thinned points.
    """

    files: Mapping[Path, bytes]
    printed: Printed
    notes: tuple[str, ...] = ()
    figures: MotionFigures = field(default_factory=MotionFigures)


class MotionExporter(Exporter[DrivenMotion, MotionContent]):
    """An exporter of motions.

    Attributes:
        rate: Samples a second where none are asked for; None where the target takes points thinned to a tolerance.
        moves_itself: Whether the target goes to the first posture by a slow move of its own where no posture is stated.
        approach_in_samples: Whether a stated posture gives an approach in samples, in a file or message of its own;
            else the target drives there by its own slow move.
    """

    takes: ClassVar[str] = "plan"
    proof: ClassVar[str] = "the printed numbers: samples of the plan, within its bounds, at rest at both ends"
    rate: ClassVar[float | None]
    moves_itself: ClassVar[bool]
    approach_in_samples: ClassVar[bool] = True

    @abstractmethod
    def content(self, subject: DrivenMotion, path: Path) -> MotionContent:
        """Return the files for a motion, the first of them at ``path``.

        Raises:
            BadOption: Another number or kind of joints than the target has, too many points, or a rate it cannot keep.
            FileError: A name that the target cannot have.
        """

    def prove(self, subject: DrivenMotion, content: MotionContent, path: Path) -> tuple[Proof, ...]:
        """Compare the printed samples with the motion, its bounds, and rest at both ends.

        Raises:
            FileError: One of these fails by more than the printed digits explain.
        """
        return (check_printed(subject, content.printed, self.proof, path),)
