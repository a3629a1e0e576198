"""Mesh files: found beneath stated folders only, read as STL and MSH here and as anything else by coal."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest

from dynident.errors import FileError, MissingDependency
from dynident.model.shapes import Box, Mesh
from dynident.robot_files import meshes
from dynident.robot_files.meshes import mesh_file, mesh_points

CORNERS = Box(np.array([0.5, 0.25, 1.0])).corners  # exact in 32 bits
FACES = [(0, 1, 2), (2, 1, 3), (4, 5, 6), (6, 5, 7), (0, 4, 1), (2, 3, 6)]


def binary_stl(faces: int = len(FACES)) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *np.ravel(CORNERS[list(face)]), 0) for face in FACES]
    return b"solid looks like text".ljust(80) + struct.pack("<I", faces) + b"".join(rows)


def text_stl() -> bytes:
    lines = ["solid box"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in CORNERS[list(face)])]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid"]).encode()


def msh(last: int = 0) -> bytes:
    """Return MuJoCo's binary format with normals, without texture; ``last`` is added to the last corner."""
    faces = np.array(FACES, "<i4")
    faces[-1, -1] += last
    corners = np.array(CORNERS, "<f4").tobytes()
    return struct.pack("<4i", len(CORNERS), len(CORNERS), 0, len(FACES)) + 2 * corners + faces.tobytes()


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a folder with arm/urdf, arm/meshes/box.stl, and a secret beside it."""
    (tmp_path / "arm" / "urdf").mkdir(parents=True)
    (tmp_path / "arm" / "meshes").mkdir()
    (tmp_path / "arm" / "meshes" / "box.stl").write_bytes(binary_stl())
    (tmp_path / "secret.stl").write_bytes(binary_stl())
    return tmp_path


@pytest.mark.parametrize(
    ("data", "name"),
    [(binary_stl(), "box.STL"), (text_stl(), "box.STL"), (msh(), "box.msh")],
    ids=["stl", "text", "msh"],
)
def test_the_corners_of_a_mesh(data: bytes, name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    points = mesh_points(Mesh(name, np.array([2.0, 1.0, -1.0])), [tmp_path])
    assert {tuple(row) for row in points} == {tuple(row) for row in CORNERS * [2.0, 1.0, -1.0]}


def test_other_formats_by_coal(tmp_path: Path) -> None:
    pytest.importorskip("coal")
    lines = [*(f"v {x} {y} {z}" for x, y, z in CORNERS), *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES)]
    (tmp_path / "box.obj").write_text("\n".join(lines) + "\n")
    points = mesh_points(Mesh("box.obj"), [tmp_path])
    assert {tuple(row) for row in points} == {tuple(row) for row in CORNERS}
    (tmp_path / "box.dae").write_text("no mesh")
    with pytest.raises(FileError, match=r"box.dae: it cannot be read as a mesh .*export it as STL"):
        mesh_points(Mesh("box.dae"), [tmp_path])


def test_without_coal_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "box.dae").write_text("")
    monkeypatch.setitem(sys.modules, "coal", None)
    with pytest.raises(MissingDependency, match=r"reading the mesh 'box.dae' needs .*pip install 'dynident\[pin\]'"):
        mesh_points(Mesh("box.dae"), [tmp_path])


@pytest.mark.parametrize(
    ("name", "folders"),
    [
        ("box.stl", ["arm/meshes"]),
        ("meshes/box.stl", ["arm/urdf", "arm"]),
        ("urdf/../meshes/box.stl", ["arm"]),
        ("package://arm/meshes/box.stl", ["arm"]),
        ("package://arm/meshes/box.stl", ["."]),
        ("package://arm_support/meshes/box.stl", ["arm/urdf", "arm"]),  # its folder has another name
        ("file://{}/arm/meshes/box.stl", ["arm"]),
        ("{}/arm/meshes/box.stl", ["arm"]),
    ],
)
def test_names_that_lead_to_the_file(name: str, folders: list[str], package: Path) -> None:
    found = mesh_file(name.format(package), [package / folder for folder in folders])
    assert found == (package / "arm/meshes/box.stl").resolve()


@pytest.mark.parametrize(
    "name",
    [
        "../secret.stl",
        "meshes/../../secret.stl",
        "package://arm/../secret.stl",
        "package://../secret.stl",
        "package://arm//../../secret.stl",
        "file://{}/secret.stl",
        "{}/secret.stl",
        "link.stl",
        "meshes",
        "no.stl",
        "",
        "package://",
        "https://example.org/box.stl",
        "a\0b",
    ],
)
def test_names_that_lead_nowhere_or_outside(name: str, package: Path) -> None:
    (package / "arm" / "link.stl").symlink_to(package / "secret.stl")
    with pytest.raises(FileError, match=r"no such mesh file beneath .*mesh_folders"):
        mesh_file(name.format(package), [package / "arm"])


def test_without_folders_there_is_no_file(package: Path) -> None:
    with pytest.raises(FileError, match="beneath no folder at all"):
        mesh_file(str(package / "secret.stl"), [])


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "it is no STL"),
        (b"nonsense" * 20, r"its 160 bytes are no STL of \d+ facets"),
        (binary_stl(7), "no STL of 7 facets|it has no points"),
        (binary_stl()[:-1], "no STL of 6 facets|it has no points"),
        (b"solid x\nvertex 1 2 c\n", "a vertex is no three numbers"),
        (b"solid x\nendsolid x\n", "it has no points"),
        (b"solid x\nvertex 1 2 nan\n", "points that are no numbers"),
    ],
)
def test_damaged_files(data: bytes, why: str, tmp_path: Path) -> None:
    (tmp_path / "box.stl").write_bytes(data)
    with pytest.raises(FileError, match=why):
        mesh_points(Mesh("box.stl"), [tmp_path])


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "its 0 bytes are no MSH of MuJoCo; export the mesh again, as binary STL"),
        (msh()[:-1], "are no MSH"),
        (struct.pack("<4i", -4, 4, 0, 0), "its 16 bytes are no MSH"),
        (msh(2), "a face has a corner that is no vertex"),
        (msh(-10), "a face has a corner that is no vertex"),
        (struct.pack("<4i", 0, 0, 0, 1) + bytes(12), "a face has a corner that is no vertex"),
        (struct.pack("<4i", 0, 0, 0, 0), "it has no points"),
    ],
)
def test_damaged_files_of_mujoco(data: bytes, why: str, tmp_path: Path) -> None:
    (tmp_path / "box.msh").write_bytes(data)
    with pytest.raises(FileError, match=why):
        mesh_points(Mesh("box.msh"), [tmp_path])


def test_a_file_that_is_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "box.stl").write_bytes(binary_stl())
    monkeypatch.setattr(meshes, "MAX_BYTES", 100)
    with pytest.raises(FileError, match="it is larger than"):
        mesh_points(Mesh("box.stl"), [tmp_path])
