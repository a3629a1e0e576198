"""All joints of an arm together: fits of each joint under the loads of the motion that all these fits give."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from dynident.actuators.arm_coupling import Arm
from dynident.actuators.arm_motion import ALL_SWEEPS, SWEEPS, relaxed
from dynident.actuators.joint_fit import JointFit, fit_again
from dynident.actuators.joint_load import FINE_LOAD_STEP, divided, joint_loads, motion_at
from dynident.actuators.parameters import PLACE
from dynident.actuators.verdict import DRAWS, Spread, spread_of
from dynident.arrays import Array

#: Times that the loads of an arm are found anew from the roll-outs of all joints, at least and at most; between them
#: until no parameter that the logs see moves by more than this share of its standard deviation.
LEAST_TURNS, MOST_TURNS, SETTLED = 2, 10, 0.2

#: At most, before richer friction is sought, and in some of the logs or in all logs after some.
FIRST_TURNS, FEW_TURNS = 4, 6

#: Share of a step that is gone near the answer: derivatives by the zeros alone take the slowest mode of the arm for
#: slower than it is.
_NEAR = 0.5

#: Turns in a row with a larger error than the best one after which the best one stands.
_WORSE = 3

#: Evaluations of the output error of each joint in a turn, and with the step of the answer.
_EVALUATIONS, _FINISH = 15, 5


def settled(arm: Arm, progress: Callable[[str], None], least: int = LEAST_TURNS, most: int = MOST_TURNS) -> Arm:
    """Return an arm under loads that agree with the fits of all joints; a single joint has no others.

    Args:
        arm: With fits of each joint under its loads.
        progress: Called with each step in words.
        least: Turns at least; 0 near the answer.
        most: Turns at most.
    """
    best, error, worse = arm, np.inf, 0
    for turn in range(most if len(arm.fits) > 1 else 0):
        spreads = arm.spreads()
        arm = arm.coupled(spreads, is_whole=False)
        step = arm.step()
        if turn >= least and _is_settled(arm.reached(spreads, arm.reach, step), step):
            break
        progress(f"motion of the whole arm, turn {turn + 1}")
        arm = turned(arm, arm.after(step)).since(arm)
        now = arm.error()
        worse = 0 if now < error else worse + 1
        best, error = (arm, now) if now < error else (best, error)
        if worse == _WORSE:
            break
    return best if worse else arm


def turned(arm: Arm, fits: Sequence[JointFit], finely: bool = False) -> Arm:
    """Return an arm with the motion, the loads and the fits that follow from fits.

    Args:
        arm: Before.
        fits: Of each joint.
        finely: Whether the new fits are by the step of the answer.
    """
    used, motions, sweeps = [fit.parameters for fit in fits], [], ALL_SWEEPS if finely else SWEEPS
    zeros, before = (np.array([own[PLACE["angle_offset"]] for own in each]) for each in (used, arm.used))
    for k, (robot, motion) in enumerate(zip(arm.robots, arm.motions, strict=True)):
        shifted = replace(motion, q=motion.q + zeros - before)
        records = [data.records[k].as_first_read for data in arm.datas]
        joints = list(zip(records, used, zeros.tolist(), strict=True))
        motions.append(relaxed(robot, joints, arm.measured[k], shifted, arm.ends[k], sweeps))
    loads = [joint_loads(robot, motion) for robot, motion in zip(arm.robots, motions, strict=True)]
    datas = [data.under([load[joint] for load in loads]) for joint, data in enumerate(arm.datas)]
    datas = [data.started(own) for data, own in zip(datas, used, strict=True)]
    most = _FINISH if finely else _EVALUATIONS
    fits = [fit_again(data, fit, most, finely) for data, fit in zip(datas, fits, strict=True)]
    return replace(arm, motions=motions, datas=datas, fits=fits, used=used)


def finished(arm: Arm, progress: Callable[[str], None]) -> tuple[Arm, list[Spread]]:
    """Return an arm that is settled with fits by the step of the answer, and how their errors spread them."""
    if len(arm.fits) == 1:
        arm = replace(arm, datas=[arm.datas[0].started(arm.fits[0].parameters)])
        spread = spread_of(arm.fits[0].problem(arm.datas[0]).finely, arm.fits[0].parameters, DRAWS)
        return arm, arm.with_shared([spread], spread.covariance)
    progress("all joints with the step of the answer")
    spreads = arm.spreads()
    reach = arm.coupled(spreads, is_whole=True).reach
    arm = arm.coupled(spreads, is_whole=False)
    errors = {share: turned(arm, arm.after(arm.step(share))).error() for share in (0.0, _NEAR)}
    share = min(errors, key=errors.__getitem__)  # where zeros trade almost evenly a step is noise, many times larger
    arm = finer(replace(arm, fits=arm.after(arm.step(share))))
    step = arm.step()
    whole = arm.reached(spreads, reach, step)
    fine = arm.fine_spreads([one.covariance - own.covariance for one, own in zip(whole, spreads, strict=True)])
    return replace(arm, fits=arm.after(arm.step(share))), arm.reached(fine, reach, step)


def finer(arm: Arm) -> Arm:
    """Return an arm with the loads and the fits of the answer."""
    if len(arm.fits) == 1:
        return turned(arm, arm.fits, finely=True)
    ends = [divided(one, FINE_LOAD_STEP) for one in arm.ends]
    motions = [motion_at(*pair) for pair in zip(arm.motions, ends, strict=True)]
    return turned(replace(arm, ends=ends, motions=motions), arm.fits, finely=True)


def _is_settled(spreads: Sequence[Spread], step: Array) -> bool:
    """Return whether no free parameter that the logs see has moved by more than their noise; the step is (P,)."""
    seen = np.concatenate([spread.inner & spread.seen for spread in spreads])
    variance = np.concatenate([np.diag(spread.covariance) for spread in spreads])
    return bool(np.all(np.abs(step[seen]) <= SETTLED * np.sqrt(variance[seen])))
