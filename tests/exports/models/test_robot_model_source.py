"""The robot model that an export goes into: found from any folder, and named where it is not found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from identified_arms import estimate_of

from dynident.data.log import Log
from dynident.errors import DescriptionError, FileError
from dynident.exports.models import export_model, own_target
from dynident.exports.models.subject.source import files_of, find_source
from dynident.files import sha256_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.files.estimate_file import read_estimate, write_estimate
from dynident.robot_files import read_robot
from dynident.robot_files.robot_origin import is_unchanged, robot_facts

MJCF = """<mujoco><worldbody><body name="arm"><joint name="a" axis="0 1 0"/><geom size=".1" pos=".2 .1 0"/>
<body name="fore" pos=".3 0 0"><joint name="b" axis="1 1 0"/><geom type="box" size=".1 .2 .05"/></body></body>
</worldbody></mujoco>"""
SDF = """<sdf version="1.9"><model name="arm">
<link name="base"/><joint name="w" type="fixed"><parent>world</parent><child>base</child></joint>
<link name="arm"><inertial><pose>.2 .1 0 0 0 0</pose><mass>2</mass><inertia><ixx>.1</ixx><iyy>.1</iyy><izz>.1</izz>
</inertia></inertial></link>
<joint name="a" type="revolute"><parent>base</parent><child>arm</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>"""
FORMATS = {"mjcf": ("arm.xml", MJCF, "identified.xml"), "sdf": ("arm.sdf", SDF, "identified.sdf")}


@pytest.fixture(params=FORMATS)
def saved(
    request: pytest.FixtureRequest, tmp_path: Path, exact_log: Callable[..., Log], monkeypatch: pytest.MonkeyPatch
) -> tuple[str, Path, Estimate]:
    """Return a format, the folder of a robot, and its estimate, identified there and saved in a folder below."""
    name, text, _ = FORMATS[request.param]
    home = tmp_path / "home"
    (home / "results").mkdir(parents=True)
    (home / name).write_text(text)
    facts: Any = {"robot": {"path": name, "sha256": sha256_of(home / name)}}
    estimate = replace(estimate_of(read_robot(home / name), exact_log, exact=True), provenance=facts)
    write_estimate(estimate, home / "results" / "est.json")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return request.param, home, read_estimate(home / "results" / "est.json")


def test_the_robot_model_is_found_from_another_folder(saved: tuple[str, Path, Estimate]) -> None:
    kind, home, estimate = saved
    name, text, output = FORMATS[kind]
    found = export_model(estimate, kind, output)
    assert f"robot model: {home / name}" in found.notes and "no robot model file" not in " ".join(found.notes)
    lines, own = Path(output).read_text().splitlines(), text.splitlines()
    assert (lines[0].split("<body")[0], lines[-1]) == (own[0].split("<body")[0], own[-1])
    target = own_target(estimate)
    assert (target.name, target.ending, target.is_lost) == (kind, Path(output).suffix, False)


@pytest.mark.parametrize("is_changed", [True, False])
def test_a_robot_model_that_is_not_found_is_said_to_be_lost(
    is_changed: bool, saved: tuple[str, Path, Estimate]
) -> None:
    kind, home, estimate = saved
    name, text, output = FORMATS[kind]
    (home / name).unlink()
    if is_changed:
        (home / name).write_text(text + "\n")
    found = export_model(estimate, kind, output)
    lost = rf"({name}, which was identified, is not there or has changed, or an include of it)"
    note = f"no robot model file was given or found {lost}: the {kind.upper()} is new"
    assert any(one.startswith(note) and "--description FILE" in one for one in found.notes)
    assert own_target(estimate) == (kind, Path(output).suffix, True)


def test_the_robot_model_is_not_overwritten_from_another_folder(saved: tuple[str, Path, Estimate]) -> None:
    kind, home, estimate = saved
    with pytest.raises(FileError, match="it is an input of this command and would be overwritten"):
        export_model(estimate, kind, home / FORMATS[kind][0])
    with pytest.raises(FileError, match="it is an input of this command and would be overwritten"):
        export_model(estimate, "c_header", home / FORMATS[kind][0])


LINK = SDF[SDF.index("<inertial>") : SDF.index('</link>\n<joint name="a"')]
BODIES = MJCF[MJCF.index("<body") : MJCF.index("</worldbody>")]
GEOM = '<geom size=".1" pos=".2 .1 0"/>'
#: A main file, and two files: one that it includes, and one that this includes or that holds values.
WITH_INCLUDES = {
    "arm.xml": (
        '<mujoco><worldbody><include file="fore.xml"/></worldbody></mujoco>',
        f'<mujocoinclude><include file="more.xml"/>{BODIES}</mujocoinclude>',
        "<mujocoinclude><site name='s'/></mujocoinclude>",
    ),
    "arm.sdf": (
        '<sdf version="1.9"><model name="arm"><link name="base"/><include><uri>fore.xml</uri></include>'
        '<joint name="a" type="revolute"><parent>base</parent><child>n::l</child><axis><xyz>0 1 0</xyz></axis></joint>'
        "</model></sdf>",
        f'<sdf version="1.9"><model name="n"><link name="l">{LINK}</link><include><uri>more.xml</uri></include>'
        '<joint name="f" type="fixed"><parent>l</parent><child>m::l</child></joint></model></sdf>',
        f'<sdf version="1.9"><model name="m"><link name="l">{LINK}</link></model></sdf>',
    ),
    "arm.urdf.xacro": (
        '<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="fore.xml"/>'
        '<xacro:property name="v" value="${xacro.load_yaml(\'more.xml\')}"/><link name="base"/>'
        '<xacro:fore mass="${v[0]}"/>'
        "</robot>",
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="fore" params="mass"><link name="l">'
        '<inertial><mass value="${mass}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="a" type="continuous"><parent link="base"/><child link="l"/><axis xyz="0 1 0"/></joint>'
        "</xacro:macro></robot>",
        "[2.0, 3.0]\n",
    ),
}


@pytest.mark.parametrize("changed", ["fore.xml", "more.xml"])
@pytest.mark.parametrize("name", WITH_INCLUDES)
def test_a_changed_include_is_a_changed_robot_model(
    name: str, changed: str, tmp_path: Path, exact_log: Callable[..., Log], monkeypatch: pytest.MonkeyPatch
) -> None:
    if name.endswith("xacro"):
        pytest.importorskip("xacro", reason="pip install 'dynident[xacro]'")
    for file, text in zip((name, "fore.xml", "more.xml"), WITH_INCLUDES[name], strict=True):
        (tmp_path / file).write_text(text)
    monkeypatch.chdir(tmp_path)
    robot = read_robot(name)
    facts: Any = {"robot": robot_facts(name)}
    assert list(facts["robot"]["includes"]) == ["fore.xml", "more.xml"]
    estimate = replace(estimate_of(robot, exact_log, exact=True), provenance=facts)
    source = find_source(estimate, None)
    assert source is not None and len(files_of(source)) == (1 if name.endswith("xacro") else 3)
    Path(changed).write_text(Path(changed).read_text() + "\n")
    assert find_source(estimate, None) is None


def test_a_changed_layer_is_a_changed_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Layers below a stage, and below these, are part of what it was read from."""
    pytest.importorskip("pxr", reason="pip install 'dynident[usd]'")
    monkeypatch.chdir(tmp_path)
    Path("arm.usda").write_text("#usda 1.0\n( subLayers = [@./parts/fore.usda@] )\n")
    Path("parts").mkdir()
    Path("parts/fore.usda").write_text("#usda 1.0\n( subLayers = [@./more.usda@] )\n")
    Path("parts/more.usda").write_text('#usda 1.0\ndef Xform "arm" {}\n')
    facts = robot_facts("arm.usda")
    assert list(facts["includes"]) == ["parts/fore.usda", "parts/more.usda"] and is_unchanged(facts, "arm.usda")
    Path("parts/more.usda").write_text('#usda 1.0\ndef Xform "leg" {}\n')
    assert not is_unchanged(facts, "arm.usda")


