"""Capsules that cover a shape: what clearance checks work with, since a shape in them is safe where they are.

Every capsule returned here contains its shape, by construction and up to rounding; how tight it is decides only how
near the robot may come. Of all capsules about a given axis the one of least volume is taken.

A robot stands in its workspace as capsules: those that cover its shapes, stated ones, or from joint to joint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array
from dynident.errors import BadOption, FileError
from dynident.excitation.collision.workspace import Workspace, frame_of, link_names
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from dynident.robot_files.meshes import mesh_file, mesh_points

#: Largest number of parallel capsules that cover one flat box.
MAX_STRIPS: Final = 4

#: Number of radii that are tried for one axis, and share by which a fitted radius is widened against rounding.
_TRIALS: Final = 257
_ROUNDING: Final = 1e-9


def covering_capsules(shape: Shape, points: Callable[[Mesh], Array] | None = None) -> tuple[Capsule, ...]:
    """Return capsules whose union contains a shape, in the same frame.

    A sphere and a capsule are their own cover. A cylinder gets one capsule about its axis, a box one along its longest
    edge, or up to :data:`MAX_STRIPS` side by side where it is flat. A mesh gets one that is fitted to its points.

    Args:
        shape: The shape.
        points: Returns the points (k, 3) of a mesh, scaled, in the mesh's own frame; see meshes.py.

    Raises:
        BadOption: A mesh, and no way to read its points.
    """
    if isinstance(shape, Capsule):
        return (shape,)
    if isinstance(shape, Sphere):
        return (Capsule(shape.centre, shape.centre, shape.radius),)
    if isinstance(shape, Cylinder):
        half, radius = snug(0.5 * shape.length, shape.radius)
        tip = np.array([0.0, 0.0, half])
        return (Capsule(-tip, tip, radius).moved(shape.rotation, shape.translation),)
    if isinstance(shape, Box):
        return tuple(capsule.moved(shape.rotation, shape.translation) for capsule in _strips(shape.size))
    if points is None:
        raise BadOption("mesh", shape.file, "state the folder of the mesh files")
    return (fitted_capsule(points(shape)).moved(shape.rotation, shape.translation),)


def snug(half_length: float, reach: float) -> tuple[float, float]:
    """Return half the segment's length and the radius of the capsule of least volume around a cylinder.

    It passes through the rims: radius^2 = (half_length - half)^2 + reach^2.

    Args:
        half_length: Half the length of the cylinder, in m.
        reach: Its radius, in m.
    """
    half = np.linspace(0.0, half_length, _TRIALS)
    radius = np.hypot(half_length - half, reach)
    best = int(np.argmin(radius**2 * (2.0 * half + 4.0 / 3.0 * radius)))
    return float(half[best]), float(radius[best])


def _strips(size: Array) -> list[Capsule]:
    """Return capsules along the longest edge of a box about the origin, side by side along its second longest."""
    thin, wide, long = np.argsort(size, kind="stable")
    count = int(np.clip(round(float(size[wide] / size[thin])), 1, MAX_STRIPS))
    width = size[wide] / count
    half, radius = snug(0.5 * float(size[long]), 0.5 * float(np.hypot(width, size[thin])))
    found = []
    for k in range(count):
        centre, tip = np.zeros(3), np.zeros(3)
        centre[wide] = (k + 0.5) * width - 0.5 * size[wide]
        tip[long] = half
        found.append(Capsule(centre - tip, centre + tip, radius))
    return found


def fitted_capsule(points: npt.ArrayLike) -> Capsule:
    """Return a capsule of small volume that contains all points, hence their convex hull.

    The principal axes of the points are the first guesses of its axis; the best one is refined by the simplex search
    of Nelder and Mead (1965) over direction, place and radius. Whatever the search does, the result contains the
    points: the segment follows from them.

    Args:
        points: Shape (k, 3), in m.

    Raises:
        ValueError: No points, or values that are not finite.
    """
    cloud = np.asarray(points, dtype=float)
    if cloud.ndim != 2 or cloud.shape[1] != 3 or not len(cloud) or not np.all(np.isfinite(cloud)):
        raise ValueError(f"points have shape {cloud.shape}, expected (k, 3) with finite values")
    hull = _hull(cloud)
    middle = 0.5 * (hull.min(axis=0) + hull.max(axis=0))
    away = hull - middle
    size = float(np.abs(away).max())
    if size == 0.0:
        return Capsule(middle, middle, 0.0)
    frames = np.linalg.svd(away - away.mean(axis=0))[2]
    choices = [_about(away / size, np.roll(frames, -k, axis=0), np.zeros(5)) for k in range(3)]
    first = int(np.argmin([capsule.volume for capsule in choices]))
    frame = np.roll(frames, -first, axis=0)
    from scipy.optimize import minimize  # scipy loads with the first mesh

    found = minimize(
        lambda x: _about(away / size, frame, x).volume,
        np.zeros(5),
        method="Nelder-Mead",
        options={"maxfev": 600, "initial_simplex": 0.2 * np.vstack([np.zeros(5), np.eye(5)]), "fatol": 1e-6},
    )
    best = min(choices[first], _about(away / size, frame, found.x), key=lambda capsule: capsule.volume)
    exact = Capsule(size * best.start + middle, size * best.end + middle, size * best.radius)
    beyond = max(0.0, float(exact.distances(hull).max()))
    return Capsule(exact.start, exact.end, exact.radius + beyond + _ROUNDING * size)


def _about(points: Array, frame: Array, x: Array) -> Capsule:
    """Return the capsule about the line that ``x`` tilts (2), shifts (2) and widens (1), through all points."""
    axis = frame[0] + x[0] * frame[1] + x[1] * frame[2]
    axis = axis / np.linalg.norm(axis)
    origin = x[2] * frame[1] + x[3] * frame[2]
    along = (points - origin) @ axis
    square = np.sum((points - origin) ** 2, axis=1) - along**2
    radius = float(np.sqrt(max(square.max(), 0.0) + x[4] ** 2))
    spare = np.sqrt(np.maximum(radius**2 - square, 0.0))
    start, end = float((along + spare).min()), float((along - spare).max())
    if start > end:  # one ball is enough
        start = end = 0.5 * (start + end)
    return Capsule(origin + start * axis, origin + end * axis, radius)


def _hull(cloud: Array) -> Array:
    """Return the corners of the convex hull, or all points where they are flat or few."""
    if len(cloud) < 5:
        return cloud
    from scipy.spatial import ConvexHull, QhullError

    try:
        return cloud[ConvexHull(cloud).vertices]
    except QhullError:  # flat, or all on a line
        return cloud


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
