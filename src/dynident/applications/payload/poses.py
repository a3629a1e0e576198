"""Postures at which the arm stood still in a log, one row each: gravity alone tells mass and centre of a payload."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.log import Log, measured_torque
from dynident.data.preprocessing import Prepared, Preprocessing, at_rest
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import LogMismatch
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.friction import Motion

#: Speed in rad/s or m/s below which a joint stands, where the preparation states none.
STANDING = 0.01

#: Shortest stand in s, and what is left out at its start, where the arm still settles.
SHORTEST, SETTLING = 0.5, 0.2

#: Postures that differ by less than this in all joints are one, in rad or m.
SAME = 0.02

#: Share of a log at rest from which it is taken for one of postures, and postures at least.
MOSTLY, FEWEST = 0.5, 3

#: Speed in rad/s or m/s at which sliding friction bounds what holds a joint that stands.
CREEP = 0.05


def standing(prepared: Prepared) -> BoolArray:
    """Return at which samples all joints stand still, shape (N,)."""
    log = prepared.log
    speed = max(prepared.how.standstill, STANDING)
    return np.all(at_rest(np.asarray(motion_of(log).dq), speed, log.rate, SHORTEST), axis=1)


def postures(prepared: Prepared) -> list[slice]:
    """Return the samples of each stand, its start left out where the arm settles."""
    still = np.diff(np.concatenate([[False], standing(prepared), [False]]).astype(np.int8))
    early = round(SETTLING * prepared.log.rate)
    ends = zip(np.flatnonzero(still == 1) + early, np.flatnonzero(still == -1), strict=True)
    return [slice(int(start), int(stop)) for start, stop in ends if stop - start >= 2]


def mostly_standing(logs: Sequence[Prepared]) -> bool:
    """Return whether logs are of postures rather than of a motion."""
    share = np.mean(np.concatenate([standing(log) for log in logs]))
    return bool(share >= MOSTLY and sum(len(postures(log)) for log in logs) >= FEWEST)


def posture_log(prepared: Prepared) -> Prepared:
    """Return a log with one row for each posture: mean position and torque, no speed; postures held twice are one.

    Raises:
        LogMismatch: Fewer than three different postures.
    """
    log = prepared.log
    torques, held = measured_torque(log), postures(prepared)
    q = np.array([log.q[part].mean(axis=0) for part in held]).reshape(-1, len(log.joints))
    torque = np.array([torques[part].mean(axis=0) for part in held]).reshape(q.shape)
    groups: list[list[int]] = []
    for k, posture in enumerate(q):
        same = next((group for group in groups if np.max(np.abs(q[group[0]] - posture)) < SAME), None)
        groups.append([k]) if same is None else same.append(k)
    if len(groups) < FEWEST:
        evidence = f"the arm stands still at {len(groups)} posture{'' if len(groups) == 1 else 's'}"
        step = f"hold {FEWEST} and more, {SHORTEST + SETTLING:g} s and longer, with the wrist turned"
        raise LogMismatch(log.name, evidence, step)
    q, torque = (np.array([values[group].mean(axis=0) for group in groups]) for values in (q, torque))
    none = np.zeros_like(q)
    found = Log(log.joints, np.arange(float(len(q))), q, none, none, torque, source=log.source)
    if log.temperature is not None:
        warm = np.asarray(log.temperature)
        means = np.array([np.mean([warm[held[k]].mean(axis=0) for k in group], axis=0) for group in groups])
        found = replace(found, temperature=means)
    return Prepared(found, np.arange(len(q)), Preprocessing(AsGiven(), rest="keep"))


def holding_friction(estimate: Estimate, log: Log) -> Array:
    """Return the torque that friction can hold at each joint at most, shape (n,): half the step between slow motions.

    Args:
        estimate: The robot.
        log: Postures; friction that grows with the load takes its mean over them.
    """
    theta = estimate.base.to_standard(estimate.beta)
    model, none = estimate.model, np.zeros_like(log.q)
    still = Motion(log.q, none, none, temperature=log.temperature)
    load = model.loaded(still, theta).torque
    table = model.coefficient_table(theta)
    sides = []
    for sign in (1.0, -1.0):
        motion = Motion(log.q, np.full_like(log.q, sign * CREEP), none, torque=load, temperature=log.temperature)
        sides.append(np.einsum("sjk,jk->sj", model.friction_values(motion), table))
    half = 0.5 * np.abs(sides[0] - sides[1]).mean(axis=0)
    return half @ np.abs(np.asarray(model.robot.coupling))
