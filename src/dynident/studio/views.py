"""The answers of the studio: plain data about files of the session. What takes long is a command, see runs.py."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynident.errors import BadOption, DynidentError, FileError
from dynident.plugins import part_names
from dynident.studio.folder import Folder, kind_of

if TYPE_CHECKING:
    from dynident.arrays import Array
    from dynident.case.case import Case
    from dynident.excitation.collision.workspace import Workspace
    from dynident.results.text import Table

_FAMILIES = {
    "estimators": ("dynident.identification.estimators", "dynident.identification.simulated.estimators"),
    "friction": ("dynident.model.friction",),
    "criteria": ("dynident.excitation.criteria",),
    "profiles": ("dynident.data.profiles",),
    "trajectories": ("dynident.excitation.trajectories",),
}

#: Largest text that the editor takes, in bytes.
MAX_TEXT = 1_000_000


def choices() -> dict[str, Any]:
    """Return the names of the parts that the page offers; the parts themselves are not imported."""
    from dynident.data.formats._units import UNITS
    from dynident.robot_files import shipped_robots
    from dynident.studio.orders import QUANTITIES, SIGNALS

    found: dict[str, Any] = {key: list(part_names(*folders)) for key, folders in _FAMILIES.items()}
    found["robots"] = list(shipped_robots())
    found["units"] = {quantity: list(UNITS[quantity]) for quantity in QUANTITIES}
    found["signals"] = list(SIGNALS)
    found["version"] = version("dynident")
    return found


def targets_view(kind: str) -> dict[str, Any]:
    """Return the names of the targets that a plan or an estimate is exported to; each is asked what it writes."""
    from dynident.studio.orders import targets

    return {"targets": list(targets(kind))}


def robot_view(folder: Folder, name: str) -> dict[str, Any]:
    """Return the scene of a robot: of a description, of a case, of an estimate with its bodies, or of one that ships.

    Raises:
        DynidentError: No such file, or a fault of it.
    """
    from dynident.robot_files import read_robot, shipped_robots
    from dynident.studio.scene import scene_of

    if name in shipped_robots() and name not in folder.names():
        return {**scene_of(read_robot(name), folder.path), "source": name}
    path = folder.find(name)
    kind = _kind(path)
    theta: Array | None = None
    workspace: Workspace | None = None
    if kind == "estimate":
        from dynident.identification.files.estimate_file import read_estimate

        estimate = read_estimate(path)
        robot, theta = estimate.model.robot, estimate.theta
    else:
        case = _case(folder, name) if kind == "case" else None
        robot = read_robot(path) if case is None else case.robot
        workspace = None if case is None else case.workspace
    return {**scene_of(robot, folder.path, theta, workspace), "source": name}


def log_view(folder: Folder, name: str, case: str, columns: tuple[str, ...]) -> dict[str, Any]:
    """Return the columns of a log with first rows and ranges, or curves of some columns.

    Args:
        folder: The session.
        name: The log.
        case: A case that says how the log is read; empty for its suffix.
        columns: Columns whose curves are wanted; none for the preview.

    Raises:
        DynidentError: No such file, or a fault of it.
    """
    from dynident.studio.preview import curves, preview

    path = folder.find(name)
    how = _case(folder, case).columns if case else None
    return curves(path, columns, how) if columns else preview(path, how)


def motion_view(folder: Folder, name: str, case: str) -> dict[str, Any]:
    """Return the motion of a plan, or of a log as a case reads it, for playback.

    Raises:
        DynidentError: No such file, or a fault of it.
    """
    from dynident.case.case import case_of_robot
    from dynident.robot_files import shipped_robots
    from dynident.studio.preview import motion_of_log, motion_of_plan

    path = folder.find(name)
    if _kind(path) == "plan":
        return motion_of_plan(path)
    if case in shipped_robots() and case not in folder.names():
        return motion_of_log(case_of_robot(case), path)
    return motion_of_log(_case(folder, case), path)


def case_view(folder: Folder, name: str) -> dict[str, Any]:
    """Return a case file: its text, what it asks, its mapping of columns, and why it cannot be used yet.

    Raises:
        FileError: No such file.
    """
    from dynident.case.case import read_case
    from dynident.case.questions import questions_in
    from dynident.studio.case_text import mapping_of, open_mapping

    path = folder.find(name)
    data = path.read_bytes()
    if len(data) > MAX_TEXT:
        raise BadOption("case", name, "this file is too long for the editor")
    text = data.decode("utf-8", errors="replace")
    shown: dict[str, Any] = {
        "text": text,
        "sha256": hashlib.sha256(data).hexdigest(),
        "questions": [{"line": q.line, "asks_for": q.text, "needed": q.needed} for q in questions_in(text)],
        "mapping": None,
        "fault": "",
        "train": [],
        "test": [],
    }
    try:
        case = read_case(path)
        shown |= {"train": list(case.train), "test": list(case.test), "robot": case.robot.name}
        shown["mapping"] = mapping_of(path)
    except DynidentError as error:
        shown["fault"] = local(folder, str(error))
        shown["mapping"] = open_mapping(path)
    return shown


def estimate_view(folder: Folder, name: str) -> dict[str, Any]:
    """Return the figures of an estimate, its parameters as they are printed, and its torques for drawing.

    Raises:
        DynidentError: No such file, or no estimate.
    """
    from dynident.api.estimate_output import summary
    from dynident.diagnosis.verdict import verdict_of
    from dynident.identification.files.estimate_file import read_estimate
    from dynident.results.nominal import bodies_table, errors_table, link_changes, links_table, missing_reason
    from dynident.results.text import parameters_table
    from dynident.results.verdict import NOT_CHECKED, cause_lines, headline
    from dynident.studio.preview import torques_of

    path = folder.find(name)
    estimate = read_estimate(path)
    judged = verdict_of(estimate)
    shown: dict[str, Any] = {
        "headline": headline(judged),
        "causes": cause_lines(judged),
        "unchecked": "" if judged.is_checked else NOT_CHECKED,
        "nominal": _cells(errors_table(estimate.train)),
        "links": _cells(links_table(link_changes(estimate))),
        "bodies": _cells(bodies_table(link_changes(estimate))),
        "no_links": missing_reason(estimate),
        **torques_of(estimate, estimate.train),
        "test": json.loads(path.read_bytes()).get("summary", {}).get("test"),
        "table": parameters_table(estimate).rows,  # with the digits that the deviations allow
    }
    return {**summary(estimate), **shown, "command": str(estimate.provenance.get("command", ""))}


def _cells(table: Table) -> dict[str, Any]:
    """Return a table as plain data: headings with their units, which columns are numbers, and the rows."""
    heads = [f"{column.heading} [{column.unit}]" if column.unit else column.heading for column in table.columns]
    return {"heads": heads, "numbers": [column.numeric for column in table.columns], "rows": table.rows}


def saved_case(folder: Folder, data: Mapping[str, Any]) -> dict[str, Any]:
    """Write a case file: with the text of the editor, or with other columns; return it as :func:`case_view` does.

    ``sha256`` of the data is that of the file which :func:`case_view` has shown.

    Raises:
        DynidentError: No such file, too long, a mapping that cannot be, or changed since it was shown.
    """
    from dynident.studio.case_text import Mapped, with_columns

    name = str(data.get("name", ""))
    path = folder.find(name)
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise BadOption("case", name, "choose a case file")
    text = data.get("text")
    if text is None:
        mapped = Mapped.from_data(data)
        try:
            text = with_columns(path.read_text(encoding="utf-8"), mapped)
        except UnicodeDecodeError as error:
            raise FileError(name, f"byte {error.start} is not UTF-8 text", "save the file as UTF-8") from error
    if not isinstance(text, str) or len(text.encode()) > MAX_TEXT:
        raise BadOption("case", name, f"give a text of up to {MAX_TEXT:,} bytes")
    folder.write(name, text, str(data.get("sha256", "")))
    return case_view(folder, name)


def local(folder: Folder, text: str) -> str:
    """Return a message with the names of files without the folder of the session."""
    return text.replace(f"{folder.path}/", "").replace(f"{folder.path}\\", "")


def _kind(path: Path) -> str:
    facts = path.stat()
    return kind_of(path, facts.st_mtime_ns, facts.st_size)


def _case(folder: Folder, name: str) -> Case:
    from dynident.case.case import read_case

    return read_case(folder.find(name), open_gains=True)
