"""False alarms on logs of random robots, simulated by Pinocchio: python -m benchmarks.faults.clean [FIRST LAST [LOGS]].

A robot has 3 to 7 joints on axes at right angles or askew, some of them slides, with drives, rates, noise and lengths
of logs as they are common; its robot model is off by what makers' are (15 % of each mass, 12 mm of each centre). The
case is drafted by ``init``, as a user has it. With LOGS an arm has so many of other motions, which are checked
together. Every error and every warning that the checks tell is false, and printed.
"""

from __future__ import annotations

import contextlib
import io
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pinocchio
import scipy.stats

from benchmarks.faults.trials import tracked
from benchmarks.strangers.plant import Body, cylinder, urdf, waves
from dynident.api.init import init
from dynident.case.case import Case, read_case
from dynident.diagnosis.examination import examine, examine_logs
from dynident.diagnosis.finding import Finding

LOGS = 300

#: Findings that are true of such a log, and why.
TRUE_OF_A_LOG = {
    "coarse positions": "the encoder of some robots is coarse",
    "coarse torques": "the torque sensor of some robots is coarse",
    "poor excitation": "axes are nearly, but not exactly, parallel or through one point in some random arms",
    "standstill": "a log may rest at its ends",
    "scale not determined": "a vertical first joint tells no scale of its torque",
}

#: Share of joints that slide, of robots whose axes are askew, and of those whose torques are seen on the motor's side.
SLIDES, ASKEW, MOTOR_SIDE = 0.1, 0.3, 0.6


def robot(generator: np.random.Generator) -> list[Body]:
    """Return the bodies of a random arm that gets lighter towards its tip."""
    count = int(generator.integers(3, 8))
    size = float(np.exp(generator.uniform(np.log(0.5), np.log(2.0))))
    askew = generator.random() < ASKEW
    bodies = []
    for k in range(count):
        length = size * generator.uniform(0.08, 0.45)
        mass = size**2 * 8.0 * float(np.exp(-0.45 * k)) * generator.uniform(0.6, 1.6)
        along = int(generator.integers(3))
        place = np.zeros(3)
        if k:
            place[int(generator.integers(3))] = length
            place += generator.normal(0, 0.02 * size, 3)
        axis = np.eye(3)[2 if k == 0 else int(generator.integers(3))]
        if askew and k:
            axis = generator.normal(size=3)
            axis /= np.linalg.norm(axis)
        centre = generator.normal(0, 0.1 * size, 3) * np.where(np.arange(3) == along, 1.5, 0.4)
        slide = k > 0 and generator.random() < SLIDES
        radius = 0.3 * size * generator.uniform(0.1, 0.3)
        bodies.append(
            Body(
                joint=f"joint_{k + 1}",
                place=place,
                axis=axis,
                limits=(-0.3, 0.3) if slide else (-2.6, 2.6),
                speed=0.6 if slide else 2.5,
                effort=float(400.0 * size**3 * np.exp(-0.5 * k)),
                mass=mass,
                centre=centre,
                inertia=cylinder(mass, radius, length, along),
                kind="prismatic" if slide else "revolute",
            )
        )
    return bodies


