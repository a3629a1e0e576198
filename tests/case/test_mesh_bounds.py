"""Meshes as bounds and densities as masses, in every way that files and units go wrong, against closed forms."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from dynident import read_robot
from dynident.arrays import Array
from dynident.case.constraints_file import read_constraints
from dynident.case.link_volume import mesh_volume
from dynident.case.mesh_bounds import with_mesh_points
from dynident.cli.main import main
from dynident.errors import DescriptionError, FileError
from dynident.model.joint import rotation_about
from dynident.model.plausible import link_points, plausible_constraints, shape_points
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from dynident.robot_files.meshes import DIRECTIONS, outermost
from dynident.robot_files.solids import solid_of

SIZE = np.array([0.5, 0.14, 0.1])
CENTRE = np.array([0.2, 0.0, 0.0])
VOLUME = float(np.prod(SIZE))

ARM = """<robot name="arm"><link name="base"/>
<link name="upper">{collision}<inertial><origin xyz="0.2 0 0"/><mass value="5"/>
<inertia ixx="0.012" ixy="0" ixz="0" iyy="0.11" iyz="0" izz="0.11"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.004" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="elbow" type="revolute"><origin xyz="0.4 0 0"/><parent link="upper"/><child link="fore"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""


def box_triangles(size: Array, centre: Array) -> Array:
    """Return the twelve triangles of a box, shape (12, 3, 3), their normals outwards."""
    faces = []
    for axis in range(3):
        u, v = np.roll(np.eye(3), 1, axis=0)[axis], np.roll(np.eye(3), 2, axis=0)[axis]
        for sign in (1.0, -1.0):
            middle = sign * np.eye(3)[axis]
            ring = [middle + a * u + b * v for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))][:: int(sign)]
            if np.cross(ring[1] - ring[0], ring[2] - ring[0]) @ middle < 0:
                ring = ring[::-1]
            faces += [[ring[0], ring[1], ring[2]], [ring[0], ring[2], ring[3]]]
    return np.array(faces) * size / 2 + centre


def write_stl(path: Path, triangles: Array) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *map(float, corners.ravel()), 0) for corners in triangles)
    path.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + facets)


def arm(folder: Path, mesh: str, scale: str = "") -> tuple[Robot, str]:
    path = folder / "arm.urdf"
    path.parent.mkdir(parents=True, exist_ok=True)
    stated = f' scale="{scale}"' if scale else ""
    path.write_text(
        ARM.format(collision=f'<collision><geometry><mesh filename="{mesh}"{stated}/></geometry></collision>')
    )
    return read_robot(path), str(path)


@pytest.mark.parametrize(
    ("mesh", "place"),
    [
        ("upper.stl", "upper.stl"),
        ("meshes/upper.stl", "meshes/upper.stl"),
        ("package://arm_description/meshes/upper.stl", "../meshes/upper.stl"),
    ],
)
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_mesh_bounds_its_link_as_the_box_that_it_draws(tmp_path: Path, mesh: str, place: str, unit: float) -> None:
    folder = tmp_path / "arm_description" / "urdf"
    write_stl(folder / place, box_triangles(SIZE * unit, CENTRE * unit))
    robot, path = arm(folder, mesh, "0.001 0.001 0.001" if unit > 1 else "")
    assert not len(shape_points(robot.links[0]))
    read, faults = with_mesh_points(robot, path)
    assert faults == ()
    corners = Box(SIZE, np.eye(3), CENTRE).corners
    assert {tuple(row) for row in shape_points(read.links[0]).round(6)} == {tuple(row) for row in corners.round(6)}
    body = plausible_constraints(read).links["upper"].body_ellipsoid
    assert body is not None
    np.testing.assert_allclose(np.sort(body.semi_axes), np.sort(SIZE) / 2 * np.sqrt(3), rtol=1e-6)
    assert read.links[1] == robot.links[1]


