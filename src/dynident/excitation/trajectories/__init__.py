"""Trajectories, a family: one kind of motion per part."""

from dynident.excitation.trajectories.base import Trajectory
from dynident.plugins import Family

TRAJECTORIES: Family[Trajectory] = Family("dynident.excitation.trajectories", Trajectory, "trajectory")  # type: ignore[type-abstract]

__all__ = ["TRAJECTORIES", "Trajectory"]
