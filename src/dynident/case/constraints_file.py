"""What is known about bodies, as it is written: the section ``constraints`` of a case file, or a file of its own.

Keys: links (by name: mass, density, centre, body, symmetry, thickness), total_mass, fixed; see docs/case-file.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.case.case_values import guarded
from dynident.files import bytes_of
from dynident.model.body_constraints import AXES, BodyConstraints, BoundingBox, Constraints, Ellipsoid, ValueRange
from dynident.model.documents.sections import Section
from dynident.model.robot import Robot
from dynident.robot_files.rotations import rotation_from_rpy
from dynident.robot_files.strict_yaml import load_yaml

KEYS = ("links", "total_mass", "fixed")
_LINK_KEYS = ("mass", "density", "centre", "body", "symmetry", "thickness")


def read_constraints(path: str | Path, robot: Robot, robot_path: str = "") -> Constraints:
    """Read a file with what is known about the bodies of a robot.

    Args:
        path: YAML with the keys of the case file's section ``constraints``.
        robot: The robot, locked joints merged.
        robot_path: Its robot model, beside which meshes are read where a density is stated.

    Raises:
        FileError: The file cannot be read.
        DescriptionError: A fault in it, with the line and the key.
    """
    value, lines = load_yaml(path, bytes_of(path))
    return constraints_of(Section.top(path, value, KEYS, lines), robot, robot_path)


def constraints_of(section: Section, robot: Robot, robot_path: str = "") -> Constraints:
    """Return what a section with the keys links, total_mass and fixed states.

    Raises:
        DescriptionError: A link that the robot does not have, or a value that cannot be.
    """
    links = section.section("links", [link.name for link in robot.links]) if section.has("links") else None
    from dynident.robot_files.meshes import mesh_places  # few cases need it

    places = mesh_places(robot, robot_path) if robot_path else ()
    found = {
        link.name: _body(links.section(link.name, _LINK_KEYS), robot, i, places)
        for i, link in enumerate(robot.links)
        if links is not None and links.has(link.name)
    }
    total = _range(section, "total_mass")
    fixed: dict[str, float] = {}
    if section.has("fixed"):
        stated = section.values["fixed"]
        keys = [str(key) for key in stated] if isinstance(stated, dict) else []
        inner = section.section("fixed", keys)
        fixed = {key: inner.number(key) for key in keys}
    return Constraints(found, total, fixed)


def _body(section: Section, robot: Robot, index: int, folders: Sequence[str | Path]) -> BodyConstraints:
    centre_box = centre_hull = body_box = ellipsoid = None
    if section.has("centre"):
        centre = section.section("centre", ("box", "hull"))
        centre_box = _box(centre) if centre.has("box") else None
        centre_hull = _hull(centre) if centre.has("hull") else None
    if section.has("body"):
        body = section.section("body", ("box", "ellipsoid"))
        body_box = _box(body) if body.has("box") else None
        ellipsoid = _ellipsoid(body) if body.has("ellipsoid") else None
    symmetry: dict[str, float] = {}
    if section.has("symmetry"):
        planes = section.section("symmetry", AXES)
        symmetry = {axis: planes.number(axis) for axis in AXES if planes.has(axis)}
    mass, thickness = _range(section, "mass"), section.number("thickness", 0.0)
    if section.has("density"):
        from dynident.case.link_volume import mass_of_density  # few cases need it

        density = _range(section, "density")
        mass = guarded(
            section.place("density"), lambda stated=mass: mass_of_density(robot, index, density, stated, folders)
        )
    key = "thickness" if thickness < 0 else "mass" if section.has("mass") else ""
    return guarded(
        section.place(key),
        lambda: BodyConstraints(mass, centre_box, centre_hull, body_box, ellipsoid, symmetry, thickness),
    )


def _range(section: Section, key: str) -> ValueRange:
    """Return a range that is written as one number, or as {min: a, max: b} with either left out."""
    if not section.has(key):
        return ValueRange()
    if not isinstance(section.values[key], dict):
        value = section.number(key)
        return ValueRange(value, value)
    inner = section.section(key, ("min", "max"))
    low = inner.number("min", -np.inf) if inner.has("min") else -np.inf
    high = inner.number("max", np.inf) if inner.has("max") else np.inf
    return guarded(section.place(key), lambda: ValueRange(low, high))


def _box(section: Section) -> BoundingBox:
    corners = section.matrix("box", 2, 3)
    return guarded(section.place("box"), lambda: BoundingBox(corners[0], corners[1]))


def _hull(section: Section) -> Array:
    value = section.value("hull")
    if not isinstance(value, list) or not value:
        raise section.place("hull").error("no list of points", "write a list of points [x, y, z] in m")
    return section.matrix("hull", len(value), 3)


def _ellipsoid(section: Section) -> Ellipsoid:
    inner = section.section("ellipsoid", ("centre", "semi_axes", "rpy"))
    centre = inner.numbers("centre", 3, (0.0, 0.0, 0.0))
    axes = inner.numbers("semi_axes", 3)
    turn = rotation_from_rpy(inner.numbers("rpy", 3, (0.0, 0.0, 0.0)))
    return guarded(inner.place("semi_axes"), lambda: Ellipsoid(centre, axes, turn))