def test_meshes_that_only_show_a_link_are_read_where_none_touches(tmp_path: Path) -> None:
    """A ball to touch with and a mesh to look at; a missing one is a fault only where the link has no other shape."""
    write_stl(tmp_path / "upper.stl", box_triangles(SIZE, CENTRE))
    look, ball = (
        '<visual><geometry><mesh filename="{}.stl"/></geometry></visual>',
        '<geometry><sphere radius="0.02"/></geometry>',
    )
    path = tmp_path / "arm.urdf"
    for collision, name, points, count in (
        (f"<collision>{ball}</collision>", "upper", 26 + 8, 0),
        (f"<collision>{ball}</collision>", "missing", 26, 0),
        ("", "upper", 8, 0),
        ("", "missing", 0, 1),
        ('<collision><geometry><mesh filename="upper.stl"/></geometry></collision>', "missing", 8, 0),
    ):
        path.write_text(ARM.format(collision=collision + look.format(name)))
        read, faults = with_mesh_points(read_robot(path), str(path))
        assert (len(shape_points(read.links[0])), len(faults)) == (points, count)


@pytest.mark.parametrize(
    ("unit", "scale", "words"),
    [
        (1000.0, "", ("529 m large", "millimetres", 'scale="0.001 0.001 0.001"')),
        (1.0, "0.001 0.001 0.001", ("0.000529 m large", 'scale="1000 1000 1000"')),
    ],
)
def test_a_mesh_in_another_unit_is_named_and_not_used(
    tmp_path: Path, unit: float, scale: str, words: tuple[str, ...]
) -> None:
    write_stl(tmp_path / "upper.stl", box_triangles(SIZE * unit, CENTRE * unit))
    robot, path = arm(tmp_path, "upper.stl", scale)
    read, (fault,) = with_mesh_points(robot, path)
    said = f"{fault.evidence}; {fault.remedy}"
    assert fault.link == "upper" and all(word in said for word in words)
    np.testing.assert_array_equal(link_points(read, 0), link_points(robot, 0))


@pytest.mark.parametrize(
    ("mesh", "content", "words"),
    [
        ("nowhere.stl", None, ("no such mesh file", "workspace.mesh_folders")),
        ("package://other/upper.stl", None, ("no such mesh file",)),
        ("upper.stl", b"solid nothing\nendsolid", ("no points",)),
        ("upper.stl", b"garbage", ("no STL", "export the mesh again")),
    ],
)
def test_a_mesh_that_cannot_be_read_is_named_and_the_frames_give_the_size(
    tmp_path: Path, mesh: str, content: bytes | None, words: tuple[str, ...]
) -> None:
    if content is not None:
        (tmp_path / "upper.stl").write_bytes(content)
    robot, path = arm(tmp_path, mesh)
    read, (fault,) = with_mesh_points(robot, path)
    said = f"{fault.evidence}; {fault.remedy}"
    assert fault.link == "upper" and all(word in said for word in words)
    np.testing.assert_array_equal(link_points(read, 0), link_points(robot, 0))


def test_an_open_mesh_has_the_hull_of_its_points(tmp_path: Path) -> None:
    write_stl(tmp_path / "upper.stl", box_triangles(SIZE, CENTRE)[2:])
    robot, path = arm(tmp_path, "upper.stl")
    read, faults = with_mesh_points(robot, path)
    assert faults == () and len(shape_points(read.links[0])) == 8


def test_few_points_stand_for_the_hull_of_many() -> None:
    generator = np.random.default_rng(0)
    points = generator.normal(size=(20_000, 3))
    points = points / np.linalg.norm(points, axis=1, keepdims=True) * np.array([0.3, 0.2, 0.1])
    few = outermost(points)
    assert len(few) <= DIRECTIONS
    others = generator.normal(size=(300, 3))
    others /= np.linalg.norm(others, axis=1, keepdims=True)
    assert np.max((points @ others.T).max(axis=0) - (few @ others.T).max(axis=0)) < 2e-3 * 0.6


def test_volumes_of_shapes() -> None:
    assert solid_of(Sphere(0.3)).mass == pytest.approx(4 / 3 * np.pi * 0.027)
    assert solid_of(Cylinder(0.1, 0.5)).mass == pytest.approx(np.pi * 0.005)
    assert solid_of(Box(SIZE)).mass == pytest.approx(VOLUME)
    pill = Capsule(np.zeros(3), np.array([0.0, 0.3, 0.4]), 0.1)
    assert solid_of(pill).mass == pytest.approx(np.pi * 0.005 + 4 / 3 * np.pi * 0.001)


