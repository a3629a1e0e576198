"""Which reader a file gets, and what becomes of a path that is no robot model."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from dynident.errors import DescriptionError, DynidentError, FileError
from dynident.model.documents.robot_data import robot_to_dict
from dynident.robot_files import read_robot, reading, shipped_robots

URDF = """<robot name="arm"><link name="a"/><link name="b"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint></robot>"""
TABLE = "name: arm\nconvention: modified\njoints: [{a: 0, alpha: 0, d: 0}]\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def failure(path: str | Path) -> str:
    with pytest.raises(DynidentError) as caught:
        read_robot(path)
    assert isinstance(caught.value, FileError | DescriptionError)
    return str(caught.value)


@pytest.mark.parametrize("name", ["arm.urdf", "arm.URDF", "arm.xml", "arm.yaml", "arm"])
def test_xml_is_known_by_its_first_character(name: str) -> None:
    Path(name).write_bytes(b"\xef\xbb\xbf\n " + URDF.encode())
    # A byte order mark stands first in XML; without the declaration white space may follow it.
    assert read_robot(name).joint_names == ("j",)


@pytest.mark.parametrize("name", ["arm.yaml", "arm.yml", "arm.YAML"])
def test_tables_are_known_by_their_ending(name: str) -> None:
    Path(name).write_bytes(b"\xef\xbb\xbf" + TABLE.encode())
    assert read_robot(Path(name)).joint_names == ("joint1",)


def test_json_is_known_by_its_ending() -> None:
    Path("arm.json").write_text(json.dumps(robot_to_dict(read_robot("generic-7r"))))
    assert read_robot("arm.json").dof == 7


def test_a_robot_that_ships_goes_by_its_name_unless_a_file_has_it() -> None:
    Path("generic-6r").mkdir()
    assert read_robot("generic-6r").dof == 6
    assert read_robot(Path("generic-7r")).dof == 7
    Path("generic-7r").write_text(URDF)
    assert read_robot("generic-7r").name == "arm"


def test_every_robot_that_ships_has_its_own_name() -> None:
    names = shipped_robots()
    assert set(names) >= {"generic-6r", "generic-7r", "generic-scara"}
    for name in names:
        assert read_robot(name).name == name


def test_no_such_file() -> None:
    message = failure("generic-6")
    assert message == (
        "generic-6: no such file; give a file, or a built-in example robot: "
        f"{', '.join(shipped_robots())}; did you mean 'generic-6r'?"
    )
    assert failure("missing/arm.urdf") == (
        f"missing/arm.urdf: no such file; give a file, or a built-in example robot: {', '.join(shipped_robots())}"
    )


def test_folder() -> None:
    Path("arms").mkdir()
    assert failure("arms") == "arms: it is a folder; give the robot model file in it"
    assert failure("") == ".: it is a folder; give the robot model file in it"


def test_unknown_ending() -> None:
    Path("arm.step").write_text("name: arm\n")
    assert failure("arm.step") == (
        "arm.step: a file that ends with '.step' is not known; give a file that ends with one of: "
        ".yaml, .yml, .mjcf, .xml, .json, .sdf, .urdf, .xacro, .usda, .usd, .usdc, .usdz"
    )


@pytest.mark.parametrize("data", [b"", b" \n\t", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("name", ["arm.urdf", "arm.yaml", "arm.json", "arm"])
def test_empty(name: str, data: bytes) -> None:
    Path(name).write_bytes(data)
    assert failure(name) == f"{name}: the file is empty; give a URDF, MJCF, SDF or xacro, or a DH table in YAML"


def test_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path("arm.urdf").open("wb") as stream:
        stream.truncate(reading.MAX_BYTES + 1)
    assert failure("arm.urdf") == "arm.urdf: it is larger than 20 MB; give the model of one robot"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_pipe_does_not_block() -> None:
    os.mkfifo("arm.urdf")
    assert failure("arm.urdf") == "arm.urdf: it is no regular file; give a file"


def test_not_readable(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("arm.urdf").write_text(URDF)

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    assert failure("arm.urdf") == "arm.urdf: it cannot be read (Permission denied); check its permissions"


def test_nul_in_the_path() -> None:
    assert ": no such file; " in failure("arm\0.urdf")
