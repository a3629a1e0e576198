"""The case file: the one place where a user describes their robot, their log and how the two are used.

YAML. Keys: case (the version of the format), robot, gravity, limits, locked, joints, coupling, drives, friction, log
(profile, format, columns, units, ...), preprocessing (filter, rate_hz, trim_s, standstill, rest), estimator, bodies,
train, test, split, accept, workspace, cell, servo, note. Unknown keys are errors that name the nearest known one.
docs/case-file.md describes each.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from dynident.case.acceptance import CRITERIA, Acceptance, acceptance_of
from dynident.case.case_values import find_file, guarded, model_place, robot_named, texts
from dynident.case.constraints_file import KEYS as CONSTRAINT_KEYS
from dynident.case.constraints_file import constraints_of
from dynident.case.log_section import led_by_joints, read_columns
from dynident.case.part_sections import AUTO, PartChoice, estimator_of, friction_of, preprocessing_of, robot_of
from dynident.case.questions import check_answered, without_open_gains
from dynident.data.formats import ColumnMap
from dynident.data.log import Log
from dynident.data.log_of_robot import read_signals, read_with
from dynident.data.log_places import is_address
from dynident.data.preprocessing import Preprocessing, default_preprocessing
from dynident.data.split import Split
from dynident.errors import FileError
from dynident.file_versions import Document, FileVersions, renamed
from dynident.files import bytes_of
from dynident.model.body_constraints import BODIES, Constraints
from dynident.model.documents.sections import Section
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction, default_friction
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.robot_files.strict_yaml import load_yaml

if TYPE_CHECKING:
    from dynident.actuators.servo_log import ServoSetup
    from dynident.case.cell_section import CellSetup
    from dynident.excitation.collision.workspace import Workspace
    from dynident.identification.streaming.stream_setup import StreamSetup


def _to_2(data: Document) -> Document:
    return renamed(data, {"drives.*.gain_deviation": "gain_std"})


#: Case files.
VERSIONS = FileVersions("a case", (_to_2,), key="case")

_KEYS = (
    "case",
    "robot",
    "gravity",
    "limits",
    "locked",
    "joints",
    "coupling",
    "drives",
    "friction",
    "log",
    "preprocessing",
)
_KEYS += ("estimator", "bodies", "constraints", "prior", "train", "test", "split", "accept")
_KEYS += ("workspace", "cell", "servo", "note")


@dataclass(frozen=True)
class Case:
    """A robot, how its logs are read and prepared, and what is asked.

    Attributes:
        robot: With locked joints, gravity, drives and coupling applied.
        friction: Friction parts.
        choose_friction: Whether the friction is to be chosen from the logs in their place, from the parts of a draft.
        columns: How columns become signals.
        preprocessing: How logs become rows.
        estimator: Name and options.
        train: Logs to learn from, as written.
        test: Logs to test on, as written.
        split: How a single log is split; None where it is not.
        locked: Positions of the joints that do not move, by name.
        workspace: What the robot must keep clear of; None where the case does not say.
        bodies: `free`, `plausible` or `auto`, of the estimator `consistent`; empty: as its options say.
        constraints: What is known about bodies beforehand.
        prior: Robot model or estimate file with inertias known beforehand, as written; empty for none.
        cell: The virtual cell in which the case is simulated; None where the case does not say.
        servo: Position servos whose logs have no torque; None where the case does not say.
        accept: What an estimate must meet to be accepted.
        path: The case file; empty for a case made from a robot alone.
        robot_path: The robot model.
    """

    robot: Robot
    friction: tuple[Friction, ...]
    columns: ColumnMap
    preprocessing: Preprocessing
    estimator: PartChoice = field(default_factory=PartChoice)
    train: tuple[str, ...] = ()
    test: tuple[str, ...] = ()
    split: Split | None = None
    locked: Mapping[str, float] = field(default_factory=dict)
    workspace: Workspace | None = None
    path: str = ""
    robot_path: str = ""
    choose_friction: bool = False
    constraints: Constraints = field(default_factory=Constraints)
    prior: str = ""
    cell: CellSetup | None = None
    accept: Acceptance = field(default_factory=lambda: Acceptance({}))
    bodies: str = ""
    servo: ServoSetup | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of this machine that the case stands on: itself, its robot and the logs it names."""
        own = [Path(name) for name in (self.path, self.robot_path) if name]
        named = (*self.train, *self.test, *filter(None, [self.prior]))
        return (*own, *(self.find(name) for name in named if not is_address(name)))

    @property
    def model(self) -> DynamicModel:
        """The dynamic model of the case."""
        return DynamicModel(self.robot, self.friction)

    def find(self, name: str) -> Path:
        """Return a file named in the case: as it is, beside the case file, or under the folder DYNIDENT_DATA.

        Raises:
            FileError: It is an address, and no file of this machine.
        """
        if is_address(name):
            step = "copy it to this machine; reduce, identify and validate read logs at addresses"
            raise FileError(name, "it is an address, and a file of this machine is needed here", step)
        return find_file(name, self.path)

    def stream_setup(self) -> StreamSetup:
        """Return what a stream of logs needs to know of the case."""
        from dynident.identification.streaming.stream_setup import StreamSetup  # few cases need it

        return StreamSetup(
            model=self.model,
            columns=self.columns,
            preprocessing=self.preprocessing,
            locked=self.locked,
            case_path=self.path,
            choose_friction=self.choose_friction,
            split=self.split,
        )

    def place(self, name: str | Path) -> str | Path:
        """Return where a log is: its address, or the file of this machine.

        Raises:
            FileError: No such file.
        """
        return name if is_address(str(name)) else self.find(str(name))

    def read(self, name: str | Path) -> Log:
        """Return a log with torques, from its currents where it has no torques.

        Raises:
            LogMismatch: A joint is missing, currents have no gain, or a locked joint moves.
        """
        return read_with(self.place(name), self.columns, self.robot, self.locked)

    def read_currents(self, name: str | Path) -> Log:
        """Return a log as it came: its currents are turned into no torques, and need no gains.

        Raises:
            LogMismatch: A joint is missing, or a locked joint moves.
        """
        return read_signals(self.place(name), self.columns, self.robot, self.locked)


