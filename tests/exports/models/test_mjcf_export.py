"""MJCF: the user's own file with what was identified in it, every other byte kept; MuJoCo reads the same torques."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from identified_arms import estimate_of

import dynident as di
from dynident.data.log import Log
from dynident.errors import DescriptionError, FileError
from dynident.exports.models import export_model
from dynident.exports.models.mjcf import Mjcf
from dynident.exports.models.proving.robot_model_proof import reload_mjcf
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.mjcf_own import PatchedMjcf, beside, patched_mjcf
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import default_friction
from dynident.model.inertia import Inertia
from dynident.robot_files import read_robot

#: An arm with what files have: comments, odd blanks and quotes, classes, an include, geoms as inertia, a fixed body.
MJCF = """<?xml version='1.0' encoding="utf-8"?>
<!-- <joint damping="9"/> a comment is no joint; café -->
<mujoco model="arm">
  <compiler  angle = 'radian'  autolimits="true"/>
  <default><joint armature=".05" damping="1"/><default class="fast"><joint frictionloss='0.4'/></default></default>
  <include file="tip.xml"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="upper" pos="0 0 .3" euler="0 .2 0">
      <joint   name='shoulder' axis="0 1 0" class="fast" range="-2 2" />
      <inertial mass="3" pos=".1 0 .02" quat="1 .1 0 0" diaginertia=".03 .04 .05"
      /><geom type="capsule" fromto="0 0 0 .3 0 0" size=".04" mass="7"/>
      <body name="lower" pos=".3 0 0">
        <!-- no inertial: the geoms give it -->
        <joint name="elbow" axis="0 0 1" pos="0 .02 0" damping="0.5"/>
        <geom type="box" size=".1 .02 .03" pos=".1 0 0"/>
        <body name="flange" pos=".2 0 0"><geom size=".03" pos="0 .1 0"/></body>
        <body name="wrist" pos=".25 0 0"><joint name="wrist" axis="1 0 1"/>
          <geom name="hand" type="cylinder" size=".03 .05"/><body name="tip"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><position joint="shoulder" kp="100"/><motor joint="wrist" gear="30" armature="1e-4"/></actuator>
