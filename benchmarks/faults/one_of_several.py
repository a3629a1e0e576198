"""A fault in one of three logs of random arms: is it told, and are the other logs left in peace?

Run: python -m benchmarks.faults.one_of_several [FIRST LAST]. The arms are those of ``benchmarks.faults.clean``. In the
second log, at a joint that is drawn, the zero of the position has moved by 0.1 rad (20 mm of a slide), the torque has
an offset of a third of its standard deviation, is 1.3 times itself or has the other sign, or there is more friction, of
half that deviation. Printed for each: in how many arms the log has an error or a warning beside the other logs, in how
many alone, and in how many another log or all together have one.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.faults.clean import TRUE_OF_A_LOG, recorded, robot, written
from benchmarks.faults.trials import tracked
from benchmarks.strangers.plant import Body, urdf
from dynident.api.init import init
from dynident.arrays import Array
from dynident.case.case import read_case
from dynident.diagnosis.examination import Examination, examine_logs

LOGS, FAULTY, ARMS = 3, 1, 20

Columns = dict[str, Array]


def moved(columns: Columns, joint: int, body: Body) -> Columns:
    q = columns["q"].copy()
    q[:, joint] += 0.02 if body.kind == "prismatic" else 0.1
    return {**columns, "q": q}


def with_torque(columns: Columns, joint: int, change: Callable[[Array], Array]) -> Columns:
    tau = columns["tau"].copy()
    tau[:, joint] = change(tau[:, joint])
    return {**columns, "tau": tau}


def rubbing(columns: Columns, joint: int) -> Columns:
    speed = np.gradient(columns["q"][:, joint], columns["t"])
    return with_torque(columns, joint, lambda tau: tau + 0.5 * tau.std() * np.tanh(speed / (0.05 * speed.std())))


FAULTS: dict[str, Callable[[Columns, int, Body], Columns]] = {
    "zero moved": moved,
    "torque offset": lambda columns, joint, body: with_torque(columns, joint, lambda tau: tau + 0.33 * tau.std()),
    "torque scale": lambda columns, joint, body: with_torque(columns, joint, lambda tau: 1.3 * tau),
    "torque sign": lambda columns, joint, body: with_torque(columns, joint, np.negative),
    "more friction": lambda columns, joint, body: rubbing(columns, joint),
}


def is_grave(examinations: Sequence[Examination]) -> bool:
    """Return whether there is an error or a warning that is not true of such logs."""
    found = [finding for one in examinations for finding in one.findings]
    return any(finding.severity != "note" and finding.name not in TRUE_OF_A_LOG for finding in found)


def judged(seed: int, folder: Path) -> dict[str, tuple[bool, bool, bool]]:
    """Return by fault: told beside the other logs, told alone, and something is told of others."""
    generator = np.random.default_rng([24, seed])
    bodies = robot(generator)
    recordings, _ = recorded(generator, bodies, urdf(f"arm_{seed}", bodies, seed), LOGS)
    (folder / "arm.urdf").write_text(urdf(f"arm_{seed}", bodies))
    paths = [str(folder / f"run{k}.csv") for k in range(LOGS)]
    for columns, path in zip(recordings, paths, strict=True):
        written(columns, Path(path))
    with contextlib.redirect_stdout(io.StringIO()):
        (folder / "case.yaml").write_text(init(str(folder / "arm.urdf"), paths, folder).text)
    case, joint, found = read_case(folder / "case.yaml"), int(generator.integers(len(bodies))), {}
    for name, fault in FAULTS.items():
        written(fault(recordings[FAULTY], joint, bodies[joint]), Path(paths[FAULTY]))
        each = examine_logs(case, paths)
        others = [one for k, one in enumerate(each) if k != FAULTY]
        alone = examine_logs(case, [paths[FAULTY]])
        found[name] = is_grave([each[FAULTY]]), is_grave(alone), is_grave(others)
    return found


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ARMS)
    counts = {name: Counter[int]() for name in FAULTS}
    with tempfile.TemporaryDirectory() as name:
        for seed in tracked(range(first, last), "arms"):
            for fault, told in judged(seed, Path(name)).items():
                counts[fault].update(k for k, one in enumerate(told) if one)
                print(f"{seed} {fault}: beside {told[0]}, alone {told[1]}, others {told[2]}", flush=True)
    for fault, count in counts.items():
        print(f"{fault}: of {last - first} arms told beside {count[0]}, alone {count[1]}, of others {count[2]}")


if __name__ == "__main__":
    main()
