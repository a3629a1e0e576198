"""Joints that run into an end stop: python -m benchmarks.faults.end_stops [FIRST LAST].

One joint of the random arms of ``benchmarks.faults.clean`` is held by a stop in a tenth of the samples, hard or one
that gives way by a twentieth or a fifth, and its motor pushes on, up to three times the deviation of its torque.
Counted are the logs in which the joint is named, and the error of the model on another motion without a stop before and
after the named rows are left out; ``held`` are joints that stand as long at the end of their travel and hold 1.5 times
their dry friction there, of which nothing may be said.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio

from benchmarks.faults.clean import case_of, robot, written
from benchmarks.faults.trials import tracked
from benchmarks.strangers.plant import urdf, waves
from dynident.case.case import Case
from dynident.diagnosis.examination import examine
from dynident.identification.identify import identify
from dynident.identification.validate import validate

ARMS, SHARE, PUSH, HELD = 20, 0.1, 3.0, 1.5

#: How far a stop gives way, over how far the joint would go on.
STOPS = {"hard": 0.0, "stiff": 0.05, "soft": 0.2, "held": 0.0}


def stopped(seed: int, kind: str) -> tuple[str, str, list[dict[str, np.ndarray]], int]:
    """Return a robot model, the side of its torques, a log with a stop and one without, and the joint of the stop."""
    generator = np.random.default_rng([24, seed])
    bodies = robot(generator)
    truth, count = urdf("arm", bodies, seed), len(bodies)
    rate, seconds = float(generator.choice([100, 200, 500])), float(generator.uniform(15, 45))
    t = np.arange(int(rate * seconds)) / rate
    first, speed = float(generator.choice([0.05, 0.1, 0.2])), float(generator.uniform(0.3, 0.7))
    reach = [0.3 * (body.limits[1] - body.limits[0]) for body in bodies]
    joint, side = int(generator.integers(count)), float(generator.choice([-1, 1]))
    model = pinocchio.buildModelFromXML(truth)
    data = model.createData()
    rotors, friction = None, np.zeros((2, count))
    found = []
    for k in range(2):
        q = waves(bodies, first, 5, seed + 1000 * k, reach, 0.0, speed)(t)[0]
        over = np.maximum(side * q[:, joint] - np.quantile(side * q[:, joint], 1 - SHARE), 0.0) * (k == 0)
        q[:, joint] -= side * over * (1 - STOPS[kind])
        dq = np.gradient(q, t, axis=0)
        ddq = np.gradient(dq, t, axis=0)
        rigid = np.array([pinocchio.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])
        if rotors is None:
            size = np.maximum(rigid.std(axis=0), 0.02 * rigid.std())
            rotors = generator.uniform(0.1, 1.0, count) * np.diag(pinocchio.crba(model, data, q[len(t) // 2]))
            friction = generator.uniform(0.05, 0.4, (2, count)) * size
            noise = generator.uniform(0.002, 0.03) * size
        tau = rigid + rotors * ddq + friction[0] * np.tanh(dq / 0.005) + friction[1] * dq / np.abs(dq).max(axis=0)
        push = PUSH * size[joint] * np.minimum(2.0 * over / max(over.max(), 1e-9), 1.0)
        tau[:, joint] += side * (HELD * friction[0, joint] * (over > 0) if kind == "held" else push)
        found.append({"t": t, "q": q + 2e-5 * generator.normal(size=q.shape)})
        found[-1]["tau"] = tau + noise * generator.normal(size=q.shape)
    return urdf("arm", bodies), "motor", found, joint


def error_of(case: Case, columns: dict[str, np.ndarray], unseen: dict[str, np.ndarray], folder: Path) -> float:
    """Return the error on unseen columns of what is identified from others, as a share of the torque."""
    for name, own in (("train", columns), ("test", unseen)):
        written(own, folder / f"{name}.csv")
    train, test = (case.read(folder / f"{name}.csv") for name in ("train", "test"))
    return validate(identify(case.model, [train], "wls", case.preprocessing), [test]).total_relative_error


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ARMS)
    for kind in STOPS:
        named, others, gains = 0, list[str](), list[float]()
        for seed in tracked(range(first, last), "logs"):
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                described, side, (columns, unseen), joint = stopped(seed, kind)
                case = case_of(described, side, folder)
                written(columns, folder / "run.csv")
                found = [one for one in examine(case, str(folder / "run.csv")).findings if one.severity != "note"]
                ends = [one for one in found if one.name == "end stop"]
                named += bool(ends) and [one.joint for one in ends] == [f"joint_{joint + 1}"]
                others += [f"{seed}: {one.label}" for one in found if one not in ends or kind == "held"]
                if not ends or kind == "held":
                    continue
                at, place = ends[0].numbers["position"], columns["q"][:, joint]
                beyond = place >= at if "upper" in ends[0].evidence else place <= at
                near = np.convolve(beyond, np.ones(2 * round(0.2 / columns["t"][1]) + 1), "same") > 0
                mended = replace(case, preprocessing=replace(case.preprocessing, longest_gap_s=60.0))
                cut = {key: values[~near] for key, values in columns.items()}
                before, after = error_of(case, columns, unseen, folder), error_of(mended, cut, unseen, folder)
                gains.append(after / before)
                print(f"{kind} {seed}: error {before:.2%} with these rows, {after:.2%} without", flush=True)
        print(f"{kind}: the joint named in {named} of {last - first}; besides: {'; '.join(others) or 'nothing'}")
        if gains:
            print(f"  errors without these rows over those with: median {np.median(gains):.2f}, most {max(gains):.2f}")


if __name__ == "__main__":
    main()
