"""A sound URDF and a sound DH table, what to spoil in them, and the whole message that must come of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dynident.errors import DescriptionError
from dynident.robot_files import read_robot

#: What to replace by what (None: the whole file), and the message after the file name.
Fault = tuple[str | None, str | bytes, str]

GOOD_URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0.1 0 0" rpy="0 0 0.5"/>
      <mass value="1.5"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/>
    </inertial>
  </link>
  <link name="hand"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.3" rpy="0 0 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="10" velocity="2"/>
    <dynamics damping="0.5" friction="0.1"/>
  </joint>
  <joint name="wrist" type="continuous">
    <parent link="upper"/>
    <child link="hand"/>
    <mimic joint="shoulder" multiplier="2" offset="0.1"/>
  </joint>
</robot>
"""

GOOD_DH = """name: arm
convention: modified
joints:
  - name: swivel
    a: 0
    alpha: -pi/2
    d: 0.3
    limits: {lower: -1, upper: 1, velocity: 2}
    drive: {gear_ratio: 100, rotor_inertia: 1e-4, gain: 5}
    damping: 0.5
    link:
      name: upper
      inertia:
        mass: 1.5
        centre_of_mass: [0.1, 0, 0]
        about_centre: [0.01, 0, 0, 0.02, 0, 0.03]
  - name: slide
    kind: prismatic
    a: 0.2
    alpha: 0
    theta: 0
tool: {translation: [0, 0, 0.1]}
coupling: [[1, 0], [0.5, 1]]
"""


def assert_refused(file: str, good: str, fault: Fault) -> None:
    """Write a sound description with one fault into ``file`` and hold the message of its reader against the stated."""
    old, new, message = fault
    assert old is None or old in good
    text = new if isinstance(new, bytes) else new.encode()
    Path(file).write_bytes(text if old is None else good.encode().replace(old.encode(), text, 1))
    with pytest.raises(DescriptionError) as caught:
        read_robot(file)
    assert str(caught.value) == f"{file}: {message}"
    assert "\n" not in str(caught.value)


def assert_sound(file: str, good: str) -> None:
    """Write the sound description and read it."""
    Path(file).write_text(good)
    assert read_robot(file).name == "arm"
