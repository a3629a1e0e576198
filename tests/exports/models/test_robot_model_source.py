"""The robot model that an export goes into: found from any folder, and named where it is not found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from identified_arms import estimate_of

from dynident.data.log import Log
from dynident.errors import FileError
from dynident.exports.models import export_model, own_target
from dynident.files import sha256_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.files.estimate_file import read_estimate, write_estimate
from dynident.robot_files import read_robot

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
    note = rf"no robot model file was given or found ({name}, which was identified, is not there or has changed): the "
    assert any(one.startswith(f"{note}{kind.upper()} is new") and "--description FILE" in one for one in found.notes)
    assert own_target(estimate) == (kind, Path(output).suffix, True)


def test_the_robot_model_is_not_overwritten_from_another_folder(saved: tuple[str, Path, Estimate]) -> None:
    kind, home, estimate = saved
    with pytest.raises(FileError, match="it is an input of this command and would be overwritten"):
        export_model(estimate, kind, home / FORMATS[kind][0])
    with pytest.raises(FileError, match="it is an input of this command and would be overwritten"):
        export_model(estimate, "c_header", home / FORMATS[kind][0])
