"""Joints whose logs give torques no scale: what is known as a ratio to the torque at full duty, and by a stated one.

Torque at full duty, friction, back-EMF, and armature with the inertia of the bodies may all be twice as large where no
weight is carried: the motion is the same. Half widths of ratios are those with the torque at full duty held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynident.actuators.parameters import PLACE
from dynident.actuators.verdict import AS_RATIO, WEAK, Known, Spread, lacks_scale
from dynident.arrays import Array

#: Parameters in units of the torque at full duty; armature is one with the inertia of the bodies.
_SCALED = ("full_torque", "back_emf", "viscous", "coulomb", "coulomb_stribeck")


def as_ratios(known: Sequence[Known], spread: Spread, inertia: float) -> tuple[Known, ...]:
    """Return what is known of a joint, with the ratios that are known where the scale is not.

    Args:
        known: Free parameters of the joint.
        spread: How its errors spread them; the covariance has the directions that the logs see.
        inertia: Of the bodies about the joint, which is one with the armature, in kg m^2.
    """
    if spread.ratio is not None or not lacks_scale({one.name: one.label for one in known}):
        return tuple(known)
    names = [one.name for one in known]
    scaled = np.array([_of_scale(one.name, one.value, inertia) for one in known])
    torque, found = names.index("full_torque"), []
    for k, one in enumerate(known):
        if one.label != "not separable" or scaled[k] == 0.0 or k == torque:
            found.append(one)
            continue
        beside = np.eye(len(names))[k] - scaled[k] / scaled[torque] * np.eye(len(names))[torque]
        half = float(spread.factors[k] * np.sqrt(max(float(beside @ spread.covariance @ beside), 0.0)))
        is_known = half < WEAK * abs(scaled[k])
        found.append(replace(one, label=AS_RATIO, together="full_torque", ratio=half) if is_known else one)
    return tuple(found)


def at_torque(known: Sequence[Known], stated: tuple[float, float], inertia: float) -> tuple[Known, ...]:
    """Return what is known of a joint without scale where its torque at full duty is stated.

    Args:
        known: As of :func:`as_ratios`.
        stated: Torque at full duty and its half width, in N m.
        inertia: Of the bodies about the joint, in kg m^2.
    """
    torque = next(one.value for one in known if one.name == "full_torque")
    share, found = stated[1] / stated[0], []
    for one in known:
        size = _of_scale(one.name, one.value, inertia)
        value = one.value + size * (stated[0] / torque - 1.0)
        if one.name != "full_torque" and one.label != AS_RATIO:
            found.append(replace(one, value=value))
            continue
        half = float(np.hypot(share * size * stated[0] / torque, (one.ratio or 0.0) * stated[0] / torque))
        label = "identified" if half < WEAK * abs(value) else "weak"
        found.append(Known(one.name, value, half, label))
    return tuple(found)


def contradiction(known: Sequence[Known], stated: tuple[float, float], is_free: bool) -> tuple[str, ...]:
    """Return in words what a stated torque says where it is not the scale.

    Args:
        known: Free parameters of the joint.
        stated: Torque at full duty and its half width, in N m.
        is_free: Whether the gain of the drive is not known.
    """
    found = next(one for one in known if one.name == "full_torque")
    if is_free:
        return ("full_torque has no effect while the gain of the drive is not known: state error_gain and kp",)
    if not abs(found.value - stated[0]) > np.hypot(found.half_width, stated[1]):
        return ()
    return (
        f"full torque {found.value:.3g} +- {found.half_width:.2g} N m by the logs, stated {stated[0]:.3g} +- "
        f"{stated[1]:.2g}: check the bodies of the robot model, kp and the drive law; the logs are the scale here",
    )


def rescaled(parameters: Array, torque: float, inertia: float) -> Array:
    """Return the parameters of a joint without scale, shape (COUNT,), at another torque at full duty in N m."""
    found = parameters.copy()
    for name in (*_SCALED, "armature"):
        value = float(parameters[PLACE[name]])
        found[PLACE[name]] += _of_scale(name, value, inertia) * (torque / float(parameters[PLACE["full_torque"]]) - 1.0)
    found[PLACE["armature"]] = max(float(found[PLACE["armature"]]), 0.0)
    return found


def _of_scale(name: str, value: float, inertia: float) -> float:
    """Return what of a parameter grows with the scale of all torques."""
    return value + inertia if name == "armature" else value * (name in _SCALED)
