"""What a designed motion must keep: one small object a kind of bound, all with the interface of ``base.Bound``."""

from dynident.excitation.design.bounds.base import Bound, BoundLabel, Grid
from dynident.excitation.design.bounds.clearance import ClearanceBound
from dynident.excitation.design.bounds.kinematic import KinematicBound
from dynident.excitation.design.bounds.tool_speed import ToolSpeedBound
from dynident.excitation.design.bounds.torque import TorqueBound
from dynident.excitation.design.bounds.torque_rate import TorqueRateBound, smooth_parameters

__all__ = [
    "Bound",
    "BoundLabel",
    "ClearanceBound",
    "Grid",
    "KinematicBound",
    "ToolSpeedBound",
    "TorqueBound",
    "TorqueRateBound",
    "smooth_parameters",
]
