"""Joint controllers of the virtual cell, a family: one part per file, its law a compiled function."""

from dynident.plugins import Family
from dynident.simulation.controllers.base import Controller, Loop

CONTROLLERS: Family[Controller] = Family("dynident.simulation.controllers", Controller, "controller")  # type: ignore[type-abstract]

__all__ = ["CONTROLLERS", "Controller", "Loop"]
