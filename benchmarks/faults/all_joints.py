"""Faults of all joints at once on random arms: python -m benchmarks.faults.all_joints [FIRST LAST [KIND ...]].

The random arms of ``benchmarks.faults.clean``, with torques in another unit beside a tool that the robot model does not
have (1 to 4 times the mass of the last link), all positions, torques or both with the other sign, and positions of two
joints in radians or metres that are declared as degrees or millimetres; torques half, twice or four times as large,
with and without the tool. Right are such arms with the tool, and with masses of the robot model that are off together
or each for itself. Counted are the faults that the gravest error names, right logs with an error, and those on which a
warning or a note tells a scale of all torques.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.faults.clean import findings_of, log, robot
from benchmarks.faults.loads import loaded
from benchmarks.faults.trials import tracked
from benchmarks.strangers.plant import urdf

ARMS = 16

#: The finding of a factor of two of all torques, a warning or a note.
SCALE = "torque scale"

#: The finding that names each fault; none for a right log.
KINDS = {
    "right with a tool": "",
    "tool, masses x 1.5": "",
    "tool, masses x 0.5": "",
    "tool, masses each off by 50 %": "",
    "tool, torques / 9.81": "torque unit",
    "tool, torques / 5": "torque unit",
    "tool, torques x 10": "torque unit",
    "positions turned": "position sign",
    "torques turned": "torque sign",
    "both turned": "axis sign",
    "two position units": "position unit",
    "torques x 4": "torque unit",
    "torques x 2": SCALE,
    "torques / 2": SCALE,
    "tool, torques x 2": SCALE,
    "tool, torques / 2": SCALE,
    "right": "",
}


def heavier(text: str, times: float, spread: float, generator: np.random.Generator) -> str:
    """Return a robot model whose masses and inertias are so many times as large, each by a spread of its own."""

    def one(found: re.Match[str]) -> str:
        share = times * float(np.exp(spread * generator.normal()))
        return re.sub(
            r'(mass value|i[xyz][xyz])="([^"]+)"', lambda each: f'{each[1]}="{float(each[2]) * share:.9g}"', found[0]
        )

    return re.sub(r"<inertial>.*?</inertial>", one, text, flags=re.DOTALL)


def logs(seed: int) -> Iterator[tuple[str, dict[str, np.ndarray], str, str]]:
    """Yield each kind on the arm of a seed: its columns, robot model and where its torque was measured."""
    bodies = robot(np.random.default_rng([24, seed]))
    truth, described, generator = urdf("arm", bodies, seed), urdf("arm", bodies), np.random.default_rng([77, seed])
    share, place = float(np.exp(generator.uniform(0.0, np.log(4.0)))), generator.normal(0, 0.15, 3)
    carrying = loaded(truth, f"link_{len(bodies)}", share * bodies[-1].mass, place)
    bare, side = log(np.random.default_rng([25, seed]), bodies, truth)
    tool, _ = log(np.random.default_rng([25, seed]), bodies, carrying)
    for kind, times, spread in (("", 1.0, 0.0), ("x 1.5", 1.5, 0.0), ("x 0.5", 0.5, 0.0), ("each", 1.0, 0.5)):
        name = next(name for name in KINDS if (name.startswith("right") if not kind else kind in name))
        yield name, tool, heavier(described, times, spread, generator), side
    for name, factor in (("/ 9.81", 1 / 9.81), ("/ 5", 0.2), ("x 10", 10.0), ("/ 2", 0.5), ("x 2", 2.0)):
        yield f"tool, torques {name}", {**tool, "tau": factor * tool["tau"]}, described, side
    for name, factor in (("right", 1.0), ("torques / 2", 0.5), ("torques x 2", 2.0), ("torques x 4", 4.0)):
        yield name, {**bare, "tau": factor * bare["tau"]}, described, side
    turned = {key: -bare[key] for key in ("q", "dq") if key in bare}
    yield "positions turned", {**bare, **turned}, described, side
    yield "torques turned", {**bare, "tau": -bare["tau"]}, described, side
    yield "both turned", {**bare, **turned, "tau": -bare["tau"]}, described, side
    units = np.ones(len(bodies))
    for k in generator.choice(len(bodies), 2, replace=False):
        units[k] = 1e-3 if bodies[k].kind == "prismatic" else np.pi / 180
    small = {key: units * bare[key] for key in ("q", "dq") if key in bare}
    yield "two position units", {**bare, **small}, described, side


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ARMS)
    counts, wanted = Counter[tuple[str, str]](), sys.argv[3:] or [*KINDS]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seed in tracked(range(first, last), "arms"):
            for kind, columns, model, side in logs(seed):
                if kind not in wanted:
                    continue
                found = findings_of(columns, model, side, folder)
                errors = [one for one in found if one.severity == "error" and one.name != "poor excitation"]
                of_all = [one for one in found if one.name == SCALE and not one.joint]
                counts[kind, "warning"] += any(one.severity == "warning" for one in of_all)
                counts[kind, "note"] += any(one.severity == "note" for one in of_all)
                if KINDS[kind] == SCALE:
                    continue
                counts[kind, "error"] += bool(errors) and errors[0].name == (KINDS[kind] or errors[0].name)
                if [one.name for one in errors[:1]] != [KINDS[kind]] * bool(KINDS[kind]):
                    print(f"{seed} {kind}: {'; '.join(one.line()[:160] for one in errors) or 'no error'}", flush=True)
    for kind in wanted:
        scales = f"scale of all a warning on {counts[kind, 'warning']}, a note on {counts[kind, 'note']}"
        print(f"{kind}: {KINDS[kind] or 'an'} error on {counts[kind, 'error']} of {last - first}, {scales}")


if __name__ == "__main__":
    main()
