"""Sound files of every kind, small, made by the writers of the library and of the packages it reads with."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.model.robot import Robot

JOINTS = ("shoulder", "elbow")
ROWS = 10

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="3"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial>
    <collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.1 0.1"/></geometry></collision></link>
  <link name="lower"><inertial><origin xyz="0.15 0 0" rpy="0 0 0.1"/><mass value="2"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="100" velocity="3"/><dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="3"/></joint>
</robot>
"""

_OTHERS = r" *<coll.*</collision>|  <link name=.lower.*?</link>\n|  <joint name=.elbow.*?</joint>\n"
#: The first joint of it alone: what is read in a moment is read often.
ONE = re.sub(_OTHERS, "", URDF, flags=re.DOTALL)

MJCF = """<mujoco model="arm"><compiler angle="radian"/><default><joint damping="0.1"/></default><worldbody>
<body name="upper" euler="0 0.1 0"><joint name="shoulder" axis="0 1 0" armature="0.1" range="-3 3"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0.4 0 0"/>
<body name="lower" pos="0.4 0 0"><joint name="elbow" type="slide"/>
<inertial pos="0.1 0 0" mass="1" diaginertia="1 1 1"/><site name="tip"/></body></body></worldbody>
<equality><joint joint1="elbow" joint2="shoulder" polycoef="0 2 0 0 0"/></equality>
<actuator><motor joint="shoulder" gear="2" forcerange="-5 5"/></actuator></mujoco>
"""
USD = """#usda 1.0
(
    defaultPrim = "arm"
    metersPerUnit = 1
    kilogramsPerUnit = 1
    upAxis = "Z"
)
def PhysicsScene "scene" {
    vector3f physics:gravityDirection = (0, 0, -1)
    float physics:gravityMagnitude = 9.81
}
def Xform "arm" {
    def Xform "upper" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {
        float physics:mass = 2
        point3f physics:centerOfMass = (0.1, 0, 0.05)
        float3 physics:diagonalInertia = (0.02, 0.03, 0.04)
        quatf physics:principalAxes = (1, 0, 0, 0)
        double3 xformOp:translate = (0, 0, 0.3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Capsule "c" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
            uniform token axis = "X"
            double radius = 0.05
            double height = 0.3
            double3 xformOp:scale = (1, 2, 2)
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }
        def Mesh "m" {
            point3f[] points = [(0, 0, 0), (0.1, 0, 0), (0, 0.2, 0), (0, 0, 0.3)]
        }
    }
    def Xform "fore" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {
        float physics:mass = 1
        point3f physics:centerOfMass = (0, 0.1, 0)
        float3 physics:diagonalInertia = (0.01, 0.01, 0.02)
    }
    def PhysicsRevoluteJoint "shoulder" (prepend apiSchemas = ["PhysicsDriveAPI:angular"]) {
        rel physics:body1 = </arm/upper>
        uniform token physics:axis = "Z"
        point3f physics:localPos0 = (0, 0, 0.3)
        float physics:lowerLimit = -90
        float physics:upperLimit = 90
        float drive:angular:physics:damping = 0.5
        float drive:angular:physics:maxForce = 80
    }
    def PhysicsPrismaticJoint "elbow" {
        rel physics:body0 = </arm/upper>
        rel physics:body1 = </arm/fore>
        uniform token physics:axis = "X"
        point3f physics:localPos0 = (0.4, 0, 0)
        quatf physics:localRot0 = (0.7071068, 0, 0.7071068, 0)
    }
}
"""

SDF = """<sdf version="1.9"><model name="arm"><pose>0 0 1 0 0.1 0</pose><link name="base"/>
<frame name="mount" attached_to="base"><pose degrees="true">0 0 0.2 0 10 0</pose></frame>
<link name="upper"><pose relative_to="shoulder"/><inertial><pose>0.1 0 0 0 0 0</pose><mass>2</mass>
<inertia><ixx>0.1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia></inertial>
<collision name="c"><geometry><box><size>0.4 0.1 0.1</size></box></geometry></collision></link>
<joint name="shoulder" type="revolute"><pose relative_to="mount"/><parent>base</parent><child>upper</child>
<axis><xyz expressed_in="mount">0 1 0</xyz><limit><lower>-1</lower></limit>
<dynamics><damping>0.1</damping></dynamics></axis></joint>
<model name="hand"><link name="palm"/></model>
<joint name="g" type="fixed"><parent>upper</parent><child>hand::palm</child></joint></model></sdf>
"""

