"""Axes of the robot model that are askew or displaced, beside the other causes of a residual.

A rotor inertia at an axis can take in most of what an axis that is turned in the robot model leaves. Where one seems to
explain a log, all causes are searched again at a few hundred of its rows, with the columns that errors of the frames
have there (:mod:`dynident.diagnosis.causes.frame_errors`): turned axes and displaced ones, three coefficients each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.causes.cause_columns import CauseRows
from dynident.diagnosis.causes.cause_search import Blame, Cause, CauseSearch
from dynident.diagnosis.causes.frame_errors import MOVED, TURNED
from dynident.diagnosis.causes.model_error import ModelError
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.finding import Finding, listed
from dynident.model.base_parameters import base_parameters
from dynident.model.joint import rotation_about
from dynident.model.robot import Robot

#: Names of the causes that are errors of a link's frame, by rad and by m.
AXES = TURNED_AXIS, MOVED_AXIS = "turned axis", "displaced axis"

#: Turn of an axis in rad, and displacement over the reach, beyond which straight lines hold for neither.
FAR_TURN, FAR_MOVE = 0.6, 0.2


def blames_beside_frames(
    fit: QuickFit, rows: CauseRows, causes: Sequence[Cause], error: ModelError
) -> tuple[Blame, ...]:
    """Return the causes that are sure where axes may be off as well; nothing where the robot model states no bodies.

    Args:
        fit: The fit of the log.
        rows: Its rows.
        causes: The other causes, filtered as the rows are.
        error: Gives the rows, one of each ``every``, and the torques by errors of the frames there.
    """
    if error.frames is None:
        return ()
    some = slice(None, None, error.every)
    few = replace(
        rows,
        blocks=[block[some] for block in rows.blocks],
        target=rows.target[some],
        measured=rows.measured[some],
        masks=rows.masks[some],
        oversampling=1.0,
        made={},
    )
    others = [replace(cause, columns=cause.columns[:, some]) for cause in causes]
    return CauseSearch(few, [*others, *_frame_causes(fit, error.frames)], few.shared).blames()


def axes_off(blames: Sequence[Blame], robot: Robot) -> tuple[Blame, ...]:
    """Return those of some causes that are axes, from the base on; none where one is off by too much."""
    reach = sum(float(np.linalg.norm(joint.translation)) for joint in robot.joints)
    most = {TURNED_AXIS: FAR_TURN, MOVED_AXIS: FAR_MOVE * reach}
    found = [blame for blame in blames if blame.cause.name in most]
    if any(np.linalg.norm(blame.values) > most[blame.cause.name] for blame in found):
        return ()
    return tuple(sorted(found, key=lambda blame: robot.joint_names.index(blame.cause.joint)))


def corrected(fit: QuickFit, axes: Sequence[Blame]) -> QuickFit:
    """Return the fit with axes of the robot model where they were found."""
    joints = {joint.name: joint for joint in fit.model.robot.joints}
    for blame in axes:
        joint, size = joints[blame.cause.joint], max(float(np.linalg.norm(blame.values)), 1e-12)
        turned = rotation_about(blame.values / size, size) @ joint.axis
        moved = (
            {"axis": turned} if blame.cause.name == TURNED_AXIS else {"translation": joint.translation + blame.values}
        )
        joints[joint.name] = replace(joint, **moved)
    model = replace(fit.model, robot=replace(fit.model.robot, joints=tuple(joints.values())))
    return replace(fit, model=model, base=base_parameters(model), made=None)


def _frame_causes(fit: QuickFit, frames: Array) -> Iterator[Cause]:
    """Yield a turn and a displacement of each axis, ``frames`` as :func:`~.frame_errors.frame_errors` returns them."""
    chain, robot = fit.model.robot.chain, fit.model.robot
    for place, link in enumerate(np.flatnonzero(chain.parent >= 0)):
        name = robot.joint_names[chain.joint[link]]
        own = frames[6 * place : 6 * place + 6]
        yield Cause(TURNED_AXIS, name, own[:3] / TURNED, is_filtered=True)
        yield Cause(MOVED_AXIS, name, own[3:] / MOVED, is_filtered=True)


def frame_findings(frames: Sequence[Blame], is_grave: bool) -> list[Finding]:
    """Return what is said of axes that are turned or displaced in the robot model; nothing where none is.

    A link's frame that is turned turns the axes of all joints after it. It is a warning where they explain most,
    ``is_grave``.
    """
    if not frames:
        return []
    told, best = [], max(frames, key=lambda blame: blame.certainty)
    numbers = {"t": best.certainty, "share": best.share}
    for blame in frames:
        size, is_turned = float(np.linalg.norm(blame.values)), blame.cause.name == TURNED_AXIS
        numbers[f"{'angle_deg' if is_turned else 'distance_m'} {blame.cause.joint}"] = (
            float(np.degrees(size)) if is_turned else size
        )
        by = f"turned by about {np.degrees(size):.2g} degrees" if is_turned else f"off by about {1e3 * size:.2g} mm"
        told.append(f"{blame.cause.joint} {by}")
    evidence = (
        f"the residual is that of axes which are off in the robot model: {', '.join(told)} (t = "
        f"{best.certainty:.0f}, {100 * best.share:.0f} % of a joint's residual variance)"
    )
    remedy = (
        "compare axes and origins of the robot model with the drawing of the robot, from the first of these joints on, "
        "and check again: figures of other causes depend on them"
    )
    joints = listed(tuple(dict.fromkeys(blame.cause.joint for blame in frames)))
    return [
        Finding(
            "warning" if is_grave else "note", "link frame", joints, evidence, remedy, numbers, ("inconsistent links",)
        )
    ]
