"""The answer: the actuators of a robot, with what is known of them and how well their roll-outs follow the logs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.actuators import KIND
from dynident.actuators.drive_law import DriveLaw, KnownFrom
from dynident.actuators.free_bodies import FreeBodies, bodies_data, read_bodies, with_bodies
from dynident.actuators.parameters import PARAMETERS, PLACE, unit_for, unit_of
from dynident.actuators.verdict import Known
from dynident.arrays import Array
from dynident.errors import EstimateFormatError
from dynident.files import read_json, write_atomically
from dynident.model.robot import Robot

#: Version of the file.
VERSION = 1


@dataclass(frozen=True)
class Combination:
    """A number that the logs determine although its factors or parts are not known apart.

    Attributes:
        name: What it is.
        value: Its value.
        unit: Its unit.
        words: What it is made of, and what would tell the parts apart.
        half_width: Of the interval at 95 %; infinite where the logs do not tell it.
    """

    name: str
    value: float
    unit: str
    words: str
    half_width: float = np.inf


@dataclass(frozen=True)
class JointActuator:
    """The actuator of one joint.

    Attributes:
        name: The joint.
        law: Drive law.
        kp: Position gains of the training logs, in the drive's unit, sorted.
        friction: Name of the friction model.
        parameters: All parameters in the order of PARAMETERS, shape (COUNT,).
        known: How far each free parameter is known.
        combinations: What is known only together.
        linear: Parameters of the linear start, shape (COUNT,).
        simple: Parameters of the fit with Coulomb and viscous friction, which simulators have, shape (COUNT,).
        train: Mean absolute position error of the roll-out of each training log, in rad.
        test: The same of each log that was tested on.
        linear_test: The same of each test log (of each training log where there is none) by the linear start.
        folds: Cross-validation error of each friction model, in rad (geometric mean over logs).
        saturated: Share of the samples at which the duty is at its limit, by the measured positions, in the training
            logs in which the joint is not held.
        remarks: What the user has to know.
        slides: Whether the joint slides: m, N and kg stand for rad, N m and kg m^2.
        largest_torque: Largest torque of the drive in the training logs, by the fit with Coulomb and viscous friction
            and the measured positions, in N m; nan in files that do not state it.
    """

    name: str
    law: DriveLaw
    kp: tuple[float, ...]
    friction: str
    parameters: Array
    known: tuple[Known, ...]
    combinations: tuple[Combination, ...]
    linear: Array
    simple: Array
    train: Mapping[str, float]
    test: Mapping[str, float]
    linear_test: Mapping[str, float]
    folds: Mapping[str, float]
    saturated: float
    remarks: tuple[str, ...] = ()
    slides: bool = False
    largest_torque: float = np.nan

    def value(self, name: str) -> float:
        """Return a parameter by its name."""
        return float(self.parameters[PLACE[name]])

    def stiffness(self, kp: float) -> float:
        """Return the torque per rad of error of the drive at a position gain, in N m/rad."""
        return self.value("full_torque") * self.value("gain_ratio") * self.law.error_gain * kp

    def of_slide(self) -> JointActuator:
        """Return the actuator of a joint that slides, with its units."""
        own = tuple(replace(one, unit=unit_for(one.unit, True)) for one in self.combinations)
        return replace(self, combinations=own, slides=True)

    @property
    def has_torque(self) -> bool:
        """Whether the torque at full duty is known apart from the gain: else nothing tells the largest torque."""
        return not any(one.name == "full_torque" and one.together == "gain_ratio" for one in self.known)

    @property
    def has_limit(self) -> bool:
        """Whether the drive has a limit of its torque that the logs determine."""
        return self.has_torque and bool(np.isfinite(self.law.limit))

    def mean_error(self, errors: Mapping[str, float]) -> float:
        """Return the mean over logs, in rad; nan for none."""
        return float(np.mean(list(errors.values()))) if errors else float("nan")


@dataclass(frozen=True)
class ActuatorEstimate:
    """The actuators of a robot.

    Attributes:
        robot: Name of the robot.
        joints: Its actuators.
        provenance: Files, command and version.
        bodies: Bodies that were found beside them; None where they are those of the robot model.
        file: The file that it was read from; empty for none.
    """

    robot: str
    joints: tuple[JointActuator, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    bodies: FreeBodies | None = None
    file: str = ""

    def joint(self, name: str) -> JointActuator:
        """Return the actuator of a joint."""
        return next(joint for joint in self.joints if joint.name == name)

    def on(self, robot: Robot) -> Robot:
        """Return a robot model with the bodies that were found."""
        return robot if self.bodies is None else with_bodies(robot, self.bodies.theta)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def as_data(estimate: ActuatorEstimate) -> dict[str, Any]:
    """Return the estimate as plain data; what is infinite or not known is null."""
    joints = {}
    for joint in estimate.joints:
        law = {key: _finite(v) if isinstance(v, float) else v for key, v in asdict(joint.law).items()}
        names = [one.name for one in PARAMETERS]
        joints[joint.name] = {
            "friction_model": joint.friction,
            "parameters": {
                name: {"value": _finite(value), "unit": unit_of(name, joint.slides)}
                for name, value in zip(names, joint.parameters, strict=True)
            },
            "known": [_known(one) for one in joint.known],
            "combinations": [{**asdict(one), "half_width": _finite(one.half_width)} for one in joint.combinations],
            "coulomb_viscous": {name: _finite(value) for name, value in zip(names, joint.simple, strict=True)},
            "linear_start": {name: _finite(value) for name, value in zip(names, joint.linear, strict=True)},
            "law": law,
            "kp": list(joint.kp),
            "train_error_rad": dict(joint.train),
            "test_error_rad": dict(joint.test),
            "linear_error_rad": dict(joint.linear_test),
            "cross_validation_rad": {key: _finite(v) for key, v in joint.folds.items()},
            "saturated_share": joint.saturated,
            "largest_torque_in_logs": _finite(joint.largest_torque),
            "remarks": list(joint.remarks),
        }
    found = {"kind": KIND, "version": VERSION, "robot": estimate.robot, "joints": joints}
    if estimate.bodies is not None:
        found["bodies"] = bodies_data(estimate.bodies)
    return {**found, "provenance": dict(estimate.provenance)}


def _known(one: Known) -> dict[str, Any]:
    """Return how far a parameter is known as plain data; a ratio only where the bodies are found beside it."""
    found = {**asdict(one), "half_width": _finite(one.half_width)}
    if one.ratio is None:
        del found["ratio"]
    return found


def write_actuators(estimate: ActuatorEstimate, path: str | Path) -> None:
    """Write the estimate as JSON.

    Raises:
        FileError: The file cannot be written.
    """
    write_atomically(path, json.dumps(as_data(estimate), indent=1, allow_nan=False) + "\n")


def read_actuators(path: str | Path) -> ActuatorEstimate:
    """Read a file of write_actuators.

    Raises:
        FileError: The file cannot be read.
        EstimateFormatError: It is no such file, or damaged.
    """
    step = "name a file that 'dynident identify' has written for a case with servo:"
    data = read_json(path, step, EstimateFormatError)
    if not isinstance(data, dict) or data.get("kind") != KIND or data.get("version") != VERSION:
        raise EstimateFormatError(path, "no estimate of actuators", step)
    try:
        joints = tuple(_joint(name, own) for name, own in data["joints"].items())
        bodies = read_bodies(data["bodies"]) if "bodies" in data else None
        return ActuatorEstimate(data["robot"], joints, data.get("provenance", {}), bodies, str(path))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise EstimateFormatError(path, f"damaged ({type(error).__name__}: {error})", step) from error


def _joint(name: str, own: Mapping[str, Any]) -> JointActuator:
    law = dict(own["law"])
    law["known"] = {key: KnownFrom(**value) for key, value in law["known"].items()}
    law["limit"] = np.inf if law["limit"] is None else law["limit"]
    law["full_torque"] = tuple(law["full_torque"]) if law.get("full_torque") else None

    def array(values: Mapping[str, Any]) -> Array:
        found = [values[one.name] for one in PARAMETERS]
        return np.array([np.inf if value is None else float(value) for value in found])

    def infinite(one: Mapping[str, Any]) -> dict[str, Any]:
        half = one.get("half_width")
        return {**one, "half_width": np.inf if half is None else half}

    return JointActuator(
        name=name,
        law=DriveLaw(**law),
        kp=tuple(own["kp"]),
        friction=own["friction_model"],
        parameters=array({key: value["value"] for key, value in own["parameters"].items()}),
        known=tuple(Known(**infinite(one)) for one in own["known"]),
        combinations=tuple(Combination(**infinite(one)) for one in own["combinations"]),
        linear=array(own["linear_start"]),
        simple=array(own["coulomb_viscous"]),
        train=own["train_error_rad"],
        test=own["test_error_rad"],
        linear_test=own["linear_error_rad"],
        folds={key: np.inf if v is None else v for key, v in own["cross_validation_rad"].items()},
        saturated=own["saturated_share"],
        remarks=tuple(own["remarks"]),
        slides=own["parameters"]["full_torque"].get("unit") == unit_of("full_torque", slides=True),
        largest_torque=np.nan if own.get("largest_torque_in_logs") is None else own["largest_torque_in_logs"],
    )
