"""The parameters behind the logs of a virtual robot, where they are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.case.prior_file import is_estimate, read_prior
from dynident.errors import DescriptionError
from dynident.files import is_json_of, read_json
from dynident.model.dynamic_model import DynamicModel
from dynident.robot_files import read_robot
from dynident.simulation.truth import KIND, VERSIONS


def read_truth(path: str | Path, model: DynamicModel, locked: Mapping[str, float] | None = None) -> Array:
    """Return the standard parameters that are known to stand behind the logs, shape (p,).

    Args:
        path: The truth that 'dynident simulate' wrote beside the log; the robot model that was simulated, with
            inertias; or an estimate file with standard parameters. Friction that a description does not state is zero.
        model: The model whose parameters they are.
        locked: Positions of the joints that the case has locked, which are locked in the robot model too.

    Raises:
        FileError: The file cannot be read.
        DescriptionError: It states no inertias, not all parameters, or other link frames.
        UnknownChoice: A joint of the robot is missing in it.
    """
    if is_json_of(path, KIND):
        return _of_cell(path, model)
    known = read_prior(path, model.robot, locked)  # which refuses other link frames
    if is_estimate(path):
        return _ordered(path, dict(zip(known.names, known.theta.tolist(), strict=True)), model)
    given = read_robot(path)
    positions = {name: position for name, position in (locked or {}).items() if name in given.joint_names}
    theta = replace(model, robot=given.locked(positions) if positions else given).nominal()
    assert theta is not None  # read_prior has refused a description without inertias
    return theta


def _of_cell(path: str | Path, model: DynamicModel) -> Array:
    """Return the parameters of a virtual cell, a payload included; for the robot that it had."""
    step = "give the .truth.json that 'dynident simulate' wrote beside the log"
    data = read_json(path, step, lambda file, evidence, advice: DescriptionError(str(file), "", evidence, advice))
    if not isinstance(data, dict):
        raise DescriptionError(path, "", "not one JSON object", step)
    data = VERSIONS.migrated(data, lambda evidence, advice: DescriptionError(path, "", evidence, advice))
    if data.get("robot") != model.robot.name:
        raise DescriptionError(path, "robot", f"of '{data.get('robot')}', the case has '{model.robot.name}'", step)
    try:
        values = {f"{each['symbol']}[{each['owner']}]": float(each["value"]) for each in data["parameters"]}
    except (KeyError, TypeError, ValueError) as error:
        raise DescriptionError(path, "parameters", "not all have symbol, owner and value", step) from error
    return _ordered(path, values, model)


def _ordered(path: str | Path, values: Mapping[str, float], model: DynamicModel) -> Array:
    """Return the values of a file in the order of the model's parameters, shape (p,)."""
    lacking = [parameter.name for parameter in model.parameters if parameter.name not in values]
    if lacking:
        step = "give one made with the same friction parts, or a robot model"
        raise DescriptionError(path, "", f"no parameter {lacking[0]}", step)
    return np.array([values[parameter.name] for parameter in model.parameters])
