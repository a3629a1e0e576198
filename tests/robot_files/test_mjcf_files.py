"""The files of an MJCF: where includes and meshes are looked for, as MuJoCo looks for them."""

from __future__ import annotations

from pathlib import Path

import pytest

from dynident.errors import DescriptionError
from dynident.robot_files import read_robot

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
