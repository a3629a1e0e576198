"""Values of an MJCF that come from several places (classes, followers, defaults of sections), against mj_inverse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mjcf_torques import torque_difference

from dynident.api.given_robots import robot_of
from dynident.errors import BadArgument, DescriptionError
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

mujoco = pytest.importorskip("mujoco")

TWO = (
    '<mujoco>{head}<worldbody><body name="a"><joint name="j1" axis="0 1 0" {one}/><geom type="capsule" '
    'fromto="0 0 0 .3 .1 .2" size=".04"/><body name="b" pos=".3 0 0"><joint name="j2" axis="0 0 1" pos=".01 .02 .03" '
    '{two}/><geom type="box" size=".1 .02 .03" pos=".1 0 .05"/><body name="c" pos=".2 0 0"><joint name="j3" '
    'axis="1 1 0" {three}/><geom size=".05" pos=".1 0 0"/></body></body></body></worldbody>{tail}</mujoco>'
)


def two(**parts: str) -> str:
    return TWO.format(**{"head": "", "one": "", "two": "", "three": "", "tail": "", **parts})


def both(text: str, folder: Path) -> tuple[Robot, Any]:
    (folder / "arm.xml").write_text(text)
    return read_robot(folder / "arm.xml"), mujoco.MjModel.from_xml_path(str(folder / "arm.xml"))


ONE = '<mujoco>{}<worldbody><body><joint name="a" axis="0 1 0" {}/><geom {} pos=".2 .1 0"/></body></worldbody></mujoco>'
TIE = '<equality><joint joint1="j2" joint2="j1" {}/></equality>'
CHAIN = (
    '<equality><joint joint1="j3" joint2="j2" polycoef=".1 -3 0 0 0"/><joint joint1="j2" joint2="j1" '
    'polycoef=".2 2 0 0 0"/></equality>'
)
FILES = {
    "a radius, and the length of the class": ONE.format(
        '<default><geom type="capsule" size="0.05 0.1"/></default>', "", 'size=".04"'
    ),
    "one length, and two of the class": ONE.format(
        '<default><geom type="box" size=".1 .2 .3"/></default>', "", 'size=".05"'
    ),
    "classes in classes": ONE.format(
        '<default><geom type="box" size=".1 .2 .3"/><default class="c"><geom size=".2 .4"/></default></default>',
        "",
        'class="c" size=".05"',
    ),
    "a follower with armature and damping": two(
        one='armature=".05" damping=".5"', two='armature=".3" damping=".7"', tail=TIE.format('polycoef="0 -2 0 0 0"')
    ),
    "a class with armature": two(head='<default><joint armature=".1"/></default>', tail=TIE.format("")),
    "a chain of followers with armature": two(
        head='<default><joint armature=".1" damping=".2"/></default>', tail=CHAIN
    ),
    "a follower with a motor": two(
        tail=TIE.format('polycoef="0 2 0 0 0"')
        + '<actuator><motor joint="j2" gear="20" armature="1e-3" damping="1e-2"/><motor joint="j1"/></actuator>'
    ),
    "gravity that a flag turns off": two(head='<option><flag gravity="disable"/></option>'),
    "a joint that is held still": two(
        one='ref="10"', tail='<equality><joint joint1="j2" polycoef=".7"/></equality>', two='ref="20" damping="3"'
    ),
    "a slide that is held still": two(
        tail='<equality><joint joint1="j2" polycoef=".7"/></equality>', two='type="slide" ref=".2" armature="2"'
    ),
    "a joint that follows one that is held still": two(
        two='ref="20"',
        tail='<equality><joint joint1="j3" joint2="j2" polycoef=".1 2"/><joint joint1="j2" polycoef=".3"/></equality>',
    ),
    "an empty body with bounds": two(head='<compiler boundmass=".3" boundinertia=".01"/>').replace(
        '<body name="c"', '<body name="empty" pos=".1 .2 .3"/><body name="c"'
    ),
    "an empty body in a frame with bounds": two(head='<compiler boundmass=".3"/>').replace(
        '<body name="c"', '<frame pos="1 0 0" euler="0 0 90"><body name="empty" pos=".1 .2 .3"/></frame><body name="c"'
    ),
    "a chain of followers with references": two(one='ref="10"', two='ref="-20"', three='ref="5"', tail=CHAIN),
    "equalities that a class turns off": two(
        head='<default><equality active="false"/></default>', tail=TIE.format('polycoef="0 2 0 0 0"')
    ),
    "one coefficient": two(tail=TIE.format('polycoef="0.1"')),
    "defaults of joints, which equalities have not": two(
        head='<default><joint limited="false" damping="1"/></default>', tail=TIE.format('polycoef="0 2"')
    ),
    "joints without a name beside one that is called so": ONE.format("", "", 'size=".1"').replace(
        "</body></worldbody>",
        '<body name="body1" pos=".3 0 0"><joint/><geom size=".1" pos=".1 0 0"/></body></body></worldbody>',
    ),
}

#: A body and what is on it, thrice; actuators and equalities name what is copied.
COPIES = (
    '<mujoco>{}<worldbody><replicate count="3" sep="-" offset="0 1 0" euler="0 0 20"><body name="b"><joint name="a" '
    'axis="0 1 0" ref="10"/><geom size=".1" pos=".2 .1 0"/><body pos=".3 0 0"><joint name="c" axis="1 0 0" ref="20" '
    'armature=".1"/><geom size=".1" pos=".1 .2 .3"/></body></body></replicate><body><joint name="q" axis="1 1 0"/>'
    '<geom size=".1" pos=".2 .1 0"/></body></worldbody>{}</mujoco>'
)
FILES |= {
    f"{what}, switched off": two(
        head=f'<option density="2" viscosity=".1"><flag {flags}/></option>',
        one='damping="2" stiffness="3" frictionloss="4"',
        tail=TIE.format("") + '<actuator><motor joint="j1" damping="1"/></actuator>',
    )
    for what, flags in {
        "damping, springs and a fluid": 'spring="disable" damper="disable"',
        "all constraints and forces": 'constraint="disable" spring="disable" damper="disable"',
        "equalities and forces": 'equality="disable" damper="disable" spring="disable"',
    }.items()
} | {
    "actuators of copies": COPIES.format(
        "", '<actuator><motor joint="c" gear="3" armature=".2" damping=".3"/></actuator>'
    ),
    "equalities in copies": COPIES.format("", '<equality><joint joint1="c" joint2="a" polycoef=".1 -2"/></equality>'),
    "copies that are held still": COPIES.format("", '<equality><joint joint1="c" polycoef=".1"/></equality>'),
    "one copy that follows": COPIES.format("", '<equality><joint joint1="c-1" joint2="q"/></equality>'),
    "copies in copies": COPIES.format("", '<actuator><motor joint="a" armature=".2"/></actuator>')
    .replace(
        '<body pos=".3 0 0"><joint name="c"',
        '<replicate count="2" offset="0 0 1" sep="."><body><joint name="i" axis="1 0 0"/><geom size=".1" pos=".1 0 1"/>'
        '</body></replicate><body pos=".3 0 0"><joint name="c"',
    )
    .replace("</actuator>", '<motor joint="i" armature=".3"/></actuator>'),
}

#: Fixed tendons over joints that are copied, within and around the copies.
TENDON = '<tendon><fixed name="t">{}</fixed><fixed name="u">{}</fixed></tendon><equality>{}</equality>'
_A, _C, _LAST, _Q = (
    f'<joint joint="{name}" coef="{coef}"/>' for name, coef in (("a", 2), ("c", -3), ("c-2", 1), ("q", 0.5))
)
_FIRST = '<worldbody><body><joint name="q" axis="1 1 0"/><geom size=".1" pos=".2 .1 0"/></body>'
_COPIED = {
    "each copy with a tendon": (_A + _C, _A, '<tendon tendon1="t" polycoef=".2"/>'),
    "each copy with one joint on a tendon": (_C, _A, '<tendon tendon1="t" polycoef=".2"/>'),
    "the tendon of one copy": (_A + _C, _A, '<tendon tendon1="t-1"/>'),
    "two tendons of each copy": (_C, _A, '<tendon tendon1="t" tendon2="u" polycoef=".2 3"/>'),
    "two tendons over the same joints": (_A + _C, _A, '<tendon tendon1="t" tendon2="u" polycoef=".1 2"/>'),
    "tendons over what is outside": (_Q + _C, _A, '<tendon tendon1="t" polycoef=".2"/>'),
    "a tendon over a copy": (_Q + _LAST, _A, '<tendon tendon1="t"/>'),
    "tendons that are free": (_A + _C, _A, ""),
}
FILES |= {
    what: COPIES.format("", TENDON.format(*parts))
    .replace(_FIRST.removeprefix("<worldbody>"), "")
    .replace("<worldbody>", _FIRST)
    for what, parts in _COPIED.items()
}
#: Copies of copies: those of a name that the inner ones make are one in each of the outer ones.
FILES |= {
    f"{what}, in copies": FILES[what]
    .replace("<replicate", '<replicate count="2" sep="." offset="1 0 0" euler="5 6 7"><replicate')
    .replace("</replicate>", "</replicate></replicate>")
    for what in ("equalities in copies", *_COPIED)
    if what != "a tendon over a copy"
}


@pytest.mark.parametrize("name", FILES)
def test_torques_are_those_of_mujoco(name: str, tmp_path: Path) -> None:
    robot, model = both(FILES[name], tmp_path)
    assert torque_difference(robot, model) < 1e-12
    given = robot_of(model)
    assert given.joint_names == robot.joint_names and torque_difference(given, model) < 1e-12
    assert [link.name for link in given.links] == [link.name for link in robot.links]


def test_the_first_order_of_damping_keeps_the_others_of_the_class(tmp_path: Path) -> None:
    text = ONE.format('<default><joint damping="0 0.5"/></default>', 'damping="0.7"', 'type="box" size=".1 .1 .1"')
    robot, model = both(text, tmp_path)
    assert model.dof_dampingpoly[0].tolist() == [0.5, 0.0]
    assert robot.joints[0].damping == 0.7 and "without damping of second and third order (a)" in robot.note
    assert "without damping of second and third order" in robot_of(model).note


def test_a_follower_has_no_share_of_its_own_left(tmp_path: Path) -> None:
    text = two(one='frictionloss=".1"', two='frictionloss=".4" armature=".3"', tail=TIE.format('polycoef="0 -2 0 0 0"'))
    robot, _ = both(text, tmp_path)
    leader, follower = robot.joints[0], robot.joints[1]
    assert leader.friction is not None
    np.testing.assert_allclose([leader.friction, leader.drive.reflected_inertia], [0.1 + 2 * 0.4, 4 * 0.3])
    assert (follower.friction, follower.damping, follower.drive.reflected_inertia) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("motor", "told"),
    [
        ('joint="j1" damping="0.1 0.2"', "without damping of second and third order (j1)"),
        ('tendon="t" armature="0.2"', "without armature and damping of actuators beside joints (m)"),
    ],
)
def test_what_an_actuator_adds_beyond_joints_and_first_order_is_named(motor: str, told: str, tmp_path: Path) -> None:
    tendon = '<tendon><fixed name="t"><joint joint="j1" coef="1"/></fixed></tendon>'
    tail = f'{tendon}<actuator><motor name="m" {motor}/></actuator>'
    (tmp_path / "arm.xml").write_text(two(tail=tail))
    assert told in read_robot(tmp_path / "arm.xml").note
    (tmp_path / "arm.xml").write_text(two(tail=tail.replace(' armature="0.2"', "").replace("0.1 0.2", "0.1")))
    assert told not in read_robot(tmp_path / "arm.xml").note


def test_a_class_gives_tendons_a_spring(tmp_path: Path) -> None:
    tendon = '<tendon><fixed name="t"><joint joint="j1" coef="1"/></fixed></tendon>'
    robot, model = both(two(head='<default><tendon stiffness="100"/></default>', tail=tendon), tmp_path)
    assert model.tendon_stiffness[0] == 100 and robot.note.endswith("without tendons (t)")


def test_names_are_given_around_those_of_the_file(tmp_path: Path) -> None:
    inner = '<body name="body1"><joint name="joint1" axis="0 0 1"/><geom size=".1" pos=".1 0 0"/></body>'
    text = f'<mujoco><worldbody><body name=""><joint axis="0 1 0"/><geom size=".1"/>{inner}</body></worldbody></mujoco>'
    robot, _ = both(text, tmp_path)
    assert robot.joint_names == ("joint2", "joint1") and [link.name for link in robot.links] == ["body2", "body1"]


def test_a_range_that_ends_below_its_start_is_none(tmp_path: Path) -> None:
    robot, model = both(two(one='range="20 10"', two='range="10 20"'), tmp_path)
    assert model.jnt_limited.tolist() == [0, 1, 0]
    assert [np.isfinite(joint.limits.upper) for joint in robot.joints] == [False, True, False]
    with pytest.raises(DescriptionError, match="ends below its start"):
        both(two(one='limited="true" range="20 10"'), tmp_path)


def test_a_class_is_not_shown_as_a_name(tmp_path: Path) -> None:
    text = two(head='<default><default class="f"><joint axis="0 0 0"/></default></default>')
    with pytest.raises(DescriptionError, match=r"<joint class='f'>: axis"):
        both(text.replace('<joint name="j1" axis="0 1 0" ', '<joint class="f" '), tmp_path)


@pytest.mark.parametrize(
    ("ties", "told"),
    [
        (
            '<joint joint1="j2" joint2="j1"/><joint joint1="j1" joint2="j2"/>',
            "follow each other: 'j1' -> 'j2' -> 'j1': redundant equality c",
        ),
        ('<joint joint1="j2" joint2="j1"/><joint joint1="j2" joint2="j3"/>', "joint 'j2' is tied twice"),
        ('<joint joint1="j2" joint2="j1" polycoef="0 1 1 0 0"/>', "is no linear one of joints"),
        ('<joint joint1="j1"/><joint joint1="j2"/><joint joint1="j3"/>', "a model without moving joints"),
    ],
)
def test_ties_that_cannot_be_of_a_model_in_python(ties: str, told: str) -> None:
    model = mujoco.MjModel.from_xml_string(two(tail=f"<equality>{ties}</equality>"))
    with pytest.raises(BadArgument, match=told):
        robot_of(model)


def test_a_geom_too_small_for_its_mass_is_refused(tmp_path: Path) -> None:
    """MuJoCo refuses it by the mass of its body; with a density it adds nothing."""
    for small in ('type="sphere" size="1e-110"', 'type="capsule" size="1e-110 1e-108"'):
        text = ONE.format("", "", f'{small} mass="1"')
        with pytest.raises(ValueError, match="must be larger than mjMINVAL"):
            mujoco.MjModel.from_xml_string(text)
        with pytest.raises(DescriptionError, match=r"<geom>: size '.*' is too small for its mass of 1 kg; write len"):
            both(text, tmp_path)


def test_an_equality_that_mujoco_leaves_out_is_refused(tmp_path: Path) -> None:
    """One joint is copied, the other is not: MuJoCo refuses it, or has no equality and no word of it."""
    text = COPIES.format("", '<equality><joint joint1="c" joint2="q"/></equality>')
    with pytest.raises(ValueError, match="unknown element 'c'"):
        mujoco.MjModel.from_xml_string(text)
    first = '<worldbody><body><joint name="q"/><geom size=".1"/></body>'
    before = text.replace("<worldbody>", first).replace('<body><joint name="q" axis', '<body><joint name="r" axis')
    assert mujoco.MjModel.from_xml_string(before).neq == 0
    with pytest.raises(DescriptionError, match=r"copies both of its joints; name those of copies, such as c-0 and q"):
        both(text, tmp_path)


def test_flags_end_what_they_switch_off(tmp_path: Path) -> None:
    head = '<option density="1"><flag frictionloss="disable" {}/></option>'
    one = 'frictionloss=".1" damping="2 1" stiffness="3"'
    for flags, damping, told in (
        ("", 2.0, "without a fluid, springs of joints"),
        ('damper="disable"', 0.0, "without a fluid, springs of joints"),
        ('damper="disable" spring="disable"', 0.0, ""),
    ):
        robot, model = both(two(head=head.format(flags), one=one), tmp_path)
        for found in (robot, robot_of(model)):
            assert (found.joints[0].friction, found.joints[0].damping) == (0.0, damping)
            assert ("of second" in found.note) == ("damper" not in flags)
            assert "without" not in found.note if not told else "springs of joints" in found.note
    with pytest.raises(
        DescriptionError, match=r"<flag>: damper 'disabled' is not known; choose one of: enable, disable"
    ):
        both(two(head='<option><flag damper="disabled"/></option>'), tmp_path)
