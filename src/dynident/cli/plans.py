"""What excite, inspect and report share: a plan with its case, checked again, and its tables in the terminal."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from dynident.cli import console
from dynident.cli.knowledge import knowledge_of
from dynident.errors import BadOption, FileError

if TYPE_CHECKING:
    from dynident.errors import FileError
    from dynident.excitation.design.limits import LimitRow
    from dynident.model.robot import Robot
    from dynident.results.plan_view import PlanView


def is_plan(path: str) -> bool:
    """Return whether a file says of itself that it is a plan."""
    from dynident.excitation.design.plan import KIND

    if Path(path).suffix.lower() != ".json":
        return False
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False  # whoever reads it next says what is wrong with it
    return isinstance(data, dict) and data.get("kind") == KIND


def files_of(case_path: str | None) -> list[str | Path]:
    """Return a case and the files it stands on; none without a case.

    Raises:
        DynidentError: A fault of the case.
    """
    if case_path is None:
        return []
    from dynident.case.case import read_case

    return [case_path, *read_case(case_path).files]


def plan_view(
    path: str,
    case_path: str | None,
    estimate: str | None = None,
    sigmas: float | None = None,
    robot: Robot | None = None,
) -> PlanView:
    """Read a plan and check it again.

    Args:
        path: The plan.
        case_path: Case file or robot model; None to check only what the plan itself holds.
        estimate: Estimate whose parameters and covariance stand for the torques; None for the robot model's masses.
        sigmas: Standard deviations of its torque that stay free; None for 2.
        robot: Robot for the path of the tool, where no case is given.

    Raises:
        DynidentError: A fault of a file, a robot with other joints, or an estimate without a case.
    """
    from dynident.excitation.design.plan import read_plan
    from dynident.excitation.design.recheck import recheck
    from dynident.results.plan_view import PlanView

    plan = read_plan(path)
    if case_path is None:
        for name, value in (("--model", estimate), ("--sigmas", sigmas)):
            if value is not None:
                raise BadOption(name, value, "it needs --case, the robot whose torques it is about")
        return PlanView(plan, recheck(plan), robot, source=path)
    from dynident.api.excite import case_clearance, space_limits
    from dynident.case.case import read_case
    from dynident.excitation.design.recheck import with_friction_of

    case = read_case(case_path)
    model = with_friction_of(plan, case.model)
    nothing = {"noise": None, "noise_from": None, "earlier": None, "earlier_logs": []}
    known = knowledge_of(argparse.Namespace(model=estimate, sigmas=sigmas, **nothing), case, model)
    theta = model.nominal() if known.theta is None else known.theta
    clearance, tool = case_clearance(case), space_limits(case).tool
    check = recheck(plan, model, theta=theta, uncertainty=known.uncertainty, clearance=clearance, tool=tool)
    free = f", {known.uncertainty.sigmas:g} sigmas free" if known.uncertainty else ""
    torques = "" if theta is None else f"{known.model or 'the nominal masses'}{free}"
    return PlanView(plan, check, case.robot, model, theta, case.workspace, clearance, torques, path)


def check_kept(view: PlanView, path: str) -> None:
    """Refuse a plan that passes a bound, after it has been shown.

    Raises:
        FileError: A bound is passed.
    """
    if not view.check.kept:
        raise breached(view.check.worst, path)


def breached(worst: LimitRow, path: str) -> FileError:
    """Return the error to raise for a plan that passes a bound and must not be driven."""
    from dynident.excitation.design.plan import breach_of

    return FileError(path, breach_of(worst), "do not drive it; design the motion again with these limits")


def show_plan(view: PlanView) -> None:
    """Print what a plan is, its figures and its check."""
    from dynident.results import plan_view as shown
    from dynident.results.text import label

    facts = shown.plan_facts(view)
    width = max(len(name) for name, _ in facts)
    for name, value in facts:
        console.answer(f"{name:<{width}}  {value}")
    console.answer(f"\n{shown.verdict(view)}")
    for finding in view.check.findings:
        console.answer(f"does not agree with the file: {label(finding)}")
    console.answer()
    console.answer_table(shown.criteria_table(view))
    for table in (
        shown.limits_table(view),
        shown.clearance_table(view) if view.check.clearances else None,
        shown.outlook_table(view.plan, console.NAME_WIDTH),
    ):
        if table is not None:
            console.answer()
            console.answer_table(table, table.note)
    console.answer()
    for remark in shown.plan_remarks(view):
        console.answer(label(remark))
