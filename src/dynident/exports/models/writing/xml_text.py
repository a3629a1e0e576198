"""What the XML formats share: numbers to the last bit, orientations exact to rounding, names that XML can hold."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.shapes import Capsule


def number(value: float) -> str:
    """Return a number so that reading it gives the same bits; zero has no sign."""
    return repr(float(value) + 0.0)


def numbers(values: Iterable[float] | Array) -> str:
    """Return numbers with blanks between."""
    return " ".join(number(value) for value in values)


def quaternion(rotation: Array) -> Array:
    """Return (w, x, y, z) with w >= 0 of a rotation matrix, shape (3, 3) -> (4,) (Shepperd 1978: no small divisor)."""
    r = np.asarray(rotation, dtype=float)
    trace = float(np.trace(r))
    squares = np.array([1.0 + trace, *(1.0 + 2.0 * np.diag(r) - trace)])  # 4 w^2, 4 x^2, 4 y^2, 4 z^2
    k = int(np.argmax(squares))
    odd = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    if k == 0:
        found = np.array([squares[0], *odd])
    else:
        a = k - 1
        found = np.array([odd[a], *(r[a] + r[:, a])])
        found[k] = squares[k]
    found = found / np.linalg.norm(found)
    return (found if found[0] >= 0 else -found) + 0.0


def roll_pitch_yaw(rotation: Array) -> Array:
    """Return (roll, pitch, yaw) in rad with R = Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3) -> (3,).

    Where pitch is a right angle only roll and yaw together are determined: yaw is then what rounding makes it, and roll
    is computed for that yaw.
    """
    r = np.asarray(rotation, dtype=float)
    yaw = np.arctan2(r[1, 0], r[0, 0])
    cos, sin = np.cos(yaw), np.sin(yaw)
    rest = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ r  # Ry(pitch) Rx(roll)
    return np.array([np.arctan2(-rest[1, 2], rest[1, 1]), np.arctan2(-rest[2, 0], rest[0, 0]), yaw]) + 0.0


def checked_names(what: str, names: Sequence[str]) -> list[str]:
    """Return names that can stand in XML, each once.

    Raises:
        BadOption: An empty name, characters that cannot be printed, or two alike.
    """
    check_printable(what, names)
    for name in names:
        if names.count(name) > 1:
            raise BadOption(what, name, f"two have this name; give each {what} a name of its own")
    return list(names)


def check_printable(what: str, names: Sequence[str]) -> None:
    """Refuse names that no reader of a robot model takes.

    Raises:
        BadOption: An empty name, or characters that cannot be printed.
    """
    for name in names:
        if not name.strip() or not name.isprintable():
            raise BadOption(what, name, "rename it in the robot model: it must be plain text of one line")


def unused_name(name: str, taken: Collection[str]) -> str:
    """Return the name, with a number behind it where it is taken."""
    found, number = name, 2
    while found in taken:
        found, number = f"{name}_{number}", number + 1
    return found


def along(capsule: Capsule) -> Array:
    """Return a rotation whose z axis is that of a capsule, shape (3, 3)."""
    z = (capsule.end - capsule.start) / capsule.length
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
