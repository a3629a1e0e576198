"""Trajectories and the tool's path, designed and recorded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from markupsafe import Markup

from dynident.arrays import Array
from dynident.model.robot import Robot
from dynident.results.figures import path_chart, tool_path, trajectory_chart
from dynident.results.report.sections.base import ReportSection, drawn, left_out
from dynident.results.report.subject import MOST_DRAWN, Subject
from dynident.results.text import label


@dataclass(frozen=True)
class MotionSection(ReportSection):
    """Positions and speeds over time and the path in space, of reference motions and of the logs."""

    title: ClassVar = "Trajectories and tool path"

    def context(self, subject: Subject) -> dict[str, Any]:
        robot = subject.estimate.model.robot
        groups: list[tuple[str, list[Markup]]] = []
        for name, log in subject.trajectories.items():
            if log.samples:
                groups.append(
                    (f"Reference: {label(name)}", _figures(robot, f"reference-{name}", log.time, log.q, log.dq, (0,)))
                )
        for dataset in subject.datasets[:MOST_DRAWN]:
            v = dataset.validation
            groups.append(
                (
                    f"{dataset.name}, as recorded: {dataset.logs}",
                    _figures(robot, dataset.name, v.time, v.q, v.dq, v.starts),
                )
            )
        return {"groups": groups, "left_out": left_out(subject)} if groups else {}


def _figures(robot: Robot, name: str, time: Array, q: Array, dq: Array | None, starts: tuple[int, ...]) -> list[Markup]:
    kinds = [joint.kind for joint in robot.active]
    return [
        drawn(trajectory_chart("Joints", robot.joint_names, kinds, time, q, dq, starts), "trajectory", name),
        drawn(path_chart("Path of the tool", tool_path(robot, q)), "tool-path", name),
    ]
