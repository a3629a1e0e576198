"""The files of an MJCF: where includes and meshes are looked for, as MuJoCo looks for them."""

from __future__ import annotations

from pathlib import Path

import pytest

from dynident.errors import DescriptionError
from dynident.robot_files import read_robot
from dynident.robot_files.meshes import missing_meshes

mujoco = pytest.importorskip("mujoco")


def body(name: str) -> str:
    return f'<mujoco><worldbody><body name="{name}"><joint/><geom size=".1"/></body></worldbody></mujoco>'


def written(folder: Path, files: dict[str, str]) -> Path:
    """Write files, and return the one that is called main.xml."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return folder / "main.xml"


@pytest.mark.parametrize("more", [{}, {"two.xml": body("of the main folder")}])
def test_a_nested_include_is_beside_the_main_file_or_beside_the_one_that_includes_it(
    more: dict[str, str], tmp_path: Path
) -> None:
    files = {
        "main.xml": '<mujoco><include file="sub/one.xml"/></mujoco>',
        "sub/one.xml": '<mujoco><include file="two.xml"/></mujoco>',
        "sub/two.xml": body("of the folder below"),
    }
    path = written(tmp_path, files | more)
    assert read_robot(path).links[0].name == mujoco.MjModel.from_xml_path(str(path)).body(1).name


def test_a_missing_include_names_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written(tmp_path, {"main.xml": '<mujoco><include file="gone.xml"/></mujoco>'})
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DescriptionError, match=r"the file 'gone\.xml' is missing in the current folder; put it there"):
        read_robot("main.xml")


MESH = (
    '<mujoco><compiler meshdir="{}"/><asset><mesh name="m" file="m.obj"/></asset><worldbody><body><joint axis="0 1 0"/>'
    '<geom type="mesh" mesh="m" mass="3" pos=".1 .2 .3"/></body></worldbody></mujoco>'
)
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("name", ["main.xml", "../home/main.xml"])
def test_meshes_of_a_folder_beside_that_of_the_model(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("coal")
    home = tmp_path / "home"
    written(home, {"main.xml": MESH.format("../shared"), "../shared/m.obj": OBJ})
    monkeypatch.chdir(home)
    robot = read_robot(name)
    model = mujoco.MjModel.from_xml_path(name)
    assert robot.links[0].inertia is not None
    assert robot.links[0].inertia.centre_of_mass == pytest.approx(model.body_ipos[1], abs=1e-6)
    assert not missing_meshes(robot, name)


@pytest.mark.parametrize("folder", ["{}/shared", "gone", "../../../../shared"])
def test_a_mesh_that_is_not_there_has_a_remedy_that_helps(folder: str, tmp_path: Path) -> None:
    home = tmp_path / "home"
    path = written(home, {"main.xml": MESH.format(folder.format(tmp_path)), "../shared/m.obj": OBJ})
    with pytest.raises(DescriptionError) as caught:
        read_robot(path)
    remedy = "put it there, with a name relative to that folder, or write the <inertial> of the body"
    assert f"no such mesh file beneath {home}; {remedy}" in str(caught.value)


def test_a_mesh_that_is_there_and_none_has_a_remedy_that_helps(tmp_path: Path) -> None:
    path = written(tmp_path, {"main.xml": MESH.format("."), "m.obj": "no mesh"})
    with pytest.raises(DescriptionError, match=r"m.obj: .*; export it as STL, or write the <inertial> of the body"):
        read_robot(path)


def test_a_mesh_of_a_urdf_in_the_folder_beside_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    urdf = (
        '<robot name="u"><link name="a"/><link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
        'ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><mesh filename="{}"/></geometry></collision></link>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint></robot>'
    )
    written(tmp_path / "urdf", {"u.urdf": urdf.format("../meshes/m.obj"), "../meshes/m.obj": OBJ})
    monkeypatch.chdir(tmp_path / "urdf")
    assert not missing_meshes(read_robot("u.urdf"), "u.urdf")
    Path("u.urdf").write_text(urdf.format("../../../../meshes/m.obj"))
    assert [mesh.link for mesh in missing_meshes(read_robot("u.urdf"), "u.urdf")] == ["b"]
