"""What static friction can hold: at rest a drive's torque is anything in an interval, and a model states that.

A drive that rests has no friction of its own motion: dry friction takes whatever the load asks for, up to its level at
breakaway in either direction. So the torque of a joint at rest is known to lie between two values, the torque of the
bodies and of offsets less and plus what its resting drives can hold. Signs are sharp there, however wide they are in
the model; parts with a state are at their bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.applications.compensation import parameters_of
from dynident.arrays import Array, BoolArray
from dynident.data.preprocessing import Prepared, at_rest
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Validation
from dynident.identification.problem.problem import rest_speeds
from dynident.identification.problem.regressor_stream import remembered_motion
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, Motion

#: Speed at which dry friction holds, and the width of its sign there, in rad/s or m/s.
CREEP, SHARP = 1e-6, 1e-9


@dataclass(frozen=True)
class HeldTorque:
    """Torque where static friction holds.

    Attributes:
        torque: Torque of the model; where drives rest, the middle of what it can be, shape (N, n), in N m or N.
        half: Half the width of the interval about it, shape (N, n); 0 where no drive of the joint rests.
        rests: Where a drive of the joint rests, shape (N, n).
    """

    torque: Array
    half: Array
    rests: BoolArray


def held_torque(model: DynamicModel, theta: Array, motion: Motion, rests: BoolArray) -> HeldTorque:
    """Return the torques between which static friction holds each joint.

    Args:
        model: Robot, drives and friction.
        theta: Standard parameters, shape (p,).
        motion: The motion, with the states of friction where it has some.
        rests: Where each drive rests, shape (N, n).
    """
    coupling, table = np.asarray(model.robot.coupling), model.coefficient_table(theta)
    motion = model.loaded(motion, theta)
    own, forth, back = (
        np.einsum("sjk,jk->sj", each.friction_values(at), table)
        for each, at in ((model, motion), *(_creeping(model, motion, sign) for sign in (1.0, -1.0)))
    )
    drives = np.where(rests, 0.5 * (forth + back), own)
    half = np.where(rests, 0.5 * np.abs(forth - back), 0.0) @ np.abs(coupling)
    torque = model.torque(motion, theta) + (drives - own) @ coupling
    return HeldTorque(torque, half, (rests @ (coupling != 0)) > 0)


def _creeping(model: DynamicModel, motion: Motion, sign: float) -> tuple[DynamicModel, Motion]:
    """Return the model with sharp signs, and the motion with all drives creeping one way."""
    sharp = replace(model, friction=tuple(_sharp(part) for part in model.friction))
    creep = np.linalg.solve(np.asarray(model.robot.coupling), np.full(model.robot.dof, sign * CREEP))
    each = [(part, state) for part in model.friction for state in part.states]
    state = np.zeros((*motion.q.shape, len(each))) if motion.state is None else np.array(motion.state)
    for k, (part, own) in enumerate(each):
        if part.lags:
            state[..., k] = own.high if sign > 0 else own.low
    return sharp, replace(motion, dq=np.broadcast_to(creep, motion.q.shape), state=state if each else None)


def _sharp(part: Friction) -> Friction:
    return replace(part, width=SHARP) if "width" in part.options else part  # type: ignore[call-arg]


def held_along(estimate: Estimate, prepared: Prepared) -> HeldTorque:
    """Return the torques along the kept rows of a log, filtered as the measured ones are."""
    model, log = estimate.model, prepared.log
    motion = remembered_motion(model, log)
    speeds = motion.at_motors(np.asarray(model.robot.coupling)).dq
    rests = at_rest(speeds, rest_speeds(model.robot, prepared.how.standstill), log.rate)
    found = held_torque(model, parameters_of(estimate), motion, rests)
    torque, half = (prepared.smooth(one.T).T[prepared.keep] for one in (found.torque, found.half))
    return HeldTorque(torque, np.maximum(half, 0.0), found.rests[prepared.keep])


def with_rest(estimate: Estimate, found: Validation, logs: Sequence[Prepared]) -> Validation:
    """Return a validation with what it makes of the samples at rest: how many lie in what static friction can hold.

    The interval is wider by the 95 % band of the measured torque where that is known.

    Args:
        estimate: The estimate.
        found: Its validation on the logs.
        logs: The logs as they were prepared for it.
    """
    parts = [held_along(estimate, log) for log in logs]
    torque, half, rests = (
        np.concatenate([getattr(one, name) for one in parts]) for name in ("torque", "half", "rests")
    )
    widths = found.half_widths()
    error, bound = found.measured - torque, half + (0.0 if widths is None else widths[1])
    table: list[dict[str, Any]] = []
    for i, fit in enumerate(found.joints):
        own = rests[:, i]
        if own.any():
            beyond = np.maximum(np.abs(error[own, i]) - half[own, i], 0.0)
            facts = {"name": fit.name, "unit": fit.unit, "samples": int(own.sum())}
            facts |= {"half_width": float(np.sqrt(np.mean(half[own, i] ** 2)))}
            facts |= {"inside": float(np.mean(np.abs(error[own, i]) <= bound[own, i]))}
            table.append(facts | {"rms_beyond": float(np.sqrt(np.mean(beyond**2)))})
    return replace(found, at_rest=tuple(table))
