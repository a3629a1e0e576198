"""ROS 2: the friction of each joint as node parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import yaml

from dynident.errors import BadOption
from dynident.exports.models.base import ModelContent, ModelExporter, Reloaded
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.states import StateSet
from dynident.exports.names_in_files import ros_names
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION

_NODE = re.compile(r"/?(?:[A-Za-z_*][A-Za-z0-9_*]*/?)+")

_TAKEN = ("joints", "coupling")


@dataclass(frozen=True)
class Ros2Friction(ModelExporter):
    """ROS 2 parameter file of the friction of each joint: every part with its options and coefficients, and armature.

    Attributes:
        node: Name of the node that gets the parameters; ``/**`` is every node.
    """

    node: str = "/**"

    suffix: ClassVar[str] = ".yaml"
    proof: ClassVar[str] = "friction and identified rotor inertia by PyYAML; not run in ROS 2"
    remembers: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not _NODE.fullmatch(self.node):
            raise BadOption("node", self.node, "give the name of a node, such as /arm/controller, or /**")

    def content(self, subject: Identified, path: Path) -> ModelContent:
        robot = subject.model.robot
        names = ros_names(robot.joint_names)
        for name in names:
            if "." in name or name in _TAKEN:
                step = "'.' begins another level there, and 'joints' and 'coupling' are taken; rename the joint"
                raise BadOption("joint", name, step)
        lines = [
            "# Friction of each drive, identified by dynident. SI units: rad or m, s, N m or N; speeds at the motors.",
            "# Under each joint: rotor inertia, known bias, then each friction part: options and coefficients.",
            f"{self.node}:",
            "  ros__parameters:",
            f"    joints: [{', '.join(map(_quoted, names))}]",
            f"    coupling: [{', '.join(map(_number, np.asarray(robot.coupling).ravel()))}]",
        ]
        drives = drives_of(subject)
        for j, joint in enumerate(robot.active):
            lines += [f"    {_quoted(joint.name)}:", f"      armature: {_number(drives.armature[j])}"]
            lines += [f"      bias: {_number(joint.drive.bias)}"]
            for part, options, values in _parts(subject.model, subject.theta, j):
                lines += [f"      {part}:"]
                lines += [f"        {key}: {_number(value)}" for key, value in {**options, **values}.items()]
        if robot.is_coupled:
            notes = ("motors are coupled: speeds are coupling times joint speeds, torques its transpose times these",)
        else:
            notes = ()
        return ModelContent({path: ("\n".join(lines) + "\n").encode("ascii")}, (), notes)

    def reload(self, subject: Identified, content: ModelContent, folder: Path, states: StateSet) -> Iterator[Reloaded]:
        data: Any = yaml.safe_load((folder / next(iter(content.files)).name).read_bytes())
        facts = data[self.node]["ros__parameters"]
        model = subject.model
        parts, theta = _read(model, facts)
        motion = model.loaded(states.motion, subject.theta)
        found = DynamicModel(model.robot, parts)
        bodies = np.zeros(model.inertial_count)
        torque = found.torque(motion, np.concatenate([bodies, theta])) - model.known_torque(motion)
        expected = model.torque(motion, np.concatenate([bodies, subject.theta[model.inertial_count :]]))
        expected = expected - model.known_torque(motion)
        yield Reloaded("PyYAML", "friction and identified rotor inertia", torque, expected)
        yield Reloaded("ROS 2", why_not="not a Python package; by the format of its parameter files only")


def _parts(model: DynamicModel, theta: Any, drive: int) -> Iterator[tuple[str, dict[str, Any], dict[str, float]]]:
    """Yield name, options and coefficients of each friction part on a drive."""
    table, column = model.coefficient_table(theta), 0
    for part in model.friction:
        values = {key(c.symbol): float(table[drive, column + k]) for k, c in enumerate(part.coefficients)}
        column += len(part.coefficients)
        if drive in model.drives_of(part):
            options = {name: value for name, value in part.options.items() if isinstance(value, float | int)}
            yield FRICTION.name_of(part), options, values


def key(symbol: str) -> str:
    """Return a symbol as a parameter's name: ``Fc+`` becomes ``Fc_plus``."""
    return symbol.replace("+", "_plus").replace("-", "_minus")


def _read(model: DynamicModel, facts: dict[str, Any]) -> tuple[tuple[Any, ...], Any]:
    """Return the friction parts and coefficients that a file states, in the order of the model's."""
    parts, tables = [], []
    for part in model.friction:
        name = FRICTION.name_of(part)
        drives = model.drives_of(part)
        stated = [facts[model.robot.joint_names[j]][name] for j in drives]
        symbols = [key(c.symbol) for c in part.coefficients]
        options = {k: type(getattr(part, k))(v) for k, v in stated[0].items() if k not in symbols}
        parts.append(FRICTION.make(name, {**options, "joints": part.joints}))
        tables.append(np.zeros((model.robot.dof, len(symbols))))
        tables[-1][list(drives)] = [[float(one[symbol]) for symbol in symbols] for one in stated]
    drive, column = model.terms
    return tuple(parts), np.concatenate(tables, axis=1)[drive, column] if tables else np.zeros(0)


def _quoted(name: str) -> str:
    return f'"{name}"'


def _number(value: float) -> str:
    """Return a number that every YAML reader takes for a float: with a point, also before an exponent."""
    mantissa, e, power = repr(float(value) + 0.0).partition("e")
    return (mantissa if "." in mantissa else f"{mantissa}.0") + (f"e{int(power):+03d}" if e else "")
