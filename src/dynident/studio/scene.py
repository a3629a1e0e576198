"""A robot as plain data for a picture in 3D: links, joints, frames, capsules, centres of mass, inertia ellipsoids."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array, finite
from dynident.errors import DynidentError, FileError
from dynident.excitation.collision.covering import covering_capsules, robot_capsules
from dynident.excitation.collision.workspace import Workspace
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint
from dynident.model.robot import Robot
from dynident.model.shapes import Capsule, Mesh, Shape
from dynident.robot_files.meshes import mesh_file, mesh_triangles
from dynident.studio.folder import safe_name

#: Largest mesh that is drawn.
MAX_TRIANGLES = 60_000


def scene_of(
    robot: Robot, folder: Path, theta: Array | None = None, workspace: Workspace | None = None
) -> dict[str, Any]:
    """Return what a picture of a robot needs, lengths in m, angles in rad, matrices as rows.

    Args:
        robot: The robot.
        folder: Where its meshes are looked for.
        theta: Standard inertial parameters to show in place of the robot model's, shape (10 l,) at least, in the order
            of TEN; None for those of the robot model.
        workspace: Where a case states capsules of its own, or the radius of the links; None for what the robot model
            states.
    """
    notes: list[str] = []
    base, *capsules = _all_capsules(robot, folder, workspace, notes)
    active = {name: k for k, name in enumerate(robot.joint_names)}
    links = []
    for i, (link, joint) in enumerate(zip(robot.links, robot.joints, strict=True)):
        inertia = link.inertia if theta is None else Inertia.from_vector(theta[10 * i : 10 * i + 10])
        leader = joint.name if joint.mimic is None else joint.mimic.joint
        links.append(
            {
                "name": link.name,
                "fixed": list(link.fixed),
                "joint": joint.name,
                "kind": joint.kind,
                "parent": joint.parent,
                "rotation": np.asarray(joint.rotation).tolist(),
                "translation": joint.translation.tolist(),
                "axis": joint.axis.tolist(),
                "position": active[leader],
                "multiplier": 1.0 if joint.mimic is None else joint.mimic.multiplier,
                "offset": 0.0 if joint.mimic is None else joint.mimic.offset,
                "capsules": capsules[i],
                "meshes": _meshes(link.shapes, folder, link.name, notes),
                "body": _body(inertia),
            }
        )
    frames = [
        {"name": name, "link": f.link, "rotation": f.rotation.tolist(), "translation": f.translation.tolist()}
        for name, f in robot.frames.items()
    ]
    return {
        "robot": robot.name,
        "base": robot.base,
        "gravity": robot.gravity.tolist(),
        "tool": robot.tool,
        "note": robot.note,
        "joints": [_limits(joint) for joint in robot.active],
        "links": links,
        "frames": frames,
        "base_capsules": base,
        "base_meshes": _meshes(robot.base_shapes, folder, robot.base, notes),
        "notes": notes,
    }


def ellipsoid(inertia: Inertia) -> tuple[Array, Array] | None:
    """Return the half axes (3,) in m and the orientation (3, 3) of the even solid ellipsoid with this inertia.

    Its principal moments are I1 = m (b^2 + c^2) / 5 and so on, hence a^2 = 5 (I2 + I3 - I1) / (2 m).

    Returns:
        None where no body has this inertia, or none with a size.
    """
    if inertia.defect():
        return None
    moments, turn = np.linalg.eigh(inertia.about_centre)
    squares = 2.5 * (moments.sum() - 2.0 * moments) / inertia.mass
    if np.linalg.det(turn) < 0:
        turn[:, 0] *= -1.0
    return np.sqrt(np.maximum(squares, 0.0)), turn


def _body(inertia: Inertia | None) -> dict[str, Any] | None:
    if inertia is None:
        return None
    found = ellipsoid(inertia)
    return {
        "mass": float(inertia.mass),
        "centre": inertia.centre_of_mass.tolist() if inertia.mass > 0 else None,
        "axes": None if found is None else found[0].tolist(),
        "rotation": None if found is None else found[1].tolist(),
        "defect": inertia.defect(),
    }


def _limits(joint: Joint) -> dict[str, Any]:
    limits = joint.limits
    return {
        "name": joint.name,
        "kind": joint.kind,
        "unit": joint.unit,
        "lower": finite(limits.lower),
        "upper": finite(limits.upper),
        "velocity": finite(limits.velocity),
        "acceleration": finite(limits.acceleration),
        "effort": finite(limits.effort),
    }


def _all_capsules(
    robot: Robot, folder: Path, workspace: Workspace | None, notes: list[str]
) -> list[list[dict[str, Any]]]:
    """Return the capsules of the base and of each link: those that a clearance check works with, where it has them."""
    if workspace is not None:
        try:
            return [[_plain(one) for one in own] for own in robot_capsules(robot, workspace)]
        except DynidentError as error:
            notes.append(str(error).replace(str(folder), "the session"))
    owners = [(robot.base_shapes, robot.base), *((link.shapes, link.name) for link in robot.links)]
    return [_capsules(shapes, folder, name, notes) for shapes, name in owners]


def _triangles(mesh: Mesh, folder: Path) -> Array:
    """Return the triangles (k, 3, 3) of a mesh where the robot model says, or of the upload with its name."""
    try:
        mesh_file(mesh.file, [folder])
    except FileError as error:
        own = safe_name(mesh.file)
        if not (folder / own).is_file():
            raise FileError(mesh.file, "there is no such mesh among the files", "drop it here") from error
        mesh = replace(mesh, file=own)
    return mesh_triangles(mesh, [folder])


def _points(mesh: Mesh, folder: Path) -> Array:
    return np.unique(_triangles(mesh, folder).reshape(-1, 3), axis=0)


def _meshes(shapes: Sequence[Shape], folder: Path, owner: str, notes: list[str]) -> list[str]:
    """Return the triangles of each mesh of a link in its frame, 32 bit numbers in base 64; the missing are noted."""
    found = []
    for mesh in shapes:
        if not isinstance(mesh, Mesh):
            continue
        try:
            triangles = _triangles(mesh, folder) @ mesh.rotation.T + mesh.translation
        except DynidentError as error:
            note = f"{owner}: {str(error).replace(str(folder), 'the session')}"
            notes += [] if note in notes else [note]
            continue
        if len(triangles) > MAX_TRIANGLES:
            notes.append(f"{owner}: {mesh.file} has {len(triangles):,} facets; up to {MAX_TRIANGLES:,} are drawn")
            continue
        found.append(base64.b64encode(triangles.astype("<f4").tobytes()).decode())
    return found


def _capsules(shapes: Sequence[Shape], folder: Path, owner: str, notes: list[str]) -> list[dict[str, Any]]:
    found = []
    for shape in shapes:
        try:
            covering = covering_capsules(shape, lambda mesh: _points(mesh, folder))
        except DynidentError as error:
            notes.append(f"{owner}: {str(error).replace(str(folder), 'the session')}")
            continue
        found += [_plain(capsule) for capsule in covering]
    return found


def _plain(capsule: Capsule) -> dict[str, Any]:
    return {"start": capsule.start.tolist(), "end": capsule.end.tolist(), "radius": capsule.radius}