#: Nested and included models, in a world; what joints name is fixed to links.
SDF_OF_MODELS = """<sdf version="1.11"><world name="w"><gravity>0 0 -9.8</gravity>
<model name="ground"><static>true</static><link name="l"/></model>
<model name="arm" canonical_link="base" placement_frame="mount"><link name="base"/>
<frame name="mount"><pose>0 0 1 0 0 0</pose></frame>
<model name="fore" canonical_link="b" placement_frame="b"><pose relative_to="mount">1 0 0 0 0 0.1</pose>
<link name="a"><inertial><mass>2</mass></inertial></link><link name="b"><gravity>false</gravity></link>
<joint name="f" type="fixed"><parent>b</parent><child>a</child></joint></model>
<joint name="shoulder" type="continuous"><parent>__model__</parent><child>fore</child>
<axis><xyz>0 1 0</xyz></axis><drake:rotor_inertia>1e-4</drake:rotor_inertia></joint>
<include><uri>hand.sdf</uri><name>tool</name><pose relative_to="fore::b">0 0 1 0 0 0</pose></include>
<joint name="g" type="prismatic"><parent>shoulder</parent><child>tool::palm</child><axis><xyz>1 0 0</xyz></axis></joint>
</model></world></sdf>
"""
#: What it includes.
HAND = '<sdf version="1.6"><model name="hand"><pose>1 0 0 0 0 0</pose><link name="palm"/></model></sdf>'

#: Copies, what they share, flags, and a mesh of points.
MJCF_OF_COPIES = """<mujoco><option density="1"><flag damper="disable" equality="enable" gravity="disable"/></option>
<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1 .3 .3 .3"/></asset>
<worldbody><replicate count="2" sep="-" euler="0 0 90"><body name="b"><joint name="a" axis="0 1 0"/>
<geom type="mesh" mesh="m"/><body><joint name="c"/><geom size=".1"/></body></body></replicate></worldbody>
<equality><joint joint1="c" joint2="a" polycoef=".1 2"/></equality>
<actuator><motor joint="a" gear="3" damping=".1" armature=".1"/><motor joint="c-1"/></actuator></mujoco>
"""

#: An object and a handle beside an arm, and joints coupled by tendons.
MJCF_OF_A_SCENE = """<mujoco><worldbody><body name="hand" mocap="true"/>
<body name="can" pos="1 0 0"><freejoint/><geom size=".1"/></body>
<body name="b"><joint name="a" ref="20"/><geom size=".1" pos=".1 0 0"/>
<body name="k"><joint name="c"/><geom size=".1" pos=".1 0 0"/></body></body></worldbody>
<tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="c" coef="-.5"/></fixed></tendon>
<equality><tendon tendon1="t" polycoef=".1"/><weld body1="hand" body2="k"/></equality></mujoco>
"""

XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="mass" default="2"/><xacro:property name="half" value="${0.4 / 2}"/>
<xacro:include filename="ball.xacro"/><link name="base"/>
<xacro:macro name="bar" params="name parent *origin at:=^|0.1"><link name="${name}"><inertial>
<xacro:insert_block name="origin"/><mass value="$(arg mass)"/><xacro:ball/></inertial></link>
<joint name="${name}_joint" type="revolute"><parent link="${parent}"/><child link="${name}"/>
<axis xyz="0 ${1 if at else 0} 0"/><limit lower="${-pi}" upper="${radians(90)}" effort="9" velocity="1"/></joint>
</xacro:macro><xacro:bar name="upper" parent="base"><origin xyz="${half} 0 0"/></xacro:bar>
<xacro:if value="${half == 0.2}"><link name="tip"/></xacro:if><xacro:unless value="true"><a/></xacro:unless>
<joint name="tip" type="fixed"><parent link="upper"/><child link="tip"/></joint></robot>
"""
#: What it includes.
BALL = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="ball">
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></xacro:macro></robot>
"""