</mujoco>
"""
TIP = '<mujocoinclude><size memory="1M"/></mujocoinclude>\n'


def subject_of(path: Path, seed: int = 1) -> Identified:
    """Return other bodies, and friction, for the robot of a file, as if they were identified."""
    model, random = DynamicModel(read_robot(path), default_friction()), np.random.default_rng(seed)
    bodies = []
    for link in model.robot.links:
        assert link.inertia is not None
        turn = np.eye(4) + np.pad(0.05 * random.normal(size=(3, 3)), (0, 1))
        bodies.append(Inertia.from_pseudo(1.2 * turn @ link.inertia.pseudo @ turn.T).vector)
    rest = random.uniform(0.1, 1.0, len(model.parameters) - model.inertial_count)
    estimate: Any = SimpleNamespace(model=model)
    source = OwnDescription(path, path.read_bytes())
    return Identified(estimate, np.concatenate([*bodies, rest]), "of the estimate", source)


def reloaded(path: Path, folder: Path) -> tuple[PatchedMjcf, dict[Path, bytes]]:
    """Write into a file and compare torques of dynident and MuJoCo."""
    subject = subject_of(path)
    assert subject.source is not None
    patched = patched_mjcf(subject, drives_of(subject), subject.source, False, folder / "out.xml")
    files = beside(folder / "out.xml", subject.source, patched)
    engines = list(reload_mjcf(subject, subject.source, patched, files, folder))
    assert len(engines) == 2
    for one in engines:
        assert one.torque is not None and one.expected is not None, one.why_not
        np.testing.assert_allclose(one.torque, one.expected, atol=1e-9 * np.abs(one.expected).max())
    return patched, files


def given(folder: Path, text: str = MJCF) -> Path:
    (folder / "arm.xml").write_text(text)
    (folder / "tip.xml").write_text(TIP)
    return folder / "arm.xml"


def test_only_inertias_and_joint_values_change(tmp_path: Path, exact_log: Callable[..., Log]) -> None:
    estimate = estimate_of(read_robot(given(tmp_path)), exact_log, exact=True)
    found = export_model(estimate, "mjcf", tmp_path / "out.xml", description=tmp_path / "arm.xml")
    relative = [proof.relative for proof in found.proofs if proof.relative is not None]
    assert len(relative) == 2 and max(relative) < 1e-9
    after = (tmp_path / "out.xml").read_text()
    new = after.splitlines()
    changed = [line for line in MJCF.splitlines() if line not in new]
    parts = ("<joint", "<inertial", "diaginertia", "<geom size", "<geom name", "<motor", "</actuator>")
    assert changed and all(any(part in line for part in parts) for line in changed)
    assert "café" in after and "angle = 'radian'" in after and "joint   name='shoulder' axis" in after
    assert after.count("<inertial") == 3 and 'quat="1 .1 0 0"' not in after
    assert (
        '<motor joint="wrist" gear="30" armature="0"/>' in after
        and next(Path(file).name for file in found.files) == "out.xml"
    )
    assert "'lower' was identified as one body with the links fixed to it" in " ".join(found.notes)
    again = read_robot(tmp_path / "out.xml")
    assert again.nominal is not None and estimate.theta is not None
    bodies = np.asarray(estimate.theta)[: len(again.nominal)]
    np.testing.assert_allclose(again.nominal, bodies, rtol=1e-9, atol=1e-12)
    export_model(estimate, "mjcf", tmp_path / "twice.xml", description=tmp_path / "out.xml")
    then = read_robot(tmp_path / "twice.xml").nominal
    np.testing.assert_allclose(np.asarray(then), again.nominal, rtol=1e-12, atol=1e-15)
    assert len((tmp_path / "twice.xml").read_text().splitlines()) == len(new)


@pytest.mark.parametrize(
    "setting", ['inertiafromgeom="true"', 'settotalmass="20"', 'boundmass="5"', 'boundinertia=".3"']
)
def test_settings_that_change_inertia_are_ended(setting: str, tmp_path: Path) -> None:
    path = given(tmp_path, MJCF.replace('autolimits="true"', f'autolimits="true" {setting}'))
    patched, files = reloaded(path, tmp_path)
    assert setting not in files[tmp_path / "out.xml"].decode()
    assert "all bodies state their inertia now" in " ".join(patched.notes)


#: The bodies of the arm, which includes have.
INSIDE = MJCF[MJCF.index('    <body name="upper"') : MJCF.index("  </worldbody>")]


def in_includes(folder: Path) -> Path:
    """Return an arm whose bodies are in an include of an include in a folder of its own."""
    (folder / "parts").mkdir()
    (folder / "parts" / "bodies.xml").write_text(f"<mujocoinclude>\n{INSIDE}</mujocoinclude>\n")
    (folder / "whole.xml").write_text('<mujocoinclude>\n  <include file="parts/bodies.xml"/>\n</mujocoinclude>\n')
    return given(folder, MJCF.replace(INSIDE, '    <include file="whole.xml"/>\n'))


@pytest.mark.parametrize("place", ["new", "."])
def test_changed_includes_get_names_of_their_own(place: str, tmp_path: Path) -> None:
    path = in_includes(tmp_path)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*.xml")}
    folder = tmp_path / place
    folder.mkdir(exist_ok=True)
    patched, files = reloaded(path, folder)
    copied = ["out-tip.xml"] if place == "new" else []
    assert [file.name for file in files] == ["out.xml", "out-whole.xml", "out-bodies.xml", *copied]
    assert b"fullinertia" in files[folder / "out-bodies.xml"]
    assert b'<include file="out-bodies.xml"/>' in files[folder / "out-whole.xml"]
    assert files[folder / "out.xml"].count(b"armature") == path.read_bytes().count(b"armature")
    assert b'<include file="out-whole.xml"/>' in files[folder / "out.xml"]
    assert f'<include file="{copied[0] if copied else "tip.xml"}"/>'.encode() in files[folder / "out.xml"]
    what = "other files are copied to" if copied else "what changed in other files is in"
    assert f"your own files stay as they are: {what} out-whole.xml" in " ".join(patched.notes)
    assert not any(before.get(file) for file in files)


def test_names_of_changed_includes_are_those_of_no_other_file(tmp_path: Path) -> None:
    """Neither a file of the user's beside the output, nor an include; an output of before is written over."""
    path = in_includes(tmp_path)
    new = tmp_path / "new"
    new.mkdir()
    (new / "out-bodies.xml").write_text("a file of the user's")
    for _ in range(2):
        _, files = reloaded(path, new)
        assert [file.name for file in files] == ["out.xml", "out-whole.xml", "out-bodies_2.xml", "out-tip.xml"]
        shutil.rmtree(new / "tree")
        for file, data in files.items():
            file.write_bytes(data)
    whole = tmp_path / "whole.xml"
    whole.rename(tmp_path / "out-bodies.xml")
    path.write_text(path.read_text().replace("whole.xml", "out-bodies.xml"))
    _, files = reloaded(path, tmp_path)
    assert [file.name for file in files] == ["out.xml", "out-out-bodies.xml", "out-bodies_2.xml"]


