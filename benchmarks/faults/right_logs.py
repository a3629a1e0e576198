"""False alarms on recorded logs and on the strangers: python -m benchmarks.faults.right_logs [SET ...].

Every file of the five sets is read as its case in ``examples/cases`` says, and every log of ``benchmarks.strangers`` by
its answered draft. Each error and warning is printed; it is false unless it is true of the file, with its reason below.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

from benchmarks.faults.clean import bound
from benchmarks.strangers.__main__ import answered, called, logs_of
from benchmarks.strangers.cases import STRANGERS
from dynident.case.case import Case, read_case
from dynident.diagnosis.examination import examine

CASES = Path(__file__).parents[2] / "examples" / "cases"

#: Files of each set, under the folder of the data.
SETS = {
    "panda": ("panda_gaz2019/exciting_traj_1.csv",),
    "lwr4": tuple(f"kuka_lwr4_flobaroid/measurements_{k}.csv" for k in (1, 2, 3)),
    "tx40": ("staubli_tx40_figaroh/trajectory.csv",),
    "tiago": ("tiago_figaroh/trajectory.csv",),
    "ur10e": ("ur10e_mamedov/*.csv",),
}

#: Findings that are true of a file, and why, by name of the log and of the finding.
TRUE_OF_A_LOG = {
    (
        "lwr4/*",
        "counterbalance",
    ): "0.42 to 0.45 N m sin(q + 0.9) at the wrist in all three logs, beside the robot model",
    ("lwr4/*", "torque ripple"): "0.3 N m, 4.00 cycles a turn of lwr_5_joint, runs 1 and 2; modelled, its error halves",
    ("tiago/*", "coarse torques"): "the currents of the wrist have 14 steps",
    ("ur10e/*", "spikes"): "single samples of the current",
    ("ur10e/ident_20_01_13_load_2600.csv", "load at the flange"): "a payload of 2.6 kg by the file's name",
    ("ur10e/jointwise_*", "joint never moved"): "one joint moves at a time",
    ("ur10e/jointwise_*_6.csv", "poor excitation"): "one joint moves, the others only to the start",
}


def recorded(name: str) -> Iterator[tuple[Case, str]]:
    """Yield the case and each file of a recorded set."""
    case = read_case(CASES / f"{name}.yaml")
    for pattern in SETS[name]:
        first = case.find(pattern) if "*" not in pattern else case.find(case.train[0]).parent / Path(pattern).name
        for path in sorted(first.parent.glob(first.name)):
            yield case, str(path)


def strange(name: str, folder: Path) -> Iterator[tuple[Case, str]]:
    """Yield the answered draft and each log of a stranger."""
    stranger = STRANGERS[name]
    logs = [folder / log for log in logs_of(name, stranger, folder, 1.0)]
    failed: list[str] = []
    called(failed, "init", folder / "robot.urdf", *logs[:-1], "-o", folder / "case.yaml", *stranger.options)
    if failed:
        raise SystemExit("\n".join(failed))
    (folder / "case.yaml").write_text(answered((folder / "case.yaml").read_text(), stranger))
    case = read_case(folder / "case.yaml")
    for log in logs if case.servo is None else ():  # servos without torque have checks of their own
        yield case, str(log)


def reason(log: str, finding: str) -> str:
    """Return why a finding is true of a log; empty where it is false."""
    found = [why for (pattern, name), why in TRUE_OF_A_LOG.items() if name == finding and fnmatch(log, pattern)]
    return found[0] if found else ""


def main() -> None:
    wanted, false, logs = sys.argv[1:] or [*SETS, *STRANGERS], Counter[str](), 0
    for name in wanted:
        with tempfile.TemporaryDirectory() as folder:
            for case, log in recorded(name) if name in SETS else strange(name, Path(folder)):
                grave = [one for one in examine(case, log).findings if one.severity != "note"]
                label = f"{name}/{Path(log).name}"
                print(label, file=sys.stderr, flush=True)
                told = [(one, reason(label, one.name)) for one in grave]
                logs += 1
                false.update({one.severity for one, why in told if not why})
                for one, why in told:
                    print(f"{label}: {one.line()} [{why or 'FALSE'}]", flush=True)
    for severity in ("error", "warning"):
        count = false[severity]
        print(f"{count} of {logs} logs with a false {severity}; upper 95 % bound {bound(count, logs):.1%}")


if __name__ == "__main__":
    main()
