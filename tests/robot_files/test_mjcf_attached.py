"""MJCF: models attached to others are read as MuJoCo attaches them, and each is written back into its own file."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_mjcf import BODY, HINGE, arm, assert_as_mujoco, robot

from dynident.errors import DescriptionError
from dynident.exports.models.proving.robot_model_proof import reload_mjcf
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.mjcf_own import PatchedMjcf, beside, patched_mjcf
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import default_friction
from dynident.robot_files import read_robot

mujoco = pytest.importorskip("mujoco")
pytestmark = [
    pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'"),
    pytest.mark.filterwarnings("ignore:Attach conflict"),  # of gravity, which is that of the main model
]

#: A body of geoms alone, by the class of a model, in one of several frames.
FINGER = '<body name="tip" pos="0 0 .1"><joint name="t" class="quick" axis="1 0 1"/><geom pos=".1 0 0"/></body>'
HAND = f"""<mujoco model="hand"><compiler angle="radian" boundmass=".4"/><option gravity="1 2 3"/>
<default><joint damping=".2" armature=".1"/><geom size=".05" density="700"/><motor armature=".3"/>
<default class="quick"><joint frictionloss=".3" damping="1"/><geom type="box" size=".1 .2 .3"/></default></default>
<worldbody><site name="of world"/><geom name="plate" pos="0 0 .3"/>
<body name="palm" pos=".1 .2 .3" childclass="quick"><joint name="p" axis="0 1 0" range="-1 1"/>{BODY}<site name="s"/>
  <body name="left" pos="0 .1 .2" euler=".3 .4 0"><joint name="l" axis="1 0 0"/>{BODY}<site name="of left"/>
    <frame name="outer" pos="1 2 3"><frame name="inner" pos=".1 0 0" euler="0 0 1">
      <geom group="1" size=".1"/><geom group="2" size=".1"/>{FINGER}</frame></frame></body>
  <body name="right" pos="0 -.1 0"><joint name="r" axis="1 0 0"/>{BODY}</body>
  <replicate count="2" offset=".1 0 0" sep="-"><body name="copy"><joint name="c"/>{BODY}</body></replicate></body>
<body name="aside"><joint name="s"/>{BODY}</body></worldbody>
<tendon><fixed name="both"><joint joint="l" coef="1"/><joint joint="t" coef="2"/></fixed>
  <fixed name="all"><joint joint="p" coef="1"/><joint joint="s" coef="2"/></fixed></tendon>
<actuator><motor joint="p" gear="2" damping=".7" forcerange="-9 9"/><motor joint="l" class="quick"/><motor joint="c"/>
  <muscle joint="s"/><muscle tendon="all"/></actuator>
<equality><joint joint1="r" joint2="p" polycoef=".1 -1 0 0 0"/><joint joint1="s" joint2="l"/>
  <tendon tendon1="all"/><tendon tendon1="both"/><connect body1="aside" body2="palm" anchor="0 0 0"/></equality>
