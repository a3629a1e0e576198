"""All families of parts, by the name that the documentation calls each."""

from __future__ import annotations

from typing import Any

from dynident.data.formats import FORMATS
from dynident.data.preprocessing import FILTERS
from dynident.data.profiles import PROFILES
from dynident.diagnosis.checks import CHECKS
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.trajectories import TRAJECTORIES
from dynident.exports.models import MODEL_EXPORTERS
from dynident.exports.motions import MOTION_EXPORTERS
from dynident.identification.estimators import ESTIMATORS
from dynident.model.friction import FRICTION
from dynident.plugins import Family
from dynident.results.report.sections import SECTIONS
from dynident.robot_files.formats.base import DESCRIPTIONS
from dynident.simulation.controllers import CONTROLLERS

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
    "MOTION_EXPORTERS": MOTION_EXPORTERS,
    "MODEL_EXPORTERS": MODEL_EXPORTERS,
}
