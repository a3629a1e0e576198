"""Figures: data to SVG text. Each is a pure function; nothing is read, written or fetched."""

from dynident.results.figures.bodies import Scene, mass_scene, scene_chart, scene_text
from dynident.results.figures.convergence import convergence_chart
from dynident.results.figures.path import Scenery, Spot, ToolPath, path_chart, tool_path
from dynident.results.figures.residuals import friction_chart, residual_chart
from dynident.results.figures.rows import Intervals, error_chart, interval_chart
from dynident.results.figures.signals import (
    Bounded,
    TorqueBands,
    TorqueSignals,
    limit_chart,
    line_chart,
    small_torque_chart,
    torque_chart,
    torque_overview,
    trajectory_chart,
)

__all__ = [
    "Bounded",
    "Intervals",
    "Scene",
    "Scenery",
    "Spot",
    "ToolPath",
    "TorqueBands",
    "TorqueSignals",
    "convergence_chart",
    "error_chart",
    "friction_chart",
    "interval_chart",
    "limit_chart",
    "line_chart",
    "mass_scene",
    "path_chart",
    "residual_chart",
    "scene_chart",
    "scene_text",
    "small_torque_chart",
    "tool_path",
    "torque_chart",
    "torque_overview",
    "trajectory_chart",
]
