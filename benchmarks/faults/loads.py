"""Intervals of a load at the flange against robot models that are off: python -m benchmarks.faults.loads [FIRST LAST].

The random arms of ``benchmarks.faults.clean`` carry a body that their robot model does not have, of 0.3 to 3 times the
mass of the last link. Counted are the loads that the log checks name, the intervals at 95 % that hold the mass, and the
arms whose last links' own errors are named as a load where there is none.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.faults.clean import bound, findings_of, log, robot
from benchmarks.faults.trials import tracked
from benchmarks.strangers.plant import urdf
from dynident.diagnosis.finding import Finding

ARMS = 60


def loaded(truth: str, last: str, mass: float, place: np.ndarray) -> str:
    """Return a robot model with a ball of 8 cm at a place of its last link."""
    moment = 0.4 * mass * 0.08**2
    where = " ".join(f"{value:.9g}" for value in place)
    link = (
        f'<link name="load"><inertial><origin xyz="{where}" rpy="0 0 0"/><mass value="{mass:.9g}"/>'
        f'<inertia ixx="{moment:.9g}" ixy="0" ixz="0" iyy="{moment:.9g}" iyz="0" izz="{moment:.9g}"/></inertial></link>'
        f'<joint name="flange" type="fixed"><parent link="{last}"/><child link="load"/></joint></robot>'
    )
    return truth.replace("</robot>", link)


def named(seed: int, share: float, folder: Path) -> tuple[float, Finding | None]:
    """Return the mass of the load on the arm of a seed, in kg, and what the log checks say of it."""
    generator = np.random.default_rng([24, seed])
    bodies = robot(generator)
    mass = share * bodies[-1].mass
    truth = urdf("arm", bodies, seed)
    if mass:
        truth = loaded(truth, f"link_{len(bodies)}", mass, generator.normal(0, 0.1, 3))
    columns, side = log(generator, bodies, truth)
    found = findings_of(columns, urdf("arm", bodies), side, folder)
    loads = [one for one in found if one.name == "load at the flange" and "not determined" not in one.evidence]
    return mass, loads[0] if loads else None


def main() -> None:
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ARMS)
    count, held, missed = 0, 0, 0
    with tempfile.TemporaryDirectory() as name:
        for seed in tracked(range(first, last), "logs"):
            share = float(np.exp(np.random.default_rng([9, seed]).uniform(np.log(0.3), np.log(3.0))))
            mass, found = named(seed, share, Path(name))
            if found is None:
                missed += 1
                continue
            half = float(found.evidence.split("+- ")[1].split()[0])
            told = found.numbers["mass_kg"]
            count, held = count + 1, held + (abs(told - mass) <= half)
            print(f"{seed}: {mass:.3g} kg, named {told:.3g} +- {half:.2g} kg, {found.severity}", flush=True)
    print(f"{count} of {last - first} loads named, {held} intervals hold the mass, {missed} not named")
    print(f"upper 95 % bound of the share of intervals that do not: {bound(count - held, count):.1%}")


if __name__ == "__main__":
    main()
