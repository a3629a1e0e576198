"""The plan: a designed motion with the limits it keeps, as a versioned file and as samples for a controller."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array, finite
from dynident.data.preprocessing import default_preprocessing
from dynident.errors import BadOption, DynidentError, FileError
from dynident.excitation.design.bounds import BoundLabel
from dynident.excitation.design.limits import JOINTLESS, UNITS, LimitRow, MotionLimits, check_limits
from dynident.excitation.design.parametrisation import designable, kind_of
from dynident.excitation.design.rest_to_rest import RestToRest
from dynident.excitation.trajectories.base import Designable
from dynident.file_versions import Document, FileVersions, renamed
from dynident.files import DAMAGE, read_json, write_atomically
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion

KIND = "dynident plan"

#: Rows that one table of samples has at most.
MAX_ROWS = 10_000_000

_BOUNDS = ("lower", "upper", "velocity", "acceleration", "jerk", "torque", "torque_rate")


@dataclass(frozen=True)
class Plan:
    """A motion to record.

    Attributes:
        robot: Name of the robot.
        trajectory: One period of the motion.
        run_in: Length of the run-in from rest and of the run-out, in s; 0 where the motion starts at rest.
        criterion: What it was designed for.
        values: The figure of every criterion, on the grid of the check.
        limits: The bounds it keeps, margins taken off.
        rows: The dense check: the worst of every quantity of every joint, and of every clearance, over the run-in, one
            period and the run-out.
        samples: Number of samples of that check.
        settings: Plain facts of the design: noise, grid, seed, starts, effort.
    """

    robot: str
    trajectory: Designable
    run_in: float
    criterion: str
    values: Mapping[str, float]
    limits: MotionLimits
    rows: tuple[LimitRow, ...]
    samples: int
    settings: Mapping[str, Any]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.limits.joints

    @property
    def feasible(self) -> bool:
        """Whether every bound is kept."""
        return all(row.kept for row in self.rows)

    def motion(self, repeats: int = 1) -> RestToRest:
        """Return the motion as it is driven, from rest to rest, with whole periods between.

        Raises:
            BadOption: Fewer than one period.
        """
        return RestToRest(self.trajectory, self.run_in, repeats)


def worst_breach(plan: Plan) -> LimitRow | None:
    """Return the bound that a plan passes by most, None where it keeps all; what needs no model is computed again."""
    broken = [row for row in (*plan.rows, *check_limits(plan.motion(), plan.limits, plan.samples)) if not row.kept]
    return max(broken, key=lambda row: row.used) if broken else None


def slow_joints(plan: Plan, model: DynamicModel) -> list[str]:
    """Return in words which joints a fit would take for at rest half of the time, why, and what to do about each.

    Args:
        plan: The motion.
        model: That it was designed for.
    """
    core, limits, theta = plan.trajectory, plan.limits, model.nominal()
    q, dq, ddq = core.evaluate(np.linspace(0.0, core.period, plan.samples))
    speed, found = np.median(np.abs(dq), axis=0), list[str]()
    slowest = default_preprocessing().standstill * np.array([joint.speed_scale for joint in model.robot.active])
    for k in np.flatnonzero(speed <= slowest):
        joint, least = plan.joints[k], slowest[k]
        turns = limits.revolute[k]
        faster = dq.copy()
        faster[:, k] = np.where(dq[:, k] < 0, -2.0, 2.0) * least
        needed = 0.0 if theta is None else float(np.abs(model.torque(Motion(q, faster, ddq), theta)[:, k]).max())
        why = "design again with more --starts or another --seed, or"
        if needed > limits.torque[k]:
            units = "N m" if turns else "N"
            why = f"to move at {2.0 * least:.2g} takes {needed:.3g} {units} by the robot model's masses and friction"
            why += f", and {limits.torque[k]:.3g} are allowed:"
        elif not (limits.velocity[k] > 2.0 * least and 4.0 * limits.reach[k] > 2.0 * least * core.period):
            why = "its speed limit and its range allow no more:"
        told = f"{joint} moves at {np.abs(dq[:, k]).max():.2g} {'rad/s' if turns else 'm/s'} at most"
        lock = f"lock it, with locked: {{{joint}: {np.mean(q[:, k]):.4g}}} in the case"
        found.append(f"{told}, and a fit leaves out what is slower than {least:.2g}; {why} {lock}")
    return found


def breach_of(worst: LimitRow, verb: str = "is") -> str:
    """Return a bound that is passed in words."""
    what = BoundLabel(worst.joint, worst.quantity).text
    return f"the {what} {verb} {worst.value:.5g} {worst.unit} at {worst.time:.4g} s, its bound is {worst.limit:.5g}"


def refuse_breach(plan: Plan, path: str | Path) -> None:
    """Refuse a plan that passes a bound; what needs no model is computed again.

    Raises:
        FileError: A bound is passed.
    """
    worst = worst_breach(plan)
    if worst is not None:
        evidence = f"not written, because {breach_of(worst, 'would be')}"
        raise FileError(path, evidence, "design the motion again with these limits")


def write_plan(plan: Plan, path: str | Path) -> None:
    """Write a plan as JSON; the old file or the new one is there, never half of one.

    Raises:
        FileError: The plan passes a bound, or the file cannot be written.
    """
    refuse_breach(plan, path)
    write_atomically(path, json.dumps(plan_data(plan), indent=1, allow_nan=False) + "\n")


def plan_data(plan: Plan) -> dict[str, Any]:
    """Return a plan as plain data: the content of its file, and what ``--json`` prints."""
    limits = {name: [finite(v) for v in getattr(plan.limits, name)] for name in _BOUNDS}
    return {
        "kind": KIND,
        "format": VERSIONS.current,
        "robot": plan.robot,
        "joints": [
            {"name": name, "kind": "revolute" if turns else "prismatic"}
            for name, turns in zip(plan.joints, plan.limits.revolute, strict=True)
        ],
        "trajectory": {"kind": kind_of(plan.trajectory), **plan.trajectory.data(), "run_in": plan.run_in},
        "criterion": plan.criterion,
        "values": {name: finite(value) for name, value in plan.values.items()},
        "limits": limits,
        "check": {"samples": plan.samples, "rows": [{**asdict(row), "limit": finite(row.limit)} for row in plan.rows]},
        "settings": dict(plan.settings),
    }


def read_plan(path: str | Path) -> Plan:
    """Read a plan file.

    Raises:
        FileError: The file cannot be read, is no plan, is damaged or of another format.
    """
    step = "give a file that 'dynident excite -o' has written"
    data = read_json(path, step, FileError)
    if not isinstance(data, dict) or data.get("kind") != KIND:
        raise FileError(path, "no plan", step)
    try:
        return _plan(VERSIONS.migrated(data, lambda evidence, step: FileError(path, evidence, step)))
    except FileError:
        raise
    except DAMAGE as error:
        raise FileError(path, f"a damaged plan ({type(error).__name__}: {error})", "design it again") from error
    except DynidentError as error:
        raise FileError(path, f"a damaged plan ({error})", "design it again") from error


def _with_torque_rate(data: Document) -> Document:
    """Version 1 had no bound on the rate of the torque."""
    limits = data["limits"]
    return {**data, "limits": {**limits, "torque_rate": [None] * len(limits["torque"])}}


def _to_3(data: Document) -> Document:
    return renamed(data, {"settings.outlook.rows": "effective_sample_size"})


#: Plan files.
VERSIONS = FileVersions("a plan", (_with_torque_rate, _to_3))


def _plan(data: Mapping[str, Any]) -> Plan:
    motion, bounds, check = data["trajectory"], data["limits"], data["check"]
    if any(joint["kind"] not in ("revolute", "prismatic") for joint in data["joints"]):
        raise ValueError("a joint that neither turns nor slides")
    free = {"lower": -np.inf}
    limits = MotionLimits(
        tuple(str(joint["name"]) for joint in data["joints"]),
        tuple(joint["kind"] == "revolute" for joint in data["joints"]),
        **{name: np.array([free.get(name, np.inf) if v is None else v for v in bounds[name]]) for name in _BOUNDS},
    )
    rows = tuple(
        LimitRow(**{**row, "limit": np.inf if row["limit"] is None else float(row["limit"])}) for row in check["rows"]
    )
    if any(
        row.quantity not in UNITS or (row.joint not in limits.joints) != (row.quantity in JOINTLESS) for row in rows
    ):
        raise ValueError("a row of the check that belongs to no joint")
    trajectory = designable(motion["kind"]).from_data(motion)
    if trajectory.joints != len(limits.joints):
        raise ValueError(f"{trajectory.joints} motions for {len(limits.joints)} joints")
    plan = Plan(
        robot=str(data["robot"]),
        trajectory=trajectory,
        run_in=float(motion["run_in"]),
        criterion=str(data["criterion"]),
        values={name: float("nan") if value is None else float(value) for name, value in data["values"].items()},
        limits=limits,
        rows=rows,
        samples=int(check["samples"]),
        settings=dict(data["settings"]),
    )
    plan.motion()  # checks the run-in
    return plan


def sampled(plan: Plan, rate: float, repeats: int = 1) -> tuple[Array, Array, Array, Array]:
    """Return t (N,) in s from 0 and q, dq, ddq (N, n) of the motion from rest to rest; the last row is at rest.

    Args:
        plan: The plan.
        rate: Samples a second.
        repeats: Number of periods.

    Raises:
        BadOption: A rate that is not positive or gives too many rows, or fewer than one period.
    """
    motion = plan.motion(repeats)
    if not (0 < rate < np.inf and motion.duration * rate < MAX_ROWS):
        raise BadOption("rate", rate, f"give samples a second, above 0, for less than {MAX_ROWS:,} rows")
    time = np.arange(int(np.ceil(motion.duration * rate - 1e-9)) + 1) / rate
    return time, *motion.evaluate(time)


def write_samples(plan: Plan, path: str | Path, rate: float, repeats: int = 1) -> int:
    """Write t, q1.., dq1.., ddq1.. as CSV for a controller, in SI units, and return the number of rows.

    Args:
        plan: The plan.
        path: Where to write.
        rate: Samples a second.
        repeats: Number of periods.

    Raises:
        BadOption: A rate or a number of periods that cannot be.
        FileError: The plan passes a bound, or the file cannot be written.
    """
    refuse_breach(plan, path)
    time, *signals = sampled(plan, rate, repeats)
    write_atomically(path, samples_text(time, signals))
    return len(time)


def samples_text(time: Array, signals: Sequence[Array]) -> str:
    """Return a table t, q1.., dq1.., ddq1.. as CSV text with twelve digits.

    Args:
        time: Times (N,) in s.
        signals: q, dq and ddq, each (N, n).
    """
    numbers = range(1, signals[0].shape[1] + 1)
    header = ",".join(["t", *(f"{name}{i}" for name in ("q", "dq", "ddq") for i in numbers)])
    text = io.StringIO()
    np.savetxt(text, np.column_stack([time, *signals]), fmt="%.12g", delimiter=",", header=header, comments="")
    return text.getvalue()
