"""Do the intervals of whole identifications hold the truth? A Monte Carlo over the noise of virtual cells.

A robot of ``benchmarks.frictions`` moves once, without noise; each draw adds white noise to the positions of its logs
(not seen by the controller) and to the torques. ``draft`` is the case that ``init`` drafts of the first draw, and
identified as it stands: cut-off, delay, width of dry friction and parts chosen anew in each draw. ``true`` has the
friction and the delay that are there, the cut-off chosen; ``found`` the friction; ``thinned`` is ``true`` on as many
rows as Python keeps by default. Printed for each: share of 95 % intervals over all base parameters and draws that hold
the truth (``pooled``) with its standard error over the draws, the smallest shares with bias in deviations of the draws,
stated over true deviation (median), median width over that of the oracle (deviations of the draws of weighted least
squares as of ``true``, which no prior helps), and what the delay is off by in its stated deviations and in ms.
Run: python -m benchmarks.intervals ROBOT [--draws N] [--noise RAD ...] [--ways draft true] [--estimator NAME]
     [--cutoff HZ]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.frictions import NOISE, ROBOTS, Virtual, friction_of, motion_of
from benchmarks.strangers.plant import urdf
from dynident import DynamicModel, Log, read_case, read_robot
from dynident.arrays import Array
from dynident.cli.main import main as dynident
from dynident.data.preprocessing import ROWS_PER_PERIOD, Preprocessing
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.simulation.cell_simulation import simulate_cell
from dynident.simulation.controllers import CONTROLLERS
from dynident.simulation.effects import Effort, Encoder, Recorder

LOGS = 2


@dataclass(frozen=True)
class Cell:
    """A virtual robot that moved without noise.

    Attributes:
        truth: Standard parameters by name.
        logs: Its logs.
    """

    truth: dict[str, float]
    logs: Sequence[Log]

    def drawn(self, noise: float, seed: int) -> list[Log]:
        """Return the logs with noise of their own in positions and torques."""
        found = []
        for k, log in enumerate(self.logs):
            generator = np.random.default_rng([seed, k])
            q = log.q + noise * generator.normal(size=log.q.shape)
            tau = np.asarray(log.torque)
            tau = tau + NOISE * np.abs(tau).max(axis=0) * generator.normal(size=tau.shape)
            found.append(replace(log, q=q, torque=tau))
        return found


def moved(name: str, virtual: Virtual, folder: Path) -> Cell:
    """Return what the robot does; its description is written into the folder."""
    (folder / "robot.urdf").write_text(urdf(name, virtual.bodies))
    (folder / "truth.urdf").write_text(urdf(name, virtual.bodies, seed=len(name)))
    robot = read_robot(str(folder / "truth.urdf"))
    model = DynamicModel(robot, friction_of(virtual.friction))
    truth = dict(zip([p.name for p in model.parameters], np.asarray(robot.nominal), strict=False))
    for part, (*_, own) in zip(model.friction, virtual.friction, strict=True):
        columns = np.reshape(np.asarray(own, float), (robot.dof, -1)).T
        for coefficient, column in zip(part.coefficients, columns, strict=True):
            truth |= {f"{coefficient.symbol}[{joint}]": v for joint, v in zip(robot.joint_names, column, strict=True)}
    logs = []
    for k in range(LOGS):
        cell = replace(
            virtual.cell,
            controller=CONTROLLERS.make("computed_torque", {"feedforward": "model"}),
            encoder=Encoder(),
            effort=Effort(delay_s=virtual.late / virtual.rate),
            recorder=Recorder(rate=virtual.rate),
            saturation=False,
        )
        motion = motion_of(virtual, 10 * len(name) + k, virtual.first)
        theta = np.array([truth[p.name] for p in model.parameters])
        logs.append(simulate_cell(model, theta, motion, cell, duration=virtual.periods / virtual.first, seed=k).log)
    return Cell(truth, [Log(log.joints, log.time, log.q, torque=log.torque) for log in logs])


def drafted(cell: Cell, noise: float, folder: Path) -> tuple[DynamicModel, Preprocessing]:
    """Return model and preparation that ``init`` drafts of the first draw."""
    paths = []
    for k, log in enumerate(cell.drawn(noise, 0)):
        names = ["time", *(f"q_{joint}" for joint in log.joints), *(f"tau_{joint}" for joint in log.joints)]
        path = folder / f"log_{k}.csv"
        rows = np.column_stack([log.time, log.q, np.asarray(log.torque)])
        np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
        paths.append(str(path))
    case_file = folder / "case.yaml"
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as bad:
        code = dynident(["init", str(folder / "robot.urdf"), *paths, "-o", str(case_file), "--force"])
    if code or ": ask   # ask:" in case_file.read_text():
        raise SystemExit(f"init: {bad.getvalue()}")
    case = read_case(case_file)
    return case.model, case.preprocessing


def true_beta(estimate: Estimate, truth: dict[str, float]) -> Array:
    """Return the base parameters that are there, of the list of parts that the estimate has."""
    theta = [truth.get(p.name, 0.0) for p in estimate.model.parameters]
    return estimate.base.from_standard(np.array(theta))


def figures(found: Sequence[Estimate], cell: Cell, late_s: float, oracle: dict[str, float]) -> dict[str, object]:
    """Return what is printed; ``oracle`` has the deviations of the draws of ``true`` by name."""
    errors, halves, names = [], [], found[0].base.names
    same = [one for one in found if one.base.names == names]
    for one in same:
        errors.append(one.beta - true_beta(one, cell.truth))
        halves.append(one.half_widths())
    inside = np.abs(errors) < np.array(halves)
    share, spread = inside.mean(axis=0), np.std(errors, axis=0)
    wide = np.median(halves, axis=0) / 1.96
    order = np.argsort(share)[:5]
    bias = np.mean(errors, axis=0) / np.maximum(spread, 1e-300)
    delays = [d for one in found for d in one.choices.delays or ()]
    off = np.array([(d.seconds - late_s) / d.std for d in delays])
    known = [k for k, name in enumerate(names) if name in oracle]
    told: dict[str, object] = {
        "draws": len(same),
        "others": len(found) - len(same),
        "pooled": round(float(inside.mean()), 4),
        "error": round(float(inside.mean(axis=1).std() / np.sqrt(len(inside))), 4),
        "lowest": {names[k]: (round(float(share[k]), 3), round(float(bias[k]), 2)) for k in order},
        "largest_bias": round(float(np.abs(bias).max()), 2),
        "stated_over_true": round(float(np.median(wide / spread)), 3),
        "below_85": int((share < 0.85).sum()),
        "parameters": len(names),
    }
    if known:
        told["width_over_oracle"] = round(float(np.median([wide[k] / oracle[names[k]] for k in known])), 3)
    if len(off):
        applied = [d.applied - late_s for d in delays]
        told["delay"] = {
            "mean_z": round(float(off.mean()), 2),
            "rms_z": round(float(np.sqrt((off**2).mean())), 2),
            "rms_ms": round(1e3 * float(np.sqrt(np.mean((np.array([d.seconds for d in delays]) - late_s) ** 2))), 4),
            "deviation_ms": round(1e3 * float(np.median([d.std for d in delays])), 4),
            "applied_rms_ms": round(1e3 * float(np.sqrt(np.mean(np.square(applied)))), 4),
        }
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot", choices=list(ROBOTS))
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--noise", type=float, nargs="+", default=[1e-5, 1e-4])
    parser.add_argument("--ways", nargs="+", default=["true", "draft"])
    parser.add_argument("--estimator", default="consistent")
    parser.add_argument("--cutoff", type=float, help="cut-off in Hz, in place of the one that is chosen")
    given = parser.parse_args()
    virtual = ROBOTS[given.robot]
    late = virtual.late / virtual.rate
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        cell = moved(given.robot, virtual, folder)
        for noise in given.noise:
            model, how = drafted(cell, noise, folder)
            if given.cutoff:
                how = replace(how, filter=how.filter.with_cutoff(given.cutoff))
            true = replace(model, friction=friction_of(virtual.truth or virtual.friction))
            asked = {"draft": (model, how), "true": (true, replace(how, delay_s=late))}
            asked["found"] = (true, replace(how, delay_s=None))
            asked["thinned"] = (true, replace(how, delay_s=late, rows_per_period=ROWS_PER_PERIOD))
            best = [identify(true, cell.drawn(noise, seed), "wls", asked["true"][1]) for seed in range(given.draws)]
            spread = np.std([one.beta for one in best], axis=0)
            oracle = dict(zip(best[0].base.names, spread.tolist(), strict=True))
            for way in given.ways:
                begin = time.process_time()
                found = [
                    identify(asked[way][0], cell.drawn(noise, seed), given.estimator, asked[way][1])
                    for seed in range(given.draws)
                ]
                told = {"robot": given.robot, "noise": noise, "way": way, "estimator": given.estimator}
                told |= figures(found, cell, late, oracle)
                told["friction"] = " ".join(type(part).__name__ for part in found[0].model.friction)
                cutoffs = [one.preprocessing.filter.bandwidth() or 0.0 for one in found]
                told["cutoff_hz"] = round(float(np.median(cutoffs)), 2)
                told["seconds"] = round((time.process_time() - begin) / given.draws, 2)
                print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