@pytest.mark.parametrize("place", ["robot/out", "a/b"])
def test_a_file_in_another_folder_loads_there(place: str, tmp_path: Path, exact_log: Callable[..., Log]) -> None:
    """With its meshes, of a folder that an include states; MuJoCo loads it where it was written."""
    home = tmp_path / "robot"
    (home / "parts" / "stl").mkdir(parents=True)
    (tmp_path / place).mkdir(parents=True, exist_ok=True)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")[
        [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    ]
    facets = b"".join(np.zeros(3, "<f4").tobytes() + one.tobytes() + bytes(2) for one in corners)
    (home / "parts" / "stl" / "part.stl").write_bytes(bytes(80) + np.array([4], "<u4").tobytes() + facets)
    text = MJCF.replace("  <actuator>", '  <asset><mesh name="part" file="part.stl"/></asset>\n  <actuator>')
    path = given(home, text.replace("<!-- no inertial", '<geom type="mesh" mesh="part" mass="0.1"/><!-- no inertial'))
    (home / "tip.xml").write_text('<mujocoinclude><compiler meshdir="parts/stl"/></mujocoinclude>\n')
    estimate = estimate_of(read_robot(path), exact_log, exact=True)
    found = export_model(estimate, "mjcf", tmp_path / place / "out.xml", description=path)
    assert all(proof.relative is not None and proof.relative < 1e-9 for proof in found.proofs)
    assert any(note.startswith("meshes and textures are found where they are: ") for note in found.notes)
    model = pytest.importorskip("mujoco").MjModel.from_xml_path(str(tmp_path / place / "out.xml"))
    assert model.nmesh == 1 and model.body("upper").mass[0] == pytest.approx(estimate.theta[9], rel=1e-9)
    assert read_robot(tmp_path / place / "out.xml").dof == 3


def test_a_model_that_is_not_attached_is_found_from_another_folder(tmp_path: Path) -> None:
    (tmp_path / "new").mkdir()
    path = given(
        tmp_path, MJCF.replace("  <actuator>", '  <asset><model name="m" file="m.xml"/></asset>\n  <actuator>')
    )
    (tmp_path / "m.xml").write_text("<mujoco><worldbody/></mujoco>")
    _, files = reloaded(path, tmp_path / "new")
    assert b'file="../m.xml"' in files[tmp_path / "new" / "out.xml"]
    _, files = reloaded(path, tmp_path)
    assert b'file="m.xml"' in files[tmp_path / "out.xml"]


