"""Volumes of links from their shapes and closed meshes, and the mass that a range of densities gives them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.case.mesh_bounds import check_unit
from dynident.errors import BadOption, FileError
from dynident.model.body_constraints import ValueRange
from dynident.model.robot import Robot
from dynident.model.shapes import Mesh
from dynident.robot_files.meshes import mesh_triangles, outermost
from dynident.robot_files.solids import solid_of


def mass_of_density(
    robot: Robot, index: int, density: ValueRange, mass: ValueRange, folders: Sequence[str | Path]
) -> ValueRange:
    """Return the masses that a link of a density has, in kg, within a stated range of masses.

    The volume is the sum of the link's shapes: where they overlap it is too large.

    Args:
        robot: The robot.
        index: The link's.
        density: In kg/m^3.
        mass: In kg.
        folders: Where its meshes are.

    Raises:
        BadOption: No shapes, no density above 0, or a range of masses that no density in the range gives.
        FileError: A mesh that is not there, not readable, open, or in another unit than m.
    """
    link = robot.links[index]
    if not link.shapes:
        step = f"give shapes to {link.name} in the robot model, or state its mass"
        raise BadOption("density", link.name, f"the robot model states no shape, so the volume is not known; {step}")
    if not density.high > 0:
        raise BadOption("density", density.high, "give densities above 0 kg/m^3, such as {min: 500, max: 8000}")
    volume = 0.0
    for shape in link.shapes:
        if isinstance(shape, Mesh):
            triangles = mesh_triangles(shape, folders)
            check_unit(robot, index, shape, outermost(triangles.reshape(-1, 3)))
            volume += mesh_volume(triangles, shape.file)
        else:
            volume += solid_of(shape).mass
    low, high = max(density.low * volume, mass.low), min(density.high * volume, mass.high)
    if low > high:
        stated = f"{mass.low:g} to {mass.high:g} kg" if mass.low < mass.high else f"{mass.low:g} kg"
        evidence = f"{density.low:g} to {density.high:g} kg/m^3 x {volume:.3g} m^3 of {link.name}"
        raise BadOption("density", evidence, f"none of it has the stated mass of {stated}; correct one of the two")
    return ValueRange(low, high)


def mesh_volume(triangles: Array, name: str) -> float:
    """Return the volume inside triangles (k, 3, 3) by the divergence theorem, in m^3.

    Raises:
        FileError: The surface is open: an edge without a triangle on its other side.
    """
    number = np.unique(triangles.reshape(-1, 3).round(9), axis=0, return_inverse=True)[1].reshape(-1, 3)
    number = number[(number != np.roll(number, 1, axis=1)).all(axis=1)]  # triangles without an area
    edges = np.sort(np.concatenate([number[:, [0, 1]], number[:, [1, 2]], number[:, [2, 0]]]), axis=1)
    sides = np.unique(edges, axis=0, return_counts=True)[1]
    if lone := int(np.sum(sides % 2)):
        step = "close it in a mesh program, or state the mass in place of the density"
        raise FileError(name, f"the mesh is open at {lone} of {len(sides)} edges: it has no volume", step)
    return abs(float(np.sum(np.einsum("ki,ki->k", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))))) / 6.0
