"""Joint controllers of the virtual cell, a family: one part per file, its law a compiled function."""

from dynident.experiment.simulation.controllers.base import Controller, Loop
from dynident.plugins import Family

CONTROLLERS: Family[Controller] = Family("dynident.experiment.simulation.controllers", Controller, "controller")  # type: ignore[type-abstract]

__all__ = ["CONTROLLERS", "Controller", "Loop"]