@pytest.mark.parametrize("flag", ["damper", "frictionloss", "constraint"])
def test_what_a_flag_would_end_is_not_written(flag: str, tmp_path: Path) -> None:
    text = MJCF.replace("  <default><joint", f'  <option><flag {flag}="disable"/></option>\n  <default><joint', 1)
    key = "damping" if flag == "damper" else "frictionloss"
    with pytest.raises(DescriptionError, match=rf"line 5, <flag>: it switches {key} off, and joint '.*; enable it in"):
        reloaded(given(tmp_path, text), tmp_path)


@pytest.mark.parametrize("option", ["", '<option gravity="0 0 -9.81" timestep=".002"/>', "<option timestep='.002'/>"])
@pytest.mark.parametrize("leans", [True, False])
def test_gravity_under_which_a_model_was_identified_is_in_the_file(option: str, leans: bool, tmp_path: Path) -> None:
    path = given(tmp_path, MJCF.replace("  <default>", f"  {option}\n  <default>", 1))
    subject = subject_of(path)
    robot = subject.model.robot.with_gravity(np.array([0.855, 0.0, -9.7727]) if leans else subject.model.robot.gravity)
    estimate: Any = SimpleNamespace(model=replace(subject.model, robot=robot))
    subject = replace(subject, estimate=estimate)
    assert subject.source is not None
    patched = patched_mjcf(subject, drives_of(subject), subject.source, False, tmp_path / "out.xml")
    np.testing.assert_array_equal(patched.after.document.gravity, robot.gravity)
    assert any("gravity is (0.855 0.0 -9.7727) m/s^2" in note for note in patched.notes) == leans
    mujoco = pytest.importorskip("mujoco")
    for file, data in beside(tmp_path / "out.xml", subject.source, patched).items():
        file.write_bytes(data)
    np.testing.assert_allclose(mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml")).opt.gravity, robot.gravity)
    assert (b"gravity" in (tmp_path / "out.xml").read_bytes()) == (leans or "gravity" in option)


def test_gravity_that_a_flag_switches_off_is_not_written(tmp_path: Path) -> None:
    text = MJCF.replace("  <default><joint", '  <option><flag gravity="disable"/></option>\n  <default><joint', 1)
    subject = subject_of(given(tmp_path, text))
    estimate: Any = SimpleNamespace(
        model=replace(subject.model, robot=subject.model.robot.with_gravity(np.array([0.0, 0.0, -9.81])))
    )
    assert subject.source is not None
    with pytest.raises(DescriptionError, match=r"line 5, <flag>: it switches gravity off, .*; enable it in"):
        patched_mjcf(
            replace(subject, estimate=estimate), drives_of(subject), subject.source, False, tmp_path / "out.xml"
        )


def test_a_damping_that_mujoco_computes_is_not_written_over(tmp_path: Path) -> None:
    text = MJCF.replace("  <default><joint", '  <default><joint springdamper="0.1 1"', 1)
    with pytest.raises(
        DescriptionError, match=r"<joint .*: springdamper of joint '.*' sets its damping, .*; write stiff"
    ):
        reloaded(given(tmp_path, text), tmp_path)
    text = text.replace(
        "  <default>", '  <option><flag damper="disable" frictionloss="enable"/></option>\n  <default>', 1
    )
    with pytest.raises(DescriptionError, match="it switches damping off"):
        reloaded(given(tmp_path, text), tmp_path)


def test_what_a_changed_include_includes_from_its_own_folder_is_found(tmp_path: Path) -> None:
    path = in_includes(tmp_path)
    (tmp_path / "parts" / "more.xml").write_text("<mujocoinclude><site name='s'/></mujocoinclude>")
    bodies = tmp_path / "parts" / "bodies.xml"
    bodies.write_text(bodies.read_text().replace("<inertial", '<include file="more.xml"/><inertial'))
    _, files = reloaded(path, tmp_path)
    assert b'<include file="parts/more.xml"/>' in files[tmp_path / "out-bodies.xml"]


def test_no_file_of_the_robot_model_is_overwritten(tmp_path: Path, exact_log: Callable[..., Log]) -> None:
    path = in_includes(tmp_path)
    estimate = estimate_of(read_robot(path), exact_log, exact=True)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*.xml")}
    for name in ("whole.xml", "parts/bodies.xml", "tip.xml", "arm.xml"):
        with pytest.raises(FileError, match=r"it is an input of this command and would be overwritten"):
            export_model(estimate, "mjcf", tmp_path / name, description=path)
    export_model(estimate, "mjcf", tmp_path / 'prüf & "1".xml', description=path)
    assert {file: file.read_bytes() for file in before} == before
    again = read_robot(tmp_path / 'prüf & "1".xml')
    assert again.nominal is not None and estimate.theta is not None
    np.testing.assert_allclose(again.nominal, estimate.theta[: len(again.nominal)], rtol=1e-9, atol=1e-12)
    mujoco = pytest.importorskip("mujoco")
    mass = mujoco.MjModel.from_xml_path(str(tmp_path / 'prüf & "1".xml')).body("upper").mass[0]
    assert mass == pytest.approx(estimate.theta[9], rel=1e-9)


def test_a_replica_has_no_place_of_its_own(tmp_path: Path) -> None:
    text = MJCF.replace('    <body name="upper"', '    <replicate count="2">\n    <body name="upper"')
    text = text.replace("  </worldbody>", "    </replicate>\n  </worldbody>")
    path = given(tmp_path, text[: text.index("  <actuator>")] + "</mujoco>")
    with pytest.raises(DescriptionError, match="body 'upper0': its element stands for 2, by a replica"):
        reloaded(path, tmp_path)


def test_an_inertia_between_two_joints_of_one_body_has_no_place(tmp_path: Path) -> None:
    path = given(tmp_path, MJCF.replace('<body name="tip"/>', '<joint name="more" axis="0 1 0"/>'))
    subject = subject_of(path)
    subject.theta[10 * 2 : 10 * 3] = 1e-3
    assert subject.source is not None
    with pytest.raises(DescriptionError, match=r"between two joints of one body.*write a body for each joint"):
        patched_mjcf(subject, drives_of(subject), subject.source, False, tmp_path / "out.xml")


def test_two_joints_of_one_body_keep_no_mass_between_them(tmp_path: Path, exact_log: Callable[..., Log]) -> None:
    """Identified as next to none and left out of the file; MuJoCo has the torques of the estimate."""
    pair = '<joint name="shoulder" axis="0 0 1"/><joint name="pitch" axis="0 1 0" pos="0 0 .02"/>'
    box = '<geom type="box" size=".05 .04 .2" pos="0 0 .2"/>'
    path = given(tmp_path, f'<mujoco><worldbody><body name="arm">{pair}{box}</body></worldbody></mujoco>')
    estimate = estimate_of(read_robot(path), exact_log)
    assert estimate.theta is not None and 0.0 < estimate.theta[9] < 1e-9
    export_model(estimate, "mjcf", tmp_path / "out.xml", description=path)
    text = (tmp_path / "out.xml").read_text()
    assert text.count("<inertial") == 1 and text.count("<body") == 1
    model = pytest.importorskip("mujoco").MjModel.from_xml_path(str(tmp_path / "out.xml"))
    assert model.body("arm").mass[0] == pytest.approx(estimate.theta[19], rel=1e-9)


#: Two bodies of two and three joints: anchors off the origin, a reference position, a slide, grams at the end.
SHARED = """<mujoco><compiler angle="radian"/><worldbody><body name="arm" pos=".1 .2 .3" euler=".3 .5 -.4">
  <joint name="shoulder" axis="0 0 1"/><joint name="pitch" axis="0 1 .3" pos="0 0 .02" ref=".3"/>
  <geom type="box" size=".05 .04 .2" pos="0 0 .2"/>
  <body name="fore" pos=".1 0 .4" euler=".1 .2 .3">
    <joint name="lift" type="slide" axis="1 .2 0" pos=".3 0 0" ref=".05"/>
    <joint name="elbow" axis="1 0 0" pos=".01 -.04 0"/><joint name="roll" axis="0 .3 1" ref=".5"/>
    <inertial pos=".005 0 .01" mass=".02" diaginertia="2e-6 2e-6 1e-6"/>
  </body></body></worldbody></mujoco>"""


def test_several_joints_of_one_body_in_a_new_file(tmp_path: Path, exact_log: Callable[..., Log]) -> None:
    """An MJCF has them in one body again, a URDF links of next to no mass; MuJoCo has the torques of the source."""
    mujoco = pytest.importorskip("mujoco")
    path = given(tmp_path, SHARED)
    estimate = estimate_of(di.robot_of(mujoco.MjModel.from_xml_path(str(path))), exact_log, exact=True)
    torques = []
    for file, bodies in ((path, 3), (tmp_path / "new.xml", 3), (tmp_path / "new.urdf", 6)):
        if file != path:
            found = export_model(estimate, "mjcf" if file.suffix == ".xml" else "urdf", file)
            assert any("arm before pitch, fore before elbow, fore before roll" in note for note in found.notes)
            assert all(proof.relative is None or proof.relative < 1e-9 for proof in found.proofs)
        model = mujoco.MjModel.from_xml_path(str(file))
        assert model.nbody == bodies
        assert tuple(model.joint(k).name for k in range(5)) == estimate.model.robot.joint_names
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_DAMPER)
        model.dof_armature[:] = 0.0
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.qacc[:] = [0.3, 0.7, 0.1, -0.4, 1.1], [1, 2, 3, 4, 5], 2.0
        mujoco.mj_inverse(model, data)
        torques.append(data.qfrc_inverse.copy())
    np.testing.assert_allclose(torques[1:], [torques[0]] * 2, rtol=1e-9)


