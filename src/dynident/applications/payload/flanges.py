"""Where a payload may be: the ends of the branches, of which the log tells the one; frames that it is stated in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.stats

from dynident.applications.drive_gains.payload import CarriedBody, hand_of
from dynident.model.robot import Robot

#: Words in the names of frames that a payload is often stated in; frames with one are offered first.
FLANGES = ("tcp", "tool", "flange", "ee", "attachment")

#: Share of what the load lowers the weighted squares by from which one at an end of another branch counts as a second.
SECOND = 0.05

#: By how much the weighted squares of two ends differ by noise alone at most: ten unknowns, with a chance of 0.001.
BY_NOISE = float(scipy.stats.chi2.isf(0.001, 10))


def ends_of(robot: Robot) -> tuple[str, ...]:
    """Return where a payload may be: the tool of the robot model or its last link, and the ends of other branches.

    Of a gripper whose fingers move together that is the link that carries them.
    """
    first = CarriedBody(1.0)
    beyond = {first.place(robot)[0]}
    for i, joint in enumerate(robot.joints):
        if joint.parent in beyond:
            beyond.add(i)
    tips = (hand_of(robot, i) for i in robot.tips)
    return first.frame_in(robot), *dict.fromkeys(robot.links[i].name for i in tips if i not in beyond)


def chosen_end(ends: Sequence[str], gains: Sequence[float]) -> tuple[str, list[str]]:
    """Return the end at which a payload explains the torques best, and what is to be said of it.

    Args:
        ends: Names, the first of them taken unless another is better by more than noise explains.
        gains: By how much a payload at each lowers the weighted squares.
    """
    if len(ends) == 1:
        return ends[0], []
    best = int(np.argmax(gains))
    open_ones = [name for name, gain in zip(ends, gains, strict=True) if gains[best] - gain <= BY_NOISE]
    if gains[best] <= BY_NOISE:
        return ends[0], []
    if len(open_ones) > 1:
        own = ends[0] if ends[0] in open_ones else ends[best]
        text = f"the log does not tell at which end of the robot the load is: {', '.join(open_ones)}; "
        return own, [f"{text}name it (--flange NAME)"]
    shares = (100.0 * gain / gains[best] for gain in gains)
    others = [f"one at {name} by {share:.2g} % of that" for name, share in zip(ends, shares, strict=True)]
    text = f"of the ends of the robot the load is at {ends[best]}: there it lowers the weighted squares by "
    return ends[best], [f"{text}{gains[best]:.3g}, {', '.join(np.delete(others, best))} (another: --flange NAME)"]


def second_load(robot: Robot, chosen: str, ends: Sequence[str], gains: Sequence[float]) -> list[str]:
    """Return whether ends of branches that have no joint in common with the chosen one may carry a load as well.

    What a load at one of these lowers the weighted squares by, one at the other does not.
    """
    carriers = {name: set(robot.carriers(CarriedBody(1.0, frame=name).place(robot)[0])) for name in ends}
    least = max(BY_NOISE, SECOND * max(gains))
    pairs = zip(ends, gains, strict=True)
    also = [name for name, gain in pairs if gain > least and not carriers[name] & carriers[chosen]]
    return [f"a load at {name} as well lowers the weighted squares: weigh it by --flange {name}" for name in also]


def frames_beside(robot: Robot, name: str) -> list[str]:
    """Return which other frames the robot model has on the link of one that was taken for want of a flange."""
    links = [link.name for link in robot.links]
    if name == robot.tool and _is_called_flange(name):
        return []
    at, rotation, translation = CarriedBody(1.0, frame=name).place(robot)
    own = [
        other
        for other, frame in robot.frames.items()
        if frame.link == at
        and not (np.allclose(frame.rotation, rotation) and np.allclose(frame.translation, translation))
    ]
    if not own:
        return []
    own = likeliest(sorted(own, key=lambda other: float(np.linalg.norm(robot.frames[other].translation))))
    named = f"{', '.join(own[:4])}{', ...' if len(own) > 4 else ''}"
    what = f"the frame of the last link, {name}" if name in links else f"the frame {name}"
    text = f"stated in {what}, which need not be the flange; "
    return [f"{text}the robot model has these frames on it: {named} (--flange NAME)"]


def likeliest(frames: list[str]) -> list[str]:
    """Return names of frames, those that a payload is often stated in first."""
    return sorted(frames, key=lambda name: not _is_called_flange(name))


def _is_called_flange(name: str) -> bool:
    return any(word in name.lower() for word in FLANGES)
