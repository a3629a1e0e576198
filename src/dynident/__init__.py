"""dynident: dynamic model identification of robot arms.

The verbs and values of the library under one roof. Each is imported when it is first used, so that ``import dynident``
costs nothing: neither numba nor scipy is loaded before they are needed.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynident.api.applications import symbolic_model as symbolic_model
    from dynident.api.compare import compare as compare
    from dynident.api.demo import run_demo as run_demo
    from dynident.api.estimate_output import write_estimate as write_estimate
    from dynident.api.excite import excite as excite
    from dynident.api.export import export as export
    from dynident.api.given_logs import log_of as log_of
    from dynident.api.given_robots import robot_of as robot_of
    from dynident.api.identify import Record as Record
    from dynident.api.identify import identify as identify
    from dynident.api.init import init as init
    from dynident.api.validate import validate as validate
    from dynident.applications.compensation import computed_torque as computed_torque
    from dynident.applications.compensation import feed_forward as feed_forward
    from dynident.applications.compensation import friction_torque as friction_torque
    from dynident.applications.compensation import gravity_torque as gravity_torque
    from dynident.applications.compensation import mass_matrices as mass_matrices
    from dynident.applications.compensation import parameters_of as parameters_of
    from dynident.case.case import Case as Case
    from dynident.case.case import read_case as read_case
    from dynident.data.formats import ColumnMap as ColumnMap
    from dynident.data.formats import Units as Units
    from dynident.data.formats import read_log as read_log
    from dynident.data.formats import write_log as write_log
    from dynident.data.log import Log as Log
    from dynident.data.log import torque_from_current as torque_from_current
    from dynident.data.preprocessing import FILTERS as FILTERS
    from dynident.data.preprocessing import Preprocessing as Preprocessing
    from dynident.data.preprocessing import preprocess as preprocess
    from dynident.diagnosis.verdict import Verdict as Verdict
    from dynident.diagnosis.verdict import verdict_of as verdict_of
    from dynident.errors import BadArgument as BadArgument
    from dynident.errors import DynidentError as DynidentError
    from dynident.excitation.design.excitation import design_excitation as design_excitation
    from dynident.excitation.design.limits import limits_of as limits_of
    from dynident.excitation.design.options import DesignKnowledge as DesignKnowledge
    from dynident.excitation.design.options import SearchOptions as SearchOptions
    from dynident.excitation.design.options import SpaceLimits as SpaceLimits
    from dynident.excitation.design.options import TrajectoryOptions as TrajectoryOptions
    from dynident.excitation.design.plan import read_plan as read_plan
    from dynident.excitation.design.plan import write_plan as write_plan
    from dynident.excitation.trajectories.fourier import FourierSeries as FourierSeries
    from dynident.exports.models import MODEL_EXPORTERS as MODEL_EXPORTERS
    from dynident.exports.motions import MOTION_EXPORTERS as MOTION_EXPORTERS
    from dynident.exports.motions import Playback as Playback
    from dynident.exports.objects import mujoco_spec as mujoco_spec
    from dynident.exports.objects import pinocchio_model as pinocchio_model
    from dynident.exports.usd_layer import write_usd_layer as write_usd_layer
    from dynident.identification.build_problem import PriorKnowledge as PriorKnowledge
    from dynident.identification.build_problem import build_problem as build_problem
    from dynident.identification.estimate.estimate import Estimate as Estimate
    from dynident.identification.estimate.validation import Validation as Validation
    from dynident.identification.estimators import ESTIMATORS as ESTIMATORS
    from dynident.identification.files.estimate_file import read_estimate as read_estimate
    from dynident.identification.fit import fit as fit
    from dynident.identification.uncertainty.trust import TrustOptions as TrustOptions
    from dynident.model.base_parameters import BaseParameters as BaseParameters
    from dynident.model.base_parameters import base_parameters as base_parameters
    from dynident.model.body_constraints import Constraints as Constraints
    from dynident.model.dynamic_model import DynamicModel as DynamicModel
    from dynident.model.friction import FRICTION as FRICTION
    from dynident.model.friction import Motion as Motion
    from dynident.model.inertia import Inertia as Inertia
    from dynident.model.joint import Joint as Joint
    from dynident.model.joint import JointLimits as JointLimits
    from dynident.model.robot import Link as Link
    from dynident.model.robot import Robot as Robot
    from dynident.results.report import write_report as write_report
    from dynident.robot_files import read_robot as read_robot
    from dynident.simulation.cell import Cell as Cell
    from dynident.simulation.cell_simulation import simulate_cell as simulate_cell
    from dynident.simulation.controllers import CONTROLLERS as CONTROLLERS
    from dynident.simulation.effects import Effort as Effort
    from dynident.simulation.effects import Encoder as Encoder
    from dynident.simulation.effects import Recorder as Recorder
    from dynident.simulation.virtual_robot import Noise as Noise
    from dynident.simulation.virtual_robot import Timing as Timing
    from dynident.simulation.virtual_robot import simulate as simulate

_HOMES = {
    "api.applications": ("symbolic_model",),
    "api.demo": ("run_demo",),
    "api.compare": ("compare",),
    "api.estimate_output": ("write_estimate",),
    "api.excite": ("excite",),
    "api.export": ("export",),
    "api.given_logs": ("log_of",),
    "api.given_robots": ("robot_of",),
    "api.identify": ("Record", "identify"),
    "api.init": ("init",),
    "api.validate": ("validate",),
    "applications.compensation": (
        "computed_torque",
        "feed_forward",
        "friction_torque",
        "gravity_torque",
        "mass_matrices",
        "parameters_of",
    ),
    "case.case": ("Case", "read_case"),
    "data.formats": ("ColumnMap", "Units", "read_log", "write_log"),
    "data.log": ("Log", "torque_from_current"),
    "data.preprocessing": ("FILTERS", "Preprocessing", "preprocess"),
    "diagnosis.verdict": ("Verdict", "verdict_of"),
    "errors": ("BadArgument", "DynidentError"),
    "excitation.design.excitation": ("design_excitation",),
    "excitation.design.limits": ("limits_of",),
    "excitation.design.options": ("DesignKnowledge", "SearchOptions", "SpaceLimits", "TrajectoryOptions"),
    "excitation.design.plan": ("read_plan", "write_plan"),
    "excitation.trajectories.fourier": ("FourierSeries",),
    "exports.models": ("MODEL_EXPORTERS",),
    "exports.motions": ("MOTION_EXPORTERS", "Playback"),
    "exports.objects": ("mujoco_spec", "pinocchio_model"),
    "exports.usd_layer": ("write_usd_layer",),
    "identification.build_problem": ("PriorKnowledge", "build_problem"),
    "identification.estimate.estimate": ("Estimate",),
    "identification.estimate.validation": ("Validation",),
    "identification.estimators": ("ESTIMATORS",),
    "identification.files.estimate_file": ("read_estimate",),
    "identification.fit": ("fit",),
    "identification.uncertainty.trust": ("TrustOptions",),
    "model.base_parameters": ("BaseParameters", "base_parameters"),
    "model.body_constraints": ("Constraints",),
    "model.dynamic_model": ("DynamicModel",),
    "model.friction": ("FRICTION", "Motion"),
    "model.inertia": ("Inertia",),
    "model.joint": ("Joint", "JointLimits"),
    "model.robot": ("Link", "Robot"),
    "results.report": ("write_report",),
    "robot_files": ("read_robot",),
    "simulation.cell": ("Cell",),
    "simulation.cell_simulation": ("simulate_cell",),
    "simulation.controllers": ("CONTROLLERS",),
    "simulation.effects": ("Effort", "Encoder", "Recorder"),
    "simulation.virtual_robot": ("Noise", "Timing", "simulate"),
}
_HOME_OF = {name: f"dynident.{module}" for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(import_module(_HOME_OF[name]), name)
    if name == "__version__":
        return import_module("importlib.metadata").version("dynident")
    near = import_module("dynident.errors").nearest(name, _HOME_OF, 0.7)
    raise AttributeError(f"module 'dynident' has no attribute '{name}'{near}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME_OF, "__version__"])
