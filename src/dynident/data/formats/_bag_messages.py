"""Messages of ROS as named numbers: joints by their name, everything else by its place in the message."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from dynident.arrays import Array

#: Entries of one list in a message at most; more is an image or a cloud of points.
MAX_LIST = 64
_DEEPEST = 6
#: Lists of a state of joints, one number per joint each.
STATE = ("position", "velocity", "effort")
#: Types of messages with states of joints: the signals of the second one stand in the message with their names.
JOINTS, DYNAMIC = "sensor_msgs/msg/JointState", "control_msgs/msg/DynamicJointState"

#: What says which columns a message has.
Layout = tuple[Any, ...]


class Numbers(NamedTuple):
    """What is read of a message.

    Attributes:
        layout: What says which columns it has; see :func:`columns_of`.
        values: The numbers in their order, shape (k,).
        stamp: Stamp of its header in ns; None without a header.
    """

    layout: Layout
    values: Array
    stamp: int | None


def numbers_of(message: Any) -> Numbers:
    """Return what is read of a message."""
    return Numbers(*_layout_and_values(message), _stamp_of(message))


def _layout_and_values(message: Any) -> tuple[Layout, Array]:
    if is_joint_state(message):
        lists = [getattr(message, name) for name in STATE]
        whole = [values for values in lists if len(values) == len(message.name)]
        layout = ("joints", *message.name, *(len(values) == len(message.name) for values in lists))
        return layout, np.concatenate(whole) if whole else np.empty(0)
    found = list(_walk(message, (), (), 0))
    return ("names", *(name for name, _ in found)), np.array([value for _, value in found], dtype=np.float64)


@lru_cache(maxsize=1024)
def columns_of(layout: Layout) -> tuple[str, ...]:
    """Return the names of the columns of a layout: ``elbow.position``, ``wrench.force.x``, ``data[0]``."""
    if layout[0] == "names":
        return layout[1:]
    joints, there = layout[1:-3], layout[-3:]
    return tuple(f"{joint}.{name}" for name, found in zip(STATE, there, strict=True) if found for joint in joints)


def _stamp_of(message: Any) -> int | None:
    header = getattr(message, "header", None)
    if header is None:
        return None
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def is_joint_state(message: Any) -> bool:
    """Return whether a message is a state of joints."""
    return getattr(message, "__msgtype__", "") == JOINTS


def _walk(message: Any, path: tuple[str, ...], joints: Sequence[str], depth: int) -> Iterator[tuple[str, float]]:
    """Yield name and value of every number in a message."""
    place = ".".join(path)
    if is_joint_state(message):
        layout, values = _layout_and_values(message)
        for name, value in zip(columns_of(layout), values, strict=True):
            joint, _, signal = name.rpartition(".")
            yield f"{joint}.{place}.{signal}", float(value)
        return
    joints = getattr(message, "joint_names", joints)
    if getattr(message, "__msgtype__", "") == DYNAMIC:
        for joint, own in zip(joints, message.interface_values, strict=False):
            pairs = zip(own.interface_names, own.values.tolist(), strict=False)
            yield from ((f"{'.'.join((joint, *path))}.{name}", value) for name, value in pairs)
        return
    for field in fields(message):
        value = getattr(message, field.name)
        yield from _entry(value, (*path, field.name), joints, depth)


def _entry(value: Any, path: tuple[str, ...], joints: Sequence[str], depth: int) -> Iterator[tuple[str, float]]:
    place = ".".join(path)
    if isinstance(value, bool | int | float):
        yield place, float(value)
    elif isinstance(value, np.ndarray):
        if value.dtype.kind in "fiub" and len(value) <= MAX_LIST:
            named = len(joints) == len(value) > 0
            for k, number in enumerate(value):
                yield f"{joints[k]}.{place}" if named else f"{place}[{k}]", float(number)
    elif isinstance(value, list):
        for k, item in enumerate(value[:MAX_LIST]):
            if hasattr(item, "__msgtype__") and depth < _DEEPEST:
                yield from _walk(item, (*path[:-1], f"{path[-1]}[{k}]"), joints, depth + 1)
    elif hasattr(value, "__msgtype__") and depth < _DEEPEST and path[-1] != "header":
        yield from _walk(value, path, joints, depth + 1)
