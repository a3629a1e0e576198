"""What is true in a virtual cell: the parameters of its robot, near those of the robot model or of an estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, NotConsistent
from dynident.file_versions import FileVersions
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.simulation.effects import Numbers, each

#: What the file of the truth beside a simulated log says it is.
KIND = "dynident truth"

#: Files of the truth.
VERSIONS = FileVersions("a truth")


@dataclass(frozen=True)
class Truth:
    """How the true parameters are made.

    Attributes:
        parameters: ``nominal`` for those of the robot model, or an estimate file.
        spread: How far the bodies are from there: masses, lengths and moments differ by about this share at random,
            and stay those of possible bodies.
        friction: Coefficients by symbol (Fc, Fv, ...), one number for all joints or one each; the others are those of
            the robot model or estimate, 0 where it states none.
        believed: What the controller believes: ``truth``, ``nominal``, or an estimate file.
    """

    parameters: str = "nominal"
    spread: float = 0.0
    friction: Mapping[str, Numbers] = field(default_factory=dict)
    believed: str = "truth"

    def __post_init__(self) -> None:
        if not 0 <= self.spread <= 1:
            raise BadOption("truth.spread", self.spread, "give a share from 0 to 1, such as 0.2")


def nominal_parameters(model: DynamicModel) -> Array:
    """Return the parameters of the robot model, shape (p,).

    Raises:
        NotConsistent: It states no inertias.
    """
    theta = model.nominal()
    if theta is None:
        step = "name an estimate file in its place (cell: truth: parameters), or state the inertias"
        raise NotConsistent(f"robot '{model.robot.name}'", "its robot model states no inertias", step)
    return theta


def true_parameters(model: DynamicModel, start: Array, truth: Truth, seed: int = 0) -> Array:
    """Return the parameters of the plant, shape (p,).

    Args:
        model: Robot and friction.
        start: Parameters to begin with, shape (p,).
        truth: Spread and friction.
        seed: Of the spread.

    Raises:
        BadOption: A symbol that no friction part has.
    """
    theta = np.array(start, dtype=np.float64)
    generator = np.random.default_rng(seed)
    for at in range(0, model.inertial_count, 10):
        turned = np.eye(4) + 0.5 * truth.spread * generator.normal(size=(4, 4))
        if truth.spread:
            # A P A' is the pseudo-inertia of the body deformed by A, and as possible as P (Wensing, Kim, Slotine 2018).
            theta[at : at + 10] = Inertia.from_pseudo(
                turned @ Inertia.from_vector(theta[at : at + 10]).pseudo @ turned.T
            ).vector
    tail = model.parameters[model.inertial_count :]
    known = tuple(dict.fromkeys(parameter.symbol for parameter in tail))
    names = model.robot.joint_names
    for symbol, values in truth.friction.items():
        if symbol not in known:
            raise BadOption("truth.friction", symbol, f"the friction of the case has {', '.join(known) or 'no terms'}")
        numbers = each(f"truth.friction.{symbol}", values, model.robot.dof)
        for k, parameter in enumerate(tail, start=model.inertial_count):
            if parameter.symbol == symbol:
                theta[k] = numbers[names.index(parameter.owner)]
    return theta


def without_friction(model: DynamicModel, theta: Array) -> tuple[str, ...]:
    """Return the friction symbols that are 0 at every joint."""
    tail = model.parameters[model.inertial_count :]
    values: dict[str, float] = {}
    for parameter, value in zip(tail, theta[model.inertial_count :], strict=True):
        values[parameter.symbol] = values.get(parameter.symbol, 0.0) + abs(float(value))
    return tuple(symbol for symbol, size in values.items() if size == 0)
