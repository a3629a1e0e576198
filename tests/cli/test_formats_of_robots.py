"""The way of a user with a robot in each format: init, identify, export into the same format, read again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.cli.main import main
from dynident.model.dynamic_model import DynamicModel
from dynident.robot_files import read_robot

URDF = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="base"/>
<link name="upper"><inertial><origin xyz=".1 .02 .03"/><mass value="3"/>
<inertia ixx=".02" iyy=".05" izz=".04" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz=".15 0 .01"/><mass value="2"/>
<inertia ixx=".01" iyy=".03" izz=".03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="elbow" type="continuous"><origin xyz=".4 0 0"/><parent link="upper"/><child link="fore"/>
<axis xyz="0 1 0"/></joint></robot>"""
MJCF = """<mujoco model="arm"><worldbody><body name="upper">
<inertial pos=".1 .02 .03" mass="3" diaginertia=".02 .05 .04"/><joint name="shoulder" axis="0 1 0"/>
<body name="fore" pos=".4 0 0"><inertial pos=".15 0 .01" mass="2" diaginertia=".01 .03 .03"/>
<joint name="elbow" axis="0 1 0"/></body></body></worldbody></mujoco>"""
SDF = """<sdf version="1.9"><model name="arm"><link name="base"/>
<link name="upper"><inertial><pose>.1 .02 .03 0 0 0</pose><mass>3</mass>
<inertia><ixx>.02</ixx><iyy>.05</iyy><izz>.04</izz></inertia></inertial></link>
<link name="fore"><pose>.4 0 0 0 0 0</pose><inertial><pose>.15 0 .01 0 0 0</pose><mass>2</mass>
<inertia><ixx>.01</ixx><iyy>.03</iyy><izz>.03</izz></inertia></inertial></link>
<joint name="shoulder" type="continuous"><parent>base</parent><child>upper</child><axis><xyz>0 1 0</xyz></axis></joint>
<joint name="elbow" type="continuous"><parent>upper</parent><child>fore</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>"""
XACRO = URDF.replace('<link name="base"/>', '<link name="base"/><xacro:arg name="m" default="2"/>').replace(
    'value="2"', 'value="$(arg m)"'
)
USD = """#usda 1.0
(
  metersPerUnit = 1
  upAxis = "Z"
)
def Xform "upper" (
  prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
)
{
  float physics:mass = 3
  float3 physics:diagonalInertia = (.02, .05, .04)
  point3f physics:centerOfMass = (.1, .02, .03)
}
def Xform "fore" (
  prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
)
{
  double3 xformOp:translate = (.4, 0, 0)
  uniform token[] xformOpOrder = ["xformOp:translate"]
  float physics:mass = 2
  float3 physics:diagonalInertia = (.01, .03, .03)
  point3f physics:centerOfMass = (.15, 0, .01)
}
def PhysicsRevoluteJoint "shoulder"
{
  rel physics:body1 = </upper>
  uniform token physics:axis = "Y"
}
def PhysicsRevoluteJoint "elbow"
{
  rel physics:body0 = </upper>
  rel physics:body1 = </fore>
  point3f physics:localPos0 = (.4, 0, 0)
  uniform token physics:axis = "Y"
}
"""

#: Name of the file, what it holds, the target of the export and the file that it writes.
FORMATS = {
    "mjcf": ("arm.xml", MJCF, "mjcf", "found.xml"),
    "sdf": ("arm.sdf", SDF, "sdf", "found.sdf"),
    "xacro": ("arm.urdf.xacro", XACRO, "urdf", "found.urdf"),
    "usd": ("arm.usda", USD, "usd", "found.usda"),
}


def true_torque(q: Array, dq: Array, ddq: Array) -> Array:
    """Return the torques of the arm with a forearm of 1.5 times its mass and inertia, by Pinocchio."""
    pin: Any = pytest.importorskip("pinocchio")
    model = pin.buildModelFromXML(
        URDF.replace("continuous", "revolute").replace(
            "</joint>", '<limit lower="-9" upper="9" effort="99" velocity="99"/></joint>'
        )
    )
    body = model.inertias[2]
    model.inertias[2] = pin.Inertia(1.5 * body.mass, body.lever, 1.5 * body.inertia)
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)])


@pytest.mark.parametrize("name", FORMATS)
def test_from_the_file_and_back_into_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, text, target, result = FORMATS[name]
    if name in ("usd", "xacro"):
        pytest.importorskip({"usd": "pxr.Usd", "xacro": "xacro"}[name], reason=f"pip install 'dynident[{name}]'")
    monkeypatch.chdir(tmp_path)
    Path(file).write_text(text, encoding="utf-8")
    time = np.arange(0, 10, 0.01)
    rates, phases = np.array([[1.2, 2.9], [1.7, 3.6]]), np.array([[0.3, 1.1], [2.0, 0.4]])
    turned = rates * time[:, None, None] + phases
    q, dq = np.sin(turned).sum(axis=2) * 0.6, (rates * np.cos(turned)).sum(axis=2) * 0.6
    torque = true_torque(q, dq, -(rates**2 * np.sin(turned)).sum(axis=2) * 0.6)
    noise = np.random.default_rng(0).normal(scale=0.01, size=torque.shape)
    columns = "t," + ",".join(f"{kind}{k}" for kind in ("q", "dq", "tau") for k in (1, 2))
    rows = np.column_stack([time, q, dq, torque + noise])
    np.savetxt("run.csv", rows, delimiter=",", header=columns, comments="")

    assert main(["init", file, "run.csv", "-o", "case.yaml", "--quiet"]) == 0
    assert main(["identify", "case.yaml", "run.csv", "-o", "estimate.json", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["validate", "estimate.json", "run.csv"]) == 0
    told = capsys.readouterr().err
    assert f"next: dynident export estimate.json --to {target} -o identified{Path(result).suffix}" in told
    assert main(["report", "estimate.json", "-o", "report.html", "--quiet"]) == 0
    assert main(["export", "estimate.json", "--to", target, "-o", result]) == 0

    model = DynamicModel(read_robot(result))
    nominal = model.nominal()
    assert nominal is not None
    states = np.random.default_rng(1).uniform(-1.5, 1.5, (3, 50, 2))
    expected = true_torque(*states)
    found = (model.regressor(*states) @ nominal[: model.inertial_count]).reshape(expected.shape)
    assert np.abs(found - expected).max() < 0.01 * np.abs(expected).max()
    stated = read_robot(file)  # what was there is not what came out
    before = DynamicModel(stated).nominal()
    assert before is not None
    unchanged = (model.regressor(*states) @ before[: model.inertial_count]).reshape(expected.shape)
    assert np.abs(unchanged - expected).max() > 0.1 * np.abs(expected).max()
