"""Bodies that were identified beside the drives, in the robot model of the identification."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dynident.actuators.estimate import ActuatorEstimate
from dynident.case.case import read_case
from dynident.errors import DescriptionError
from dynident.exports.models.writing.mjcf_own import own_bodies
from dynident.exports.models.writing.placement import place, shared
from dynident.exports.models.writing.urdf import urdf_with_bodies
from dynident.exports.models.writing.xml_edit import quaternion
from dynident.model.inertia import Inertia
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.robot_files.formats.urdf import read_urdf_bodies
from dynident.robot_files.mjcf.model import read_mjcf_model


def robot_of(estimate: ActuatorEstimate) -> Robot:
    """Return the robot of the identification with the bodies found, by its case, or by its file where that is gone."""
    case = str(dict(estimate.provenance.get("case", {})).get("path", ""))
    found = read_case(case).robot if case and Path(case).is_file() else None
    return estimate.on(found or read_robot(str(dict(estimate.provenance["robot"])["path"])))


def urdf_of(estimate: ActuatorEstimate, path: str) -> bytes:
    """Return the URDF of the identification, with the bodies found where some were.

    Raises:
        DescriptionError: It is faulty, or another robot than that of the estimate.
    """
    data, robot = Path(path).read_bytes(), robot_of(estimate) if estimate.bodies is not None else None
    return data if robot is None else urdf_with_bodies(path, data, robot, _inertias(robot))


def set_bodies(spec: Any, estimate: ActuatorEstimate, path: str) -> None:
    """Give the bodies of a MuJoCo specification those that were found; others keep what the file states.

    Args:
        spec: As read from the robot model.
        estimate: The actuators; nothing changes where the bodies are those of the robot model.
        path: The robot model, URDF or MJCF.

    Raises:
        DescriptionError: The robot model is another one than that of the estimate, or a body has no name.
    """
    if estimate.bodies is None:
        return
    robot, data = robot_of(estimate), Path(path).read_bytes()
    if path.lower().endswith(".urdf"):
        bodies, joints = read_urdf_bodies(path, data)
        new = dict(shared(robot, _inertias(robot), place(path, robot, bodies, joints), lump=False).inertias)
    else:
        model = read_mjcf_model(path, data)
        found = own_bodies(model, robot, _inertias(robot), lump=False)[2]
        new = {name: body and body.moved(np.eye(3), -model.tree.sources[name].origin) for name, body in found.items()}
        spec.compiler.inertiafromgeom, spec.compiler.balanceinertia, spec.compiler.settotalmass = 0, False, -1.0
        spec.compiler.boundmass = spec.compiler.boundinertia = 0.0
    for name, body in new.items():
        own = spec.body(name)
        if own is None:
            step = "give each body a name of its own there, and identify again"
            raise DescriptionError(path, f"body '{name}'", "MuJoCo does not find it, and it has another inertia", step)
        _set(own, body)


def _inertias(robot: Robot) -> list[Inertia]:
    return [link.inertia for link in robot.links if link.inertia is not None]


def _set(own: Any, body: Inertia | None) -> None:
    """Give a body of a specification another inertia, about its own frame; none where it has none any more."""
    own.explicitinertial = True
    own.fullinertia[:] = np.nan
    own.iquat[:] = (1.0, 0.0, 0.0, 0.0)
    if body is None:
        own.mass, own.ipos[:], own.inertia[:] = 0.0, 0.0, 0.0
        return
    moments, axes = np.linalg.eigh(np.asarray(body.about_centre))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    own.mass, own.ipos[:], own.inertia[:] = body.mass, body.centre_of_mass, np.maximum(moments, 0.0)
    own.iquat[:] = quaternion(axes)
