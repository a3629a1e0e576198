"""The report: its sections in order, in one self-contained page that asks nothing of any network."""

from __future__ import annotations

import base64
import hashlib
import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from dynident.data.log import Log, Source
from dynident.errors import BadArgument
from dynident.exports.models.proving.followed_motion import MotionProof
from dynident.files import check_outputs, files_behind, write_atomically
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.plugins import added
from dynident.results.plan_view import PlanView
from dynident.results.report.plan_context import plan_context
from dynident.results.report.sections import SECTIONS
from dynident.results.report.subject import Comparison, Subject
from dynident.results.text import Table, clean, display_width, label

#: Sections from top to bottom; one that is not named here stands before the last.
ORDER = (
    "verdict",
    "torques",
    "nominal",
    "friction",
    "parameters",
    "bodies",
    "mass_distribution",
    "mass_matrix",
    "simulation",
    "validation",
    "residuals",
    "trust",
    "choices",
    "data",
    "log_quality",
    "excitation",
    "motion",
    "robot",
    "convergence",
    "comparison",
    "provenance",
)

#: Scripts, by the attribute in a page that asks for each; a page without its scripts says the same.
SCRIPTS = {"zoom.js": " data-zoom=", "turn.js": " data-scene="}

#: Looks of a page: those that the studio has too, those of tables in a narrow place, those of a page on its own.
STYLES = ("style.css", "cards.css", "page.css")

#: Letters that a table may take across, by its class; from 34, 50 and 66 rem on there is place for them.
SIZES = {"": 68, "many": 102}

#: Letters after which a cell breaks.
_WIDEST = 46


def write_report(
    path: str | PathLike[str],
    estimate: Estimate,
    validations: Validation | Iterable[Validation] = (),
    *,
    comparison: Comparison | Sequence[Mapping[str, Any]] | None = None,
    trajectories: Mapping[str, Log] | None = None,
    command: str = "",
    sources: Iterable[Source] = (),
    plan: PlanView | None = None,
) -> None:
    """Write the report of an estimate as one HTML file; see :func:`build_report` for the arguments.

    Raises:
        BadOption: The plan has other joints than the robot.
        BadArgument: Something else in place of the estimate.
        FileError: The file cannot be written, or the estimate was made from it.
        LogMismatch: A validation or a trajectory has other joints than the robot.
    """
    if not isinstance(estimate, Estimate):
        step = "write di.write_report(path, estimate)"
        raise BadArgument("estimate", f"{type(estimate).__name__} where an Estimate is wanted", step)
    check_outputs((str(path),), files_behind(estimate.provenance))
    page = build_report(
        estimate,
        validations,
        comparison=comparison,
        trajectories=trajectories,
        command=command,
        sources=sources,
        plan=plan,
    )
    write_atomically(path, page)


def build_report(
    estimate: Estimate,
    validations: Validation | Iterable[Validation] = (),
    *,
    comparison: Comparison | Sequence[Mapping[str, Any]] | None = None,
    trajectories: Mapping[str, Log] | None = None,
    command: str = "",
    sources: Iterable[Source] = (),
    plan: PlanView | None = None,
    motion: MotionProof | None = None,
) -> str:
    """Return the report of an estimate as HTML.

    Args:
        estimate: What it is about.
        validations: Comparisons with logs that the fit did not see; one or several.
        comparison: Several estimators on the same data, or only the rows of their table.
        trajectories: Reference motions by name, as logs with time, q and, where known, dq.
        command: The command line that repeats it; by default that of the estimate's provenance.
        sources: Files of the tests; those of the fit are in the estimate's provenance.
        plan: The motion that was designed, with its check.
        motion: What ``prove_motion`` of an export made of the model along the motion of a log.

    Raises:
        BadOption: The plan has other joints than the robot.
        LogMismatch: A validation or a trajectory has other joints than the robot.
    """
    beside = comparison if isinstance(comparison, Comparison) else Comparison(tuple(comparison or ()))
    given = (dict(trajectories or {}), command, tuple(sources), plan)
    seen = (validations,) if isinstance(validations, Validation) else tuple(validations)
    return render(Subject(estimate, seen, beside, *given, motion=motion))


def render(subject: Subject, names: Sequence[str] = ()) -> str:
    """Return the page of a subject.

    Args:
        subject: What the report is about.
        names: Sections to show, in order; all by default. One with nothing to show is left out.
    """
    return report_page(subject, parts_of(subject, names))


def parts_of(subject: Subject, names: Sequence[str] = ()) -> tuple[ReportPart, ...]:
    """Return the sections of a report as data, arguments as of :func:`render`."""
    found = []
    for name in names or section_names():
        section = SECTIONS.make(name)
        context = section.context(subject)
        if context:
            found.append(ReportPart(name, section.title, section.template, context))
    return tuple(found)


