"""The search for an excitation of a UR10 to a condition number of 30, beside FIGAROH's own with its own settings.

Both have the limits to position and speed. FIGAROH's motion is a spline through waypoints at rest, 12 s long, within
limits to torque; ours is a Fourier series of 10 s within limits to acceleration: tools are compared, not one algorithm.
A run of FIGAROH that ends without the goal counts with all its time.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from benchmarks.speed import figaroh_search
from benchmarks.speed.designs import ur10_design
from benchmarks.speed.harness import Line, Record, Times
from benchmarks.speed.rows.excitation import GOAL, HERE, SEEDS, until_reached
from dynident.excitation.design.feasibility import feasible_start
from dynident.excitation.design.start import Trail, candidates

CAP = 60.0  # s of the processor for each run of FIGAROH
FIGAROH = "FIGAROH, spline and IPOPT"


def measure() -> Record:
    found = Record("figaroh", f"UR10, to a condition number of {GOAL:g}, {len(SEEDS)} seeds, tools as they are")
    with ThreadPoolExecutor(len(SEEDS)) as pool:  # processes of their own, beside the searches of this one
        theirs = list(pool.map(lambda seed: figaroh_search.search(seed, GOAL, CAP), SEEDS))
    problem = ur10_design()
    dense = replace(problem, samples=10 * problem.samples)
    start = feasible_start(problem, np.random.default_rng(SEEDS[0]))
    list(candidates(problem, start, Trail(time.perf_counter() + 1.0, lambda *_: None)))  # compiles
    ours = [until_reached(problem, dense, seed)[0] for seed in SEEDS]
    found.agree("here: seeds that do not reach the goal", sum(not np.isfinite(moment) for moment in ours), 0)
    found.times[HERE] = Times(ours, ours)
    found.facts["runs of FIGAROH"] = theirs
    if found.peer("figaroh") and found.peer("cyipopt", "cyipopt-wheels"):
        faults = [run["fault"] for run in theirs if "fault" in run]
        if faults:
            found.missing[FIGAROH] = "; ".join(faults)
        else:
            spent = [run["reached_s"] or run["processor_s"] for run in theirs]
            found.times[FIGAROH] = Times(spent, spent)
    never = all(run.get("reached_s") is None for run in theirs)
    word = f", where the peer did not get in {CAP:g} s" if never else ""
    found.lines = [Line(f"excitation of a UR10 to a condition number of {GOAL:g}{word}", HERE, FIGAROH)]
    return found
