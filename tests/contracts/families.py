"""All families of parts, by the name that the documentation calls each."""

from __future__ import annotations

from typing import Any

from dynident.estimation.doctor import CHECKS
from dynident.estimation.estimators import ESTIMATORS
from dynident.experiment.criteria import CRITERIA
from dynident.experiment.formats import FORMATS
from dynident.experiment.preprocessing import FILTERS
from dynident.experiment.profiles import PROFILES
from dynident.experiment.simulation.controllers import CONTROLLERS
from dynident.experiment.trajectories import TRAJECTORIES
from dynident.model.descriptions.base import DESCRIPTIONS
from dynident.model.friction import FRICTION
from dynident.plugins import Family
from dynident.results.exporters import EXPORTERS
from dynident.results.model_exporters import MODEL_EXPORTERS
from dynident.results.report.sections import SECTIONS

FAMILIES: dict[str, Family[Any]] = {
    "FRICTION": FRICTION,
    "ESTIMATORS": ESTIMATORS,
    "FILTERS": FILTERS,
    "FORMATS": FORMATS,
    "PROFILES": PROFILES,
    "CHECKS": CHECKS,
    "TRAJECTORIES": TRAJECTORIES,
    "CRITERIA": CRITERIA,
    "CONTROLLERS": CONTROLLERS,
    "DESCRIPTIONS": DESCRIPTIONS,
    "SECTIONS": SECTIONS,
    "EXPORTERS": EXPORTERS,
    "MODEL_EXPORTERS": MODEL_EXPORTERS,
}