def report_page(subject: Subject, parts: Sequence[ReportPart]) -> str:
    """Return the page of a subject from its sections.

    Args:
        subject: What the report is about.
        parts: From top to bottom, as of :func:`parts_of`.
    """
    estimate = subject.estimate
    lead = (f"{estimate.base.count} base parameters", f"estimator {estimate.estimator}", f"{estimate.samples} samples")
    return build_page("Identification", estimate.model.robot.name, lead, parts)


def write_plan_page(path: str | PathLike[str], view: PlanView) -> None:
    """Write a plan as one HTML file; see :func:`build_plan_page`.

    Raises:
        FileError: The file cannot be written.
    """
    write_atomically(path, build_plan_page(view))


def build_plan_page(view: PlanView) -> str:
    """Return a plan as an HTML page of its own: the section of the report, and nothing else.

    Args:
        view: The plan with its check.
    """
    plan = view.plan
    lead = (f"criterion {label(plan.criterion)}", f"{plan.motion().duration:g} s", *filter(None, [view.source]))
    template = SECTIONS.make("excitation").template
    part = ReportPart("excitation", "Motion, limits and check", template, plan_context(view))
    return build_page("Excitation", plan.robot, lead, [part])


@dataclass(frozen=True)
class ReportPart:
    """A part of a page: its place, its heading, and what fills its template."""

    name: str
    title: str
    template: str
    context: Mapping[str, Any]


def build_page(what: str, robot: str, lead: Sequence[str], parts: Sequence[ReportPart]) -> str:
    """Return a self-contained page about a robot.

    Args:
        what: What it shows, the first word of its title.
        robot: Name of the robot.
        lead: Facts below the title.
        parts: From top to bottom.
    """
    filled = [(part.name, part.title, _filled(part.template, part.context)) for part in parts]
    return _page(what, robot, lead, filled)


def _filled(template: str, context: Mapping[str, Any]) -> Markup:
    return Markup(_environment().get_template(template).render(context))


def _page(what: str, robot: str, lead: Sequence[str], parts: Sequence[tuple[str, str, Markup]]) -> str:
    """Return a whole page of sections: name, title and body each."""
    page = _environment()
    style = Markup("".join(page.get_template(name).render() for name in STYLES))
    bodies = "".join(body for _, _, body in parts)
    return page.get_template("report.html").render(
        title=f"{what} of {label(robot)}",
        what=what,
        robot=label(robot),
        lead=lead,
        sections=parts,
        style=style,
        style_hash=_digest(style),
        scripts=[_script(name) for name, mark in SCRIPTS.items() if mark in bodies],
        version=version("dynident"),
    )


@dataclass(frozen=True)
class Script:
    """A script of a page.

    Attributes:
        text: What it does; no ``</script`` in it.
        digest: Its SHA-256 as base64, by which the page allows it and no other.
    """

    text: Markup
    digest: str


@cache
def _script(name: str) -> Script:
    text = _environment().get_template(name).render()
    return Script(Markup(text), _digest(text))


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def section_names() -> tuple[str, ...]:
    """Return the sections of the family in the order of the report."""
    found = SECTIONS.names()
    new = [name for name in found if name not in ORDER]
    return (*[name for name in ORDER[:-1] if name in found], *new, ORDER[-1])


def _shown(value: Any) -> Any:
    """Make a text that a template puts in printable and keep its signs of percent to their numbers."""
    if isinstance(value, str) and not isinstance(value, Markup):
        return clean(value).replace(" %", "\u00a0%")
    return value


def _size(table: Table) -> str:
    """Return the class of a table by the place that it takes: none, ``many`` or ``vast``; see the style."""
    heads = [f"{column.heading} {column.unit}" for column in table.columns]
    lines = [heads, *([_seen(cell) for cell in row] for row in table.rows)]
    need = sum(min(max(map(display_width, column)), _WIDEST) + 2 for column in zip(*lines, strict=True))
    return next((name for name, most in SIZES.items() if need <= most), "vast")


def _seen(cell: str) -> str:
    """Return what is seen of a cell in its first line: no tags, and a deviation stands below its value."""
    text = cell.striptags() if isinstance(cell, Markup) else cell
    return text.partition(" ± ")[0]


@cache
def _environment() -> jinja2.Environment:
    beside = {Path(inspect.getfile(SECTIONS.get(name))).parent for name in added(SECTIONS.package)}
    made = jinja2.Environment(
        loader=jinja2.ChoiceLoader(
            [jinja2.PackageLoader("dynident.results.report", "templates"), jinja2.FileSystemLoader(sorted(beside))]
        ),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_shown,
    )
    made.filters["size"] = _size
    return made