def recorded(
    generator: np.random.Generator, bodies: list[Body], truth: str, logs: int
) -> tuple[list[dict[str, np.ndarray]], str]:
    """Return the columns of logs of one arm in several motions, and where its torque was measured."""
    count = len(bodies)
    rate = float(generator.choice([100, 125, 200, 250, 500, 1000]))
    seconds = float(generator.uniform(15, 45))
    first = float(generator.choice([0.05, 0.1, 0.2]))
    reach = [0.6 * (body.limits[1] - body.limits[0]) / 2 for body in bodies]
    seed, speed = int(generator.integers(1 << 30)), float(generator.uniform(0.3, 0.7))
    t = np.arange(int(rate * seconds)) / rate
    moved = [waves(bodies, first, 5, seed + k, reach, 0.0, speed)(t) for k in range(logs)]
    model = pinocchio.buildModelFromXML(truth)
    data = model.createData()
    rigid = [np.array([pinocchio.rnea(model, data, *row) for row in zip(*each, strict=True)]) for each in moved]
    size = np.maximum(rigid[0].std(axis=0), 0.02 * rigid[0].std())
    rotors = np.zeros(count)
    if motor := generator.random() < MOTOR_SIDE:
        masses = np.diag(pinocchio.crba(model, data, moved[0][0][len(t) // 2]))
        rotors = generator.uniform(0.1, 1.0, count) * masses
    dry, slope = (generator.uniform(0.05, 0.4, (2, count)) * (1.0 if motor else 0.2)) * size
    load = generator.uniform(0, 0.06) * motor
    slope, offset = slope / np.abs(moved[0][1]).max(axis=0), 0.02 * generator.normal(size=count) * size
    noise, tick, rough = generator.uniform(0.002, 0.03) * size, 0.0, 0.0
    found = []
    for (q, dq, ddq), bare in zip(moved, rigid, strict=True):
        tau = bare + rotors * ddq
        tau += (dry + load * np.abs(tau)) * np.tanh(dq / 0.005) + slope * dq + offset
        tau += noise * generator.normal(size=tau.shape)
        tick = tick or float(10 ** generator.uniform(-5.5, -3.7))
        columns = {"t": t, "q": np.round(q / tick) * tick, "tau": tau}
        if not found:
            rough = float(10 ** generator.uniform(-4, -2.3)) if generator.random() < 0.6 else 0.0
        if rough:
            columns["dq"] = dq + rough * generator.normal(size=dq.shape)
        found.append(columns)
    return found, "motor" if motor else "joint"


def log(generator: np.random.Generator, bodies: list[Body], truth: str) -> tuple[dict[str, np.ndarray], str]:
    """Return the columns of one log, and where its torque was measured."""
    (columns,), side = recorded(generator, bodies, truth, 1)
    return columns, side


def written(columns: dict[str, np.ndarray], path: Path) -> None:
    names = [
        f"{key}{k + 1}" if values.ndim > 1 else key for key, values in columns.items() for k in range(values[0].size)
    ]
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=",".join(names), comments="")


def case_of(model: str, side: str, folder: Path) -> Case:
    """Return a case of simple friction of a robot model, with rotor inertias where the torques are the motors'."""
    (folder / "arm.urdf").write_text(model)
    rotors = ", rotor_inertia" * (side == "motor")
    text = f"case: 2\nrobot: arm.urdf\nfriction: [coulomb, viscous, offset{rotors}]\n"
    (folder / "case.yaml").write_text(text)
    return read_case(folder / "case.yaml")


def findings_of(columns: dict[str, np.ndarray], model: str, side: str, folder: Path) -> tuple[Finding, ...]:
    """Return the findings on a log under that case."""
    written(columns, folder / "run.csv")
    return tuple(examine(case_of(model, side, folder), str(folder / "run.csv")).findings)


def told(seed: int, folder: Path, logs: int = 1) -> tuple[list[Finding], str]:
    """Return the findings at error and warning level on the logs of a seed, and what robot it is."""
    generator = np.random.default_rng([24, seed])
    bodies = robot(generator)
    truth, described = urdf(f"arm_{seed}", bodies, seed), urdf(f"arm_{seed}", bodies)
    recordings, side = recorded(generator, bodies, truth, logs)
    (folder / "arm.urdf").write_text(described)
    paths = [str(folder / f"run{k}.csv") for k in range(logs)]
    for columns, path in zip(recordings, paths, strict=True):
        written(columns, Path(path))
    with contextlib.redirect_stdout(io.StringIO()):
        draft = init(str(folder / "arm.urdf"), paths, folder)
    (folder / "case.yaml").write_text(draft.text)
    case = read_case(folder / "case.yaml")
    found = [one for each in examine_logs(case, paths) for one in each.findings if one.severity != "note"]
    kind = "".join("P" if body.kind == "prismatic" else "R" for body in bodies)
    return found, f"{kind}, {side} side, {len(recordings[0]['t'])} rows"


def bound(count: int, logs: int) -> float:
    """Return the upper 95 % bound of a share (Clopper and Pearson 1934)."""
    return 1.0 if count >= logs else float(scipy.stats.beta.ppf(0.95, count + 1, logs - count))


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, LOGS)
    logs = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    alarmed: Counter[str] = Counter()
    kinds: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        for seed in tracked(range(first, last), "logs"):
            found, about = told(seed, Path(name), logs)
            false = [one for one in found if one.name not in TRUE_OF_A_LOG]
            for severity in {one.severity for one in false}:
                alarmed[severity] += 1
            for one in false:
                kinds[one.name] += 1
                print(f"{seed} ({about}): {one.line()}", flush=True)
    arms = last - first
    for severity in ("error", "warning"):
        count = alarmed[severity]
        print(
            f"{count} of {arms} arms of {logs} logs with a false {severity}; upper 95 % bound {bound(count, arms):.1%}"
        )
    print(", ".join(f"{name} {count}" for name, count in kinds.most_common()))


if __name__ == "__main__":
    main()
