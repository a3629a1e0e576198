"""What robot programs share: comments, joints on the axes of a controller, degrees and millimetres, thinned points.

Thinned are points, evenly spaced in time, until an interpolation keeps just within a tolerance of the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray
from dynident.errors import BadOption, UnknownChoice
from dynident.exports.motions._motion import DrivenMotion
from dynident.exports.names_in_files import comment_text, shown_names

#: Robot axes and external axes of KUKA and ABB controllers.
ROBOT_AXES = EXTERNAL_AXES = 6


@dataclass(frozen=True)
class Axes:
    """The joints of a motion on the axes of a controller.

    Attributes:
        robot: Numbers of the joints on the robot axes, in order.
        external: Numbers of the joints on the external axes, in order.
    """

    robot: IntArray
    external: IntArray


def assign(motion: DrivenMotion, external: str) -> Axes:
    """Return the axes: the joints named in ``external`` (with commas) are external, else those after the sixth.

    Raises:
        UnknownChoice: A name that is no joint.
        BadOption: Too many joints, or one named twice.
    """
    names = [name.strip() for name in external.split(",") if name.strip()]
    for name in names:
        if name not in motion.joints:
            raise UnknownChoice("joint", name, motion.joints)
    outside = [motion.joints.index(name) for name in names]
    if not names:
        outside = list(range(ROBOT_AXES, len(motion.joints)))
    inside = [i for i in range(len(motion.joints)) if i not in outside]
    if len(set(outside)) != len(outside) or len(inside) > ROBOT_AXES or len(outside) > EXTERNAL_AXES or not inside:
        step = f"1 to {ROBOT_AXES} joints are robot axes and at most {EXTERNAL_AXES} external ones, each named once"
        raise BadOption("external", external, step)
    return Axes(np.array(inside, dtype=np.int64), np.array(outside, dtype=np.int64))


def degrees_and_mm(revolute: Sequence[bool]) -> Array:
    """Return the scale of controllers that print degrees and millimetres, shape (n,)."""
    return np.where(np.array(revolute), 180 / np.pi, 1000.0)


def header_lines(motion: DrivenMotion, *own: str) -> list[str]:
    """Return lines of plain text, without the sign of a comment; ``own`` are those of the target."""
    shown, _ = shown_names(motion.joints)
    share = motion.speed
    lines = [
        f"Excitation of {motion.plan.robot} - written by dynident",
        f"plan: sha256 {motion.plan_sha256}",
        f"joints, in order: {' '.join(shown)}",
        f"{motion.repeats} x {motion.plan.trajectory.duration:.6g} s, {motion.motion.duration:.6g} s from rest to rest",
        f"speed: {100 * share:.6g} % of the design: same path, speeds x {share:.6g}, accelerations x {share**2:.6g}",
        "A speed override of the controller stretches time further: identify from measured time and positions only.",
        "The approach is not checked for obstacles, the motion as far as its plan says. Keep a hand on the stop.",
        *own,
    ]
    cut = [line[i : i + 110] for line in map(str, lines) for i in range(0, max(len(line), 1), 110)]
    return [comment_text(line) for line in cut]


def name_notes(motion: DrivenMotion) -> tuple[str, ...]:
    """Return the sentence that says which names are written otherwise; none where all are as they are."""
    _, changed = shown_names(motion.joints)
    return tuple(f"joint {name!r} stands in comments as {new}" for name, new in changed.items())


#: Samples between two points at which the deviation is looked at, and the fewest intervals that are tried.
FINER, FEWEST = 10, 8

#: From points (M,), (M, n) and times (N,) to positions (N, n).
Interpolation = Callable[[Array, Array, Array], Array]


def linear(knots: Array, points: Array, time: Array) -> Array:
    """Return straight lines between points, as a controller that moves all joints from point to point."""
    return np.stack([np.interp(time, knots, column) for column in points.T], axis=1)


def clamped_cubic(knots: Array, points: Array, time: Array) -> Array:
    """Return the cubic spline through points that is at rest at both ends."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(knots, points, bc_type="clamped")(time))


def thinned(
    motion: DrivenMotion, tolerance: Array, most: int, interpolation: Interpolation
) -> tuple[Array, Array, Array]:
    """Return times (M,), points (M, n) and the largest deviation of each joint (n,), within ``tolerance`` (n,).

    Raises:
        BadOption: More than ``most`` points would be needed.
    """

    def attempt(intervals: int) -> tuple[Array, Array, Array]:
        knots = np.linspace(0.0, motion.motion.duration, intervals + 1)
        points = motion.motion.evaluate(knots)[0]
        fine = np.linspace(0.0, motion.motion.duration, FINER * intervals + 1)
        away = np.abs(interpolation(knots, points, fine) - motion.motion.evaluate(fine)[0])
        return knots, points, away.max(axis=0)

    failed, intervals = FEWEST // 2, FEWEST
    while np.any(attempt(intervals)[2] > tolerance):
        failed, intervals = intervals, 2 * intervals
        if failed >= most:
            break
    while intervals - failed > 1:
        middle = (failed + intervals) // 2
        if np.any(attempt(middle)[2] > tolerance):
            failed = middle
        else:
            intervals = middle
    found = attempt(intervals)
    if intervals + 1 > most or np.any(found[2] > tolerance):
        step = (
            f"more than {most} points would be needed; give a larger tolerance, fewer repeats, or more with most_points"
        )
        raise BadOption("most_points", most, step)
    return found
