"""What a target cannot take as it is: names that SDF keeps, a description it does not need, followers of Pinocchio."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from identified_arms import URDF, estimate_of

from dynident.data.log import Log
from dynident.errors import BadOption, FileError
from dynident.exports.models import MODEL_EXPORTERS, export_model
from dynident.identification.estimate.estimate import Estimate
from dynident.model.robot import Robot
from dynident.robot_files.formats.urdf import read_urdf


@pytest.fixture
def on_world(planar_2r: Robot, exact_log: Callable[..., Log]) -> Estimate:
    return estimate_of(replace(planar_2r, base="world"), exact_log, exact=True)


def test_a_base_called_world_has_another_name_in_sdf(on_world: Estimate, tmp_path: Path) -> None:
    """libsdformat refuses a link that is called world, a usual root of URDFs."""
    found = export_model(on_world, "sdf", tmp_path / "arm.sdf")
    model = ElementTree.parse(tmp_path / "arm.sdf").getroot().find("model")
    assert model is not None
    assert "world" not in [element.get("name") for element in model] and model[0].get("name") == "base"
    assert "world" not in [parent.text for parent in model.iter("parent")]
    assert any("'world' is 'base'" in note for note in found.notes)
    (relative,) = (proof.relative for proof in found.proofs if proof.engine == "dynident")
    assert relative is not None and relative < 1e-12
    export_model(on_world, "drake", tmp_path / "arm.dmd.yaml")
    assert "::base" in (tmp_path / "arm.dmd.yaml").read_text()


def test_a_base_with_the_name_of_a_joint_has_another_in_sdf(
    planar_2r: Robot, exact_log: Callable[..., Log], tmp_path: Path
) -> None:
    """The base of a DH table is called base, and so may its first joint; in SDF both are frames of one room."""
    joints = (replace(planar_2r.joints[0], name="base"), *planar_2r.joints[1:])
    robot = replace(planar_2r, base="base", joints=joints)
    estimate = estimate_of(robot, lambda *a, **k: replace(exact_log(*a, **k), joints=robot.joint_names), exact=True)
    found = export_model(estimate, "sdf", tmp_path / "arm.sdf")
    model = ElementTree.parse(tmp_path / "arm.sdf").getroot().find("model")
    assert model is not None
    names = [element.get("name") for element in model]
    assert len(set(names)) == len(names) and names[0] == "base_2"
    assert [joint.get("name") for joint in model.iter("joint")] == list(robot.joint_names)
    assert any("'base' is 'base_2' here: in SDF no link has the name of a joint" in note for note in found.notes)
    export_model(estimate, "drake", tmp_path / "arm.dmd.yaml")
    assert "::base_2" in (tmp_path / "arm.dmd.yaml").read_text()


def test_a_link_with_the_name_of_a_joint_is_refused_by_sdf(on_world: Estimate, tmp_path: Path) -> None:
    robot = on_world.model.robot
    links = (replace(robot.links[0], name=robot.joint_names[1]), *robot.links[1:])
    estimate = replace(on_world, model=replace(on_world.model, robot=replace(robot, links=links)))
    with pytest.raises(BadOption, match="a link and a joint have this name"):
        export_model(estimate, "sdf", tmp_path / "arm.sdf")


@pytest.mark.parametrize("name", ["world", "__root__", "a::b"])
def test_other_names_that_sdf_keeps_are_refused(
    planar_2r: Robot, exact_log: Callable[..., Log], tmp_path: Path, name: str
) -> None:
    links = (replace(planar_2r.links[0], name=name), *planar_2r.links[1:])
    estimate = estimate_of(replace(planar_2r, links=links), exact_log, exact=True)
    with pytest.raises(BadOption, match="rename it in the robot model"):
        export_model(estimate, "sdf", tmp_path / "arm.sdf")
    assert not list(tmp_path.iterdir())


def test_a_description_is_refused_where_nothing_is_written_into_one(on_world: Estimate, tmp_path: Path) -> None:
    with pytest.raises(BadOption, match="drake is written from the estimate alone"):
        export_model(on_world, "drake", tmp_path / "arm.dmd.yaml", description=tmp_path / "other.urdf")


@pytest.mark.parametrize("mixed", [False, True])
def test_what_is_said_of_followers_is_what_pinocchio_does(
    exact_log: Callable[..., Log], tmp_path: Path, mixed: bool
) -> None:
    """Pinocchio ties no joint with bounds to a continuous one."""
    pinocchio: Any = pytest.importorskip("pinocchio")
    data = URDF.replace('joint="grip"', 'joint="shoulder"' if mixed else 'joint="a_grip"')
    data = data if mixed else data.replace('name="grip"', 'name="a_grip"')
    source = tmp_path / "own.urdf"
    source.write_text(data)
    estimate = estimate_of(read_urdf(source, source.read_bytes()), exact_log, exact=True)
    path = tmp_path / "arm.urdf"
    notes = " ".join(export_model(estimate, "pinocchio", path, description=source).notes)
    if mixed:
        assert "refuses this URDF with mimic=True" in notes
        with pytest.raises(ValueError, match="different sizes"):
            pinocchio.buildModelFromUrdf(str(path), mimic=True)
    else:
        assert "load it with mimic=True" in notes
        assert pinocchio.buildModelFromUrdf(str(path), mimic=True).nv == 3


def test_the_package_file_of_a_ros_package_stays_as_it_is(on_world: Estimate, tmp_path: Path) -> None:
    about = b'<package format="3">\n  <name>arm_description</name><depend>xacro</depend>\n</package>\n'
    (tmp_path / "package.xml").write_bytes(about)
    export_model(on_world, "drake", tmp_path / "arm.dmd.yaml")
    assert (tmp_path / "package.xml").read_bytes() == about
    assert "package://arm_description/arm.sdf" in (tmp_path / "arm.dmd.yaml").read_text()
    with pytest.raises(FileError, match="of the package 'arm_description', not 'other'"):
        export_model(on_world, MODEL_EXPORTERS.make("drake", {"package": "other"}), tmp_path / "arm.dmd.yaml")
    (tmp_path / "package.xml").write_text("<package>")
    with pytest.raises(FileError, match="names no package"):
        export_model(on_world, "drake", tmp_path / "arm.dmd.yaml")
