"""A prior from a file: the inertias of a robot model, or the standard parameters of an estimate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError, UnknownChoice
from dynident.files import is_json_of
from dynident.identification.files.estimate_file import read_estimate
from dynident.identification.problem.prior import BodyPrior
from dynident.model.parameters import inertial_parameters
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

#: By how much link frames of prior and robot may differ, in m and in entries of rotation matrices.
_APART = 1e-4


def read_prior(path: str | Path, robot: Robot, locked: Mapping[str, float] | None = None) -> BodyPrior:
    """Read inertias known beforehand.

    Args:
        path: A robot model (URDF, native) with inertias, or an estimate file with standard parameters.
        robot: The robot whose prior it is; link frames must be the same.
        locked: Positions of the joints that the robot's case has locked, which are locked in the robot model too.

    Raises:
        FileError: The file cannot be read.
        DescriptionError: It states no inertias, or its link frames are others than the robot's.
        UnknownChoice: A joint of the robot is missing in it.
    """
    if is_estimate(path):
        estimate = read_estimate(path)
        if estimate.theta is None:
            step = "give an estimate of 'consistent', or a robot model"
            raise DescriptionError(path, "", "an estimate of base parameters only", step)
        _check_frames(path, estimate.model.robot, robot)
        names = tuple(parameter.name for parameter in estimate.model.parameters)
        return BodyPrior(estimate.theta, names, f"the estimate {Path(path).name}")
    given = read_robot(path)
    known = {name: position for name, position in (locked or {}).items() if name in given.joint_names}
    given = given.locked(known) if known else given
    _check_frames(path, given, robot)
    theta = given.nominal
    if theta is None:
        lacking = next(link.name for link in given.links if link.inertia is None)
        raise DescriptionError(path, f"link '{lacking}'", "no inertia", "give a robot model with inertias as the prior")
    names = tuple(parameter.name for parameter in inertial_parameters(given))
    return BodyPrior(np.asarray(theta), names, f"the inertias of {Path(path).name}")


def is_estimate(path: str | Path) -> bool:
    """Return whether a file is called and begins as an estimate file does."""
    return is_json_of(path, "dynident estimate")


def _check_frames(path: str | Path, given: Robot, robot: Robot) -> None:
    """Refuse a prior whose link frames are not those of the robot: its numbers would mean other bodies."""
    theirs = dict(zip([joint.name for joint in given.joints], given.joints, strict=True))
    for joint in robot.joints:
        if joint.name not in theirs:
            raise UnknownChoice(f"joint in the prior {path}", joint.name, list(theirs))
        other = theirs[joint.name]
        pairs: list[tuple[Array, Array]] = [
            (joint.rotation, other.rotation),
            (joint.translation, other.translation),
            (joint.axis, other.axis),
        ]
        away = max(float(np.max(np.abs(a - b))) for a, b in pairs)
        if away > _APART:
            evidence = f"its frame is placed {away:.3g} away from the robot's"
            raise DescriptionError(path, f"joint '{joint.name}'", evidence, "give a prior with the same link frames")
