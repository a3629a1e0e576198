"""The equations of small arms as SymPy expressions."""

from dynident.applications.symbolic.symbolic_model import SymbolicModel, symbolic_model

__all__ = ["SymbolicModel", "symbolic_model"]