def test_models_that_may_be_attached_are_files_of_an_mjcf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is attached, with its includes; one that is named only, and missing, is none."""
    monkeypatch.chdir(tmp_path)
    models = '<asset><model name="m" file="hand.xml"/><model name="gone" file="gone.xml"/></asset>'
    body = f'{BODIES}<attach model="m" prefix="h_"/>'
    Path("arm.xml").write_text(f"<mujoco>{models}<worldbody>{body}</worldbody></mujoco>")
    Path("hand.xml").write_text('<mujoco><worldbody><include file="part.xml"/></worldbody></mujoco>')
    Path("part.xml").write_text(f'<mujocoinclude><body name="p"><joint name="p"/>{GEOM}</body></mujocoinclude>')
    assert read_robot("arm.xml").joint_names == ("a", "b", "h_p")
    assert list(robot_facts("arm.xml")["includes"]) == ["hand.xml", "part.xml"]


def test_what_an_included_model_states_is_not_written(
    tmp_path: Path, exact_log: Callable[..., Log], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The way out is the file with its includes expanded; a model whose inertia stays is left alone."""
    for file, text in zip(("arm.sdf", "fore.xml", "more.xml"), WITH_INCLUDES["arm.sdf"], strict=True):
        (tmp_path / file).write_text(text)
    monkeypatch.chdir(tmp_path)
    estimate = estimate_of(read_robot("arm.sdf"), exact_log, exact=True)
    told = r"fore\.xml: line 1, <link name='l'>.*an included file; export with --description .* expand the includes"
    with pytest.raises(DescriptionError, match=told):
        export_model(estimate, "sdf", "out.sdf", description="arm.sdf")
    main, fore, _ = WITH_INCLUDES["arm.sdf"]
    inner = fore[fore.index("<model") : fore.index("</sdf>")]
    Path("arm.sdf").write_text(main.replace("<include><uri>fore.xml</uri></include>", inner))
    export_model(estimate, "sdf", "out.sdf", description="arm.sdf")
    again = read_robot("out.sdf").nominal
    assert again is not None and estimate.theta is not None
    assert again == pytest.approx(estimate.theta[: len(again)], rel=1e-9, abs=1e-12)
    assert "<include><uri>more.xml</uri></include>" in Path("out.sdf").read_text()