@pytest.mark.parametrize(("motor", "follower"), [('<motor joint="elbow"/>', "wrist"), ("", "elbow")])
def test_a_joint_that_follows_has_the_friction_of_its_leader(motor: str, follower: str, tmp_path: Path) -> None:
    """The wrist has a motor: it moves on its own where the elbow has none."""
    tie = '<equality><joint joint1="wrist" joint2="elbow" polycoef="0 2 0 0 0"/></equality>'
    path = given(tmp_path, MJCF.replace("  <actuator>", f"  {tie}\n  <actuator>{motor}"))
    _, files = reloaded(path, tmp_path)
    (line,) = re.findall(rf'<joint name="{follower}" axis(.*?)/>', files[tmp_path / "out.xml"].decode())
    own = dict(re.findall(r'(\w+)="([^"]*)"', line))
    assert own["damping"] == "0.0" and float(own.get("frictionloss", 0.0)) == 0.0
    assert (
        "armature" not in own and b'armature="1e-4"' in files[tmp_path / "out.xml"]
    )  # of the file: none was identified


@pytest.mark.parametrize("has_friction", [True, False])
def test_a_follower_with_armature_leaves_it_to_its_leader(has_friction: bool, tmp_path: Path) -> None:
    tie = '<equality><joint joint1="wrist" joint2="elbow" polycoef="0 2 0 0 0"/></equality>'
    path = given(tmp_path, MJCF.replace("  <actuator>", f"  {tie}\n  <actuator><motor joint='elbow'/>"))
    robot = read_robot(path)
    subject = subject_of(path)
    if not has_friction:
        model = DynamicModel(robot, ())
        subject = replace(subject, estimate=SimpleNamespace(model=model), theta=subject.theta[: model.inertial_count])
    assert subject.source is not None
    patched = patched_mjcf(subject, drives_of(subject), subject.source, False, tmp_path / "out.xml")
    files = beside(tmp_path / "out.xml", subject.source, patched)
    for one in reload_mjcf(subject, subject.source, patched, files, tmp_path):
        assert one.torque is not None and one.expected is not None, one.why_not
        np.testing.assert_allclose(one.torque, one.expected, atol=1e-9 * np.abs(one.expected).max())
    leader = next(joint for joint in patched.after.robot().joints if joint.name == "elbow")
    rotor = 0.05 + 4.0 * (0.05 + 1e-4 * 30**2)
    assert has_friction or leader.drive.reflected_inertia == pytest.approx(rotor)
    if not has_friction:  # nothing was identified of either
        assert b'<joint name="wrist" axis="1 0 1"/>' in files[tmp_path / "out.xml"]
    drives = drives_of(subject)
    drives = replace(drives, armature=np.asarray(drives.armature) + 0.1)
    patched = patched_mjcf(subject, drives, subject.source, False, tmp_path / "out.xml")
    assert b'gear="30" armature="0"/>' in patched.texts[str(path)]
    assert patched.tags["wrist"][0] == 0.0 and patched.tags["elbow"][0] == pytest.approx(rotor + 0.1)