DH = """name: one
convention: modified
joints:
  - {alpha: 0, a: 0, d: 0, theta: 0}
"""
_LINK = """
    link:
      name: lower
      inertia: {mass: 2, centre_of_mass: [0.1, 0, 0], about_centre: [0.02, 0, 0, 0.02, 0, 0.01]}
"""
DHS = (
    DH + "gravity: [0, -9.81, 0]\n",
    DH.replace("}", ", limits: {lower: -3, upper: 3, velocity: 2, effort: 50}}"),
    DH.replace("modified", "standard")
    .replace("alpha: 0", "alpha: pi/2")
    .replace("}", ", friction: 0.3, damping: 0.1}"),
    DH.replace("}", ", drive: {gear_ratio: 100, rotor_inertia: 2.0e-5}}"),
    DH.replace("{alpha: 0, a: 0, d: 0, theta: 0}\n", "alpha: 0\n    a: 0.5\n    d: 0\n    theta: 0" + _LINK),
)

CASE = "case: 2\nrobot: arm.urdf\n"
CASES = (
    CASE + "friction: [{coulomb: {width: 0.02}}, viscous, offset]\n",
    CASE + "train: [run.csv]\ntest: run.csv\nestimator: wls\n",
    CASE + "log:\n  columns: {time: t, q: [q1], torque: [tau1]}\n  units: {position: deg}\n",
    CASE
    + "gravity: [0, 0, -9.81]\npreprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 50, delay_s: 0.004}\n",
)


_RULE = "=" * 80
IDL = f"""{_RULE}
IDL: sensor_msgs/msg/JointState
module sensor_msgs {{ module msg {{
  @verbatim (language="comment", text="state of joints")
  struct JointState {{
    std_msgs::msg::Header header;
    sequence<string> name;
    sequence<double> position;
    sequence<double> velocity;
    sequence<double> effort;
  }};
}}; }};
{_RULE}
IDL: std_msgs/msg/Header
module std_msgs {{ module msg {{
  struct Header {{ builtin_interfaces::msg::Time stamp; string frame_id; }};
}}; }};
{_RULE}
IDL: builtin_interfaces/msg/Time
module builtin_interfaces {{ module msg {{
  struct Time {{ long sec; unsigned long nanosec; }};
}}; }};
"""


def _log(samples: int = ROWS, rate: float = 100.0) -> Log:
    time = np.arange(samples) / rate
    phase = np.outer(time, [1.7, 2.3])
    q = np.sin(phase) + 0.3 * np.cos(3 * phase)
    return Log(JOINTS, time, q, torque=10 * np.cos(q))


def _robot(folder: Path) -> Robot:
    from dynident.robot_files import read_robot

    (folder / "arm.urdf").write_text(URDF)
    return read_robot(folder / "arm.urdf")


def urdf(folder: Path) -> list[Path]:
    """Write URDFs."""
    (folder / "a.urdf").write_text(URDF)
    return [folder / "a.urdf"]


def mjcf(folder: Path) -> list[Path]:
    """Write MJCFs."""
    return _texts(folder, MJCF, MJCF_OF_COPIES, MJCF_OF_A_SCENE)


def xacro(folder: Path) -> list[Path]:
    """Write xacro files."""
    arguments = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="a" default="z"/>'
    short = ONE.replace('<robot name="arm">', arguments).replace('mass value="3"', 'mass value="${2 + 1}"')
    return _texts(folder, XACRO, short.replace("shoulder", "$(arg a)"))


def sdf(folder: Path) -> list[Path]:
    """Write SDFs."""
    return _texts(folder, SDF, SDF_OF_MODELS)


def usd(folder: Path) -> list[Path]:
    """Write stages of USD."""
    (folder / "a.usda").write_text(USD)
    return [folder / "a.usda"]


def dh(folder: Path) -> list[Path]:
    """Write DH tables."""
    return _texts(folder, *DHS)


def _texts(folder: Path, *texts: str) -> list[Path]:
    found = [folder / f"{k}.yaml" for k in range(len(texts))]
    for path, text in zip(found, texts, strict=True):
        path.write_text(text)
    return found


def robot_json(folder: Path) -> list[Path]:
    """Write robots in the library's own form."""
    from dynident.model.documents.robot_data import robot_to_dict

    (folder / "a.json").write_text(json.dumps(robot_to_dict(_robot(folder))))
    return [folder / "a.json"]


def case(folder: Path) -> list[Path]:
    """Write case files beside their robot."""
    (folder / "arm.urdf").write_text(ONE)
    return _texts(folder, *CASES)


