"""Folders of ROS packages: by the rules of ROS 1 and 2, beside the file, and nowhere else."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dynident.cli.main import main
from dynident.errors import FileError
from dynident.excitation.collision.covering import robot_capsules
from dynident.excitation.collision.workspace import Workspace
from dynident.robot_files import read_robot
from dynident.robot_files.meshes import missing_meshes, package_folders
from dynident.robot_files.ros_packages import package_folder
from two_joint_arm import URDF


@pytest.fixture(autouse=True)
def _no_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)


def package(folder: Path, name: str) -> Path:
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(f"<package format='3'>\n  <name>{name}</name>\n</package>")
    return folder


def test_beside_the_file(tmp_path: Path) -> None:
    own, other = package(tmp_path / "ws/src/arm", "arm"), package(tmp_path / "ws/src/hand", "hand")
    robot = own / "urdf" / "arm.urdf"
    assert package_folder("arm", robot) == own and package_folder("hand", robot) == other
    assert package_folder("foot", robot) is None and package_folder("arm") is None
    (tmp_path / "bare" / "urdf").mkdir(parents=True)  # a folder of that name that holds the file needs no manifest
    assert package_folder("bare", tmp_path / "bare/urdf/x.urdf") == tmp_path / "bare"
    (tmp_path / "ws/src/plain").mkdir()  # one beside it does
    assert package_folder("plain", robot) is None
    index = tmp_path / "share" / "ament_index/resource_index/packages"  # installed, with another name in the manifest
    deep = package(tmp_path / "share" / "robot-data", "robot_data") / "robots" / "arm" / "urdf" / "arm.urdf"
    assert package_folder("robot-data", deep) is None
    index.mkdir(parents=True)
    (index / "robot-data").touch()
    assert package_folder("robot-data", deep) == tmp_path / "share" / "robot-data"
    assert package_folder("../hand", robot) is None and package_folder("", robot) is None


def test_by_the_package_path_of_ros_1(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = package(tmp_path / "a/x/arm-0.1", "arm"), package(tmp_path / "b/arm", "arm")
    ignored = package(tmp_path / "b/old/leg", "leg")
    (ignored.parent / "CATKIN_IGNORE").touch()
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(map(str, (tmp_path / "a", tmp_path / "b"))))
    assert package_folder("arm") == second  # by its folder; only then by a search
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "a"))
    assert package_folder("arm") == first and package_folder("leg") is None
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(first))
    assert package_folder("arm") == first


def test_by_the_prefixes_of_ros_2(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = package(tmp_path / "install/share/arm", "arm")
    (tmp_path / "install/share/data").mkdir()
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(map(str, (tmp_path / "none", tmp_path / "install"))))
    assert package_folder("arm") == found and package_folder("data") is None


def with_meshes(*names: str) -> str:
    """Return the URDF of the arm with one mesh for each link."""
    text = URDF
    for link, name in zip(("upper", "fore"), names, strict=True):
        shape = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{shape}', 1)
    return text


def test_meshes_of_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "robots" / "arm.urdf"
    file.parent.mkdir()
    file.write_text(with_meshes("package://arm/meshes/a.stl", "b.stl"))
    robot = read_robot(file)
    assert [(m.link, m.file) for m in missing_meshes(robot, file)] == [
        ("upper", "package://arm/meshes/a.stl"),
        ("fore", "b.stl"),
    ]
    reasons = [mesh.reason for mesh in missing_meshes(robot, file)]
    assert reasons[0].startswith("no package arm beside the file or in AMENT_PREFIX_PATH (not set) or ROS_")
    assert reasons[1] == "no such file"
    folder = package(tmp_path / "elsewhere" / "arm", "arm")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "elsewhere"))
    assert package_folders(robot, file) == (folder,)
    (folder / "meshes").mkdir()
    (folder / "meshes" / "a.stl").touch()
    (file.parent / "b.stl").touch()
    assert missing_meshes(robot, file) == []


@pytest.mark.parametrize(("beside", "is_found"), [("arm", True), ("", True), ("arm/robots", True), ("other", False)])
def test_a_package_whose_folder_has_another_name(tmp_path: Path, beside: str, is_found: bool) -> None:
    file = tmp_path / "arm" / "robots" / "arm.urdf"
    file.parent.mkdir(parents=True)
    file.write_text(with_meshes("package://arm_support/meshes/a.stl", "package://arm_support/meshes/a.stl"))
    (tmp_path / beside / "meshes").mkdir(parents=True)
    (tmp_path / beside / "meshes" / "a.stl").touch()
    assert (missing_meshes(read_robot(file), file) == []) == is_found
    assert missing_meshes(read_robot(file), file, [tmp_path / beside]) == []


def test_meshes_that_only_show_a_link_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "arm.urdf"
    shown = '<visual><geometry><mesh filename="package://look/v.stl"/></geometry></visual><collision>'
    file.write_text(with_meshes("a.stl", "b.stl").replace("<collision>", shown, 1))
    package(tmp_path / "look", "look")
    assert main(["inspect", str(file)]) == 0
    told = capsys.readouterr().out
    assert "3 of 3 meshes are missing" in told and "    upper: package://look/v.stl (visual)\n" in told
    (tmp_path / "look" / "v.stl").touch()
    assert [(m.file, m.is_visual) for m in missing_meshes(read_robot(file), file)] == [
        ("a.stl", False),
        ("b.stl", False),
    ]


def test_a_check_of_clearances_names_every_missing_mesh(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(with_meshes("a.stl", "b.stl"))
    robot = read_robot(tmp_path / "arm.urdf")
    with pytest.raises(FileError, match=r"2 mesh files are not beneath .*: a\.stl of upper, b\.stl of fore; name the"):
        robot_capsules(robot, Workspace(mesh_folders=(str(tmp_path),)))
    (tmp_path / "a.stl").write_bytes(b"")
    with pytest.raises(FileError, match=r"b\.stl: no such mesh file beneath"):
        robot_capsules(robot, Workspace(mesh_folders=(str(tmp_path),)))