def test_the_volume_of_a_mesh_depends_on_no_frame_and_no_winding() -> None:
    turn = rotation_about(np.array([0.6, 0.0, 0.8]), 0.7)
    moved = box_triangles(SIZE, CENTRE) @ turn.T + np.array([3.0, -2.0, 1.0])
    for triangles in (moved, moved[:, ::-1]):
        assert mesh_volume(triangles, "a.stl") == pytest.approx(VOLUME, rel=1e-9)
        whole = solid_of(Box(SIZE, turn, turn @ CENTRE + np.array([3.0, -2.0, 1.0])))
        np.testing.assert_allclose(solid_of(Mesh("a.stl"), triangles).pseudo, whole.pseudo, rtol=1e-9, atol=1e-12)
        lidless = solid_of(Mesh("a.stl"), triangles[2:])
        assert 0.7 * VOLUME < lidless.mass < VOLUME and lidless.is_consistent()


def constraints(folder: Path, text: str, mesh: str = "upper.stl", scale: str = "") -> tuple[float, float]:
    robot, path = arm(folder, mesh, scale)
    (folder / "known.yaml").write_text(text)
    mass = read_constraints(folder / "known.yaml", robot, path).links["upper"].mass
    return mass.low, mass.high


@pytest.mark.parametrize(("unit", "scale"), [(1.0, ""), (1000.0, "0.001 0.001 0.001")])
def test_a_density_bounds_the_mass(tmp_path: Path, unit: float, scale: str) -> None:
    write_stl(tmp_path / "upper.stl", box_triangles(SIZE * unit, CENTRE * unit))
    found = constraints(tmp_path, "links: {upper: {density: {min: 500, max: 3000}}}", scale=scale)
    assert found == pytest.approx((500 * VOLUME, 3000 * VOLUME), rel=1e-6)
    both = "links: {upper: {density: {min: 500, max: 3000}, mass: {min: 4}}}"
    assert constraints(tmp_path, both, scale=scale) == pytest.approx((4.0, 3000 * VOLUME), rel=1e-6)


@pytest.mark.parametrize(
    ("unit", "triangles", "text", "words"),
    [
        (1.0, 12, "density: {min: 500, max: 3000}, mass: 40", "500 to 3000 kg.* x 0.007 m.* of upper.*mass of 40 kg"),
        (1.0, 12, "density: -1", "densities above 0"),
        (1.0, 10, "density: 800", "open at 4 of 17 edges.*close it in a mesh program"),
        (1000.0, 12, "density: 800", "529 m large.*in millimetres.*scale=.0.001 0.001 0.001"),
    ],
)
def test_what_no_density_can_be_is_named(tmp_path: Path, unit: float, triangles: int, text: str, words: str) -> None:
    write_stl(tmp_path / "upper.stl", box_triangles(SIZE * unit, CENTRE * unit)[-triangles:])
    with pytest.raises((DescriptionError, FileError), match=words):
        constraints(tmp_path, f"links: {{upper: {{{text}}}}}")


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_inspect_names_a_mesh_in_another_unit(tmp_path: Path, unit: float, capsys: pytest.CaptureFixture[str]) -> None:
    write_stl(tmp_path / "upper.stl", box_triangles(SIZE * unit, CENTRE * unit))
    assert main(["inspect", arm(tmp_path, "upper.stl")[1]]) == 0
    shown = capsys.readouterr().out
    assert ("it is 529 m large where the frames of upper are" in shown) == (unit == 1000.0)
    assert ('in millimetres?; write scale="0.001' in shown) == (unit == 1000.0)


def test_a_link_without_shapes_and_a_missing_mesh_have_no_volume(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="no such mesh file"):
        constraints(tmp_path, "links: {upper: {density: 800}}", "nowhere.stl")
    (tmp_path / "known.yaml").write_text("links: {fore: {density: 800}}")
    with pytest.raises(DescriptionError, match=r"links.fore.density.*states no shape.*state its mass"):
        read_constraints(tmp_path / "known.yaml", read_robot(tmp_path / "arm.urdf"), str(tmp_path / "arm.urdf"))
