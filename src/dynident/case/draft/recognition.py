"""What was recognised in a robot and its logs: the value that the text of a case file and its JSON are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dynident.arrays import Array
from dynident.case.draft.column_groups import Group, StatedJoints
from dynident.case.draft.joint_choice import JointChoice, without_positions
from dynident.case.draft.profile_fit import ProfileFit
from dynident.case.draft.readings import LogReading
from dynident.case.draft.signal_units import SignalUnit, factor_of
from dynident.case.draft.structure import TableStructure
from dynident.case.evidence.torques import TorqueEvidence, agrees
from dynident.data.log import Log
from dynident.model.robot import Robot


@dataclass(frozen=True)
class SignalSource:
    """A signal of the logs.

    Attributes:
        columns: One per joint, in the order of the joints.
        pattern: How the case file writes them; empty for a list.
        side: motor or link.
        how: What told it.
        unknown: Words in their names that are not known.
        doubt: What has to be asked about them; empty for nothing.
    """

    columns: tuple[str, ...]
    pattern: str
    side: str
    how: str
    unknown: tuple[str, ...] = ()
    doubt: str = ""

    @classmethod
    def of_group(cls, group: Group) -> SignalSource:
        """Return that of columns which names tell."""
        how = "by the names of the joints" if group.named else "by the numbers in their names"
        how += f" in {group.told_by}" if group.told_by else ""
        if group.meaning.signal == "torque" and group.meaning.kind == "model":
            how += "; what the drives estimate, as the log has no measured torques"
        return cls(group.names, group.pattern, group.meaning.side or "link", how, group.meaning.strange)

    def shown(self) -> str:
        """Return the columns in words."""
        return self.columns[0] if len(self.columns) == 1 else f"{self.columns[0]} to {self.columns[-1]}"


@dataclass(frozen=True)
class Recognised:
    """Everything that a draft stands on.

    Attributes:
        robot: The robot with all its joints.
        header: Columns of the first log.
        stated: The joints that cells name.
        time: Column of the time, or the stated rate or the sum of two columns in its place; empty where none is known.
        is_clocked: Whether it is such a rate or sum.
        sources: Columns of each signal.
        joints: The joints of the columns.
        readings: The logs.
        units: Unit of each quantity (time, position, velocity, torque, current).
        profiles: Profiles that fit, the best first; the first is taken where no other is as good.
        rivals: Groups that fit a signal equally well.
        refused: Columns that are no measurement, and why.
        evidence: What the robot model's masses say about torques or currents.
        band_hz: Band of the motion; 0 where it is not known.
        still: Position in rad or m of the joints that stand still.
        grippers: Joints that jump between a few positions, or have no torque to speak of and move next to no mass: the
            middle of their positions in rad or m, and why they are not read.
        left_out: Signals whose columns were found and are not read, and why.
        unread: Columns that look like those of a signal and are left out, and why.
        temperature: The temperatures of the drives; None where none are read.
        without_effort: Joints with positions and, unlike others, neither torques nor currents: the column and, once it
            is read, the middle of the positions in rad or m.
        likely_effort: Columns that may be the torques or currents that a profile does not read; empty for none.
        is_large: Whether the logs that train are reduced as a stream.
        turn: A whole turn after which positions start again, in the file's unit; 0 where they do not.
        wrapped: Joints that turn, where some of them start again so.
        structure: What the values of columns say whose names say nothing; None where names do.
        sample: Robot with the joints of the log, and the longest log in SI units, torques as they stand in the file;
            None where it has none.
        gravity: The gravity that the torques follow, shape (3,), in m/s^2; None where nobody looked, or no log tells.
        form: How the file is read where its suffix does not say, as the case file writes it; empty for nothing.
    """

    robot: Robot
    header: tuple[str, ...]
    stated: StatedJoints = field(default_factory=StatedJoints)
    time: str = ""
    is_clocked: bool = False
    sources: Mapping[str, SignalSource] = field(default_factory=dict)
    joints: JointChoice = field(default_factory=lambda: JointChoice((), False, ""))
    readings: tuple[LogReading, ...] = ()
    units: Mapping[str, SignalUnit] = field(default_factory=dict)
    profiles: tuple[ProfileFit, ...] = ()
    rivals: Mapping[str, tuple[Group, ...]] = field(default_factory=dict)
    refused: tuple[tuple[Group, str], ...] = ()
    evidence: TorqueEvidence | None = None
    band_hz: float = 0.0
    still: Mapping[str, float] = field(default_factory=dict)
    grippers: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    unread: Mapping[str, str] = field(default_factory=dict)
    temperature: SignalSource | None = None
    without_effort: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    likely_effort: str = ""
    is_large: bool = False
    turn: float = 0.0
    wrapped: tuple[str, ...] = ()
    structure: TableStructure | None = None
    form: str = ""
    sample: tuple[Robot, Log] | None = None
    gravity: Array | None = None

    @property
    def effort(self) -> str:
        """``torque`` or ``current``, whichever is read; empty where neither is."""
        return next((signal for signal in ("torque", "current") if signal in self.sources), "")

    @property
    def torque_is_unnamed(self) -> bool:
        """Whether values alone say which columns are torques, not their names."""
        told = self.structure.groups.get("torque") if self.structure is not None else None
        return told is not None and "torque" in self.sources and self.sources["torque"].columns == told.names

    @property
    def drivers_differ(self) -> bool:
        """Whether the profile names columns of torques in which drivers write other quantities as well."""
        effort = self.profiles[0].effort if self.profiles else None
        return effort is not None and effort.signal == "torque" and "differ" in effort.note

    @property
    def torques_agree(self) -> bool:
        """Whether the torques, as they stand in the file, are about those of the robot model's masses."""
        if self.effort != "torque" or self.evidence is None or not any(self.evidence.telling):
            return False
        seen = np.abs(self.evidence.ratios[np.array(self.evidence.telling)])
        return agrees(float(np.median(seen)))

    @property
    def moving(self) -> Robot | None:
        """The robot with the joints of the columns only; None where they are not known."""
        names = self.joints.names
        if not names or set(names) - set(self.robot.joint_names):
            return None
        others = [name for name in self.robot.joint_names if name not in names]
        return self.robot.locked(dict.fromkeys(others, 0.0)) if others else self.robot

    @property
    def without_positions(self) -> dict[str, str]:
        """Joints that the log has by name and no positions of, each with what it has, in words."""
        positions = self.sources.get("q")
        return {} if positions is None else without_positions(self.robot, self.header, positions.columns)

    @property
    def to_seconds(self) -> float:
        """Factor of the time's unit, the likely one where it is asked."""
        told = self.units.get("time")
        return factor_of("time", told.text) if told and told.words else 1.0

    @property
    def on_motors(self) -> tuple[str, ...]:
        """Signals of motion and torque that were logged at the motors."""
        return tuple(s for s in ("q", "dq", "torque", "q_ref") if s in self.sources and self.sources[s].side == "motor")
