"""A trial: a case and the columns of a log, clean logs of robots that ship, and recorded ones."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from dynident.case.case import Case, read_case
from dynident.diagnosis.checks.base import CheckedLog
from dynident.diagnosis.examination import Examination, examine
from dynident.diagnosis.recording import read_recording
from dynident.diagnosis.repair import repair
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion

RATE, DURATION = 200.0, 20.0

VIRTUAL = ("er16", "generic-6r", "generic-7r")
REAL = {"panda": "panda_gaz2019/exciting_traj_1.csv", "tx40": "staubli_tx40_figaroh/trajectory.csv"}

#: Share of a recorded log that is learned from; the rest is held out.
LEARNED = 0.6667

#: Seconds between two lines of progress.
EVERY_S = 10.0

Columns = dict[str, np.ndarray]

Item = TypeVar("Item")


def tracked(items: Sequence[Item], what: str) -> Iterator[Item]:
    """Yield items, with a line on standard error now and then: how many are done, and what time the rest will take."""
    begin = said = time.perf_counter()
    for done, item in enumerate(items):
        now = time.perf_counter()
        if done and now - said > EVERY_S:
            rest = (now - begin) / done * (len(items) - done)
            print(f"{done} of {len(items)} {what}, {rest:.0f} s left", file=sys.stderr, flush=True)
            said = now
        yield item


@dataclass(frozen=True)
class Trial:
    """A case and the columns t (N,), q, dq, tau (N, n) of a log of it, in the units that the case states."""

    case: Case
    columns: Columns

    def with_columns(self, **new: np.ndarray) -> Trial:
        return replace(self, columns={**self.columns, **new})

    def without(self, name: str) -> Trial:
        return replace(self, columns={key: values for key, values in self.columns.items() if key != name})

    def rows(self, index: np.ndarray) -> Trial:
        return replace(self, columns={name: values[index] for name, values in self.columns.items()})

    @property
    def joints(self) -> int:
        return self.columns["q"].shape[1]

    def written(self, folder: Path, name: str = "run") -> Path:
        """Write the columns as an archive, which takes a tenth of the time of text; return its path."""
        path = folder / f"{name}.npz"
        np.savez(path, **self.columns)  # type: ignore[arg-type]
        return path

    def examined(self, folder: Path, earlier: Estimate | None = None) -> Examination:
        return examine(self.case, str(self.written(folder)), earlier)

    def estimate(self, folder: Path) -> Estimate:
        """Return what is identified from the log by weighted least squares, as the case prepares it."""
        return identify(self.case.model, [self.case.read(self.written(folder))], "wls", self.case.preprocessing)


def subject_of(trial: Trial, folder: Path) -> CheckedLog:
    """Return what the checks look at."""
    recording = read_recording(trial.case, str(trial.written(folder)))
    return CheckedLog(trial.case, recording, repair(recording, trial.case.robot).recording)


def smooth_motion(
    case: Case, seed: int = 0, rate: float | None = None, shift: float = 0.0
) -> tuple[np.ndarray, Motion]:
    """Return times and a motion of five harmonics a joint within its limits, at times that are ``shift`` s earlier."""
    generator = np.random.default_rng(seed)
    t = np.arange(int((rate or RATE) * DURATION)) / (rate or RATE)
    limits = [joint.limits for joint in case.robot.active]
    reach = np.array([min(one.upper - one.lower, 4.0) if np.isfinite(one.upper - one.lower) else 4.0 for one in limits])
    middle = np.array([(one.upper + one.lower) / 2 if np.isfinite(one.upper + one.lower) else 0.0 for one in limits])
    pulsation = 2 * np.pi * 0.1 * np.arange(1, 6)
    height = generator.normal(size=(len(limits), 5)) / np.arange(1, 6)
    begin = generator.uniform(-np.pi, np.pi, (len(limits), 5))
    scale = 0.35 * reach / np.abs(np.sum(height * np.sin(t[:, None, None] * pulsation + begin), axis=-1)).max(axis=0)
    phase = (t - shift)[:, None, None] * pulsation + begin
    q = np.sum(height * np.sin(phase), axis=-1) * scale + middle
    dq = np.sum(height * pulsation * np.cos(phase), axis=-1) * scale
    ddq = -np.sum(height * pulsation**2 * np.sin(phase), axis=-1) * scale
    return t, Motion(q, dq, ddq)


def virtual(case: Case, seed: int = 0, rate: float | None = None, delay: float = 0.0) -> Trial:
    """Return a clean log of a virtual robot, torques with its friction, 2 % of noise and ``delay`` s behind."""
    t, motion = smooth_motion(case, seed, rate)
    model = DynamicModel(case.robot, case.friction)
    theta = model.nominal()
    assert theta is not None
    tau = model.torque(smooth_motion(case, seed, rate, delay)[1], theta)
    generator = np.random.default_rng([seed, 1])
    tau = tau + 0.02 * tau.std(axis=0) * generator.normal(size=tau.shape)
    q = motion.q + 2e-5 * generator.normal(size=tau.shape)
    return Trial(case, {"t": t, "q": q, "dq": motion.dq + 1e-3 * generator.normal(size=q.shape), "tau": tau})


def recorded(name: str) -> Trial:
    """Return the whole recorded log of a robot."""
    case = read_case(Path(__file__).parents[2] / "examples" / "cases" / f"{name}.yaml")
    table = np.genfromtxt(case.find(REAL[name]), delimiter=",", names=True)
    header = table.dtype.names or ()
    parts = {key: [column for column in header if column.rstrip("0123456789") == key] for key in ("q", "dq", "tau")}
    data = {key: np.stack([table[column] for column in names], axis=1) for key, names in parts.items() if names}
    return Trial(case, {"t": table["t"], **data})


def robots(wanted: list[str]) -> dict[str, tuple[Trial, Trial]]:
    """Return a log to put faults into and one to hold out, of each robot; recorded ones where the data is there."""
    found = {}
    for name in VIRTUAL:
        if not wanted or name in wanted:
            case = read_case(name)
            found[name] = (virtual(case), virtual(case, seed=1))
    for name in REAL:
        if name in wanted or (not wanted and os.environ.get("DYNIDENT_DATA")):
            whole = recorded(name)
            count = int(LEARNED * len(whole.columns["t"]))
            found[name] = (whole.rows(np.arange(count)), whole.rows(np.arange(count, len(whole.columns["t"]))))
    return found
