"""The capsules that stand for a robot in its workspace: those that cover its shapes, stated ones, joint to joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption, FileError
from dynident.excitation.collision.covering import covering_capsules
from dynident.excitation.collision.workspace import Workspace, frame_of, link_names
from dynident.model.robot import Robot
from dynident.model.shapes import Capsule, Mesh, Shape
from dynident.robot_files.meshes import mesh_file, mesh_points


def robot_capsules(robot: Robot, workspace: Workspace) -> tuple[tuple[Capsule, ...], ...]:
    """Return the capsules of the base and of each moving link, in the frames of these, 1 + l tuples.

    A link has the capsules of ``workspace.shapes``, be they none, else those that cover its shapes in the robot model,
    else, with a ``joint_radius``, those from its joint to the next ones, else none. Capsules stated for a frame come
    in addition, and so does the tool.

    Raises:
        UnknownChoice: ``shapes`` or ``tool`` name no link or frame.
        BadOption: The robot has no shapes at all and no joint radius is stated.
        FileError: A mesh that cannot be read.
        MissingDependency: A mesh in a format that needs the pin extra.
    """
    names = link_names(robot)
    _check_meshes(robot, workspace)
    added: list[list[Capsule]] = [[] for _ in names]
    for name, capsules in workspace.shapes.items():
        frame = frame_of(robot, name)
        if name not in names:
            added[frame.link + 1] += [capsule.moved(frame.rotation, frame.translation) for capsule in capsules]
    own: list[list[Capsule]] = []
    for name, shapes in zip(names, [robot.base_shapes, *(link.shapes for link in robot.links)], strict=True):
        own.append(list(workspace.shapes[name]) if name in workspace.shapes else _covered(shapes, workspace))
    if workspace.joint_radius is not None:
        for body, name in enumerate(names):
            if not own[body] and name not in workspace.shapes:
                own[body] = _joint_to_joint(robot, workspace, body - 1, workspace.joint_radius)
    if not any(own):
        step = f"'{robot.name}' has no shapes: give the radius of its links in m, or capsules by link under shapes"
        raise BadOption("joint_radius", None, step)
    if workspace.tool is not None:
        frame = workspace.tool_frame(robot)
        capsule = Capsule(np.zeros(3), workspace.tool.offset, workspace.tool.radius)
        added[frame.link + 1].append(capsule.moved(frame.rotation, frame.translation))
    return tuple((*first, *second) for first, second in zip(own, added, strict=True))


def _check_meshes(robot: Robot, workspace: Workspace) -> None:
    """Refuse a robot whose mesh files are not all there.

    Raises:
        FileError: Mesh files of links without stated shapes are missing; the message names each.
    """
    missing: dict[str, FileError] = {}
    for name, shapes in [(robot.base, robot.base_shapes), *((link.name, link.shapes) for link in robot.links)]:
        meshes = (shape for shape in shapes if isinstance(shape, Mesh) and name not in workspace.shapes)
        for mesh in meshes:
            try:
                mesh_file(mesh.file, workspace.mesh_folders)
            except FileError as problem:
                missing[f"{mesh.file} of {name}"] = problem
    if len(missing) == 1:
        raise next(iter(missing.values()))
    if missing:
        where = ", ".join(workspace.mesh_folders) or "no folder at all"
        step = "name the folders that hold them (the packages', for package://) under workspace.mesh_folders"
        raise FileError(robot.name, f"{len(missing)} mesh files are not beneath {where}: {', '.join(missing)}", step)


def _covered(shapes: Sequence[Shape], workspace: Workspace) -> list[Capsule]:
    folders = workspace.mesh_folders
    return [
        capsule for shape in shapes for capsule in covering_capsules(shape, lambda mesh: mesh_points(mesh, folders))
    ]


def _joint_to_joint(robot: Robot, workspace: Workspace, link: int, radius: float) -> list[Capsule]:
    """Return capsules from the link's joint to the next joints; a slide also gets its travel as a rod.

    A last link reaches to the tool point, or to the farthest frame on it.
    """
    ends = [joint.translation for joint in robot.joints if joint.parent == link]
    if not ends and link >= 0:
        ends = _tips(robot, workspace, link)
    if link >= 0 and robot.joints[link].kind == "prismatic":
        ends += [-at * robot.joints[link].axis for at in travel(robot)[link] if np.isfinite(at)]
    found: dict[bytes, Capsule] = {}
    for end in ends or [np.zeros(3)]:
        found.setdefault(np.round(end, 9).tobytes(), Capsule(np.zeros(3), end, radius))
    return list(found.values())


def _tips(robot: Robot, workspace: Workspace, link: int) -> list[Array]:
    frame = workspace.tool_frame(robot)
    if frame.link == link:
        offset = np.zeros(3) if workspace.tool is None else workspace.tool.offset
        tip = frame.rotation @ offset + frame.translation
        if float(np.linalg.norm(tip)) > 1e-9:
            return [tip]
    places = [frame.translation for frame in robot.frames.values() if frame.link == link]
    return [max(places, key=lambda place: float(np.linalg.norm(place)))] if places else []


def travel(robot: Robot) -> tuple[tuple[float, float], ...]:
    """Return the lowest and highest position of each link's joint, in rad or m, followers by their leaders' limits."""
    limits = {joint.name: joint.limits for joint in robot.active}
    found = []
    for joint in robot.joints:
        if joint.mimic is None:
            found.append((joint.limits.lower, joint.limits.upper))
            continue
        leader = limits[joint.mimic.joint]
        both = [joint.mimic.multiplier * at + joint.mimic.offset for at in (leader.lower, leader.upper)]
        found.append((min(both), max(both)))
    return tuple(found)
