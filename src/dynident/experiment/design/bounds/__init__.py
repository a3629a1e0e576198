"""What a designed motion must keep: one small object a kind of bound, all with the interface of ``base.Bound``."""

from dynident.experiment.design.bounds.base import Bound, Grid, Label
from dynident.experiment.design.bounds.clearance import ClearanceBound
from dynident.experiment.design.bounds.kinematic import KinematicBound
from dynident.experiment.design.bounds.tool_speed import ToolSpeedBound
from dynident.experiment.design.bounds.torque import TorqueBound
from dynident.experiment.design.bounds.torque_rate import TorqueRateBound, smooth_parameters

__all__ = [
    "Bound",
    "ClearanceBound",
    "Grid",
    "KinematicBound",
    "Label",
    "ToolSpeedBound",
    "TorqueBound",
    "TorqueRateBound",
    "smooth_parameters",
]
