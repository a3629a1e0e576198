"""Where the links of a URDF stand on the links of the model: fixed ones, and those behind joints that are locked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.model.descriptions._tree import Connection
from dynident.model.inertia import Inertia
from dynident.model.robot import Joint, Robot, rotation_about

#: Largest difference between a pose of the file and one of the model, in m and as entries of a rotation.
SAME = 1e-9

_STEP = "give the URDF that was identified, with --description"


@dataclass(frozen=True)
class Placed:
    """A link of the file on a link of the model.

    Attributes:
        owner: Index of the model's link; -1 is the base.
        rotation: Orientation in it, shape (3, 3).
        translation: Position in it, shape (3,), in m.
        behind_lock: Whether a joint that moves in the file, and is locked in the model, stands between.
    """

    owner: int
    rotation: Array
    translation: Array
    behind_lock: bool = False


@dataclass(frozen=True)
class Placement:
    """All links of a file on the model.

    Attributes:
        bodies: Inertia of each link of the file about its own frame; None where it states none.
        placed: Where each stands.
        locked: Position of each joint that moves in the file and is locked in the model.
    """

    bodies: Mapping[str, Inertia | None]
    placed: Mapping[str, Placed]
    locked: Mapping[str, float]

    def on(self, owner: int) -> list[str]:
        """Return the links of the file on a link of the model."""
        return [name for name, place in self.placed.items() if place.owner == owner]


def place(path: object, robot: Robot, bodies: Mapping[str, Inertia | None], joints: Sequence[Connection]) -> Placement:
    """Return where the links of a file stand on the links of the robot that was identified.

    Raises:
        DescriptionError: A joint or link that the other does not have, or that stands elsewhere.
    """
    moving = {joint.name: (i, joint) for i, joint in enumerate(robot.joints)}
    missing = sorted(moving.keys() - {joint.name for joint in joints})
    if missing:
        raise DescriptionError(path, f"joint '{missing[0]}'", "the estimate has it and the file has not", _STEP)
    children = {joint.child for joint in joints}
    placed = {name: Placed(-1, np.eye(3), np.zeros(3)) for name in bodies if name not in children}
    locked: dict[str, float] = {}
    waiting = list(joints)
    while waiting:
        joint = next(joint for joint in waiting if joint.parent in placed)  # it is a tree: the reader has seen to that
        waiting.remove(joint)
        parent = placed[joint.parent]
        turn = parent.rotation @ joint.rotation
        shift = parent.translation + parent.rotation @ joint.translation
        if joint.name in moving:
            index, known = moving[joint.name]
            _check(path, joint, known, robot, parent.owner, turn, shift, index)
            placed[joint.child] = Placed(index, np.eye(3), np.zeros(3))
        elif joint.kind == "fixed":
            placed[joint.child] = Placed(parent.owner, turn, shift, parent.behind_lock)
        else:
            locked[joint.name] = position = _position(path, joint, robot, parent.owner, turn, shift)
            turn, shift = _moved(joint, turn, shift, position)
            placed[joint.child] = Placed(parent.owner, turn, shift, True)
    return Placement(bodies, placed, locked)


def _check(
    path: object, joint: Connection, known: Joint, robot: Robot, owner: int, turn: Array, shift: Array, index: int
) -> None:
    axis = joint.axis / np.linalg.norm(joint.axis)
    differs = max(np.abs(turn - known.rotation).max(), np.abs(shift - known.translation).max())
    differs = max(differs, np.abs(axis - known.axis).max())
    is_same = owner == known.parent and joint.kind == known.kind and joint.child == robot.links[index].name
    if not is_same or differs > SAME:
        raise DescriptionError(path, f"joint '{joint.name}'", "it is another one than in the estimate", _STEP)


def _moved(joint: Connection, turn: Array, shift: Array, position: float) -> tuple[Array, Array]:
    axis = joint.axis / np.linalg.norm(joint.axis)
    if joint.kind == "prismatic":
        return turn, shift + position * turn @ axis
    return turn @ rotation_about(axis, position), shift


def _position(path: object, joint: Connection, robot: Robot, owner: int, turn: Array, shift: Array) -> float:
    """Return where a joint is locked, from the frame that its link has become."""
    where = f"joint '{joint.name}'"
    frame = robot.frames.get(joint.child)
    if frame is None or frame.link != owner:
        raise DescriptionError(path, where, "it moves, and is neither moving nor locked in the estimate", _STEP)
    axis = joint.axis / np.linalg.norm(joint.axis)
    if joint.kind == "prismatic":
        position = float(axis @ turn.T @ (frame.translation - shift))
    else:
        inner = turn.T @ frame.rotation
        skewed = np.array([inner[2, 1] - inner[1, 2], inner[0, 2] - inner[2, 0], inner[1, 0] - inner[0, 1]])
        position = float(np.arctan2(0.5 * axis @ skewed, 0.5 * (np.trace(inner) - 1.0)))
    at = _moved(joint, turn, shift, position)
    if max(np.abs(at[0] - frame.rotation).max(), np.abs(at[1] - frame.translation).max()) > SAME:
        raise DescriptionError(path, where, "its link stands elsewhere in the estimate", _STEP)
    return position
