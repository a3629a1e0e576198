"""The figures of a report as files for a paper, those of the article under its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from html import unescape
from os import PathLike
from pathlib import Path
from typing import Any

from dynident.errors import FileError
from dynident.files import write_atomically
from dynident.results.figures import convergence_chart, path_chart, tool_path, torque_overview, trajectory_chart
from dynident.results.figures.files import figure_file
from dynident.results.report.builder import ReportPart
from dynident.results.report.sections.base import Drawing, drawn
from dynident.results.report.sections.convergence import traces_of
from dynident.results.report.subject import Dataset, Subject


def report_figures(subject: Subject, parts: Iterable[ReportPart]) -> dict[str, Drawing]:
    """Return the figures of a report by the names of their files without a suffix, in the order of the report.

    The same report has the same names. Two figures that would share one (joints whose names differ only in signs
    that files do not take) are told apart by a number. Figures 4 to 9 of the article come last, where it is its robot.

    Args:
        subject: What the report is about.
        parts: Its sections.
    """
    found: dict[str, Drawing] = {}
    for drawing in (*(each for part in parts for each in _drawings(part.context)), *article_figures(subject)):
        name, count = drawing.stem, 1
        while name in found:
            count += 1
            name = f"{drawing.stem}-{count}"
        found[name] = drawing
    return found


def write_figures(folder: str | PathLike[str], figures: Mapping[str, Drawing], format: str = "svg") -> tuple[Path, ...]:
    """Write figures as files into a folder, which is made where it is missing, and return their paths.

    Args:
        folder: Where they go.
        figures: By the name of their files without a suffix, as of :func:`report_figures`.
        format: ``svg``, ``pdf`` or ``png``.

    Raises:
        FileError: The folder or a file cannot be written.
        MissingDependency: PDF and PNG need the package typst.
        UnknownChoice: Another format.
    """
    contents = {name: figure_file(drawing, *_said(drawing), format) for name, drawing in figures.items()}
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(place, f"cannot be made ({error.strerror})", "choose another folder with --figures") from error
    for name, content in contents.items():
        write_atomically(place / f"{name}.{format}", content)
    return tuple(place / f"{name}.{format}" for name in contents)


def _drawings(value: Any) -> Iterator[Drawing]:
    """Yield the figures in what a template shows."""
    if isinstance(value, Drawing):
        yield value
    elif isinstance(value, Mapping):
        for each in value.values():
            yield from _drawings(each)
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _drawings(each)
    elif is_dataclass(value) and type(value).__module__.startswith("dynident.results.report"):
        for own in fields(value):
            yield from _drawings(getattr(value, own.name))


def _said(drawing: Drawing) -> tuple[str, str]:
    """Return the title and the robot model that stand in a figure."""
    return tuple(unescape(_between(drawing, tag)) for tag in ("title", "desc"))  # type: ignore[return-value]


def _between(drawing: str, tag: str) -> str:
    return drawing.partition(f"<{tag}>")[2].partition(f"</{tag}>")[0]


#: Name of the article's robot, as it ships.
ROBOT = "er16"


def article_figures(subject: Subject) -> tuple[Drawing, ...]:
    """Return the figures of the article; none for another robot or a fit of several logs.

    Figures 4, 5 and 7 show the motion of the fit and its torques, 8 and 9 those of the first test, 6 the objective over
    the iterations of the estimate's search. One for which the estimate has nothing is left out.
    """
    if subject.estimate.model.robot.name != ROBOT or len(subject.estimate.train.logs) != 1:
        return ()
    return tuple(_numbered(subject))


def _numbered(subject: Subject) -> Iterator[Drawing]:
    robot, train = subject.estimate.model.robot, [data for data in subject.datasets if not data.held_out]
    for data in train:
        yield _trajectory(subject, data, "Excitation trajectory", "figure-4-excitation-trajectory")
        path = path_chart("Excitation trajectory in space", tool_path(robot, data.validation.q))
        yield drawn(path, "figure-5-excitation-trajectory-in-space")
    traces, optimum = traces_of(subject)
    if traces:
        chart = convergence_chart(traces, optimum, subject.comparison.objective)
        yield drawn(chart, "figure-6-convergence")
    for data in train:
        yield _torques(data, "Torques of the fit", "figure-7-torques-of-the-fit")
    for data in subject.held_out[:1]:
        yield _trajectory(subject, data, "Validation trajectory", "figure-8-validation-trajectory")
        yield _torques(data, "Torques of the validation", "figure-9-torques-of-the-validation")


def _trajectory(subject: Subject, data: Dataset, title: str, name: str) -> Drawing:
    v, robot = data.validation, subject.estimate.model.robot
    kinds = [joint.kind for joint in robot.active]
    return drawn(trajectory_chart(title, robot.joint_names, kinds, v.time, v.q, v.dq, v.starts), name)


def _torques(data: Dataset, title: str, name: str) -> Drawing:
    v = data.validation
    joints = [(fit.name, fit.unit) for fit in v.joints]
    return drawn(torque_overview(title, joints, v.time, v.measured, v.predicted, v.starts), name)
