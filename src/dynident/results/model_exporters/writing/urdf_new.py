"""A URDF of a model whose description is no URDF: links, joints, frames and shapes, all anew."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.model.robot import Joint, Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Shape, Sphere
from dynident.results.model_exporters.subject.drives import Drives
from dynident.results.model_exporters.subject.identified import Identified
from dynident.results.model_exporters.writing.rotations import roll_pitch_yaw
from dynident.results.model_exporters.writing.urdf_patch import joint_tags
from dynident.results.model_exporters.writing.urdf_text import inertia_tags, number, numbers
from dynident.results.model_exporters.writing.xml_names import checked_names, unused_name


def new_urdf(subject: Identified, drives: Drives) -> bytes:
    """Return the URDF of a model, written anew; meshes are left out.

    Raises:
        BadOption: A name that XML cannot have, or two links of one name.
    """
    robot = subject.model.robot
    links = checked_names("link", [robot.base, *(link.name for link in robot.links)])
    checked_names("joint", [joint.name for joint in robot.joints])
    checked_names("robot", [robot.name])
    for name in (robot.name, *links, *robot.frames, *(joint.name for joint in robot.joints)):
        if "${" in name or "$(" in name:
            raise BadOption("name", name, "xacro would take it for an expression; rename it in the robot description")
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={quoteattr(robot.name)}>"]
    lines += [f"  <link name={quoteattr(robot.base)}>", *_shapes(robot.base_shapes), "  </link>"]
    tags = joint_tags(subject, drives)
    for i, (link, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        lines += [f"  <link name={quoteattr(link.name)}>", "    <inertial>"]
        lines += [f"      {tag}" for tag in inertia_tags(subject.bodies[i])]
        lines += ["    </inertial>", *_shapes(link.shapes), "  </link>"]
        lines += _joint(robot, joint, links[joint.parent + 1], links[i + 1], tags.get(joint.name, (0.0, 0.0)))
    lines += _frames(robot, links)
    return ("\n".join([*lines, "</robot>"]) + "\n").encode("utf-8")


def _joint(robot: Robot, joint: Joint, parent: str, child: str, tags: tuple[float, float]) -> Iterator[str]:
    limits = joint.limits
    bounded = np.isfinite([limits.lower, limits.upper]).all()
    kind = joint.kind if bounded or joint.kind == "prismatic" else "continuous"
    yield f'  <joint name={quoteattr(joint.name)} type="{kind}">'
    yield f"    {_origin(joint.rotation, joint.translation)}"
    yield f"    <parent link={quoteattr(parent)}/>"
    yield f"    <child link={quoteattr(child)}/>"
    yield f'    <axis xyz="{numbers(joint.axis)}"/>'
    lower, upper = (v if np.isfinite(v) else np.sign(v) * 1e9 for v in (limits.lower, limits.upper))
    position = "" if kind == "continuous" else f'lower="{number(lower)}" upper="{number(upper)}" '
    effort, velocity = (v if np.isfinite(v) else 1e9 for v in (limits.effort, limits.velocity))
    yield f'    <limit {position}effort="{number(effort)}" velocity="{number(velocity)}"/>'
    if any(tags):
        yield f'    <dynamics damping="{number(tags[0])}" friction="{number(tags[1])}"/>'
    if joint.mimic is not None:
        ratio, offset = number(joint.mimic.multiplier), number(joint.mimic.offset)
        yield f'    <mimic joint={quoteattr(joint.mimic.joint)} multiplier="{ratio}" offset="{offset}"/>'
    yield "  </joint>"


def _frames(robot: Robot, links: Sequence[str]) -> Iterator[str]:
    """Yield a massless link and a fixed joint for each named frame."""
    taken = {*links}
    joints = {joint.name for joint in robot.joints}
    for name, frame in robot.frames.items():
        if name in taken:
            continue
        checked_names("frame", [name])
        taken.add(name)
        joint = unused_name(f"{name}_fixed", joints)
        joints.add(joint)
        yield f"  <link name={quoteattr(name)}/>"
        yield f'  <joint name={quoteattr(joint)} type="fixed">'
        yield f"    {_origin(frame.rotation, frame.translation)}"
        yield f"    <parent link={quoteattr(links[frame.link + 1])}/>"
        yield f"    <child link={quoteattr(name)}/>"
        yield "  </joint>"


def _origin(rotation: Array, translation: Array) -> str:
    return f'<origin xyz="{numbers(translation)}" rpy="{numbers(roll_pitch_yaw(rotation))}"/>'


def _shapes(shapes: Sequence[Shape]) -> Iterator[str]:
    for shape in shapes:
        if isinstance(shape, Sphere):
            origin, text = _origin(np.eye(3), shape.centre), f'<sphere radius="{number(shape.radius)}"/>'
        elif isinstance(shape, Box):
            origin, text = _origin(shape.rotation, shape.translation), f'<box size="{numbers(shape.size)}"/>'
        elif isinstance(shape, Cylinder):
            size = f'radius="{number(shape.radius)}" length="{number(shape.length)}"'
            origin, text = _origin(shape.rotation, shape.translation), f"<cylinder {size}/>"
        elif isinstance(shape, Capsule) and shape.length > 0 and shape.radius > 0:
            size = f'radius="{number(shape.radius)}" length="{number(shape.length)}"'
            origin, text = _origin(along(shape), 0.5 * (shape.start + shape.end)), f"<capsule {size}/>"
        else:
            continue
        yield f"    <collision>{origin}<geometry>{text}</geometry></collision>"


def along(capsule: Capsule) -> Array:
    """Return a rotation whose z axis is that of a capsule, shape (3, 3)."""
    z = (capsule.end - capsule.start) / capsule.length
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
