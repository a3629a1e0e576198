"""MJCF: objects and mocap bodies beside a robot, joints coupled by a tendon: read as MuJoCo has them, or refused."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_mjcf import BODY, HINGE, LAST, arm, assert_as_mujoco, robot

from dynident.api.given_robots import robot_of
from dynident.errors import BadArgument, DescriptionError
from dynident.exports.models.proving.robot_model_proof import reload_mjcf
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import OWN, Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.mjcf_own import beside, patched_mjcf
from dynident.model.dynamic_model import DynamicModel

mujoco = pytest.importorskip("mujoco")

CAN = (
    '<body name="can" pos="1 0 0"><freejoint/><geom size=".1"/><site name="top"/>'
    '<body pos=".1 0 0"><geom size=".05"/></body></body>'
)
#: A robot that floats.
LEGS = f"""<body name="torso"><freejoint/>{BODY}<body name="leg"><joint name="hip"/>{BODY}
<body pos=".1 0 0"><joint name="knee" axis="0 1 0"/>{BODY}</body></body></body>"""
#: Three joints, two of them with a position at which they are placed as written.
HAND = HINGE.replace("/>", ' ref="20"/>') + BODY + f'<body name="b"><joint name="b" ref="-30"/>{BODY}</body>'


def coupled(joints: str, equality: str = 'tendon1="t" polycoef=".3"', more: str = "") -> str:
    """Return an arm with a fixed tendon over some joints, whose length is held."""
    parts = "".join(f'<joint joint="{name}" coef="{coef}"/>' for name, coef in map(str.split, joints.split(",")))
    return arm(
        HAND, tail=f'<tendon><fixed name="t">{parts}</fixed>{more}</tendon><equality><tendon {equality}/></equality>'
    )


SCENES = {
    "an object in front": (
        arm(HINGE + BODY).replace("<worldbody>", f"<worldbody>{CAN}"),
        "bodies that float freely (can)",
    ),
    "names by number": (
        arm(f'<joint axis="0 1 0"/>{BODY}').replace("<worldbody>", f"<worldbody>{CAN}").replace(' name="can"', ""),
        "bodies that float freely (body1)",
    ),
    "objects in frames": (
        arm(HINGE + BODY).replace("</worldbody>", f'<frame pos="1 1 1">{CAN}</frame></worldbody>'),
        "bodies that float freely (can)",
    ),
    "a mass of all": (
        arm(HINGE + BODY, '<compiler settotalmass="7"/>').replace("<worldbody>", f"<worldbody>{CAN}"),
        "bodies that float freely (can)",
    ),
    "a robot that floats": (
        f"<mujoco><worldbody>{LEGS.replace('torso', 'first')}</worldbody></mujoco>",
        "the motion of floating bases, which are held still (first)",
    ),
    "legs beside an arm": (
        arm(HINGE + BODY)
        .replace("<worldbody>", f"<worldbody>{LEGS.replace('<freejoint/>', '<joint type=`free`/>')}{CAN}")
        .replace("`", '"'),
        "the motion of floating bases, which are held still (torso), bodies that float freely (can)",
    ),
    "a handle": (
        arm(HINGE + BODY, tail='<equality><weld body1="hand" body2="last"/></equality>').replace(
            "<worldbody>", '<worldbody><body name="hand" mocap="true"/>'
        ),
        "what ties it to mocap bodies (hand)",
    ),
    "two joints on a tendon": (coupled("a 1, b 1.5"), ""),
    "in the other order": (coupled("b 1.5, a 1", 'tendon1="t"'), ""),
    "one joint on a tendon": (coupled("b 2"), ""),
    "a row of tendons": (
        coupled("a 1, b 1.5", more='<fixed name="u"><joint joint="z" coef="2"/><joint joint="b" coef="-.5"/></fixed>')
        .replace("<equality>", '<equality><tendon tendon1="t"/>')
        .replace('tendon1="t" polycoef=".3"', 'tendon1="u"'),
        "",
    ),
}


@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'")
@pytest.mark.parametrize("name", SCENES)
def test_a_robot_among_objects_is_read_as_mujoco_reads_it(name: str, tmp_path: Path) -> None:
    text, left = SCENES[name]
    found, path = robot(text, tmp_path)
    assert found.note == "read from arm.xml" + (f"; without {left}" if left else "")
    assert_as_mujoco(found, path)
    assert left.partition(" (")[0] in robot_of(mujoco.MjModel.from_xml_path(str(path))).note


def test_a_tendon_couples_as_an_equality_of_joints_does(tmp_path: Path) -> None:
    """A held length: 1 (a - 20 deg) + 1.5 (b + 30 deg) = 0.3."""
    found, _ = robot(coupled("a 1, b 1.5"), tmp_path)
    mimic = found.joints[1].mimic
    assert mimic is not None and mimic.joint == "a" and found.joint_names == ("a", "z")
    q = 0.7
    follower = mimic.multiplier * q + mimic.offset
    assert (q - np.radians(20)) + 1.5 * (follower + np.radians(30)) == pytest.approx(0.3, abs=1e-14)


@pytest.mark.parametrize(
    "name",
    ["an object in front", "a robot that floats", "legs beside an arm", "two joints on a tendon", "a row of tendons"],
)
def test_identified_values_return_into_the_file(name: str, tmp_path: Path) -> None:
    """The object and the tendon stay as they are, and MuJoCo has the torques of the changed file."""
    found, path = robot(SCENES[name][0], tmp_path)
    model = DynamicModel(found)
    nominal = model.nominal()
    assert nominal is not None
    source, estimate = OwnDescription(path, path.read_bytes()), SimpleNamespace(model=model)
    subject = Identified(estimate, 1.2 * nominal, OWN, source)  # pyright: ignore[reportArgumentType]
    patched = patched_mjcf(subject, drives_of(subject), source, lump=False, output=path)
    (tmp_path / "again").mkdir()
    proofs = list(reload_mjcf(subject, source, patched, beside(path, source, patched), tmp_path / "again"))
    assert [proof.why_not for proof in proofs] == ["", ""]
    for proof in proofs:
        wanted: Any = proof.expected
        np.testing.assert_allclose(np.asarray(proof.torque), wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())
    for kept in (CAN, "<tendon>"):
        assert (kept in path.read_text()) == (kept in beside(path, source, patched)[path].decode())


FAULTS = {
    "an object alone": (f"<mujoco><worldbody>{CAN}</worldbody></mujoco>", "'can' floats freely", "floats"),
    "a loop between links": (
        arm(HINGE + BODY, tail='<equality><connect body1="first" body2="last" anchor="0 0 0"/></equality>'),
        "<connect> closes a loop",
        "no linear one",
    ),
    "two tendons": (
        coupled("a 1, b 1", 'tendon1="t" tendon2="u"', '<fixed name="u"><joint joint="z" coef="1"/></fixed>'),
        "other than a linear one of two joints",
        "no linear one",
    ),
    "three joints": (coupled("a 1, b 1, z 1"), "other than a linear one of two joints", "no linear one"),
    "a tendon over sites": (
        arm(
            HINGE + '<site name="s" pos="0 0 1"/><site name="r"/>' + BODY,
            tail='<tendon><spatial name="t"><site site="s"/><site site="r"/></spatial></tendon>'
            '<equality><tendon tendon1="t"/></equality>',
        ),
        "other than a linear one of two joints",
        "no linear one",
    ),
    "tied twice": (
        coupled("a 1, b 1").replace("</equality>", '<joint joint1="b"/><joint joint1="a"/></equality>'),
        "joint 'b' is tied twice",
        "tied twice",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_other_scenes_are_refused(name: str, tmp_path: Path) -> None:
    text, told, of_model = FAULTS[name]
    with pytest.raises(DescriptionError) as caught:
        robot(text, tmp_path)
    message = str(caught.value)
    assert "arm.xml: line 1, <" in message and told in message and "; " in message and "\n" not in message
    if name != "an object alone":
        with pytest.raises(BadArgument, match=of_model):
            robot_of(mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml")))


def test_names_of_tendons_are_checked(tmp_path: Path) -> None:
    copied = coupled("z 1, b 1")
    for one in (LAST, f'<body name="b"><joint name="b" ref="-30"/>{BODY}</body>'):
        copied = copied.replace(one, f'<replicate count="2">{one}</replicate>')
    for text, told in (
        (coupled("a 1, b 1", 'tendon1="tt"'), "tendon1 'tt' is no tendon; correct the name; did you mean 't'"),
        (coupled("a 1, b 1", 'tendon2="t"'), "no attribute 'tendon1'; write tendon1="),
        (arm(HAND, tail="<equality><joint/></equality>"), "no attribute 'joint1'; write joint1="),
        (coupled("a 1, bb 1"), "joint 'bb' is no joint; correct the name; did you mean 'b'"),
        (coupled("a 1, a 2"), "the tendon has joint 'a' twice; write the sum of both coef once"),
        (copied, "no <replicate> copies all that it runs over"),
        (
            arm(HAND, '<compiler autolimits="false"/>', '<actuator><motor joint="a" forcerange="-1 1"/></actuator>'),
            "forcerange without forcelimited where autolimits is false",
        ),
        (
            arm(HAND, tail='<contact><exclude body1="world" body2="firs"/></contact>'),
            "body2 'firs' is no body; correct the name; did you mean 'first'",
        ),
    ):
        with pytest.raises(DescriptionError, match=told):
            robot(text, tmp_path)
        with pytest.raises(ValueError, match=r"not found|unknown|repeated|required|missing|but not `forcelimited`"):
            mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
