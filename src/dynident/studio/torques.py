"""Torques of an estimate for drawing, on the data that it was trained on and on the data that it was tested on."""

from __future__ import annotations

import json
import math
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from dynident.errors import DynidentError
from dynident.studio.folder import Folder
from dynident.studio.preview import curve, run_times

if TYPE_CHECKING:
    from dynident.data.log import Log
    from dynident.identification.estimate.estimate import Estimate
    from dynident.identification.estimate.validation import Validation

#: Test logs above this size in all, in bytes, are not read for a picture.
LARGE = 1 << 27


def torques_of(estimate: Estimate, data: Validation) -> dict[str, Any]:
    """Return curves of each joint's torque over time, and the motion that belongs to them, as plain data.

    Args:
        estimate: The estimate.
        data: Measured and predicted torques, of the training or of a test.
    """
    time = run_times(data.time, data.starts)
    joints = [
        {
            "name": fit.name,
            "unit": fit.unit,
            "measured": curve(time, data.starts, data.measured[:, k]),
            "predicted": curve(time, data.starts, data.predicted[:, k]),
            "residual": curve(time, data.starts, data.residual[:, k]),
        }
        for k, fit in enumerate(data.joints)
    ]
    names = list(estimate.model.robot.joint_names)
    return {"torques": joints, "motion": {"joints": names, "time": time.tolist(), "q": data.q.tolist(), "still": {}}}


def torques_on_test_data(folder: Folder, name: str) -> dict[str, Any]:
    """Return the torques of an estimate on its test data, read anew from the logs of its case.

    ``missing`` says why there are none: the estimate was not tested, or case and logs are no longer those of the test.

    Raises:
        DynidentError: No such file, or no estimate.
    """
    from dynident.api.validate import compared
    from dynident.identification.files.estimate_file import read_estimate

    path = folder.find(name)
    estimate = read_estimate(path)
    stated = json.loads(path.read_bytes()).get("summary", {}).get("test")
    if not stated:
        return _none("The estimate was not tested; choose test logs below.")
    try:
        logs, missing = _test_logs(folder, estimate)
    except (DynidentError, OSError) as error:
        logs, missing = (), f"The test logs cannot be read: {str(error).replace(f'{folder.path}/', '')}"
    if missing:
        return _none(missing)
    found = compared(estimate, logs)
    if not math.isclose(found.total_relative_error, stated["total_relative_error"], rel_tol=1e-6):
        return _none("The case or its logs are no longer those of the test.")
    return {**torques_of(estimate, found), "missing": ""}


def _none(missing: str) -> dict[str, Any]:
    return {"torques": [], "motion": None, "missing": missing}


def _test_logs(folder: Folder, estimate: Estimate) -> tuple[tuple[Log, ...], str]:
    """Return the test logs of the case of an estimate, or why there are none."""
    from dynident.api.case_logs import read_data
    from dynident.case.case import read_case

    file = PurePath(str(estimate.provenance.get("case", {}).get("path", ""))).name
    if file not in folder.names():
        return (), "The case of the estimate is not in this folder."
    case = read_case(folder.find(file))
    if not case.test and case.split is None:
        return (), "The case names no test logs; those of the test were chosen elsewhere."
    if sum(Path(case.find(log)).stat().st_size for log in {*case.train, *case.test}) > LARGE:
        return (), "The test logs are too large to draw here; the report has their figures."
    return read_data(case).test, ""
