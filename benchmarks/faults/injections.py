"""How each fault is put into the columns of a log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.signal

from benchmarks.faults.trials import Trial
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.joint import rotation_about

DEG = 180.0 / np.pi
X, Y = np.eye(3)[:2]


def of_joint(trial: Trial, name: str, joint: int, change: Callable[[np.ndarray], np.ndarray]) -> Trial:
    values = trial.columns[name].copy()
    joint %= values.shape[1]
    values[:, joint] = change(values[:, joint])
    return trial.with_columns(**{name: values})


def heaviest(trial: Trial) -> int:
    """Return the joint with the largest torque: what happens to it matters."""
    return int(np.argmax(spreads(trial, "tau")))


def spreads(trial: Trial, name: str) -> np.ndarray:
    """Return the standard deviation of each joint's column, shape (n,)."""
    return trial.columns[name].std(axis=0)


def step_of(trial: Trial) -> float:
    """Return the median step of the time in s."""
    return float(np.median(np.diff(trial.columns["t"])))


def timed(trial: Trial, factor: float) -> Trial:
    return trial.with_columns(t=factor * trial.columns["t"])


def jitter(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    t = trial.columns["t"]
    step = np.median(np.diff(t))
    late = np.sort(t + s * step * g.uniform(0, 1, len(t)))
    return trial.with_columns(t=late + 1e-6 * step * np.arange(len(late)))


def duplicates(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    count = len(trial.columns["t"])
    again = g.choice(count, max(1, int(s * count)), replace=False)
    return trial.rows(np.sort(np.concatenate([np.arange(count), again])))


def disorder(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    order = np.arange(len(trial.columns["t"]))
    for k in g.choice(len(order) // 4 - 1, max(1, int(s * len(order))), replace=False):
        order[[4 * k, 4 * k + 1]] = order[[4 * k + 1, 4 * k]]
    return trial.rows(order)


def restart(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    t = trial.columns["t"]
    half = int(s * len(t))
    return trial.with_columns(t=np.concatenate([t[:half], t[half:] - t[half] + t[0]]))


def gap(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    t = trial.columns["t"]
    middle = t[len(t) // 2]
    return trial.rows(np.flatnonzero((t < middle) | (t > middle + s)))


def lost(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    tau = trial.columns["tau"].copy()
    tau[g.choice(len(tau), max(1, int(s * len(tau))), replace=False)] = np.nan
    return trial.with_columns(tau=tau)


def flips(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    tau = trial.columns["tau"].copy()
    tau[g.choice(len(tau), max(1, round(s * len(tau))), replace=False)] = 0.0
    return trial.with_columns(tau=tau)


def spikes(trial: Trial, s: float, g: np.random.Generator, count: int = 5) -> Trial:
    def change(v: np.ndarray) -> np.ndarray:
        v = v.copy()
        v[len(v) // 20 + g.choice(len(v) * 9 // 10, count, replace=False)] += s * np.ptp(v)
        return v

    return of_joint(trial, "tau", heaviest(trial), change)


def wrap(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    return of_joint(trial, "q", 0, lambda v: np.where(v > np.quantile(v, s), v - 2 * np.pi, v))


def delayed(trial: Trial, samples: float, name: str = "tau") -> Trial:
    t = trial.columns["t"]
    seconds = samples * step_of(trial)
    return trial.with_columns(**{name: np.stack([np.interp(t - seconds, t, v) for v in trial.columns[name].T], axis=1)})


def two_clocks(trial: Trial, ratio: float) -> Trial:
    """Let the clock of the torques run ``ratio`` times as fast as that of the positions."""
    t = trial.columns["t"]
    at = t[0] + (t - t[0]) / ratio
    return trial.with_columns(tau=np.stack([np.interp(at, t, v) for v in trial.columns["tau"].T], axis=1))


def clipped(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    return of_joint(trial, "tau", heaviest(trial), lambda v: np.minimum(v, np.quantile(v, 1 - s)))


def coarse(trial: Trial, s: float, name: str) -> Trial:
    """Round to steps of the share ``s`` of the range."""
    joint = heaviest(trial)
    return of_joint(trial, name, joint, lambda v: np.round(v / (np.ptp(v) * s)) * (np.ptp(v) * s))


def still(trial: Trial, joint: int, g: np.random.Generator) -> Trial:
    trial = of_joint(trial, "q", joint, lambda v: np.full_like(v, v[0]) + 1e-5 * g.normal(size=len(v)))
    return of_joint(trial, "dq", joint, np.zeros_like) if "dq" in trial.columns else trial


def pause(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    columns = trial.columns
    count = int(len(columns["t"]) * s / (1 - s))
    held = {
        name: np.repeat(v[-1:], count, axis=0) + 1e-9 * g.normal(size=(count, *v.shape[1:]))
        for name, v in columns.items()
    }
    held["t"] = columns["t"][-1] + np.median(np.diff(columns["t"])) * np.arange(1, count + 1)
    if "dq" in held:
        held["dq"] = 1e-6 * g.normal(size=held["dq"].shape)
    return replace(trial, columns={name: np.concatenate([v, held[name]]) for name, v in columns.items()})


def turned(trial: Trial, names: tuple[str, ...], joint: int) -> Trial:
    for name in names:
        if name in trial.columns:
            trial = of_joint(trial, name, joint, np.negative)
    return trial


def swapped(trial: Trial, names: tuple[str, ...], i: int) -> Trial:
    order = np.arange(trial.joints)
    order[[i, i + 1]] = order[[i + 1, i]]
    return trial.with_columns(**{name: trial.columns[name][:, order] for name in names if name in trial.columns})


def scaled(trial: Trial, s: float, joint: int | None = None) -> Trial:
    """Multiply the torques, or the torque of one joint, by 1 + s."""
    if joint is None:
        return trial.with_columns(tau=(1 + s) * trial.columns["tau"])
    return of_joint(trial, "tau", joint, lambda v: (1 + s) * v)


def sprung(trial: Trial, s: float, joint: int) -> Trial:
    """Add a spring whose torque has the share ``s`` of the standard deviation of the joint's torque."""
    q = trial.columns["q"][:, joint]
    return of_joint(trial, "tau", joint, lambda v: v + s * v.std() / q.std() * (q - q.mean()))


def balanced(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    """Add a counterbalance K sin q to the joint with the largest torque, K a share of its standard deviation."""
    joint = heaviest(trial)
    q = trial.columns["q"][:, joint]
    return of_joint(trial, "tau", joint, lambda v: v + s * v.std() * np.sin(q))


def drifting(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    t = trial.columns["t"]
    clock = (t - t[0]) / np.ptp(t) - 0.5
    return of_joint(trial, "tau", heaviest(trial), lambda v: v + s * v.std() * clock)


def warming(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    """Let friction of all joints fall off as they warm up: by a share of their torque at the start, none at the end.

    The torque falls as exp(-3 t / T) with the sign of the velocity (Simoni et al. 2015 have such a first-order law).
    """
    motion, t = smoothed(trial), trial.columns["t"]
    fall = np.exp(-3 * (t - t[0]) / np.ptp(t))[:, None]
    tau = trial.columns["tau"]
    return trial.with_columns(tau=tau + s * tau.std(axis=0) * fall * np.tanh(motion.dq / 0.02))


def loaded(trial: Trial, kilograms: float, g: np.random.Generator) -> Trial:
    """Attach a payload: a sphere at 0.1 m from the flange along the axis of the last joint, described nowhere."""
    robot = trial.case.robot
    model = DynamicModel(robot)
    arm = 0.1 * np.asarray(robot.active[-1].axis)
    turn = kilograms * (np.dot(arm, arm) * np.eye(3) - np.outer(arm, arm)) + 0.4 * kilograms * 0.05**2 * np.eye(3)
    body = np.zeros(model.inertial_count)
    body[-10:] = [*turn[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]], *(kilograms * arm), kilograms]
    motion = smoothed(trial)
    own = model.torque(motion, body) - model.torque(motion, 0 * body)  # rotors count once
    return trial.with_columns(tau=trial.columns["tau"] + own)


def smoothed(trial: Trial, cutoff: float = 10.0) -> Motion:
    """Return the motion of a log, low-passed; time steps are taken as equal."""
    t, q = trial.columns["t"], trial.columns["q"]
    step = np.ptp(t) / (len(t) - 1)
    sections = scipy.signal.butter(3, cutoff, fs=1 / step, output="sos")
    q = scipy.signal.sosfiltfilt(sections, q, axis=0)
    dq = np.gradient(q, step, axis=0)
    return Motion(q, dq, np.gradient(dq, step, axis=0))


def tilted(trial: Trial, degrees: float, g: np.random.Generator) -> Trial:
    """Declare the base level where it leans: gravity as it is described, turned about a horizontal axis."""
    gravity = np.asarray(trial.case.robot.gravity)
    size = float(np.linalg.norm(gravity))
    aside = np.cross(gravity / size, [0.6, 0.8, 0.1])
    aside /= np.linalg.norm(aside)
    wrong = size * (np.cos(degrees / DEG) * gravity / size + np.sin(degrees / DEG) * aside)
    return replace(trial, case=replace(trial.case, robot=trial.case.robot.with_gravity(wrong)))


def mounted(trial: Trial, kind: int) -> Trial:
    """Declare another mounting: wall, ceiling, other wall."""
    field = ((9.81, 0.0, 0.0), (0.0, 0.0, 9.81), (0.0, 9.81, 0.0))[kind]
    return replace(trial, case=replace(trial.case, robot=trial.case.robot.with_gravity(field)))


def other_arm(trial: Trial, kind: int) -> Trial:
    """Declare another arm: the axes of the second joint, of the third, or of every second one turned to others."""
    robot = trial.case.robot
    joints = list(robot.joints)
    turn = rotation_about(X, np.pi / 2) @ rotation_about(Y, np.pi / 2)
    for k in ([1], [2], range(1, len(joints), 2))[kind]:
        joints[k] = replace(joints[k], rotation=joints[k].rotation @ turn)
    return replace(trial, case=replace(trial.case, robot=replace(robot, joints=tuple(joints))))


def declared(trial: Trial, **units: str | tuple[str, ...]) -> Trial:
    columns = trial.case.columns
    return replace(trial, case=replace(trial.case, columns=replace(columns, units=replace(columns.units, **units))))


def poor(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    """One slow sine, the same at all joints: they move, and say nothing."""
    c = trial.columns
    sine = s * np.sin(2 * np.pi * 0.05 * c["t"])[:, None] * np.ones(trial.joints)
    moved = trial.with_columns(q=c["q"].mean(axis=0) + sine, tau=c["tau"].mean(axis=0) + sine * c["tau"].std(axis=0))
    return moved.without("dq")


def slowed(trial: Trial, s: float, g: np.random.Generator) -> Trial:
    """Run at a share of the commanded speed, which is logged."""
    clock = trial.columns["t"] - trial.columns["t"][0]
    late = np.stack([np.interp(s * clock, clock, v) for v in trial.columns["q"].T], axis=1)
    trial = trial.with_columns(q=late, q_ref=trial.columns["q"]).without("dq")
    names = tuple(f"q_ref{k + 1}" for k in range(trial.joints))
    return replace(trial, case=replace(trial.case, columns=replace(trial.case.columns, q_ref=names)))
