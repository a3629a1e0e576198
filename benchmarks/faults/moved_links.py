"""Links that are not where the log says: python -m benchmarks.faults.moved_links [FIRST LAST [KIND ...]].

Random arms of :mod:`.clean`, whose drives have a Stribeck effect and friction that grows with the load besides. Each is
logged as it is, with elastic joints seen at the drives (4 to 12 Hz where the other joints are locked), with the zero of
one position off by 5 to 15 degrees, with one position 0.5 to 2 times the right one, with the torque of one joint 4 to
30 ms late or early, and with a ripple of one joint, 0.05 to 0.3 of its torque, 5 to 59 cycles a turn (of slides 2 to 12
in the range); and in another motion with the zeros of two positions off by 0.5 to 20 degrees, against an estimate from
the right log. Counted are the joints that are named, those whose 95 % interval holds the truth (of a stiffness, that it
is within a factor of three: some rotor inertia counts as that of links; of a ripple, amplitude and cycles), and what
else is told of these kinds.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio  # pyright: ignore[reportMissingImports]
import scipy.interpolate

from benchmarks.faults.clean import robot, written
from benchmarks.faults.trials import Columns, tracked
from benchmarks.strangers.plant import urdf, waves
from dynident.api.init import init
from dynident.case.case import Case, read_case
from dynident.diagnosis.examination import examine
from dynident.diagnosis.finding import Finding
from dynident.identification.identify import identify

ARMS, RATE, SECONDS = 30, 250.0, 40.0

#: Each kind of log, and the finding that is right there.
KINDS = {
    "right": "",
    "soft": "joint elasticity",
    "zero": "position zero",
    "gear": "position scale",
    "late": "torque delay",
    "ripple": "torque ripple",
    "two zeros": "position zero",
}


@dataclass(frozen=True)
class Moved:
    """A log of an arm, and what is wrong with it.

    Attributes:
        model: The robot model that the user has.
        columns: The log.
        truth: The figure of each joint: compliance, offset of the zero, share by which it moves farther than its
            positions say, delay, or amplitude; 0 for none.
        cycles: Cycles a turn of a ripple.
    """

    model: str
    columns: Columns
    truth: dict[str, float]
    cycles: float = 0.0

    def case(self, folder: Path) -> Case:
        """Return the drafted case, with the log beside it as run.csv."""
        (folder / "arm.urdf").write_text(self.model)
        written(self.columns, folder / "run.csv")
        with contextlib.redirect_stdout(io.StringIO()):
            text = init(str(folder / "arm.urdf"), [str(folder / "run.csv")], folder).text
        (folder / "case.yaml").write_text(text)
        return read_case(folder / "case.yaml")

    def told(self, folder: Path, right: Moved | None = None) -> list[Finding]:
        """Return the findings on the log; against an estimate from a right one, if that is given."""
        if right is None:
            return list(examine(self.case(folder), str(folder / "run.csv")).findings)
        case = right.case(folder)
        earlier = identify(case.model, [case.read(folder / "run.csv")], "wls", case.preprocessing)
        written(self.columns, folder / "run.csv")
        return list(examine(case, str(folder / "run.csv"), earlier).findings)


def moved(seed: int, kind: str, run: int = 0) -> Moved:
    """Return a log of one kind of the arm of a seed; ``run`` counts its motions."""
    generator = np.random.default_rng([924, seed])
    bodies = robot(generator)
    truth, count, t = urdf("arm", bodies, seed), len(bodies), np.arange(int(RATE * SECONDS)) / RATE
    reach = [0.6 * (body.limits[1] - body.limits[0]) / 2 for body in bodies]
    share, motion = float(generator.uniform(0.4, 0.8)), int(generator.integers(1 << 30))
    model = pinocchio.buildModelFromXML(truth)
    data = model.createData()

    def recorded(which: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        states = waves(bodies, 0.1, 8, motion + which, reach, 0.0, share)(t)
        return *states, np.array([pinocchio.rnea(model, data, *row) for row in zip(*states, strict=True)])

    q, dq, _, rigid = recorded(0)
    size = np.maximum(rigid.std(axis=0), 0.02 * rigid.std())
    inertia = np.diag(pinocchio.crba(model, data, q[len(t) // 2])).copy()
    rotor = generator.uniform(0.1, 1.0, count) * inertia
    dry, slope = generator.uniform(0.05, 0.4, (2, count)) * size
    fading = generator.uniform(0, 0.3, count) * dry * (generator.random() < 0.6)
    load, offset = generator.uniform(0, 0.06), 0.02 * generator.normal(size=count) * size
    noise, joint = generator.uniform(0.002, 0.02) * size, int(generator.integers(count))
    compliance = 1.0 / ((2 * np.pi * generator.uniform(4, 12, count)) ** 2 * inertia)
    away = float(generator.choice([-1, 1]))
    figures, cycles = np.zeros(count), 0.0
    degrees = np.where([body.kind == "prismatic" for body in bodies], 0.002, np.pi / 180)
    if kind == "soft":
        figures = compliance
    elif kind == "zero":
        figures[joint] = away * generator.uniform(5, 15) * degrees[joint]
    elif kind == "gear":
        figures[joint] = 2.0 ** (away * generator.uniform(0.2, 1.0)) - 1.0
    elif kind == "two zeros":
        both = generator.choice(count, 2, replace=False)
        figures[both] = generator.choice([-1, 1], 2) * 0.5 * 40.0 ** generator.uniform(size=2) * degrees[both]
    elif kind == "late":
        figures[joint] = away * generator.uniform(0.004, 0.03)
    elif kind == "ripple":
        figures[joint] = generator.uniform(0.05, 0.3) * size[joint]
        cycles = float(generator.integers(5, 60))
        if bodies[joint].kind == "prismatic":
            cycles = 2 * np.pi * generator.uniform(2, 12) / float(np.ptp(q[:, joint]))
    if run:
        q, dq, _, rigid = recorded(run)
    drive = scipy.interpolate.CubicSpline(t, q + rigid * compliance * (kind == "soft"))
    speed, swing = drive(t, 1), drive(t, 2)
    friction = (dry + load * np.abs(rigid) + fading * np.exp(-((speed / 0.08) ** 2))) * np.tanh(speed / 0.005)
    tau = rigid + rotor * swing + friction + slope / np.abs(dq).max(axis=0) * speed + offset
    tau += noise * generator.normal(size=tau.shape)
    if kind == "ripple":
        tau += figures * np.sin(cycles * q + away)
    if kind == "late":
        tau[:, joint] = np.interp(t - figures[joint], t, tau[:, joint])
    seen = (
        drive(t) / (1.0 + figures * (kind == "gear"))
        - figures * ("zero" in kind)
        + 1e-5 * generator.normal(size=q.shape)
    )
    names = [body.joint for body in bodies]
    columns = {"t": t, "q": seen, "tau": tau}
    return Moved(urdf("arm", bodies), columns, dict(zip(names, figures.tolist(), strict=True)), cycles)


def holds(finding: Finding, truth: float, cycles: float = 0.0) -> bool:
    """Return whether the 95 % interval of a finding holds a figure; of a compliance, whether it is near."""
    if cycles and abs(finding.numbers["cycles"] - cycles) > finding.numbers["cycles_half_width"]:
        return False
    if finding.name == KINDS["soft"]:
        return 1 / 3 < finding.numbers["value"] / truth < 3
    return abs(finding.numbers["value"] - truth) <= finding.numbers["half_width"]


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ARMS)
    counts: Counter[tuple[str, str]] = Counter()
    kinds = {kind: KINDS[kind] for kind in sys.argv[3:] or KINDS}
    for seed in tracked(range(first, last), "arms"):
        for kind, name in kinds.items():
            earlier = moved(seed, "right") if kind == "two zeros" else None
            log = moved(seed, kind, int(earlier is not None))
            with tempfile.TemporaryDirectory() as folder:
                found = [one for one in log.told(Path(folder), earlier) if one.name in KINDS.values() and one.joint]
            right = [one for one in found if one.name == name and log.truth[one.joint]]
            counts[kind, "joints with the fault"] += sum(value != 0.0 for value in log.truth.values())
            counts[kind, "named"] += len(right)
            counts[kind, "within the interval"] += sum(holds(one, log.truth[one.joint], log.cycles) for one in right)
            for one in right:
                if not holds(one, log.truth[one.joint], log.cycles):
                    print(f"{seed} {kind}: {log.truth[one.joint]:.4g}, {log.cycles:.4g}: {one.line()}", flush=True)
            for other in (one for one in found if one not in right):
                counts[kind, f"false {other.severity}"] += 1
                print(f"{seed} {kind}: {other.line()}", flush=True)
    for (kind, what), count in counts.items():
        print(f"{kind}: {count} {what}")


if __name__ == "__main__":
    main()
