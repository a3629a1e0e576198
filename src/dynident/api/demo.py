"""demo: the whole job on an industrial arm, from its URDF and a log to report, URDF, MJCF and C."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dynident.api.case_logs import read_data
from dynident.api.estimate_output import write_estimate
from dynident.api.export import export
from dynident.api.identify import Record, identify
from dynident.api.init import init
from dynident.api.validate import validate
from dynident.case.case import read_case
from dynident.case.case_values import DATA_VARIABLE
from dynident.exports.models import ModelExport
from dynident.files import write_atomically
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.results.report import write_report

#: Robot model and log of the virtual arm, and the case of a real one whose data are elsewhere.
_DATA = Path(__file__).parent / "demo_data"
_ROBOT, _LOG, _REAL = "arm.urdf", "run.csv", "ur10e.yaml"

#: What is exported, and the name of its file.
_EXPORTS = {"urdf": "identified.urdf", "mjcf": "identified.xml", "c_header": "identified.h"}


@dataclass(frozen=True)
class Demo:
    """What the demo came to.

    Attributes:
        source: What the robot and the log are, in words.
        estimate: The estimate.
        test: Its figures on samples that had no part in the fit.
        exports: What was exported, with its proofs.
        files: Names of the files in the folder, in the order of the job.
    """

    source: str
    estimate: Estimate
    test: Validation
    exports: tuple[ModelExport, ...]
    files: tuple[str, ...]


def run_demo(
    folder: str | Path, command: str = "", progress: Callable[[str], None] = lambda step: None, *, virtual: bool = False
) -> Demo:
    """Draft a case, identify, validate, report and export, and leave all files in a folder.

    The robot is a virtual arm; with DYNIDENT_DATA set to a folder that has the logs of a UR10e, it is that one.

    Args:
        folder: Where files are written; it is made where it is not there.
        command: What was typed, for the provenance.
        progress: Called with each step in words.
        virtual: The virtual arm, with DYNIDENT_DATA set too.

    Raises:
        FileError: A file cannot be written.
    """
    is_real, folder = not virtual and _has_real_arm(), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    progress("case file")
    if is_real:
        source = "real UR10e (Mamedov and Mikhel 2020): motor currents, the last log to test"
        files = ["case.yaml"]
        write_atomically(folder / "case.yaml", (_DATA / _REAL).read_bytes())
    else:
        source = "virtual six-joint arm: simulated log with noise, its last third to test; URDF with wrong inertias"
        files = [_ROBOT, _LOG, "case.yaml"]
        for name in (_ROBOT, _LOG):
            write_atomically(folder / name, (_DATA / name).read_bytes())
        write_atomically(folder / "case.yaml", init(str(folder / _ROBOT), str(folder / _LOG), folder).text)
    case = read_case(folder / "case.yaml")
    data = read_data(case)
    estimate = identify(case, data.train, record=Record(command=command), progress=progress)
    test = validate(estimate, data.test)
    progress("report")
    write_estimate(estimate, folder / "estimate.json")
    write_report(folder / "report.html", estimate, (test,), command=command, sources=[log.source for log in data.test])
    exports = []
    for name, file in _EXPORTS.items():
        progress(f"export to {name}, and proof")
        exports.append(export(estimate, name, folder / file))
    return Demo(source, estimate, test, tuple(exports), (*files, "estimate.json", "report.html", *_EXPORTS.values()))


def _has_real_arm() -> bool:
    place = os.environ.get(DATA_VARIABLE)
    return bool(place) and Path(str(place), "ur10e_mamedov", "robot.urdf").is_file()
