"""dynident: dynamic model identification of robot arms.

The verbs and values of the library under one roof. Each is imported when it is first used, so that ``import dynident``
costs nothing: neither numba nor scipy is loaded before they are needed.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynident.errors import DynidentError as DynidentError
    from dynident.estimation.estimate import Estimate as Estimate
    from dynident.estimation.estimate_file import read_estimate as read_estimate
    from dynident.estimation.estimate_file import write_estimate as write_estimate
    from dynident.estimation.estimators import ESTIMATORS as ESTIMATORS
    from dynident.estimation.identify import identify as identify
    from dynident.estimation.identify import validate as validate
    from dynident.estimation.validation import Validation as Validation
    from dynident.experiment.case_file.case import Case as Case
    from dynident.experiment.case_file.case import read_case as read_case
    from dynident.experiment.design.excitation import design_excitation as design_excitation
    from dynident.experiment.design.limits import limits_of as limits_of
    from dynident.experiment.design.plan import read_plan as read_plan
    from dynident.experiment.design.plan import write_plan as write_plan
    from dynident.experiment.formats import ColumnMap as ColumnMap
    from dynident.experiment.formats import Units as Units
    from dynident.experiment.formats import read_log as read_log
    from dynident.experiment.formats import write_log as write_log
    from dynident.experiment.log import Log as Log
    from dynident.experiment.preprocessing import FILTERS as FILTERS
    from dynident.experiment.preprocessing import Preprocessing as Preprocessing
    from dynident.experiment.preprocessing import preprocess as preprocess
    from dynident.experiment.simulation.virtual_robot import simulate as simulate
    from dynident.experiment.trajectories.fourier import FourierSeries as FourierSeries
    from dynident.model.base_parameters import BaseParameters as BaseParameters
    from dynident.model.base_parameters import base_parameters as base_parameters
    from dynident.model.descriptions import read_robot as read_robot
    from dynident.model.dynamic_model import DynamicModel as DynamicModel
    from dynident.model.friction import FRICTION as FRICTION
    from dynident.model.inertia import Inertia as Inertia
    from dynident.model.robot import Joint as Joint
    from dynident.model.robot import Link as Link
    from dynident.model.robot import Robot as Robot
    from dynident.results.exporters import EXPORTERS as EXPORTERS
    from dynident.results.exporters import export as export
    from dynident.results.model_exporters import MODEL_EXPORTERS as MODEL_EXPORTERS
    from dynident.results.model_exporters import export_model as export_model
    from dynident.results.report import write_report as write_report

_HOMES = {
    "errors": ("DynidentError",),
    "estimation.estimate": ("Estimate",),
    "estimation.estimate_file": ("read_estimate", "write_estimate"),
    "estimation.estimators": ("ESTIMATORS",),
    "estimation.identify": ("identify", "validate"),
    "estimation.validation": ("Validation",),
    "experiment.case_file.case": ("Case", "read_case"),
    "experiment.design.excitation": ("design_excitation",),
    "experiment.formats": ("ColumnMap", "Units", "read_log", "write_log"),
    "experiment.design.limits": ("limits_of",),
    "experiment.log": ("Log",),
    "experiment.design.plan": ("read_plan", "write_plan"),
    "experiment.preprocessing": ("FILTERS", "Preprocessing", "preprocess"),
    "experiment.trajectories.fourier": ("FourierSeries",),
    "experiment.simulation.virtual_robot": ("simulate",),
    "model.base_parameters": ("BaseParameters", "base_parameters"),
    "model.descriptions": ("read_robot",),
    "model.dynamic_model": ("DynamicModel",),
    "model.friction": ("FRICTION",),
    "model.inertia": ("Inertia",),
    "model.robot": ("Joint", "Link", "Robot"),
    "results.exporters": ("EXPORTERS", "export"),
    "results.model_exporters": ("MODEL_EXPORTERS", "export_model"),
    "results.report": ("write_report",),
}
_HOME_OF = {name: f"dynident.{module}" for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(_HOME_OF[name]), name)
    if name == "__version__":
        return import_module("importlib.metadata").version("dynident")
    raise AttributeError(f"module 'dynident' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME_OF, "__version__"])
