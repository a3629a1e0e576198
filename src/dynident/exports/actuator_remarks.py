"""What has to be said of an export of actuators."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from dynident.actuators.estimate import ActuatorEstimate, JointActuator
from dynident.actuators.parameters import unit_for
from dynident.actuators.verdict import lacks_scale
from dynident.exports.actuator_bodies import robot_of
from dynident.exports.actuator_files import (
    PLAIN,
    TARGETS,
    command_words,
    mujoco_model,
    stated_gain,
    urdf_dynamics,
    written_limit,
)

#: Targets that hold the bodies too.
_WITH_BODIES: Final = (mujoco_model, urdf_dynamics)


def _held_out(joint: JointActuator) -> str:
    """Return the errors on held-out logs of the friction that is exported and of the one that was found, if known."""
    errors = [1e3 * joint.folds.get(name, float("nan")) for name in (PLAIN, joint.friction)]
    unit = unit_for("mrad", joint.slides)
    return f" (held out {errors[0]:.3g} {unit} for {errors[1]:.3g})" if np.all(np.isfinite(errors)) else ""


def _limit_remarks(estimate: ActuatorEstimate, has_model: bool) -> list[str]:
    """Return which force limit is written where none was identified, or another one than that of the robot model."""
    limits, unknown = dict[str, list[str]](), [joint.name for joint in estimate.joints if not joint.has_limit]
    if not has_model:
        return [f"the largest torque of {', '.join(unknown)} is not known: none is written"] if unknown else []
    efforts = {joint.name: joint.limits.effort for joint in robot_of(estimate).active}
    for joint in estimate.joints:
        effort, unit = efforts.get(joint.name, np.inf), unit_for("N m", joint.slides)
        most, is_low = written_limit(joint, effort), written_limit(joint, effort) > 1.001 * effort
        numbers = f"{joint.name} {most:.3g} {unit}, robot model {effort:.3g}"
        if joint.has_limit and is_low:
            words = "identified torque limits above the effort limits of the robot model, written in their place"
        elif joint.has_limit:
            continue
        elif is_low:
            words = "the drives gave more in the logs than the effort limits of the robot model: the largest torque of "
            words += "the logs is written, the limit itself is not known"
        else:
            words, numbers = "the effort limit of the robot model holds, the largest torque is not known", joint.name
        limits.setdefault(words, []).append(numbers)
    return [f"{words} ({'; '.join(own)})" for words, own in limits.items()]


def export_remarks(
    estimate: ActuatorEstimate, target: str, options: Mapping[str, Any] = MappingProxyType({})
) -> list[str]:
    """Return what has to be said of an export: torques that are not known, bodies that a target has not.

    Args:
        estimate: The actuators.
        target: Name of the target.
        options: Those of the target.
    """
    has_model, found = TARGETS.get(target) in _WITH_BODIES, list[str]()
    commands: dict[str, list[str]] = {}
    for joint in estimate.joints if TARGETS.get(target) is mujoco_model else ():
        commands.setdefault(command_words(joint, stated_gain(estimate, options)), []).append(joint.name)
    found += [f"commanded velocity and torque of {', '.join(own)}: {words}" for words, own in commands.items() if words]
    richer = [joint for joint in estimate.joints if joint.friction != PLAIN]
    if richer:
        told = [f"{joint.name} {joint.friction}{_held_out(joint)}" for joint in richer]
        found.append(f"exported is the fit with Coulomb and viscous friction alone, in the place of {'; '.join(told)}")
    found += _limit_remarks(estimate, has_model)
    ratios = [joint.name for joint in estimate.joints if lacks_scale({one.name: one.label for one in joint.known})]
    if ratios:
        found.append(
            f"torques, friction and armature of {', '.join(ratios)} are known as ratios: nothing gives their scale"
        )
    bent = [joint.name for joint in estimate.joints if joint.law.dead_zone or joint.law.punch]
    if bent:
        found.append(
            f"dead zone and punch of {', '.join(bent)} are no part of it: its drives are linear to their limit"
        )
    if estimate.bodies is not None and not has_model:
        names = " or ".join(name for name, write in TARGETS.items() if write in _WITH_BODIES)
        found.append(f"its torques belong to the bodies that were found: export those with --to {names}")
    return found
