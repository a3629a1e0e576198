"""Plans made of values alone for arms of any size, and the motion that an export has to show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.excitation.design.limits import MotionLimits, check_limits
from dynident.excitation.design.plan import Plan
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.excitation.trajectories.rest_fourier import RestFourier


def plan_of(
    joints: int = 6,
    *,
    sliding: Sequence[int] = (),
    names: Sequence[str] | None = None,
    run_in: float = 0.0,
    jerk: float = 200.0,
    scale: float = 0.12,
) -> Plan:
    """Return a plan of 6 s within round bounds; with a run-in its trajectory is a plain Fourier series."""
    generator = np.random.default_rng(joints)
    if run_in:
        table = scale * generator.normal(size=(2, joints, 3))
        trajectory = FourierSeries(0.1 * np.arange(joints), table[0], table[1], 6.0)
    else:
        trajectory = RestFourier.from_free(scale * generator.normal(size=(joints, 5)), 6.0)
    ones = np.ones(joints)
    limits = MotionLimits(
        joints=tuple(names or (f"joint{i + 1}" for i in range(joints))),
        revolute=tuple(i not in sliding for i in range(joints)),
        lower=-2 * ones,
        upper=2 * ones,
        velocity=3 * ones,
        acceleration=20 * ones,
        jerk=jerk * ones,
        torque=np.inf * ones,
    )
    draft = Plan("arm", trajectory, run_in, "condition", {"condition": 1.0}, limits, (), 2001, {})
    return replace(draft, rows=check_limits(draft.motion(), limits, draft.samples))


def designed(plan: Plan, time: Array, speed: float = 1.0, repeats: int = 1) -> Array:
    """Return q, dq, ddq (3, N, n) of a plan at a share of its speed, from finite differences of its positions alone."""
    motion = plan.motion(repeats)

    def q(t: Array) -> Array:
        return motion.evaluate(np.clip(t * speed, 0.0, motion.duration))[0]

    step = 1e-4
    before, now, after = q(time - step), q(time), q(time + step)
    return np.stack([now, (after - before) / (2 * step), (after - 2 * now + before) / step**2])