def csv(folder: Path) -> list[Path]:
    """Write text tables of several dialects."""
    from dynident.data.formats import write_log

    write_log(_log(), folder / "a.csv")
    text = (folder / "a.csv").read_text()
    (folder / "b.csv").write_text(text.replace(",", ";"), encoding="utf-8-sig")
    (folder / "c.csv").write_text("# a comment\n" + text.replace(",", " ").replace("\n", "\r\n"))
    (folder / "d.csv").write_text(text.replace(",", "\t").replace("t\t", '"t"\t', 1))
    return [folder / f"{k}.csv" for k in "abcd"]


def twincat(folder: Path) -> list[Path]:
    """Write exports of TwinCAT Scope."""
    log = _log()
    found = []
    for name, separator in (("a", "\t"), ("b", ";")):
        lines = [f"Name{separator}run", f"Starttime of export{separator}132959733843760000", "", ""]
        lines += [separator.join(f"Name{separator}{column}" for column in ("q1", "tau1"))]
        lines += [separator.join(f"{fact}{separator}1" for _ in range(2)) for fact in ("SampleTime[ms]", "Unit")] + [""]
        assert log.torque is not None
        for k in range(ROWS):
            lines.append(separator.join([str(k), repr(float(log.q[k, 0])), str(k), repr(float(log.torque[k, 0]))]))
        (folder / f"{name}.csv").write_text("\r\n".join([*lines, "EOF"]) + "\r\n", encoding="utf-8-sig")
        found.append(folder / f"{name}.csv")
    return found


def npz(folder: Path) -> list[Path]:
    """Write NumPy archives, packed and not."""
    from dynident.data.formats import write_log

    log = _log()
    write_log(log, folder / "a.npz")
    np.savez(folder / "b.npz", t=log.time, q=np.asfortranarray(log.q), tau=log.torque, note=np.array("text"))  # type: ignore[arg-type]
    return [folder / "a.npz", folder / "b.npz"]


def parquet(folder: Path) -> list[Path]:
    """Write Parquet files: plain columns, and lists."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from dynident.data.formats import write_log

    log = _log()
    write_log(log, folder / "a.parquet")
    assert log.torque is not None
    lists = {"t": log.time, "q": log.q.tolist(), "tau": log.torque.tolist()}
    pq.write_table(pa.table(lists), folder / "b.parquet", compression="NONE")
    return [folder / "a.parquet", folder / "b.parquet"]


def mat(folder: Path) -> list[Path]:
    """Write MATLAB files of versions 4, 5 (packed and not) and 7.3."""
    import h5py
    from scipy.io import savemat

    log = _log()
    data: Mapping[str, Any] = {"t": log.time, "q": log.q, "tau": log.torque}
    savemat(folder / "a.mat", data, format="4")
    savemat(folder / "b.mat", data)
    savemat(folder / "c.mat", {"data": data, **data}, do_compression=True)
    with h5py.File(folder / "d.mat", "w", userblock_size=512) as file:
        for name, values in data.items():
            file[name] = np.atleast_2d(values).T if values.ndim == 2 else values[None, :]
    return [folder / f"{k}.mat" for k in "abcd"]


def _states(store: Any) -> list[tuple[int, Any]]:
    log, types, found = _log(), store.types, []
    assert log.torque is not None
    for k in range(ROWS):
        stamp = 1_700_000_000_000_000_000 + k * 10_000_000
        time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
        kind = types["std_msgs/msg/Header"]
        extra = {"seq": k} if "seq" in kind.__dataclass_fields__ else {}
        head = kind(stamp=time, frame_id="", **extra)
        state = types["sensor_msgs/msg/JointState"](head, list(JOINTS), log.q[k], np.zeros(2), log.torque[k])
        found.append((stamp, state))
    return found


def bag1(folder: Path) -> list[Path]:
    """Write a bag of ROS 1."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(folder / "a.bag") as writer:
        topic = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        for stamp, message in _states(store):
            writer.write(topic, stamp, store.serialize_ros1(message, message.__msgtype__))
    return [folder / "a.bag"]


