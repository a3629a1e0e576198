"""Where the links of a robot model stand on those of the estimate, and what inertia each gets of the sum."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint, rotation_about
from dynident.model.robot import Robot
from dynident.robot_files.tree import Connection, some

#: Largest difference between a pose of the file and one of the model, in m and as entries of a rotation.
SAME = 1e-9

_STEP = "give the robot model that was identified, with --description"


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


#: Share of the smallest eigenvalue of the sum's pseudo-inertia that the moving link keeps where others keep theirs.
ROOM = 0.01


@dataclass(frozen=True)
class Shares:
    """What each link of a file gets.

    Attributes:
        inertias: New inertia about the link's own frame; None takes its inertia out. Others stay as they are.
        notes: Where a sum goes, one sentence for each link of the model that is more than one of the file.
    """

    inertias: Mapping[str, Inertia | None]
    notes: tuple[str, ...]


def shared(
    robot: Robot, bodies: Sequence[Inertia], placement: Placement, lump: bool, between: Collection[str] = ()
) -> Shares:
    """Share out the inertia of each link of the model.

    Links that are fixed to a moving one, or locked behind it, keep the inertia that the file states, and the moving
    one gets the rest, where that and they are possible bodies. Else fixed ones lose theirs to it; locked ones, which
    move in the file and need a mass, keep the same part of theirs, half of the largest that leaves a possible body.

    Args:
        robot: The robot that was identified.
        bodies: Identified inertia of each of its links, about its frame.
        placement: The links of the file on its links.
        lump: Whether fixed ones lose theirs in any case.
        between: Links that are no body of the file but stand between two joints of one; where the second is locked,
            that body gets what the link would.
    """
    inertias: dict[str, Inertia | None] = {}
    notes: list[str] = []
    for i, link in enumerate(robot.links):
        here = [name for name in placement.on(i) if name not in between]
        owner = here[0] if here else link.name
        others = [name for name in here[1:] if _weighs(placement.bodies[name])]
        fixed = [name for name in others if not placement.placed[name].behind_lock]
        held = [name for name in others if placement.placed[name].behind_lock]
        kept = [name for name in others if name in held or not (lump or _is_none(placement.bodies[name]))]
        rest = _less(bodies[i], placement, kept, 1.0)
        scale = 1.0
        if kept and not _has_room(rest, bodies[i]):
            kept, scale = held, 1.0
            rest = _less(bodies[i], placement, kept, scale)
            while kept and not _has_room(rest, bodies[i]):
                scale *= 0.5
                rest = _less(bodies[i], placement, kept, scale)
            for name in kept if scale < 1.0 else []:
                inertias[name] = _scaled(placement.bodies[name], scale)
        at = placement.placed[owner]
        inertias[owner] = rest.moved(at.rotation.T, -at.rotation.T @ at.translation)
        gone = [name for name in fixed if name not in kept]
        inertias |= dict.fromkeys(gone)
        if others:
            notes.append(_sentence(owner, kept, gone, scale))
        unreal = [name for name in others if _is_none(placement.bodies[name])]
        if unreal:
            notes.append(f"no body has the inertia that the file states for {some(unreal)}")
    return Shares(inertias, tuple(notes))


def kept_notes(shares: Shares, placement: Placement, left: Sequence[str]) -> list[str]:
    """Return where sums go and what stays as in the file; ``left`` are joints of which the model has no friction."""
    notes = list(shares.notes)
    if left:
        notes.append(f"the model has no friction of {', '.join(left)}: their damping and friction are as in the file")
    if placement.locked:
        at = some([f"{name} at {position:.6g}" for name, position in placement.locked.items()])
        notes.append(f"identified with locked joints ({at}): their friction is as in the file")
    return notes


def _has_room(rest: Inertia, total: Inertia) -> bool:
    least = ROOM * float(np.linalg.eigvalsh(total.pseudo)[0])
    return bool(np.linalg.eigvalsh(rest.pseudo)[0] >= least)


def _is_none(body: Inertia | None) -> bool:
    """Return whether no body has the inertia that a file states."""
    return body is not None and bool(body.defect())


def _weighs(body: Inertia | None) -> bool:
    return body is not None and bool(body.vector.any())


def _less(total: Inertia, placement: Placement, kept: list[str], scale: float) -> Inertia:
    vector = total.vector.copy()
    for name in kept:
        body, place = placement.bodies[name], placement.placed[name]
        assert body is not None
        vector -= scale * body.moved(place.rotation, place.translation).vector
    return Inertia.from_vector(vector)


def _scaled(body: Inertia | None, scale: float) -> Inertia:
    assert body is not None
    return Inertia.from_vector(scale * body.vector)


def _sentence(owner: str, kept: list[str], gone: list[str], scale: float) -> str:
    """Return where the sum of a link and of what hangs on it has gone."""
    parts = []
    if kept:
        part = "" if scale == 1.0 else f" {scale:.3g} times"
        parts.append(f"{some(kept)} keep{'s' if len(kept) == 1 else ''}{part} the inertia of the file")
    if gone:
        parts.append(f"{some(gone)} ha{'s' if len(gone) == 1 else 've'} none any more")
    return (
        f"'{owner}' was identified as one body with the links fixed to it: {'; '.join(parts)}; '{owner}' has the rest"
    )
