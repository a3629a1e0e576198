"""What the template of a plan needs: its curves, its path in space, its tables."""

from __future__ import annotations

from typing import Any

import numpy as np
from markupsafe import Markup

from dynident.arrays import Array
from dynident.excitation.collision.tool_speed import ToolPoint, tool_point_of
from dynident.excitation.collision.workspace import Workspace
from dynident.model.friction import Motion
from dynident.model.robot import Robot
from dynident.results.figures import Bounded, Scenery, Spot, limit_chart, path_chart, tool_path, trajectory_chart
from dynident.results.plan_view import (
    PlanView,
    clearance_table,
    criteria_table,
    limits_table,
    nearest,
    outlook_table,
    plan_facts,
    plan_remarks,
    verdict,
)
from dynident.results.report.sections.base import drawn

#: Samples of the curves: one for each half unit of a figure.
SAMPLES = 801


def plan_context(view: PlanView) -> dict[str, Any]:
    """Return what the template ``excitation.html`` shows of a plan."""
    motion = view.plan.motion()
    time = np.linspace(0.0, motion.duration, SAMPLES)
    q, dq, ddq = motion.evaluate(time)
    return {
        "kept": view.check.kept,
        "verdict": verdict(view),
        "findings": view.check.findings,
        "facts": plan_facts(view),
        "overview": _overview(view, time, q, dq),
        "with_path": view.robot is not None,
        "with_torque": view.model is not None and view.theta is not None,
        "with_workspace": view.workspace is not None,
        "joints": _joints(view, time, q, dq, ddq),
        "limits": limits_table(view),
        "clearances": clearance_table(view) if view.check.clearances else None,
        "criteria": criteria_table(view),
        "outlook": outlook_table(view.plan),
        "remarks": plan_remarks(view),
    }


def _overview(view: PlanView, time: Array, q: Array, dq: Array) -> list[Markup]:
    """Draw all joints together and, where the robot is known, the path of its tool."""
    limits = view.plan.limits
    kinds = ["revolute" if turns else "prismatic" for turns in limits.revolute]
    figures: list[Markup] = [
        drawn(trajectory_chart("All joints", limits.joints, kinds, time, q, dq), "plan-trajectory")
    ]
    if view.robot is not None:
        figures.append(drawn(_path(view, view.robot, q), "plan-tool-path"))
    return figures


def _path(view: PlanView, robot: Robot, q: Array) -> str:
    """Draw the path with what stands around, and mark where the pairs of shapes come nearest."""
    point = tool_point_of(robot, view.workspace or Workspace())
    close = nearest(view)
    when = np.array([row.time for row in close])
    postures = view.plan.motion().evaluate(when)[0]
    spots = [Spot(str(k), place) for k, place in enumerate(point.position(postures), start=1)] if close else []
    others = [_bones(robot, posture, point) for posture in postures[:1]]
    path = tool_path(robot, q, point=point)
    return path_chart("Path of the tool", path, scenery=Scenery.of(view.workspace, spots, others))


def _bones(robot: Robot, posture: Array, point: ToolPoint) -> Array:
    return tool_path(robot, posture[None, :], point=point).bones


def _joints(view: PlanView, time: Array, q: Array, dq: Array, ddq: Array) -> list[Markup]:
    """Draw each joint with its limits; its torque too where the model is known."""
    limits = view.plan.limits
    symmetric = [("speed", "velocity", dq), ("acceleration", "acceleration", ddq)]
    if view.model is not None and view.theta is not None:
        symmetric.append(("torque", "torque", view.model.torque(Motion(q, dq, ddq), view.theta)))
    figures: list[Markup] = []
    for i, name in enumerate(limits.joints):
        ends = float(limits.lower[i]), float(limits.upper[i])
        signals = [Bounded("position", limits.unit("position", i), q[:, i], *ends)]
        for word, key, values in symmetric:
            bound = float(getattr(limits, key)[i])
            shown = "force" if word == "torque" and not limits.revolute[i] else word
            signals.append(Bounded(shown, limits.unit(key, i), values[:, i], -bound, bound))
        figures.append(drawn(limit_chart(name, time, signals), "plan-limits", name))
    return figures
