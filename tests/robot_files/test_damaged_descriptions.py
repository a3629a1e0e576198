"""A damaged description either still reads or gets a DescriptionError of one line; nothing else ever comes out."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.errors import DescriptionError
from dynident.model.documents.robot_data import robot_to_dict
from dynident.robot_files import read_robot, reading
from dynident.robot_files.formats.urdf import read_urdf

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.5"/><mass value="1.5"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial></link>
  <link name="hand"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="10" velocity="2"/><dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="wrist" type="continuous"><parent link="upper"/><child link="hand"/>
    <mimic joint="shoulder" multiplier="2"/></joint>
</robot>"""
TABLE = """name: arm
convention: standard
joints:
  - {name: one, a: 0.1, alpha: -pi/2, d: 0.3, limits: {lower: -1, upper: 1}, drive: {gear_ratio: 100, gain: 5}}
  - {kind: prismatic, a: 0.2, alpha: 0, theta: 0, link: {inertia: {parameters: [1, 0, 0, 1, 0, 1, 0, 0, 0, 1]}}}
tool: {translation: [0, 0, 0.1]}
coupling: [[1, 0], [0.5, 1]]
"""
WHOLE = {"urdf": URDF, "dh": TABLE, "native": json.dumps(robot_to_dict(read_robot("generic-scara")))}
PIECES = [
    "1e308", "-1e50", "9e49", "nan", "inf", "<", ">", '"', "&", "[", "]", "{", "}", "\0", "\x1b", "pi/", ":", "\n",
    "*a", "&a ", "!!x ", "\t", "null", "true", "-", "- ", ", ", "?", "|", "<!--", "<![CDATA[", "<?x", "0", "1" * 400,
]  # fmt: skip


@pytest.mark.parametrize("name", WHOLE)
@given(data=st.data())
@settings(max_examples=150, deadline=None)
def test_nothing_but_a_description_error(name: str, data: st.DataObject) -> None:
    text = WHOLE[name]
    for _ in range(data.draw(st.integers(1, 3))):
        start = data.draw(st.integers(0, len(text)))
        text = text[:start] + data.draw(st.sampled_from(PIECES)) + text[start + data.draw(st.integers(0, 12)) :]
    try:
        robot = reading.DESCRIPTIONS.get(name)().read("damaged", text.encode())
    except DescriptionError as problem:
        assert str(problem).isprintable()
    else:
        assert all(np.all(np.isfinite(link.inertia.vector)) for link in robot.links if link.inertia is not None)


def test_the_largest_numbers_do_not_overflow() -> None:
    text = URDF.replace('"1.5"', '"1e50"').replace('"0.1 0 0"', '"1e50 1e50 1e50"').replace('"0.01"', '"1e50"')
    (link, _) = read_urdf("arm.urdf", text.encode()).links
    assert link.inertia is not None and math.isfinite(float(np.abs(link.inertia.vector).max()))
