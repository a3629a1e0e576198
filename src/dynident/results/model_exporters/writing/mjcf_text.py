"""Lines of MJCF: poses, joints, shapes that are drawn only, sites for named frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from dynident.arrays import Array
from dynident.model.robot import Joint, Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere
from dynident.results.model_exporters.writing.rotations import quaternion
from dynident.results.model_exporters.writing.urdf_text import number, numbers

_UNTOUCHED = 'contype="0" conaffinity="0"'


def pose(rotation: Array, translation: Array) -> str:
    """Return the attributes pos and quat of a pose."""
    return f'pos="{numbers(translation)}" quat="{numbers(quaternion(rotation))}"'


def joint_line(joint: Joint, armature: float, damping: float, dry: float) -> str:
    """Return the element of a joint; a range is written where both ends are known."""
    kind = "hinge" if joint.kind == "revolute" else "slide"
    lower, upper = joint.limits.lower, joint.limits.upper
    bound = f' range="{number(lower)} {number(upper)}"' if np.isfinite([lower, upper]).all() and lower < upper else ""
    values = (("armature", armature), ("damping", damping), ("frictionloss", dry))
    text = "".join(f' {name}="{number(value)}"' for name, value in values if value)
    return f'<joint name={quoteattr(joint.name)} type="{kind}" axis="{numbers(joint.axis)}"{bound}{text}/>'


def geoms(shapes: Sequence[Shape], indent: str) -> Iterator[str]:
    """Yield the shapes that MJCF has without a file."""
    for shape in shapes:
        if isinstance(shape, Sphere):
            text = f'type="sphere" pos="{numbers(shape.centre)}" size="{number(shape.radius)}"'
        elif isinstance(shape, Box):
            text = f'type="box" {pose(shape.rotation, shape.translation)} size="{numbers(0.5 * shape.size)}"'
        elif isinstance(shape, Cylinder):
            size = f"{number(shape.radius)} {number(0.5 * shape.length)}"
            text = f'type="cylinder" {pose(shape.rotation, shape.translation)} size="{size}"'
        elif isinstance(shape, Capsule) and shape.length > 0 and shape.radius > 0:
            ends = f"{numbers(shape.start)} {numbers(shape.end)}"
            text = f'type="capsule" fromto="{ends}" size="{number(shape.radius)}"'
        else:
            continue
        yield f"{indent}<geom {text} {_UNTOUCHED}/>"


def sites(robot: Robot, link: int, indent: str) -> Iterator[str]:
    """Yield a site for each named frame on a link."""
    for name, frame in robot.frames.items():
        if frame.link == link and name.isprintable() and name.strip():
            yield f"{indent}<site name={quoteattr(name)} {pose(frame.rotation, frame.translation)}/>"
