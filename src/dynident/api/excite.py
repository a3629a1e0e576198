"""excite: the design of the motion to record for a case, within its limits, workspace and friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dynident.api.given_logs import case_of
from dynident.case.case import Case
from dynident.excitation.design.excitation import ROWS_A_SECOND, design_excitation
from dynident.excitation.design.limits import MotionLimits, ToolLimit
from dynident.excitation.design.multistart import SearchState
from dynident.excitation.design.options import DesignKnowledge, SearchOptions, SpaceLimits, TrajectoryOptions
from dynident.excitation.design.plan import Plan
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction
from dynident.model.robot import Robot

if TYPE_CHECKING:
    from dynident.excitation.collision.clearance import Clearance


def excite(
    case: Case | DynamicModel | Robot | str | Path,
    criterion: str = "d_optimal",
    *,
    limits: MotionLimits | None = None,
    trajectory: TrajectoryOptions | None = None,
    knowledge: DesignKnowledge | None = None,
    search: SearchOptions | None = None,
    friction: Sequence[Friction] | None = None,
    progress: Callable[[SearchState], None] = lambda state: None,
) -> Plan:
    """Design a motion that determines the base parameters of the robot of a case.

    The workspace of the case bounds the motion in space.

    Args:
        case: Case, dynamic model or robot, or a file of one.
        criterion: Name of the criterion.
        limits: What the motion must keep; None for the limits of the robot model less 5 % (torque 20 %).
        trajectory: The family of motions; None for the default one.
        knowledge: What is known before the run; None for the robot model alone. Without ``rows`` the run counts for
            one period at the sample rate of the case.
        search: How it is searched; None for the default.
        friction: Friction parts of the design; None for those of the case whose columns follow from the motion alone,
            see :func:`friction_of_motion`.
        progress: Called about five times a second and start, and when a start is done.

    Raises:
        BadArgument: Something else than a robot.
        DynidentError: As :func:`~dynident.excitation.design.excitation.design_excitation`.
    """
    case = case_of(case)
    trajectory, knowledge = trajectory or TrajectoryOptions(), knowledge or DesignKnowledge()
    if knowledge.rows is None:
        rate = case.preprocessing.rate_hz or ROWS_A_SECOND
        knowledge = replace(knowledge, rows=rate * trajectory.period)
    parts = friction_of_motion(case.friction) if friction is None else tuple(friction)
    return design_excitation(
        replace(case, friction=parts).model,
        limits,
        criterion,
        trajectory=trajectory,
        knowledge=knowledge,
        space=space_limits(case),
        search=search,
        progress=progress,
    )


def friction_of_motion(friction: Sequence[Friction]) -> tuple[Friction, ...]:
    """Return the parts whose columns follow from the motion alone, and are certain to be there."""
    return tuple(part for part in friction if not part.needs and not part.is_optional)


def space_limits(case: Case) -> SpaceLimits:
    """Return the clearances and the tool speed that the workspace of a case asks for; none where it states none."""
    if case.workspace is None or case.workspace.tool_speed == float("inf"):
        return SpaceLimits(case_clearance(case))
    from dynident.excitation.collision.tool_speed import tool_point_of  # few cases have a workspace

    tool = ToolLimit(tool_point_of(case.robot, case.workspace), case.workspace.tool_speed)
    return SpaceLimits(case_clearance(case), tool)


def case_clearance(case: Case) -> Clearance | None:
    """Return the distances that the workspace of a case asks for; None where it states none."""
    if case.workspace is None:
        return None
    from dynident.excitation.collision.clearance import clearance_of

    return clearance_of(case.robot, case.workspace)