#: The held joint is the only one of its body, or the last of two.
HELD = (
    '<joint name="j" axis="0 1 0"/><geom size=".1" pos=".1 0 0"/><body name="b" pos=".3 0 0">'
    '<joint name="k" axis="0 1 0" ref=".2" damping="3"/><geom size=".1" pos=".1 0 0"/></body>',
    '<joint name="j" axis="0 1 0"/><joint name="k" axis="0 0 1" pos=".1 .2 0"/><geom size=".1" pos=".1 0 0"/>'
    '<body name="c"><joint name="l"/><geom size=".1"/></body>',
)


@pytest.mark.parametrize("inside", HELD)
def test_a_joint_that_an_equality_holds_moves_in_the_file(
    inside: str, tmp_path: Path, exact_log: Callable[..., Log]
) -> None:
    """MuJoCo has the torques of the others where it stands still, and each body that moves in the file has a mass."""
    still = '<equality><joint joint1="k" polycoef=".4"/></equality>'
    world = f'<worldbody><body name="a">{inside}</body></worldbody>'
    path = given(tmp_path, f'<mujoco><compiler angle="radian"/>{world}{still}</mujoco>')
    estimate = estimate_of(read_robot(path), exact_log, ("viscous",))
    mujoco = pytest.importorskip("mujoco")
    for lump in (False, True):
        found = export_model(estimate, Mjcf(lump=lump), tmp_path / "out.xml", description=path)
        relative = [proof.relative for proof in found.proofs if proof.relative is not None]
        assert len(relative) == 2 and max(relative) < 1e-9
        assert any("locked joints (k at 0." in note for note in found.notes)
        model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
        assert model.body_mass[1:].min() > 0.0 and model.njnt == len(estimate.model.robot.joints) + 1


def test_damping_of_higher_order_from_a_class_is_ended(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = given(tmp_path, MJCF.replace('armature=".05" damping="1"', 'armature=".05" damping="1 .3"'))
    patched, files = reloaded(path, tmp_path)
    assert files[tmp_path / "out.xml"].count(b' 0 0"') >= 3
    (tmp_path / "out.xml").write_bytes(files[tmp_path / "out.xml"])
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    assert not model.dof_dampingpoly.any()
    expected = [patched.tags[model.joint(number).name][1] for number in range(model.njnt)]
    np.testing.assert_allclose(model.dof_damping, np.array(expected, float))
