"""Chain: the robot as flat arrays, the only thing the kernels know."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array, IntArray

REVOLUTE, PRISMATIC = 0, 1


@dataclass(frozen=True)
class Chain:
    """The robot as flat arrays, the only thing the kernels know. l links, n joints that move on their own.

    Attributes:
        parent: Parent link of each link, -1 the base, shape (l,); a parent comes before its children.
        kind: 0 revolute, 1 prismatic, shape (l,).
        rotation: Orientation in the parent at q = 0, shape (l, 3, 3).
        translation: Position in the parent at q = 0, shape (l, 3), in m.
        axis: Unit axis in the link frame, shape (l, 3).
        joint: Column of q that moves each link, shape (l,).
        multiplier: Link position = multiplier * q[joint] + offset, shape (l,); 1 but for mimic joints.
        offset: See multiplier, shape (l,).
        gravity: Gravity in the base frame, shape (3,), in m/s^2.
        joints: n.
    """

    parent: IntArray
    kind: IntArray
    rotation: Array
    translation: Array
    axis: Array
    joint: IntArray
    multiplier: Array
    offset: Array
    gravity: Array
    joints: int

    @property
    def links(self) -> int:
        """Number of moving links, l."""
        return len(self.parent)

    @property
    def has_mimic(self) -> bool:
        """Whether two links share a joint or a joint scales its link."""
        return self.links != self.joints or bool(np.any(self.multiplier != 1.0) or np.any(self.offset != 0.0))
