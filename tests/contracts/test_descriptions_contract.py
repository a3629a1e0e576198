"""What every reader of robot models must do: read the same robot every time, and refuse damage by name."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.errors import DescriptionError
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot
from dynident.robot_files import read_robot
from dynident.robot_files.formats.base import DESCRIPTIONS

PARTS = DESCRIPTIONS.names()

_LINK = (
    '<link name="{name}"><inertial><origin xyz="0.1 0 0.02"/><mass value="2"/>'
    '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>'
)
_JOINT = (
    '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="0 {offset} 0.3" rpy="0 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="3"/>'
    "</joint>"
)
_BODIES = [_LINK.format(name=name) for name in "abc"]
_JOINTS = [
    _JOINT.format(name="j1", parent="a", child="b", offset=0.1),
    _JOINT.format(name="j2", parent="b", child="c", offset=0.2),
]


def urdf(parts: list[str]) -> bytes:
    return f'<robot name="arm">{"".join(parts)}</robot>'.encode()


#: A sound file of each format that ships; a format of another package is tried with those, which it refuses.
SAMPLES = {
    "urdf": urdf([*_BODIES, *_JOINTS]),
    "mjcf": b"""<mujoco><worldbody><body name="a"><joint name="j1" axis="0 1 0"/><geom size=".1"/>
<body name="b" pos="1 0 0">
<joint name="j2"/><inertial pos="0 0.37 0" mass="1" diaginertia="1 1 1"/></body></body></worldbody></mujoco>""",
    "sdf": b"""<sdf version="1.7"><model name="m"><link name="a"/><link name="b"><pose>0 0.37 0 0 0 0</pose></link>
<link name="c"/><joint name="j1" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="j2" type="prismatic"><parent>b</parent><child>c</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>""",
    "dh": b"name: arm\nconvention: modified\njoints:\n- {a: 0, alpha: 0, d: 0.3}\n- {a: 0.25, alpha: 1.5, d: 0}\n",
    "native": json.dumps(robot_to_dict(read_robot("generic-scara"))).encode(),
}


#: What is put into a file beside bytes that mean nothing.
PIECES = [
    b"1e308", b"-1e50", b"9e49", b"nan", b"inf", b"<", b">", b'"', b"&", b"[", b"]", b"{", b"}", b"\0", b"\x1b", b"pi/",
    b":", b"\n", b"*a", b"&a ", b"!!x ", b"\t", b"null", b"true", b"-", b"- ", b", ", b"?", b"|", b"<!--", b"<![CDATA[",
    b"<?x", b"0", b"1" * 400,
]  # fmt: skip


@pytest.fixture(params=PARTS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def read(name: str, data: bytes) -> Robot:
    return DESCRIPTIONS.make(name).read("arm.file", data)


def test_it_is_known_by_its_suffix_or_first_bytes(name: str) -> None:
    part = DESCRIPTIONS.make(name)
    assert part.suffixes and all(suffix.startswith(".") and suffix == suffix.lower() for suffix in part.suffixes)
    others = [DESCRIPTIONS.make(other) for other in PARTS if other != name]
    assert not any(set(part.suffixes) & set(other.suffixes) for other in others)
    if name in SAMPLES:
        assert SAMPLES[name].startswith(part.opening)


@pytest.mark.parametrize("name", [name for name in PARTS if name in SAMPLES])
def test_the_same_bytes_give_the_same_robot(name: str) -> None:
    data = SAMPLES[name]
    one, other = read(name, data), read(name, bytes(bytearray(data)))
    assert robot_to_dict(one) == robot_to_dict(other) and one.dof >= 2
    motion = DynamicModel(one).random_motion(5)
    torques = DynamicModel(one).regressor(motion)
    assert np.all(np.isfinite(torques))
    np.testing.assert_array_equal(torques, DynamicModel(other).regressor(motion))
    for joint in one.joints:
        np.testing.assert_allclose(joint.rotation @ joint.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(joint.rotation) > 0 and np.linalg.norm(joint.axis) == pytest.approx(1.0)


@pytest.mark.parametrize("name", [name for name in PARTS if name in SAMPLES])
def test_what_is_read_goes_through_the_format_of_dynident(name: str) -> None:
    robot = read(name, SAMPLES[name])
    again = read("native", json.dumps(robot_to_dict(robot)).encode())
    assert robot_to_dict(again) == robot_to_dict(robot)


@pytest.mark.parametrize("name", [name for name in PARTS if name in SAMPLES])
def test_every_cut_is_refused_or_a_robot(name: str) -> None:
    data, refused = SAMPLES[name], 0
    for end in range(0, len(data), max(1, len(data) // 60)):
        try:
            read(name, data[:end])
        except DescriptionError as error:
            refused += 1
            assert "arm.file" in str(error) and "\n" not in str(error)
    assert refused > 20


@pytest.mark.parametrize("name", [name for name in PARTS if name in SAMPLES])
@pytest.mark.parametrize("word", [b"nan", b"inf", b"-.inf", b"1e999", b"one", b"[]"])
def test_numbers_that_are_none_are_refused(name: str, word: bytes) -> None:
    number = {"urdf": b"0.02", "dh": b"0.25", "native": b"0.35", "mjcf": b"0.37", "sdf": b"0.37"}[name]
    data = SAMPLES[name]
    assert number in data
    with pytest.raises(DescriptionError) as caught:
        read(name, data.replace(number, word, 1))
    assert "arm.file" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("data", [b"", b"\x00", b"\xff\xfe\x00", b"<robot/>", b"{}", b"[]", b"name: x", b"a" * 5000])
def test_foreign_bytes_are_an_error_on_one_line(name: str, data: bytes) -> None:
    with pytest.raises(DescriptionError) as caught:
        read(name, data)
    assert "arm.file" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [name for name in PARTS if name in SAMPLES])
@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_bytes_put_anywhere_are_refused_or_a_robot(data: st.DataObject, name: str) -> None:
    text = SAMPLES[name]
    for _ in range(data.draw(st.integers(1, 3))):
        at, piece = data.draw(st.integers(0, len(text))), data.draw(st.sampled_from(PIECES) | st.binary(max_size=80))
        text = text[:at] + piece + text[at + data.draw(st.integers(0, 12)) :]
    try:
        robot = read(name, text)
    except DescriptionError as error:
        assert str(error).isprintable()
    else:
        assert all(np.all(np.isfinite(link.inertia.vector)) for link in robot.links if link.inertia is not None)


def test_the_order_of_elements_does_not_matter_in_xml() -> None:
    """Links and joints of a URDF may stand in any order: the same tree comes out, and the same torques."""
    parts = [*_BODIES, *_JOINTS]
    plain = read("urdf", SAMPLES["urdf"])
    assert plain.nominal is not None
    motion = DynamicModel(plain).random_motion(5)
    for seed in range(6):
        order = np.random.default_rng(seed).permutation(len(parts))
        other = read("urdf", urdf([parts[k] for k in order]))
        assert other.joint_names == plain.joint_names and other.nominal is not None
        found = DynamicModel(other).torque(motion, other.nominal)
        np.testing.assert_allclose(found, DynamicModel(plain).torque(motion, plain.nominal), rtol=1e-12)
