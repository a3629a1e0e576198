"""Which joint is which axis of a controller that has six robot axes and up to six external ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import IntArray
from dynident.errors import BadOption, UnknownChoice
from dynident.results.exporters._motion import DrivenMotion

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
