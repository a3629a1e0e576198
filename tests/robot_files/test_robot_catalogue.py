"""Robots by the names of robot_descriptions: from its cache, and a line to type where it is not there."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dynident.errors import FileError
from dynident.robot_files import read_robot
from two_joint_arm import URDF

#: The package in small: a module clones its repository as the real ones do, unless the cache has it.
_MODULE = """
import os, git
_cache = os.environ["ROBOT_DESCRIPTIONS_CACHE"]
if not os.path.isdir(_cache + "/arm"):
    print("Cloning ..."); git.Repo.clone_from("https://example.org/arm", _cache + "/arm")
print("a line that is no path")
"""


#: Fixes the link of a file that is included.
_FIXED = (
    '<joint name="fixed" type="fixed"><parent link="fore"/><child link="from_package"/><origin xyz="0 0 0"/></joint>'
)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package robot_descriptions whose cache has the repository of its robots."""
    for name, text in {
        "robot_descriptions/__init__.py": "",
        "robot_descriptions/arm_description.py": _MODULE + 'URDF_PATH = _cache + "/arm/arm.urdf"\n',
        "robot_descriptions/hand_description.py": _MODULE
        + 'XACRO_PATH = _cache + "/arm/hand.xacro"\nXACRO_ARGS = {"speed": "7"}\n'
        + 'XACRO_PACKAGE_PATHS = {"parts": _cache + "/arm/inside"}\n',
        "robot_descriptions/leg_mj_description.py": _MODULE + 'MJCF_PATH = _cache + "/arm/leg.xml"\n',
        "git/__init__.py": "class Repo:\n    @staticmethod\n    def clone_from(*_): open('cloned', 'w').close()\n",
        "cache/arm/arm.urdf": URDF,
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "robot_descriptions"]:
        monkeypatch.delitem(sys.modules, name)
    return tmp_path


def test_a_robot_by_its_name(package: Path) -> None:
    (package / "own.urdf").write_text(URDF)
    assert read_robot("arm_description").joint_names == read_robot("own.urdf").joint_names
    assert read_robot("arm_description").note == "read from arm.urdf"


def test_a_file_of_that_name_goes_first(package: Path) -> None:
    (package / "arm_description").write_text("<nothing/>")
    with pytest.raises(Exception, match=r"arm_description: .*<nothing>"):
        read_robot("arm_description")


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("amr_description", "one of the 3 robots of robot_descriptions; .*; did you mean 'arm_description'"),
        ("leg_mj_description", r"leg\.xml: no such file"),
    ],
)
def test_names_that_give_no_robot(name: str, told: str, package: Path) -> None:
    with pytest.raises(FileError, match=told):
        read_robot(name)


def test_a_xacro_with_the_arguments_and_packages_of_the_catalogue(package: Path) -> None:
    pytest.importorskip("xacro", reason="xacro files need the package xacro (extra xacro)")
    (package / "cache/arm/inside").mkdir()
    (package / "cache/arm/inside/speed.xacro").write_text('<robot><link name="from_package"/></robot>')
    macro = '<xacro:arg name="speed" default="1"/><xacro:include filename="$(find parts)/speed.xacro"/>'
    text = URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    text = text.replace(">", f">{macro}", 1) if not text.startswith("<?") else text
    text = text.replace('velocity="3"', 'velocity="$(arg speed)"', 1)
    text = text.replace("</robot>", _FIXED + "</robot>")
    (package / "cache/arm/hand.xacro").write_text(text)
    found = read_robot("hand_description")
    assert found.joints[0].limits.velocity == 7.0 and "from_package" in found.frames
    assert read_robot("hand_description speed:=2").joints[0].limits.velocity == 2.0


def test_nothing_is_fetched(package: Path) -> None:
    (package / "cache" / "arm").rename(package / "cache" / "other")
    with pytest.raises(FileError, match=r"does not have this robot .*: robot_descriptions pull arm_desc"):
        read_robot("arm_description")
    assert not (package / "cloned").exists()


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr("dynident.robot_files.reading.find_spec", lambda name: None)
    with pytest.raises(FileError, match="pip install robot_descriptions; robot_descriptions pull panda_description"):
        read_robot("panda_description")


def test_the_package_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With robot_descriptions installed: its own module and git find a clone at a commit, and clone none."""
    pytest.importorskip("robot_descriptions", reason="robot_descriptions is not installed: pip install it")
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path))
    monkeypatch.delenv("ROBOT_DESCRIPTION_COMMIT", raising=False)
    with pytest.raises(FileError, match="robot_descriptions pull panda_description"):
        read_robot("panda_description")
    assert list(tmp_path.iterdir()) == []
    made = tmp_path / "made"
    file = made / "robots" / "panda_description" / "urdf" / "panda.urdf"
    file.parent.mkdir(parents=True)
    file.write_text(URDF)
    author = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    for command in (["init", "-q"], ["add", "-A"], [*author, "commit", "-q", "-m", "robots"]):
        subprocess.run(["git", "-C", str(made), *command], check=True)
    found = subprocess.run(["git", "-C", str(made), "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
    commit = found.stdout.strip()
    target = tmp_path / f"example-robot-data-{commit}" / "example-robot-data"
    target.parent.mkdir()
    made.rename(target)
    monkeypatch.setenv("ROBOT_DESCRIPTION_COMMIT", commit)
    assert read_robot("panda_description").dof == 2