</mujoco>"""
WHOLE = HAND[: HAND.index("<tendon>")] + "</mujoco>"
#: A model to which a hand is attached.
ARM = f"""<mujoco model="fore"><compiler angle="degree" inertiafromgeom="true"/>
<default><default class="quick"><joint armature=".7"/></default></default>
<asset><model name="of hand" file="../parts/hand.xml"/></asset><worldbody>
<body name="fore"><joint name="f" class="quick"/>
{BODY}<geom size=".1"/><frame euler="0 0 30"><attach model="of hand" body="left" prefix="h_"/></frame>
<body name="more" pos="0 .1 0"><joint name="m" class="h_quick"/><geom class="h_main" pos=".1 0 0"/></body></body>
</worldbody></mujoco>"""
NAMED, UNNAMED = '<model name="hand" file="parts/hand.xml"/>', '<model file="parts/hand.xml"/>'


def attached(inside: str, models: str = NAMED, settings: str = "") -> str:
    """Return an arm with models attached in its first body."""
    return arm(HINGE + BODY + inside, f"{settings}<asset>{models}</asset>")


def written(text: str, folder: Path, hand: str = HAND) -> None:
    for name, data in (("parts/hand.xml", hand), ("fore/fore.xml", ARM), ("arm.xml", text)):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(data)


FORE = '<model name="fore" file="fore/fore.xml"/>'
CASES = {
    "a body of the world": attached('<attach model="hand" body="palm" prefix="h_"/>'),
    "a deep body, by its own pose alone": attached(
        '<frame pos="9 1 0"><attach model="hand" body="left" prefix="h_"/></frame>'
    ),
    "in frames, which are left": attached('<attach model="hand" body="tip" prefix="h_"/>'),
    "a copy of a replica": attached('<attach model="hand" body="copy-1" prefix="h_"/>'),
    "a frame": attached('<frame euler="0 20 0"><attach model="hand" frame="inner" prefix="h_"/></frame>'),
    "a frame with frames": attached('<attach model="hand" frame="outer" prefix="h_"/>'),
    "the name that the file states": attached('<attach model="hand" body="right" prefix="h_"/>', UNNAMED),
    "the first of a name": attached(
        '<attach model="hand" body="right" prefix="h_"/>', UNNAMED + '<model name="hand" file="fore/fore.xml"/>'
    ),
    "two bodies of one model": attached(
        '<attach model="hand" body="right" prefix="a_"/><attach model="hand" body="tip" prefix="b_"/>'
    ),
    "in attached models": attached('<attach model="fore" body="fore" prefix="f_"/>', FORE),
    "the world of a model with one attached": attached('<attach model="fore" prefix="f_"/>', FORE),
    "a body of a model that is attached to it": attached('<attach model="fore" body="h_tip" prefix="f_"/>', FORE),
    "classes outside, behind it": attached(
        '<attach model="hand" body="right" prefix="h_"/>'
        '<body name="b" childclass="h_quick"><joint name="b"/><geom class="h_main"/></body>'
        '<body name="c"><joint name="c" class="clash"/><geom class="h_quick"/></body>',
        settings='<default><default class="clash"><joint armature="5"/></default></default>',
    ),
    "a class of the same name outside": attached(
        f'<attach model="hand" body="right" prefix="h_"/><body name="b"><joint name="b" class="h_quick"/>{BODY}</body>',
        settings='<default><default class="h_quick"><joint armature="5"/></default></default>',
    ),
    "replicas with a tendon that couples joints": attached(
        '<replicate count="2" offset="1 0 0" euler="9 8 7"><attach model="hand" body="left" prefix="h_"/></replicate>'
    ),
    "replicas with tendons over joints of two of them": attached(
        '<replicate count="2" offset="1 0 0" sep="-"><attach model="hand" body="palm" prefix="h_"/></replicate>',
    ).replace(
        "</mujoco>",
        '<tendon><fixed name="v"><joint joint="h_c-0-0" coef="2"/><joint joint="h_p-1" coef="1"/></fixed></tendon>'
        '<equality><joint joint1="h_c-1-0" joint2="h_c-0-1"/><tendon tendon1="v" polycoef=".1"/></equality></mujoco>',
    ),
    "geoms of a frame, by the groups of the body": attached(
        '<body name="bare"><joint name="e"/><attach model="hand" frame="inner" prefix="h_"/></body>',
        settings='<compiler inertiagrouprange="0 1"/>',
    ),
    "mass of all": attached('<attach model="hand" body="left" prefix="h_"/>', settings='<compiler settotalmass="9"/>'),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_models_are_attached_as_mujoco_attaches_them(name: str, tmp_path: Path) -> None:
    written(CASES[name], tmp_path)
    path = tmp_path / "arm.xml"
    found = read_robot(path)
    assert any(joint.name.startswith(("h_", "a_", "f_")) for joint in found.joints)
    assert_as_mujoco(found, path)


@pytest.mark.parametrize("what", ['body="world"', ""])
def test_the_world_of_a_model_is_attached_with_or_without_a_body(what: str, tmp_path: Path) -> None:
    written(attached(f'<frame euler="0 20 0"><attach model="hand" {what} prefix="h_"/></frame>'), tmp_path, WHOLE)
    found = read_robot(tmp_path / "arm.xml")
    assert ("h_world" in found.frames) == bool(what) and "h_of world" in found.frames
    assert_as_mujoco(found, tmp_path / "arm.xml")


def identified(path: Path) -> Identified:
    """Return the robot of a file with other bodies and friction."""
    model, random = DynamicModel(read_robot(path), default_friction()), np.random.default_rng(3)
    nominal = model.nominal()
    assert nominal is not None
    rest = random.uniform(0.1, 1.0, len(model.parameters) - model.inertial_count)
    bodies = nominal[: model.inertial_count].reshape(-1, 10) * random.uniform(1.1, 1.5, (len(model.robot.links), 1))
    estimate: Any = SimpleNamespace(model=model)
    theta = np.concatenate([bodies.ravel(), rest])
    return Identified(estimate, theta, "of the estimate", OwnDescription(path, path.read_bytes()))


def written_back(path: Path, output: Path) -> tuple[PatchedMjcf, dict[Path, bytes]]:
    """Return the files of an identified robot, after dynident and MuJoCo have read the same torques in them."""
    subject = identified(path)
    assert subject.source is not None
    patched = patched_mjcf(subject, drives_of(subject), subject.source, lump=False, output=output)
    files = beside(output, subject.source, patched)
    for one in reload_mjcf(subject, subject.source, patched, files, path.parent / "proof"):
        assert one.torque is not None and one.expected is not None, one.why_not
        wanted: Any = one.expected
        np.testing.assert_allclose(one.torque, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())
    return patched, files


WRITTEN = {
    "a deep body, by its own pose alone": ["out-hand.xml"],
    "in frames, which are left": ["out-hand.xml"],
    "a frame": ["out-hand.xml"],
    "the name that the file states": ["out-hand.xml"],
    "two bodies of one model": ["out-hand.xml"],
    "the world of a model with one attached": ["out-fore.xml", "out-hand.xml"],
    "mass of all": ["out-hand.xml"],
}


@pytest.mark.parametrize("name", WRITTEN)
def test_identified_values_return_into_the_file_of_each_body(name: str, tmp_path: Path) -> None:
    written(CASES[name], tmp_path)
    before = {file: file.read_bytes() for file in tmp_path.rglob("*.xml")}
    for output in (tmp_path / "out.xml", tmp_path / "new" / "out.xml"):
        output.parent.mkdir(exist_ok=True)
        (tmp_path / "proof").mkdir(exist_ok=True)
        patched, files = written_back(tmp_path / "arm.xml", output)
        assert {file.name for file in files} == {"out.xml", *WRITTEN[name]}
        for file, data in files.items():
            file.write_bytes(data)
        again = read_robot(output)
        model = mujoco.MjModel.from_xml_path(str(output))
        assert model.nbody == mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml")).nbody
        wanted = patched.after.robot().nominal
        assert again.nominal is not None and wanted is not None
        np.testing.assert_allclose(again.nominal, wanted, rtol=1e-12, atol=1e-15)
        assert "your own files stay as they are" in " ".join(patched.notes)
        assert not before.keys() & files.keys()
    hand = next(data for file, data in files.items() if file.name == "out-hand.xml").decode()
    assert '<motor joint="p" gear="2" damping=".7"' in hand and '<option gravity="1 2 3"/>' in hand


def test_the_mass_of_all_ends_where_all_bodies_are_attached(tmp_path: Path) -> None:
    (tmp_path / "hand.xml").write_text(
        f'<mujoco model="hand"><worldbody><body name="a">{HINGE}{BODY}</body></worldbody></mujoco>'
    )
    cell = '<mujoco><compiler settotalmass="8"/><asset><model file="hand.xml"/></asset>'
    cell += '<worldbody><attach model="hand" body="a" prefix="p_"/></worldbody></mujoco>'
    (tmp_path / "cell.xml").write_text(cell)
    (tmp_path / "proof").mkdir()
    patched, files = written_back(tmp_path / "cell.xml", tmp_path / "out.xml")
    (link,) = patched.before.robot().links
    assert link.inertia is not None and link.inertia.mass == pytest.approx(8.0)
    assert b'settotalmass="-1"' in next(data for file, data in files.items() if file.name == "out.xml")


def test_what_is_attached_several_times_has_one_value(tmp_path: Path) -> None:
    """It is refused, with the remedy, which works."""
    twice = '<attach model="hand" body="right" prefix="a_"/><attach model="{}" body="right" prefix="b_"/>'
    written(attached(twice.format("hand")), tmp_path)
    (tmp_path / "proof").mkdir()
    told = (
        r"body 'a_right': its element stands for 2, by .*; copy hand.xml to hand-2.xml beside it, add <model "
        r"name='hand-2' file='.../hand-2.xml'/> to <asset>, write model='hand-2' in the <attach> with prefix='b_'"
    )
    with pytest.raises(DescriptionError, match=told):
        written_back(tmp_path / "arm.xml", tmp_path / "out.xml")
    written(attached(twice.format("other"), NAMED + '<model name="other" file="parts/other.xml"/>'), tmp_path)
    (tmp_path / "parts" / "other.xml").write_text(HAND)
    _, files = written_back(tmp_path / "arm.xml", tmp_path / "out.xml")
    assert [file.name for file in files] == ["out.xml", "out-hand.xml", "out-other.xml"]


def test_a_model_of_a_part_that_is_not_attached_is_found(tmp_path: Path) -> None:
    """MuJoCo reads it: in another folder it is found from the copy of the file that names it."""
    aside = ARM.replace('<frame euler="0 0 30"><attach', "<attach").replace('prefix="h_"/></frame>', 'prefix="h_"/>')
    attach = '<attach model="of hand" body="left" prefix="h_"/>'
    aside = (
        aside.replace(attach, "")
        .replace("</worldbody>", f"{attach}</worldbody>")
        .replace(' class="h_quick"', "")
        .replace(' class="h_main"', ' size=".1"')
    )
    written(attached('<attach model="fore" body="fore" prefix="f_"/>', FORE), tmp_path)
    (tmp_path / "fore" / "fore.xml").write_text(aside)
    for folder in ("proof", "new"):
        (tmp_path / folder).mkdir()
    _, files = written_back(tmp_path / "arm.xml", tmp_path / "new" / "out.xml")
    for file, data in files.items():
        file.write_bytes(data)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "new" / "out.xml")).nbody == 5


def test_meshes_of_an_attached_model_are_found_beside_its_own_file(tmp_path: Path) -> None:
    mesh = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    hand = HAND.replace('boundmass=".4"', 'meshdir="of hand"').replace(
        "<worldbody>", '<asset><mesh name="m" file="m.obj"/></asset><worldbody>'
    )
    hand = hand.replace(f'axis="1 0 0"/>{BODY}</body>', f'axis="1 0 0"/>{BODY}<geom type="mesh" mesh="m"/></body>')
    written(attached('<attach model="hand" body="right" prefix="h_"/>'), tmp_path, hand)
    for folder in ("parts/of hand", "proof", "new"):
        (tmp_path / folder).mkdir()
    (tmp_path / "parts" / "of hand" / "m.obj").write_text(mesh)
    for output, folder in ((tmp_path / "out.xml", "parts/of hand"), (tmp_path / "new" / "out.xml", "../parts/of hand")):
        patched, files = written_back(tmp_path / "arm.xml", output)
        assert f'<compiler meshdir="{folder}"/>'.encode() in files[output.with_name("out-hand.xml")]
        assert f"meshes and textures are found where they are: {folder}" in patched.notes
        for file, data in files.items():
            file.write_bytes(data)
        assert mujoco.MjModel.from_xml_path(str(output)).nmesh == 1


FAULTS = {
    "a body that is not there": (
        attached('<attach model="hand" body="lefft" prefix="h_"/>'),
        "the attached model has no body 'lefft'; correct the name; did you mean 'left'",
    ),
    "a frame that is not there": (
        attached('<attach model="hand" frame="iner" prefix="h_"/>'),
        "the attached model has no frame 'iner'; correct the name; did you mean 'inner'",
    ),
    "both": (
        attached('<attach model="hand" frame="inner" body="palm" prefix="h_"/>'), "it names a body and a frame; keep"
    ),
    "the name of the file": (
        attached('<attach model="parts" body="right" prefix="h_"/>', UNNAMED),
        "<asset> names no model 'parts', but hand; add <model name='parts' file=.../> to it, or correct the name",
    ),
    "no model": (attached('<attach model="hand" prefix="h_"/>', ""), "<asset> names no model 'hand'; add"),
    "no prefix": (attached('<attach model="hand" body="palm"/>'), "no attribute 'prefix'; write prefix="),
    "a class of a model that is not attached": (
        attached('<body name="b"><joint class="h_quick"/></body>'), "there is no defaults class 'h_quick'"
    ),
    "a class of an attached model outside of bodies": (
        attached('<attach model="hand" body="right" prefix="h_"/>').replace(
            "</mujoco>", '<actuator><motor joint="z" class="h_quick"/></actuator></mujoco>'
        ),
        "there is no defaults class 'h_quick'",
    ),
    "a frame of the main model": (
        attached('<frame name="inne"/><frame name="h_inne"/><attach model="hand" frame="inne" prefix="h_"/>'),
        "the attached model has no frame 'inne'; correct the name; did you mean 'inner'",
    ),
    "a URDF": (
        attached('<attach model="hand" prefix="h_"/>', '<model name="hand" file="parts/hand.URDF"/>'),
        "'parts/hand.URDF' is a URDF; write it as an MJCF beside it, in Python by mujoco.mj_saveLastXML('hand.xml'",
    ),
    "options that are taken over": (
        attached('<attach model="hand" body="palm" prefix="h_"/>', settings='<compiler conflict="merge"/>'),
        'conflict="merge" takes over the options of the attached model, which is not read; write the <option> into',
    ),
    "a muscle that is attached": (
        attached('<attach model="hand" body="aside" prefix="h_"/>'), "<muscle>: a muscle is not read"
    ),
    "a loop that is attached": (attached('<attach model="hand" prefix="h_"/>'), "closes a loop of bodies"),
    "itself": (
        attached('<attach model="a" prefix="a_"/>', '<model name="a" file="arm.xml"/>'), "without end; attach each"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_faults_of_attached_models_name_the_remedy(name: str, tmp_path: Path) -> None:
    text, told = FAULTS[name]
    hand = HAND.replace('<muscle joint="s"/>', "") if "loop" in name else HAND
    written(text, tmp_path, hand.replace('<muscle tendon="all"/>', "") if "loop" in name else hand)
    with pytest.raises(DescriptionError) as caught:
        robot(text, tmp_path)
    assert told in str(caught.value) and ": line " in str(caught.value) and "\n" not in str(caught.value)