def case_of_robot(path: str) -> Case:
    """Return the case that stands for a robot model alone: its joints, default friction and filter."""
    robot = read_robot(model_place(path))
    friction = tuple(FRICTION.make(name) for name in default_friction())
    return Case(robot, friction, ColumnMap(joints=robot.joint_names), default_preprocessing(), robot_path=path)


def read_case(path: str | Path, open_gains: bool = False, friction: str | Sequence[str] = ()) -> Case:
    """Read a case file, or a robot model as a case with all defaults.

    Args:
        path: The file.
        open_gains: Read a case that still asks for drive gains, as one without them.
        friction: Names of friction parts in place of those of the case; ``auto`` chooses them from the logs.

    Raises:
        FileError: No such file.
        DescriptionError: A fault in the case file or the robot model, with the key.
        UnknownChoice: A part that does not exist.
        BadOption: An option of a part with a value it cannot take.
    """
    case = _read_case(path, open_gains)
    if not friction:
        return case
    names = (friction,) if isinstance(friction, str) else tuple(friction)
    is_chosen = names == (AUTO,)
    parts = default_friction() if is_chosen else names
    return replace(case, friction=tuple(FRICTION.make(name) for name in parts), choose_friction=is_chosen)


def _read_case(path: str | Path, open_gains: bool) -> Case:
    file = Path(path)
    if file.suffix.lower() not in (".yaml", ".yml") or not os.path.isfile(file):
        return case_of_robot(str(path))
    data = bytes_of(path)
    if open_gains:
        data = without_open_gains(data)
    check_answered(path, data)
    value, lines = load_yaml(path, data)
    if isinstance(value, dict) and not {"case", "robot"} & value.keys():
        return case_of_robot(str(path))  # a DH table, or meant to be one
    top = Section.versioned(path, value, _KEYS, lines, VERSIONS)
    robot_path = robot_named(top, str(path))
    full = led_by_joints(top, read_robot(robot_path))
    choose = top.has("friction") and top.value("friction") == AUTO
    robot, locked = robot_of(top, full)
    columns = read_columns(top, full)
    return Case(
        robot=robot,
        friction=tuple(map(FRICTION.make, default_friction())) if choose else friction_of(top, robot),
        choose_friction=choose,
        columns=columns,
        preprocessing=preprocessing_of(top),
        estimator=estimator_of(top),
        train=texts(top, "train"),
        test=texts(top, "test"),
        split=guarded(top.place("split"), lambda: Split.parse(top.text("split"))) if top.has("split") else None,
        locked=locked,
        workspace=_workspace_of(top, robot, robot_path),
        constraints=constraints_of(top.section("constraints", CONSTRAINT_KEYS), robot, robot_path),
        prior=top.text("prior", ""),
        cell=_cell_of(top),
        servo=_servo_of(top, robot, columns),
        accept=acceptance_of(top.section("accept", tuple(CRITERIA))),
        path=str(path),
        robot_path=robot_path,
        bodies=top.choice("bodies", BODIES) if top.has("bodies") else "",
    )


def _workspace_of(top: Section, robot: Robot, robot_path: str) -> Workspace | None:
    if not top.has("workspace"):
        return None
    from dynident.case.workspace_section import read_workspace  # few cases need it

    return read_workspace(top, robot, robot_path)


def _cell_of(top: Section) -> CellSetup | None:
    if not top.has("cell"):
        return None
    from dynident.case.cell_section import KEYS, cell_of  # few cases need it

    return cell_of(top.section("cell", KEYS))


def _servo_of(top: Section, robot: Robot, columns: ColumnMap) -> ServoSetup | None:
    if not top.has("servo"):
        return None
    from dynident.case.servo_section import servo_of  # few cases need it

    return servo_of(top, robot, columns)
