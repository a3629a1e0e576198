"""Constraints as they are written: every key, and every fault with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynident.case.constraints_file import read_constraints
from dynident.errors import DescriptionError, FileError
from dynident.model.body_constraints import ValueRange
from dynident.model.robot import Robot

WHOLE = """
total_mass: {min: 4, max: 6}
links:
  link1:
    mass: 3
    centre: {box: [[0, -0.1, 0], [0.3, 0.1, 0]], hull: [[0, 0, 0], [1, 0, 0], [0, 1, 0]]}
    body: {box: [[0, -1, -1], [1, 1, 1]], ellipsoid: {centre: [0.2, 0, 0], semi_axes: [1, 0.5, 0.5], rpy: [0, 0, pi/2]}}
  link2:
    mass: {max: 2.5}
    symmetry: {y: 0, z: 0.1}
    thickness: 0.02
fixed: {"Fv[joint1]": 0.5}
"""


def write(folder: Path, text: str) -> Path:
    file = folder / "known.yaml"
    file.write_text(text)
    return file


def test_every_key(tmp_path: Path, planar_2r: Robot) -> None:
    found = read_constraints(write(tmp_path, WHOLE), planar_2r)
    assert found.total_mass == ValueRange(4.0, 6.0) and found.fixed == {"Fv[joint1]": 0.5}
    first, second = found.links["link1"], found.links["link2"]
    assert first.mass.low == first.mass.high == 3.0 and second.mass == ValueRange(-np.inf, 2.5)
    assert first.centre_box is not None and first.centre_box.upper.tolist() == [0.3, 0.1, 0.0]
    assert first.centre_hull is not None and first.centre_hull.shape == (3, 3)
    assert first.body_box is not None and first.body_ellipsoid is not None
    np.testing.assert_allclose(first.body_ellipsoid.quadric[:2, :2], [[-4.0, 0], [0, -1.0]], atol=1e-12)  # turned
    assert second.symmetry == {"y": 0.0, "z": 0.1} and second.thickness == 0.02 and first.thickness == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("links: {link9: {mass: 1}}", "unknown key 'link9'; known keys: link1, link2; did you mean 'link"),
        ("links: {link1: {mas: 1}}", "unknown key 'mas'.*did you mean 'mass'"),
        ("total_mass: {min: 3, max: 2}", "line 1, total_mass: .*must not be above"),
        ("links: {link1: {mass: -1}}", "links.link1.mass: .*a mass is above 0"),
        ("links: {link1: {centre: {box: [[0, 0, 0]]}}}", "links.link1.centre.box: 2 rows are needed"),
        ("links: {link1: {thickness: -1}}", "links.link1.thickness: .*a length of 0 or more in m"),
        ("links: {link1: {centre: {hull: []}}}", "links.link1.centre.hull: no list of points"),
        ("links: {link1: {body: {ellipsoid: {semi_axes: [1, 1, 0]}}}}", "semi_axes: .*three lengths above 0"),
        ("links: {link1: {symmetry: {w: 0}}}", "unknown key 'w'; known keys: x, y, z"),
        ("fixed: {a: b}", "fixed.a: 'b' is not a number"),
    ],
)
def test_faults_have_their_place(text: str, message: str, tmp_path: Path, planar_2r: Robot) -> None:
    with pytest.raises(DescriptionError, match=message):
        read_constraints(write(tmp_path, text), planar_2r)


def test_a_file_that_is_not_there(tmp_path: Path, planar_2r: Robot) -> None:
    with pytest.raises(FileError):
        read_constraints(tmp_path / "none.yaml", planar_2r)
