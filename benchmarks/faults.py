"""The doctor against injected faults: kinds x strengths x robots, and false alarms on the clean logs.

A clean log is a Fourier motion of a robot that ships, with its own friction, noise on torques and positions, written to
a CSV file. With DYNIDENT_DATA set, the Panda and the TX40 join in. Each fault is put into the file's columns; the
doctor must name it. Faults without a strength (a swapped column) are put into three different joints instead.
Run: python -m benchmarks.faults [ROBOT ...]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynident.estimation.doctor import examine
from dynident.experiment.case_file.case import Case, read_case
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion

VIRTUAL = ("er16", "generic-6r", "generic-7r")
REAL = {"panda": "panda_gaz2019/exciting_traj_1.csv", "tx40": "staubli_tx40_figaroh/trajectory.csv"}
RATE, DURATION = 200.0, 20.0

Columns = dict[str, np.ndarray]


@dataclass(frozen=True)
class Fault:
    """A fault, the findings that name it rightly, its strengths, and how it is put into t (N,), q, dq, tau (N, n)."""

    name: str
    right: tuple[str, ...]
    strengths: tuple[float, ...]
    inject: Callable[[Columns, float, np.random.Generator], Columns]
    robots: tuple[str, ...] = ()


def clean(case: Case, seed: int = 0) -> Columns:
    """Return a log of a virtual robot: five harmonics a joint within its limits, torques with friction and noise."""
    generator = np.random.default_rng(seed)
    t = np.arange(int(RATE * DURATION)) / RATE
    limits = [joint.limits for joint in case.robot.active]
    reach = np.array([min(one.upper - one.lower, 4.0) if np.isfinite(one.upper - one.lower) else 4.0 for one in limits])
    middle = np.array([(one.upper + one.lower) / 2 if np.isfinite(one.upper + one.lower) else 0.0 for one in limits])
    pulsation = 2 * np.pi * 0.1 * np.arange(1, 6)
    height = generator.normal(size=(len(limits), 5)) / np.arange(1, 6)
    phase = t[:, None, None] * pulsation + generator.uniform(-np.pi, np.pi, (len(limits), 5))
    q = np.sum(height * np.sin(phase), axis=-1)
    scale = 0.35 * reach / np.abs(q).max(axis=0)
    dq = np.sum(height * pulsation * np.cos(phase), axis=-1) * scale
    ddq = -np.sum(height * pulsation**2 * np.sin(phase), axis=-1) * scale
    q = q * scale + middle
    friction = (FRICTION.make("coulomb", width=0.01), FRICTION.make("viscous"), FRICTION.make("offset"))
    model = DynamicModel(case.robot, friction)
    tau = model.torque(Motion(q, dq, ddq), np.asarray(model.nominal()))
    tau = tau + 0.02 * tau.std(axis=0) * generator.normal(size=tau.shape)
    noisy = q + 2e-5 * generator.normal(size=q.shape)
    return {"t": t, "q": noisy, "dq": dq + 1e-3 * generator.normal(size=q.shape), "tau": tau}


def write(columns: Columns, path: Path) -> None:
    names = ["t", *(f"{name}{k + 1}" for name in columns if name != "t" for k in range(columns[name].shape[1]))]
    values = np.column_stack([columns["t"], *(columns[name] for name in columns if name != "t")])
    np.savetxt(path, values, "%.9g", ",", header=",".join(names), comments="")


def changed(columns: Columns, **new: np.ndarray) -> Columns:
    return {**columns, **new}


def of_joint(columns: Columns, name: str, joint: int, change: Callable[[np.ndarray], np.ndarray]) -> Columns:
    values = columns[name].copy()
    values[:, joint % values.shape[1]] = change(values[:, joint % values.shape[1]])
    return changed(columns, **{name: values})


def rows(columns: Columns, index: np.ndarray) -> Columns:
    return {name: values[index] for name, values in columns.items()}


def swapped(columns: Columns, names: tuple[str, ...], i: int, k: int) -> Columns:
    order = np.arange(columns["q"].shape[1])
    order[[i, k]] = order[[k, i]]
    return changed(columns, **{name: columns[name][:, order] for name in names if name in columns})


def jitter(c: Columns, s: float, g: np.random.Generator) -> Columns:
    step = np.median(np.diff(c["t"]))
    late = c["t"] + s * step * g.uniform(0, 1, len(c["t"]))
    return changed(c, t=np.maximum.accumulate(late) + 1e-6 * step * np.arange(len(late)))


def duplicates(c: Columns, s: float, g: np.random.Generator) -> Columns:
    again = g.choice(len(c["t"]), max(1, int(s * len(c["t"]))), replace=False)
    return rows(c, np.sort(np.concatenate([np.arange(len(c["t"])), again])))


def disorder(c: Columns, s: float, g: np.random.Generator) -> Columns:
    order = np.arange(len(c["t"]))
    for k in g.choice(len(order) // 4 - 1, max(1, int(s * len(order))), replace=False):
        order[[4 * k, 4 * k + 1]] = order[[4 * k + 1, 4 * k]]
    return rows(c, order)


def restart(c: Columns, s: float, g: np.random.Generator) -> Columns:
    half = int(s * len(c["t"]))
    return changed(c, t=np.concatenate([c["t"][:half], c["t"][half:] - c["t"][half] + c["t"][0]]))


def gap(c: Columns, s: float, g: np.random.Generator) -> Columns:
    middle = c["t"][len(c["t"]) // 2]
    return rows(c, np.flatnonzero((c["t"] < middle) | (c["t"] > middle + s)))


def lost(c: Columns, s: float, g: np.random.Generator) -> Columns:
    tau = c["tau"].copy()
    tau[g.choice(len(tau), max(1, int(s * len(tau))), replace=False)] = np.nan
    return changed(c, tau=tau)


def flips(c: Columns, s: float, g: np.random.Generator) -> Columns:
    tau = c["tau"].copy()
    tau[g.choice(len(tau), int(s * len(tau)), replace=False)] = 0.0
    return changed(c, tau=tau)


def spikes(c: Columns, s: float, g: np.random.Generator) -> Columns:
    def change(v: np.ndarray) -> np.ndarray:
        v = v.copy()
        v[g.choice(len(v), 5, replace=False)] += s * np.ptp(v)
        return v

    return of_joint(c, "tau", 1, change)


def wrap(c: Columns, s: float, g: np.random.Generator) -> Columns:
    def change(v: np.ndarray) -> np.ndarray:
        edge = np.quantile(v, s)
        return np.where(v > edge, v - 2 * np.pi, v)

    return of_joint(c, "q", 0, change)


def delayed(c: Columns, s: float, g: np.random.Generator, name: str = "tau") -> Columns:
    t = c["t"]
    return changed(c, **{name: np.stack([np.interp(t - s, t, v) for v in c[name].T], axis=1)})


def clipped(c: Columns, s: float, g: np.random.Generator) -> Columns:
    return of_joint(c, "tau", 1, lambda v: np.minimum(v, np.quantile(v, 1 - s)))


def coarse(c: Columns, s: float, g: np.random.Generator, name: str = "tau") -> Columns:
    return of_joint(c, name, 2, lambda v: np.round(v / (np.ptp(v) / s)) * (np.ptp(v) / s))


def still(c: Columns, s: float, g: np.random.Generator) -> Columns:
    c = of_joint(c, "q", int(s), lambda v: np.full_like(v, v[0]) + 1e-5 * g.normal(size=len(v)))
    return of_joint(c, "dq", int(s), np.zeros_like) if "dq" in c else c


def pause(c: Columns, s: float, g: np.random.Generator) -> Columns:
    count = int(len(c["t"]) * s / (1 - s))
    step = np.median(np.diff(c["t"]))
    held = {n: np.repeat(v[-1:], count, axis=0) + 1e-9 * g.normal(size=(count, *v.shape[1:])) for n, v in c.items()}
    held["t"] = c["t"][-1] + step * np.arange(1, count + 1)
    if "dq" in held:
        held["dq"] = 1e-6 * g.normal(size=held["dq"].shape)
    return {n: np.concatenate([v, held[n]]) for n, v in c.items()}


def turned(c: Columns, names: tuple[str, ...], joint: float) -> Columns:
    for name in names:
        if name in c:
            c = of_joint(c, name, int(joint), np.negative)
    return c


def sprung(c: Columns, s: float, g: np.random.Generator) -> Columns:
    q = c["q"][:, 0]
    return of_joint(c, "tau", 0, lambda v: v + s * v.std() / q.std() * (q - q.mean()))


def drifting(c: Columns, s: float, g: np.random.Generator) -> Columns:
    clock = (c["t"] - c["t"][0]) / np.ptp(c["t"]) - 0.5
    return of_joint(c, "tau", 1, lambda v: v + s * v.std() * clock)


def poor(c: Columns, s: float, g: np.random.Generator) -> Columns:
    """One slow sine, the same at all joints: they move, and say nothing."""
    sine = s * np.sin(2 * np.pi * 0.05 * c["t"])[:, None] * np.ones(c["q"].shape[1])
    moved = changed(c, q=c["q"].mean(axis=0) + sine)
    moved.pop("dq", None)
    return changed(moved, tau=c["tau"].mean(axis=0) + sine * c["tau"].std(axis=0))


def slowed(c: Columns, s: float, g: np.random.Generator) -> Columns:
    clock = c["t"] - c["t"][0]
    late = np.stack([np.interp(s * clock, clock, v) for v in c["q"].T], axis=1)
    c = changed(c, q=late, q_ref=c["q"])
    c.pop("dq", None)
    return c


JOINTS = (0.0, 1.0, 3.0)
DEG = 180 / np.pi
FAULTS = (
    Fault("time in ms", ("time unit",), JOINTS, lambda c, s, g: changed(c, t=1e3 * c["t"])),
    Fault("time in us", ("time unit",), JOINTS, lambda c, s, g: changed(c, t=1e6 * c["t"])),
    Fault("jitter", ("time jitter",), (0.5, 1.0, 3.0), jitter),
    Fault("repeated rows", ("repeated rows",), (0.0001, 0.01, 0.2), duplicates),
    Fault("rows out of order", ("rows out of order",), (0.0001, 0.005, 0.02), disorder),
    Fault("clock starts again", ("time runs back",), (0.2, 0.5, 0.8), restart),
    Fault("gap in time", ("gap in time",), (0.1, 0.4, 2.0), gap),
    Fault("not finite", ("values that are not finite", "signal missing"), (0.0001, 0.01, 0.3), lost),
    Fault("two publishers", ("two publishers",), (0.02, 0.1, 0.4), flips),
    Fault("spikes", ("spikes",), (1.0, 3.0, 10.0), spikes),
    Fault("encoder wrap", ("encoder wrap",), (0.3, 0.5, 0.8), wrap),
    Fault("positions in deg", ("positions in degrees",), JOINTS, lambda c, s, g: changed(c, q=DEG * c["q"])),
    Fault("velocities in deg/s", ("velocity unit",), JOINTS, lambda c, s, g: changed(c, dq=DEG * c["dq"])),
    Fault("sign of velocity", ("velocity sign",), JOINTS, lambda c, s, g: turned(c, ("dq",), s)),
    Fault("order of velocities", ("velocity order",), JOINTS, lambda c, s, g: swapped(c, ("dq",), int(s), int(s) + 1)),
    Fault("lag of velocity", ("velocity lag",), (0.01, 0.02, 0.05), lambda c, s, g: delayed(c, s, g, "dq")),
    Fault("saturation", ("torque saturation",), (0.02, 0.1, 0.3), clipped),
    Fault("coarse torque", ("coarse torques",), (4.0, 10.0, 40.0), coarse),
    Fault("coarse position", ("coarse positions",), (4.0, 10.0, 40.0), lambda c, s, g: coarse(c, s, g, "q")),
    Fault("joint never moved", ("joint never moved",), JOINTS, still),
    Fault("standstill", ("standstill",), (0.55, 0.7, 0.9), pause),
    Fault("sign of torque", ("torque sign",), JOINTS, lambda c, s, g: turned(c, ("tau",), s)),
    Fault("signs of all torques", ("torque sign",), JOINTS, lambda c, s, g: changed(c, tau=-c["tau"])),
    Fault("order of torques", ("torque order",), JOINTS, lambda c, s, g: swapped(c, ("tau",), int(s), int(s) + 1)),
    Fault("sign of position", ("position sign",), (1.0, 2.0, 3.0), lambda c, s, g: turned(c, ("q", "dq"), s)),
    Fault("order of joints", ("joint order",), JOINTS, lambda c, s, g: swapped(c, ("q", "dq"), int(s), int(s) + 1)),
    Fault("delay of torque", ("torque delay",), (0.01, 0.03, 0.1), delayed),
    Fault("spring", ("spring",), (0.3, 1.0, 3.0), sprung, ("er16", "generic-6r", "generic-7r")),
    Fault("drift", ("drift",), (0.3, 1.0, 3.0), drifting),
    Fault("current for torque", ("torque unit",), (5.0, 11.0, 100.0), lambda c, s, g: changed(c, tau=c["tau"] / s)),
    Fault("gear ratio", ("torque scale",), (1.5, 2.0, 10.0), lambda c, s, g: of_joint(c, "tau", 1, lambda v: v / s)),
    Fault("poor excitation", ("poor excitation",), (0.1, 0.3, 0.6), poor),
    Fault("speed scaling", ("speed scaling",), (0.9, 0.7, 0.3), slowed),
)


def mounted(case: Case) -> list[tuple[str, Case]]:
    """Return cases whose declared gravity is wrong: wall, ceiling, other wall."""
    fields = {"wall": (9.81, 0.0, 0.0), "ceiling": (0.0, 0.0, 9.81), "side": (0.0, 9.81, 0.0)}
    return [(name, replace(case, robot=case.robot.with_gravity(field))) for name, field in fields.items()]


def subjects(wanted: list[str]) -> dict[str, tuple[Case, Columns]]:
    """Return case and clean columns of each robot."""
    found = {name: (read_case(name), clean(read_case(name))) for name in VIRTUAL if not wanted or name in wanted}
    for name, path in REAL.items():
        if os.environ.get("DYNIDENT_DATA") and name in wanted:
            case = read_case(Path(__file__).parents[1] / "examples" / "cases" / f"{name}.yaml")
            table = np.genfromtxt(case.find(path), delimiter=",", names=True)
            parts = {k: [c for c in table.dtype.names if c.rstrip("0123456789") == k] for k in ("q", "dq", "tau")}
            data = {k: np.stack([table[c] for c in names], axis=1) for k, names in parts.items() if names}
            found[name] = (case, {"t": table["t"], **data})
    return found


def tried(case: Case, fault: Fault, strength: float, columns: Columns, folder: Path) -> tuple[bool, list[str]]:
    """Return whether the doctor names the fault, and what it said."""
    path = folder / "run.csv"
    write(fault.inject(columns, strength, np.random.default_rng(1)), path)
    own = case.columns
    if fault.name == "speed scaling":
        own = replace(own, q_ref=tuple(f"q_ref{k + 1}" for k in range(case.robot.dof)))
    said = [finding.name for finding in examine(replace(case, columns=own), str(path)).findings]
    return any(name in fault.right for name in said), said


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    named = total = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for robot, (case, columns) in subjects(options.robots).items():
            begin = time.perf_counter()
            write(columns, folder / "clean.csv")
            alarms = [f.severity for f in examine(case, str(folder / "clean.csv")).findings]
            print(f"{robot}: clean: {alarms.count('error')} errors, {alarms.count('warning')} warnings")
            for fault in FAULTS:
                if options.only not in fault.name or (fault.name.find("veloc") >= 0 and "dq" not in columns):
                    continue
                if fault.robots and robot not in fault.robots:
                    continue
                results = [tried(case, fault, strength, columns, folder) for strength in fault.strengths]
                total, named = total + len(results), named + sum(ok for ok, _ in results)
                marks = " ".join("yes" if ok else f"no {said}" for ok, said in results)
                print(f"  {fault.name:22} {marks}", flush=True)
            for kind, wrong in mounted(case) if options.only in "mounting" else []:
                write(columns, folder / "run.csv")
                said = [finding.name for finding in examine(wrong, str(folder / "run.csv")).findings]
                total, named = total + 1, named + ("mounting" in said)
                print(f"  mounting: {kind:12} {'yes' if 'mounting' in said else f'no {said}'}")
            print(f"  {time.perf_counter() - begin:.0f} s")
    print(f"{named} of {total} named rightly ({100 * named / max(total, 1):.1f} %)")
    sys.exit(0 if named >= 0.95 * total else 1)


if __name__ == "__main__":
    main()
