"""Parameters of one servo joint, their order in the compiled roll-out, and which of them a friction model has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from dynident.arrays import Array


@dataclass(frozen=True)
class ServoParameter:
    """A parameter of one servo joint.

    Attributes:
        name: Name in files and tables.
        unit: Unit for a joint that turns.
        lower: Lower bound.
        upper: Upper bound.
        scale: Size of a typical change, for the optimiser.
        meaning: What it is, in a few words.
    """

    name: str
    unit: str
    lower: float
    upper: float
    scale: float
    meaning: str


#: In the order of the columns of the compiled roll-out.
PARAMETERS: Final = (
    ServoParameter("gain_ratio", "1", 1e-3, 1e3, 0.1, "position gain over that of the drive law"),
    ServoParameter("full_torque", "N m", 1e-4, 1e4, 0.1, "stall torque at full duty"),
    ServoParameter("back_emf", "N m s/rad", 0.0, 1e3, 0.01, "torque lost per speed while the drive is on"),
    ServoParameter("viscous", "N m s/rad", 0.0, 1e3, 0.01, "viscous friction"),
    ServoParameter("coulomb", "N m", 0.0, 1e3, 0.01, "Coulomb friction"),
    ServoParameter("coulomb_stribeck", "N m", 0.0, 1e3, 0.01, "friction that is added near standstill"),
    ServoParameter("load_motor", "1", 0.0, 0.5, 0.1, "friction per motor torque"),
    ServoParameter("load_external", "1", 0.0, 0.5, 0.1, "friction per external torque"),
    ServoParameter("load_motor_stribeck", "1", 0.0, 1.0, 0.1, "friction per motor torque near standstill"),
    ServoParameter("load_external_stribeck", "1", 0.0, 1.0, 0.1, "friction per external torque near standstill"),
    ServoParameter("load_motor_quadratic", "1/(N m)", 0.0, 1.0, 0.05, "friction per squared motor torque"),
    ServoParameter("load_external_quadratic", "1/(N m)", 0.0, 1.0, 0.05, "friction per squared external torque"),
    ServoParameter("stribeck_velocity", "rad/s", 0.02, 5.0, 0.2, "speed over which the Stribeck effect fades"),
    ServoParameter("stribeck_exponent", "1", 0.5, 10.0, 1.0, "exponent of that fading"),
    ServoParameter("armature", "kg m^2", 1e-7, 1e3, 0.001, "rotor inertia at the joint"),
    ServoParameter("angle_offset", "rad", -0.3, 0.3, 0.02, "true joint angle less the encoder's"),
    ServoParameter("delay", "s", 0.0, 0.1, 0.005, "time until a command acts"),
    ServoParameter("slew_limit", "rad/s", 0.05, np.inf, 1.0, "fastest change of the goal inside the drive"),
    ServoParameter("damping_gain", "s/rad", 0.0, 1e3, 0.01, "duty per velocity error"),
)

#: Column of each parameter by its name.
PLACE: Final = {parameter.name: k for k, parameter in enumerate(PARAMETERS)}

COUNT: Final = len(PARAMETERS)

#: Power of a common scale of all torques and inertias by which each parameter goes, shape (COUNT,).
SCALE_POWER: Final = np.zeros(COUNT)
for _name in ("full_torque", "back_emf", "viscous", "coulomb", "coulomb_stribeck", "armature"):
    SCALE_POWER[PLACE[_name]] = 1.0
for _name in ("load_motor_quadratic", "load_external_quadratic"):
    SCALE_POWER[PLACE[_name]] = -1.0


def neutral() -> Array:
    """Return parameters of a drive without friction, delay and slew limit, shape (COUNT,)."""
    values = np.zeros(COUNT)
    values[PLACE["gain_ratio"]] = values[PLACE["full_torque"]] = values[PLACE["stribeck_exponent"]] = 1.0
    values[PLACE["stribeck_velocity"]] = 0.2
    values[PLACE["armature"]] = 1e-6
    values[PLACE["slew_limit"]] = np.inf
    return values


def with_zero(parameters: Array, zero: float) -> Array:
    """Return parameters (COUNT,) with another angle offset, in rad."""
    found = parameters.copy()
    found[PLACE["angle_offset"]] = zero
    return found


@dataclass(frozen=True)
class FrictionModel:
    """Which friction parameters are free, and which are equal.

    Attributes:
        name: Name in the case file.
        words: What it has, in words.
        free: Names of its parameters.
        tied: Parameters that are equal to another one, as (parameter, the other one).
    """

    name: str
    words: str
    free: tuple[str, ...]
    tied: tuple[tuple[str, str], ...] = ()


_STRIBECK = ("coulomb_stribeck", "stribeck_velocity", "stribeck_exponent")
_EQUAL_LOADS = (("load_external", "load_motor"),)
_EQUAL_STRIBECK = (("load_external_stribeck", "load_motor_stribeck"),)

#: Friction models M1 to M6 of Duclusaud, Passault, Padois and Daney, "Extended friction models for the physics
#: simulation of servo actuators", 2024 (arXiv:2410.08650).
FRICTION_MODELS: Final = {
    model.name: model
    for model in (
        FrictionModel("m1", "Coulomb and viscous", ("coulomb", "viscous")),
        FrictionModel("m2", "Coulomb, viscous, Stribeck", ("coulomb", "viscous", *_STRIBECK)),
        FrictionModel("m3", "load-dependent Coulomb, viscous", ("coulomb", "viscous", "load_motor"), _EQUAL_LOADS),
        FrictionModel(
            "m4",
            "load-dependent Coulomb x Stribeck, viscous",
            ("coulomb", "viscous", "load_motor", "load_motor_stribeck", *_STRIBECK),
            _EQUAL_LOADS + _EQUAL_STRIBECK,
        ),
        FrictionModel(
            "m5",
            "directional load-dependent Coulomb x Stribeck, viscous",
            (
                "coulomb",
                "viscous",
                "load_motor",
                "load_external",
                "load_motor_stribeck",
                "load_external_stribeck",
                *_STRIBECK,
            ),
        ),
        FrictionModel(
            "m6",
            "directional and quadratic load-dependent Coulomb x Stribeck, viscous",
            (
                "coulomb",
                "viscous",
                "load_motor",
                "load_external",
                "load_motor_stribeck",
                "load_external_stribeck",
                "load_motor_quadratic",
                "load_external_quadratic",
                *_STRIBECK,
            ),
        ),
    )
}


#: Units of a joint that slides, by those of one that turns.
_OF_SLIDES: Final = {
    "N m": "N",
    "N m/rad": "N/m",
    "N m s/rad": "N s/m",
    "kg m^2": "kg",
    "rad": "m",
    "mrad": "mm",
    "rad/s": "m/s",
    "s/rad": "s/m",
}


def unit_for(unit: str, slides: bool) -> str:
    """Return the unit of a joint that slides in place of that of one that turns, with what stands behind 'per'."""
    own, per, rest = unit.partition(" per ")
    return f"{_OF_SLIDES.get(own, own)}{per}{rest}" if slides else unit


def unit_of(name: str, slides: bool = False) -> str:
    """Return the unit of a parameter of a joint that turns, or slides."""
    return unit_for(PARAMETERS[PLACE[name]].unit, slides)
