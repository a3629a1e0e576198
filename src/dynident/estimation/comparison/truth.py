"""The parameters behind the logs of a virtual robot, where they are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.estimation.consistency.prior_file import is_estimate, read_prior
from dynident.model.descriptions import read_robot
from dynident.model.dynamic_model import DynamicModel


def read_truth(path: str | Path, model: DynamicModel, locked: Mapping[str, float] | None = None) -> Array:
    """Return the standard parameters that are known to stand behind the logs, shape (p,).

    Args:
        path: The robot description that was simulated, with inertias, or an estimate file with standard parameters.
            Friction that a description does not state is zero.
        model: The model whose parameters they are.
        locked: Positions of the joints that the case has locked, which are locked in the description too.

    Raises:
        FileError: The file cannot be read.
        DescriptionError: It states no inertias, not all parameters, or other link frames.
        UnknownChoice: A joint of the robot is missing in it.
    """
    known = read_prior(path, model.robot, locked)  # which refuses other link frames
    if is_estimate(path):
        values = dict(zip(known.names, known.theta.tolist(), strict=True))
        lacking = [parameter.name for parameter in model.parameters if parameter.name not in values]
        if lacking:
            evidence = f"no parameter {lacking[0]}"
            step = "give an estimate made with the same friction parts, or a robot description"
            raise DescriptionError(path, "", evidence, step)
        return np.array([values[parameter.name] for parameter in model.parameters])
    given = read_robot(path)
    positions = {name: position for name, position in (locked or {}).items() if name in given.joint_names}
    theta = replace(model, robot=given.locked(positions) if positions else given).nominal()
    assert theta is not None  # read_prior has refused a description without inertias
    return theta
