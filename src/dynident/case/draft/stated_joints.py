"""The joints that cells of a text name, as messages of ROS do beside numbered positions, in an order of their own."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

from dynident.case.draft.column_groups import StatedJoints
from dynident.case.draft.column_words import OTHER, tokens_of
from dynident.case.draft.joint_choice import JointChoice
from dynident.case.draft.readings import MOST_ROWS
from dynident.case.draft.recognition import Recognised
from dynident.case.draft.yaml_words import few
from dynident.data.formats import LogTable
from dynident.data.formats._text_header import NUMBER, cells_of, opened
from dynident.data.formats._text_table import TextTable
from dynident.data.formats.base import TableOfTable
from dynident.errors import LogFormatError

#: A name in a cell with a list of them.
_NAME = re.compile(r"[^\s,;'\"\[\]()]+")

#: Names that are those of no joint.
_NO_JOINTS = OTHER | frozenset("frame file topic".split())

#: Columns of a message of joint states that stand before its names, and the signals behind them.
_STAMP, _SIGNALS = ("sec", "nanosec", "frame_id"), ("position", "velocity", "effort")


def stated_joints(tables: Sequence[LogTable], joints: Sequence[str]) -> StatedJoints:
    """Return the joints that cells of the logs name; nothing where no column holds names.

    Args:
        tables: The opened logs.
        joints: Names of the joints of the robot.

    Raises:
        LogFormatError: The names change from row to row, or from log to log.
    """
    texts = [text for table in tables if isinstance(text := _of_file(table), TextTable)]
    if not texts:
        return StatedJoints()
    first = texts[0]
    cells = next((row for _, row in _rows(first)), [])
    found = [(columns, names) for columns in _name_columns(first.header) if (names := _names(cells, columns))]
    found.sort(key=lambda one: -len(set(joints).intersection(one[1])))
    if not found:
        return StatedJoints()
    columns, names = found[0]
    stated = StatedJoints(names, tuple(first.header[k] for k in columns))
    for table in texts:
        if table.header == first.header:
            _check_order(table, columns, stated)
    return stated


def _of_file(table: LogTable) -> LogTable:
    return _of_file(table.inner) if isinstance(table, TableOfTable) else table


def _check_order(table: TextTable, columns: Sequence[int], stated: StatedJoints) -> None:
    before: list[str] = []
    for line, cells in _rows(table):
        own = [cells[k] for k in columns]
        if own != before and any(map(str.strip, own)) and (names := _names(cells, columns)) != stated.names:
            told = f"{stated.shown}: {few(names or own, 8)} in place of {few(stated.names, 8)}"
            step = "keep the rows of one order, or write a column for each joint, such as elbow_joint.position"
            raise LogFormatError(table.path, line, told, step)
        before = own


def _rows(table: TextTable) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of the rows that a draft is made from, those apart that lack cells."""
    for line, text in islice(table.rows(), MOST_ROWS):
        cells = cells_of(text, table.delimiter)
        if len(cells) == len(table.header):
            yield line, cells


def _name_columns(header: Sequence[str]) -> list[list[int]]:
    """Return the columns that may hold names of joints: numbered ones that belong together, or one with a list."""
    found: dict[tuple[str, ...], dict[int, int]] = {}
    for k, name in enumerate(header):
        words = tokens_of(name)
        number = int(words.pop()) if words and words[-1].isdigit() else -1
        if words and words[-1] in ("name", "names") and not _NO_JOINTS.intersection(words):
            found.setdefault((*words, "" if number < 0 else "0"), {}).setdefault(number, k)
    return [[columns[number] for number in sorted(columns)] for columns in found.values()]


def _names(cells: Sequence[str], columns: Sequence[int]) -> tuple[str, ...]:
    """Return the names in the cells of a row; nothing where one is empty or a number."""
    own = [cells[k].strip() for k in columns]
    names = tuple(_NAME.findall(own[0]) if len(own) == 1 else own)
    return names if all(name and not NUMBER.fullmatch(name) for name in names) else ()


def doubted(found: Recognised) -> JointChoice:
    """Return the joints of the positions' columns, asked for where cells name others than the robot has."""
    stated, joints = found.stated, found.joints
    if not stated.names:
        return joints
    places = stated.places(found.robot.joint_names)
    known = {joint.name for joint in found.robot.joints}  # one may be fixed, or follow another one
    others = [name for name, place in zip(stated.names, places, strict=True) if place is None and name not in known]
    missing = [name for k, name in enumerate(found.robot.joint_names) if k not in places]
    if stated.shown not in joints.why:  # as many columns as names, or no name of a joint
        what = "other names than the joints of the robot" if others else "another number of joints"
        return replace(joints, certain=False, why=f"{stated.shown} hold {what}: {few(stated.names, 8)}")
    if not others:
        return joints
    told = f"{few(others, 4)} in {stated.shown}"
    if missing:
        return replace(joints, certain=False, why=f"{joints.why}; {told}: no joint of the robot by its name")
    return replace(joints, why=f"{joints.why}; {told}: no joint of the robot, its columns are not read")


def names_of_echo(path: str) -> tuple[str, ...]:
    """Return names for the columns of joint states as ``ros2 topic echo --csv`` writes them, without a header.

    A row holds seconds, nanoseconds and frame of the stamp, then the names, positions, velocities and efforts.

    Returns:
        The names; empty where the first row is not of this kind.
    """
    try:
        with opened(path) as stream:
            cells = [cell.strip() for cell in cells_of(stream.readline(1 << 20), ",")]
    except OSError:
        return ()  # said by what reads it next
    count, rest = divmod(len(cells) - len(_STAMP), 1 + len(_SIGNALS))
    names, values = cells[len(_STAMP) :][:count], cells[len(_STAMP) + count :]
    is_stamp = all(cell.isdecimal() for cell in cells[:2]) and not NUMBER.fullmatch(cells[2])
    if rest or count < 1 or not is_stamp or any(not name or NUMBER.fullmatch(name) for name in names):
        return ()
    if not all(map(NUMBER.fullmatch, values)):
        return ()
    return (*_STAMP, *(f"{word}{k}" for word in ("name", *_SIGNALS) for k in range(count)))