def _bag2(folder: Path, plugin: str, packed: bool, definition: str | None = None) -> Path:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    place = folder / f"{plugin}-{packed}-{definition is None}"
    writer = Writer(place, version=9, storage_plugin=StoragePlugin[plugin])
    if packed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        kind = "sensor_msgs/msg/JointState"
        topic = writer.add_connection(
            "/joint_states", kind, typestore=store, msgdef=definition, rihs01=store.hash_rihs01(kind)
        )
        for stamp, message in _states(store):
            writer.write(topic, stamp, store.serialize_cdr(message, message.__msgtype__))
    return next(place.glob("*.mcap" if plugin == "MCAP" else "*.db3"))


def mcap(folder: Path) -> list[Path]:
    """Write bags of ROS 2 in MCAP: packed and not, and with definitions in IDL."""
    return [_bag2(folder, "MCAP", False), _bag2(folder, "MCAP", True), _bag2(folder, "MCAP", False, IDL)]


def db3(folder: Path) -> list[Path]:
    """Write a bag of ROS 2 in SQLite, in small pages."""
    import sqlite3

    path = _bag2(folder, "SQLITE3", False)
    with contextlib.closing(sqlite3.connect(path)) as base:
        base.executescript("PRAGMA page_size = 512; VACUUM;")
    return [path]


def plan(folder: Path) -> list[Path]:
    """Write plans of two kinds of trajectory."""
    from dynident.excitation.design.limits import MotionLimits, check_limits
    from dynident.excitation.design.plan import Plan, write_plan
    from dynident.excitation.trajectories.fourier import FourierSeries
    from dynident.excitation.trajectories.rest_fourier import RestFourier

    generator, none = np.random.default_rng(3), np.full(2, np.inf)
    free: Array = 0.1 * generator.normal(size=(2, 5))
    sines, cosines = 0.1 * generator.normal(size=(2, 2, 3))
    series = FourierSeries(np.zeros(2), sines, cosines, 4.0)
    limits = MotionLimits(
        JOINTS, (True, True), -np.ones(2), np.ones(2), 3 * np.ones(2), 20 * np.ones(2), none, none, none
    )
    found = []
    for name, motion in (("a", RestFourier.from_free(free, 4.0)), ("b", series)):
        draft = Plan(
            "arm", motion, 1.0 - motion.at_rest, "condition", {"condition": 12.5}, limits, (), 201, {"seed": 4}
        )
        checked = replace(draft, rows=check_limits(draft.motion(), limits, draft.samples))
        write_plan(checked, folder / name)
        found.append(folder / name)
    return found


def _cell(folder: Path) -> tuple[Any, Path]:
    """Return the case of the first joint alone: its files are the smallest."""
    from dynident.case.case import read_case
    from dynident.data.formats import write_log

    (folder / "one.urdf").write_text(ONE)
    log = _log(130, 100.0)
    noise = np.random.default_rng(0).normal(0, 0.1, (130, 1))
    assert log.torque is not None
    write_log(Log(JOINTS[:1], log.time, log.q[:, :1], torque=log.torque[:, :1] + noise), folder / "run.npz")
    how = "friction: [viscous]\npreprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 25}"
    names = "log: {columns: {q: [q1], torque: [tau1]}}"
    (folder / "case.yaml").write_text(f"case: 2\nrobot: one.urdf\n{names}\n{how}\n")
    return read_case(folder / "case.yaml"), folder / "run.npz"


def estimate(folder: Path) -> list[Path]:
    """Write an estimate."""
    from dynident.identification.files.estimate_file import write_estimate
    from dynident.identification.identify import identify

    case, path = _cell(folder)
    write_estimate(identify(case.model, [case.read(path)], "wls", case.preprocessing), folder / "a.json")
    return [folder / "a.json"]


def triangles(folder: Path) -> list[Path]:
    """Write a triangle file."""
    from dynident.identification.streaming.reduction import reduce_logs
    from dynident.identification.streaming.triangle_file import write_digest

    case, path = _cell(folder)
    write_digest(reduce_logs(case.stream_setup(), [path]), folder / "a.tri")
    return [folder / "a.tri"]


#: The maker of sound files of each target.
MAKERS: Mapping[str, Callable[[Path], list[Path]]] = {
    maker.__name__: maker
    for maker in (
        urdf, xacro, mjcf, sdf, usd, dh, robot_json, case, csv, twincat, npz, parquet, mat, bag1, db3, mcap, plan,
        estimate, triangles,
    )
}  # fmt: skip
