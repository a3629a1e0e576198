"""SDF: poses in frames, axes and nested models against Drake and a URDF; written back; faults refused with a remedy."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dynident.errors import DescriptionError
from dynident.exports.models.proving.engines import drake_version
from dynident.exports.models.proving.robot_model_proof import reload_own_sdf
from dynident.exports.models.subject.drives import drives_of
from dynident.exports.models.subject.identified import OWN, Identified
from dynident.exports.models.subject.source import OwnDescription
from dynident.exports.models.writing.sdf_text import PatchedSdf, patched_sdf
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.shapes import Mesh
from dynident.robot_files import read_robot
from dynident.robot_files.formats.sdf import SdfFile
from dynident.robot_files.formats.urdf import read_urdf

BODY = "<inertia><ixx>.02</ixx><iyy>.03</iyy><izz>.04</izz><ixy>.001</ixy></inertia>"
#: Everything asymmetric: frames, an expressed axis, a fixed link, a nested model, the model turned in the world.
ARM = f"""<?xml version="1.0"?>
<!-- kept -->
<sdf version="1.9"><model name="arm"><pose>.1 .2 .3 .1 .2 .3</pose>
  <frame name="mount" attached_to="base"><pose>.1 0 0 0 .2 0</pose></frame>
  <link name="base"/>
  <link name="upper"><pose relative_to="mount">.2 .1 .05 .3 -.2 .1</pose>
    <inertial><pose>.1 .02 .03 .1 .2 .3</pose><mass>2</mass>{BODY}</inertial></link>
  <link name="flange"><pose relative_to="upper">.2 0 0 0 0 .4</pose><inertial><mass>.1</mass>
    <inertia><ixx>.001</ixx><iyy>.001</iyy><izz>.001</izz></inertia></inertial></link>
  <link name="tool"><pose>.5 .4 .3 .2 .1 0</pose><inertial><mass>1.5</mass>{BODY}</inertial>
    <collision name="c"><geometry><mesh><uri>model://arm/tool.stl</uri></mesh></geometry></collision></link>
  <joint name="a" type="revolute"><pose>.01 .02 .03 .1 0 .2</pose><parent>base</parent><child>upper</child>
    <axis><xyz expressed_in="mount">0 1 .2</xyz><limit><lower>-1</lower><upper>2</upper><effort>7</effort></limit>
      <dynamics><damping>.3</damping></dynamics></axis></joint>
  <joint name="f" type="fixed"><parent>upper</parent><child>flange</child></joint>
  <joint name="b" type="prismatic"><pose relative_to="flange">.01 .02 .03 .1 0 .2</pose>
    <parent>upper</parent><child>tool</child><axis><xyz>1 1 .2</xyz></axis></joint>
  <model name="hand"><pose relative_to="tool">.1 .1 0 .2 .3 0</pose>
    <link name="palm"><inertial><mass>.1</mass>
      <inertia><ixx>.001</ixx><iyy>.001</iyy><izz>.001</izz></inertia></inertial></link>
    <link name="finger"><pose>.1 0 0 0 .1 0</pose><inertial><mass>.3</mass>{BODY}</inertial></link>
    <joint name="c" type="continuous"><parent>palm</parent><child>finger</child>
      <axis><xyz expressed_in="__model__">.3 0 1</xyz></axis></joint></model>
  <joint name="g" type="fixed"><parent>tool</parent><child>hand::palm</child></joint>
</model></sdf>
"""


def test_what_shows_a_link_touches_nothing(tmp_path: Path) -> None:
    """A mesh to look at is where the one to touch with was; one without a size is passed over."""
    path = tmp_path / "arm.sdf"
    path.write_text(ARM)
    touching = read_robot(path).links[1]
    faulty = '<visual name="f"><geometry><box><size>0 1 1</size></box></geometry></visual><visual'
    path.write_text(ARM.replace("collision", "visual").replace("<visual", faulty, 1))
    shown = read_robot(path).links[1]
    (mesh,), (other,) = touching.shapes, shown.visuals
    assert shown.shapes == () == touching.visuals and isinstance(mesh, Mesh) and isinstance(other, Mesh)
    assert other.file == mesh.file and np.allclose(other.translation, mesh.translation, atol=0.0)


@pytest.mark.parametrize(
    ("stated", "told"),
    [
        ('version="1.9"', ""),
        ('version="1.12"', ""),
        ('version="1.99"', "version 1.99 is not known: read as 1.12"),
        ('version="1.3"', "version 1.3 is not known: read as 1.4"),
        ("", "no version is stated, which SDFormat requires: read as 1.12"),
    ],
)
def test_a_version_that_is_not_known_is_named(stated: str, told: str) -> None:
    note = SdfFile().read("arm.sdf", ARM.replace('version="1.9"', stated).encode()).note
    assert [part for part in note.split("; ") if "version" in part] == ([told] if told else [])


def test_torques_are_those_of_drake() -> None:
    parsing = pytest.importorskip("pydrake.multibody.parsing", reason="pip install drake")
    plant_module = pytest.importorskip("pydrake.multibody.plant", reason="pip install drake")
    from pydrake.math import RigidTransform, RollPitchYaw  # pyright: ignore[reportMissingImports]
    from pydrake.multibody.tree import MultibodyForces  # pyright: ignore[reportMissingImports]

    plant: Any = plant_module.MultibodyPlant(0.0)
    parsing.Parser(plant).AddModelsFromString(ARM, "sdf")
    place: Any = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.2, 0.3])
    plant.WeldFrames(plant.world_frame(), plant.GetBodyByName("base").body_frame(), place)
    plant.Finalize()
    robot = SdfFile().read("arm.sdf", ARM.encode())
    model = DynamicModel(robot)
    states = np.random.default_rng(0).uniform(-1, 1, (3, 6, 3))
    nominal = model.nominal()
    assert nominal is not None
    damping = np.array([joint.damping or 0.0 for joint in robot.joints])
    found = (model.regressor(*states) @ nominal).reshape(6, 3) + damping * states[1]
    at = [plant.GetJointByName(name.split("::")[-1]).velocity_start() for name in robot.joint_names]
    context = plant.CreateDefaultContext()
    for k in range(6):
        q, dq, ddq = np.zeros((3, 3))
        q[at], dq[at], ddq[at] = states[:, k]
        plant.SetPositions(context, q)
        plant.SetVelocities(context, dq)
        forces: Any = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        np.testing.assert_allclose(found[k], plant.CalcInverseDynamics(context, ddq, forces)[at], rtol=0, atol=1e-11)


def test_the_regressor_is_that_of_a_urdf_of_the_same_robot() -> None:
    urdf = """<robot name="two"><link name="base"/>
<link name="l"><inertial><origin xyz=".1 .02 .03" rpy=".1 .2 .3"/><mass value="2"/>
<inertia ixx=".02" ixy=".001" ixz="0" iyy=".03" iyz="0" izz=".04"/></inertial></link>
<link name="m"/>
<joint name="a" type="continuous"><origin xyz=".1 .2 .3" rpy=".3 .2 .1"/><parent link="base"/><child link="l"/>
<axis xyz="0 1 .5"/></joint>
<joint name="b" type="prismatic"><origin xyz="0 .2 .3" rpy=".1 .2 .4"/><parent link="l"/><child link="m"/>
<axis xyz="1 0 .5"/></joint></robot>"""
    sdf = f"""<sdf version="1.7"><model name="two"><link name="base"/>
<link name="l"><pose relative_to="a"/><inertial><pose>.1 .02 .03 .1 .2 .3</pose><mass>2</mass>{BODY}</inertial></link>
<link name="m"><pose relative_to="b"/></link>
<joint name="a" type="continuous"><pose relative_to="base">.1 .2 .3 .3 .2 .1</pose><parent>base</parent><child>l</child>
<axis><xyz>0 1 .5</xyz></axis></joint>
<joint name="b" type="prismatic"><pose relative_to="l">0 .2 .3 .1 .2 .4</pose><parent>l</parent><child>m</child>
<axis><xyz>1 0 .5</xyz></axis></joint></model></sdf>"""
    one, other = SdfFile().read("two.sdf", sdf.encode()), read_urdf("two.urdf", urdf.encode())
    states = np.random.default_rng(0).uniform(-1, 1, (3, 6, 2))
    np.testing.assert_allclose(
        DynamicModel(one).regressor(*states), DynamicModel(other).regressor(*states), rtol=0, atol=1e-12
    )
    assert one.links[0].inertia is not None and other.links[0].inertia is not None
    np.testing.assert_allclose(one.links[0].inertia.vector, other.links[0].inertia.vector, rtol=0.0, atol=1e-14)


def test_limits_frames_and_meshes_are_read(tmp_path: Path) -> None:
    (tmp_path / "arm.sdf").write_text(ARM)
    robot = read_robot(tmp_path / "arm.sdf")
    limits = robot.joints[0].limits
    assert (limits.lower, limits.upper, limits.effort) == (-1.0, 2.0, 7.0)
    assert "mount" in robot.frames and robot.frames["flange"].link == 0
    (mesh,) = robot.links[1].shapes
    assert isinstance(mesh, Mesh) and mesh.file == "model://arm/tool.stl"
    (tmp_path / "arm.sdf").write_text(ARM.replace("<mesh>", '<mesh optimization="convex_hull">'))
    assert len(read_robot(tmp_path / "arm.sdf").links[1].shapes) == 1


def assert_proved(subject: Identified, source: OwnDescription, patched: PatchedSdf) -> None:
    """Check the torques of a changed file as it is read here, and by Drake where it is installed."""
    engines = [found for found in reload_own_sdf(subject, source, patched) if found.torque is not None]
    for found in engines:
        assert found.torque is not None and found.expected is not None
        np.testing.assert_allclose(found.torque, found.expected, rtol=0, atol=1e-9 * np.abs(found.expected).max())
    assert len(engines) == 1 + bool(drake_version())


def test_identified_values_return_into_the_file_and_every_other_byte_is_kept() -> None:
    robot = SdfFile().read("arm.sdf", ARM.encode())
    model = DynamicModel(robot)
    nominal = model.nominal()
    assert nominal is not None
    source = OwnDescription(Path("arm.sdf"), ARM.encode())
    estimate: Any = SimpleNamespace(model=model)
    subject = Identified(estimate, 1.2 * nominal, OWN, source)
    patched = patched_sdf(subject, drives_of(subject), source, lump=False)
    assert_proved(subject, source, patched)
    assert "drake:rotor_inertia" not in patched.data.decode()
    old, new = ARM.splitlines(), patched.data.decode().splitlines()
    changed = {before for before, after in zip(old, new, strict=True) if before != after}
    assert changed == {
        line for line in old if "<inertial>" in line and "relative_to" not in line and "palm" not in line
    }


#: Objects beside the arm: one whose link is called as that of the arm, and two links that are fixed to each other.
CAN = f"""<model name="can"><pose>2 0 0 0 0 0</pose><link name="base"><inertial><mass>3</mass>{BODY}</inertial></link>
</model><model name="tray"><link name="a"/><link name="b"/>
<joint name="f" type="fixed"><parent>a</parent><child>b</child></joint></model>"""


def test_objects_beside_a_robot_are_left_out_with_a_note_and_stay_in_the_file() -> None:
    before, model, after = re.split(r"(<model name=.arm.*</model>)", ARM, flags=re.DOTALL)
    world = f"{before}<world name='w'>{CAN}{model}{CAN.replace('can', 'box').replace('tray', 'lid')}</world>{after}"
    robot, alone = (SdfFile().read("arm.sdf", text.encode()) for text in (world, ARM))
    assert robot.note == "read from arm.sdf; without the models beside the robot (can, tray, box, lid)"
    assert robot_to_dict(robot) == robot_to_dict(alone) | {"note": robot.note}
    dynamics = DynamicModel(robot)
    source, estimate = OwnDescription(Path("arm.sdf"), world.encode()), SimpleNamespace(model=dynamics)
    subject = Identified(cast(Any, estimate), 1.2 * np.array(dynamics.nominal()), OWN, source)
    patched = patched_sdf(subject, drives_of(subject), source, lump=False)
    assert patched.data.decode().count(CAN) == 1
    assert_proved(subject, source, patched)


@pytest.mark.parametrize(
    "stated", ["", "<drake:rotor_inertia>2e-4</drake:rotor_inertia><drake:gear_ratio>50</drake:gear_ratio>"]
)
def test_rotor_inertia_returns_into_drakes_own_elements(stated: str) -> None:
    data = ARM.replace('<joint name="a" type="revolute">', f'<joint name="a" type="revolute">{stated}').encode()
    model = DynamicModel(SdfFile().read("arm.sdf", data), ["coulomb", "viscous", "rotor_inertia"])
    theta = np.array(model.nominal())
    rotors = [k for k, parameter in enumerate(model.parameters) if parameter.symbol == "Ia"]
    theta[rotors[:2]] = 0.3, 0.7
    source = OwnDescription(Path("arm.sdf"), data)
    estimate: Any = SimpleNamespace(model=model)
    subject = Identified(estimate, theta, OWN, source)
    patched = patched_sdf(subject, drives_of(subject), source, lump=False)
    known = 2e-4 * 50**2 if stated else 0.0
    joints = SdfFile().read("arm.sdf", patched.data).joints
    assert [joint.drive.reflected_inertia for joint in joints] == pytest.approx([known + 0.3, 0.7, 0.0])
    assert joints[0].drive.gear_ratio == (50 if stated else 1)
    assert_proved(subject, source, patched)
    assert any("Gazebo passes over" in note for note in patched.notes)


@pytest.mark.parametrize("part", ["<mass>1.5</mass>", BODY])
def test_an_incomplete_inertial_is_unknown_and_named(part: str) -> None:
    """SDFormat has 1 kg and 1 kg m^2 there, which are of no robot; what is identified fills in the part."""
    before, at = ARM.split('name="tool"')
    text = f'{before}name="tool"{at.replace(part, "", 1)}'
    robot = SdfFile().read("arm.sdf", text.encode())
    missing = "mass" if "mass" in part else "inertia"
    assert robot.links[1].inertia is None
    assert robot.note == f"read from arm.sdf; without the incomplete <inertial> of tool (no <{missing}>)"
    nominal = DynamicModel(SdfFile().read("arm.sdf", ARM.encode())).nominal()
    assert nominal is not None
    source, estimate = OwnDescription(Path("arm.sdf"), text.encode()), SimpleNamespace(model=DynamicModel(robot))
    subject = Identified(cast(Any, estimate), 1.2 * nominal, OWN, source)
    patched = patched_sdf(subject, drives_of(subject), source, lump=False)
    again = DynamicModel(SdfFile().read("arm.sdf", patched.data)).nominal()
    np.testing.assert_allclose(cast(Any, again), 1.2 * nominal, rtol=0.0, atol=1e-12)


def test_gravity_that_links_are_without() -> None:
    off = "<gravity>false</gravity>"
    one = SdfFile().read("arm.sdf", ARM.replace('<link name="tool">', f'<link name="tool">{off}').encode())
    assert one.note.endswith("without <gravity>false</gravity> of links (tool)") and one.gravity.any()
    every = re.sub(r'(<link name="\w+")(/?)>', lambda m: f"{m[1]}>{off}{'</link>' if m[2] else ''}", ARM)
    assert every.count(off) == 6
    assert not SdfFile().read("arm.sdf", every.encode()).gravity.any()


def test_the_pose_of_a_model_is_that_of_its_placement_frame() -> None:
    """Gravity at the base, and the place of the base in the world, against poses that Pinocchio multiplies."""
    pin = pytest.importorskip("pinocchio", reason="pip install pin")
    place = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.1, 0.2, 0.3]))
    mount = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.2, 0.0), np.array([0.1, 0.0, 0.0]))
    tool = pin.SE3(pin.rpy.rpyToMatrix(0.2, 0.1, 0.0), np.array([0.5, 0.4, 0.3]))
    for name, frame in {"": pin.SE3.Identity(), "mount": mount, "tool": tool, "base": pin.SE3.Identity()}.items():
        text = ARM.replace('<model name="arm">', f'<model name="arm" placement_frame="{name}">', 1)
        base = place * frame.inverse()  # the link base stands at the frame of the model
        expected = base.rotation.T @ [0.0, 0.0, -9.81]
        np.testing.assert_allclose(SdfFile().read("arm.sdf", text.encode()).gravity, expected, rtol=0.0, atol=1e-12)
        fixed = text.replace(
            '<link name="base"/>', '<link name="base"/><joint name="h" type="fixed"><parent>world</parent>'
            "<child>base</child></joint>",
        )  # fmt: skip
        robot = SdfFile().read("arm.sdf", fixed.encode())
        np.testing.assert_allclose(robot.gravity, [0.0, 0.0, -9.81], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(robot.frames["base"].rotation, base.rotation, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(robot.frames["base"].translation, base.translation, rtol=0.0, atol=1e-12)


def test_what_is_not_read_may_hold_anything() -> None:
    """Elements of a user's own, with a prefix, and what is in visuals, plugins and sensors."""
    own = (
        '<visual name="v"><anything odd="1"/></visual><plugin filename="a" name="b"><pose frm="x"/></plugin>'
        '<drake:own drake:at="1"><mas/></drake:own><sensor name="s" type="imu"><imu/></sensor>'
    )
    text = ARM.replace('<link name="base"/>', f'<link name="base" drake:id="3">{own}</link>', 1)
    text = text.replace('<sdf version="1.9">', '<sdf version="1.9" xmlns:drake="d">')
    one, other = (robot_to_dict(SdfFile().read("arm.sdf", each.encode())) for each in (text, ARM))
    assert one == other


def test_comments_and_lines_in_an_inertia_are_kept() -> None:
    """Only the numbers change: blanks, comments and the order of the elements stay, also what stands behind them."""
    lines = (
        "<inertia>\n  <izz> .04 </izz><!-- kept -->\n  <ixx>.02</ixx> <!-- too -->\n"
        "  <ixy>.001</ixy>\n  <iyy>.03</iyy>\n</inertia>"
    )
    text = ARM.replace(BODY, lines, 1).replace("<mass>2</mass>", "<mass> 2 </mass>")
    model = DynamicModel(SdfFile().read("arm.sdf", text.encode()))
    nominal = model.nominal()
    assert nominal is not None
    source = OwnDescription(Path("arm.sdf"), text.encode())
    estimate: Any = SimpleNamespace(model=model)
    subject = Identified(estimate, 1.2 * nominal, OWN, source)
    patched = patched_sdf(subject, drives_of(subject), source, lump=False)
    for found in reload_own_sdf(subject, source, patched):
        if found.torque is not None and found.expected is not None:
            np.testing.assert_allclose(found.torque, found.expected, rtol=0, atol=1e-9 * np.abs(found.expected).max())
    number = r"-?[\d.e-]+"
    written = patched.data.decode()
    expected = (
        rf"<mass>{number}</mass><inertia>\n  <izz>{number}</izz><!-- kept -->\n  <ixx>{number}</ixx> <!-- too -->\n"
        rf"  <ixy>{number}</ixy>\n  <iyy>{number}</iyy>\n"
        rf"  <ixz>{number}</ixz>\n  <iyz>{number}</iyz>\n</inertia>"
    )
    assert re.search(expected, written), written


FAULTS = {
    "a placement_frame that is none": ('name="arm">', 'name="arm" placement_frame="tol">', "no frame 'tol'", "'tool'"),
    "the world as placement_frame": ('name="arm">', 'name="arm" placement_frame="world">', "is the world", "the model"),
    "a pose by attribute frame": ('relative_to="mount"', 'frame="mount"', "attribute 'frame'", "relative_to"),
    "a joint of the world": (
        "<model name='arm'>",
        "<world name='w'><joint name='q'/></world><model name='arm'>",
        "a joint of the world is not read",
        "write it in the <model>",
    ),
    "an inertial in another frame": (
        "<inertial><pose>",
        "<inertial><pose relative_to='tool'>",
        "its pose in its link",
        "without relative_to",
    ),
    "a frame that is attached to nothing": (
        "attached_to='base'><pose",
        "attached_to='bas'><pose relative_to='base'",
        "no frame 'bas'",
        "'base'",
    ),
    "frames that are attached in a ring": (
        "attached_to='base'><pose",
        "attached_to='mount'><pose relative_to='base'",
        "attached to itself",
        "attached_to",
    ),
    "an include of nothing": ("<link name='base'/>", "<include/><link name='base'/>", "0 <uri>", "write one <uri>"),
    "a static model": (
        "<link name='base'/>",
        "<static>1</static><link name='base'/>",
        "a static model",
        "remove <static>",
    ),
    "an unknown frame": ('relative_to="mount"', 'relative_to="mont"', "no frame 'mont'", "did you mean 'mount'"),
    "a ring of frames": ("<pose>.1 0 0 0 .2 0</pose>", '<pose relative_to="upper"/>', "in a ring", "relative_to"),
    "an unknown link": ("<child>tool<", "<child>tol<", "its child 'tol' is no link", "did you mean 'tool'"),
    "a ball joint": ('type="prismatic"', 'type="ball"', "type 'ball' is not read", "revolute and prismatic"),
    "an unknown joint": ('type="prismatic"', 'type="prisma"', "type 'prisma' is not known", "did you mean 'prismatic'"),
    "a computed inertia": ("<inertial><mass>1.5", '<inertial auto="true"><mass>1.5', "computes it", "<mass>"),
    "a joint between one link": ("<child>upper<", "<child>base<", "form a loop: 'base'", "only trees are read"),
    "a rotor inertia elsewhere": (
        "<axis><xyz>1 1",
        "<axis><drake:rotor_inertia>1</drake:rotor_inertia><xyz>1 1",
        "<drake:rotor_inertia> in <axis>",
        "write it in the <joint>",
    ),
    "a mistyped element of Drake": (
        "<axis><xyz>1 1",
        "<drake:rotor_inertias>1</drake:rotor_inertias><axis><xyz>1 1",
        "unknown element <drake:rotor_inertias>",
        "did you mean 'drake:rotor_inertia'",
    ),
    "a negative mass": (">1.5<", ">-1.5<", "mass -1.5 is negative", "0 or more"),
    "no axis": ("<axis><xyz>1 1 .2</xyz></axis>", "", "0 <axis> in <joint>", "write <axis>"),
    "an axis without direction": (">1 1 .2<", ">0 0 0<", "has no direction", "0 0 1"),
    "a name twice": ('link name="tool"', 'link name="upper"', "the name 'upper' is taken", "a name of its own"),
    "five numbers": (">.5 .4 .3 .2 .1 0<", ">.5 .4 .3 .2 .1<", "has 5 numbers", "write 6 numbers"),
    "a version that is none": ('version="1.9"', 'version="x"', "version 'x'", 'version="1.7"'),
    "a second robot": (
        "</sdf>",
        "<model name='door'><joint type='revolute'/></model></sdf>",
        "2 <model> with joints that move (arm, door)",
        "give the SDF of one robot, or write <static>true</static> into the others",
    ),
    "a static robot beside an object": (
        "<model name='arm'>",
        "<model name='can'><link name='x'/></model><model name='arm'><static>1</static>",
        "a static model",
        "remove <static>",
    ),
    "objects alone": (
        ARM[ARM.index("<model") :],
        "".join(f"<model name='{name}'><link name='x'/></model>" for name in "ab") + "</sdf>",
        "2 <model> without joints that move (a, b)",
        "give the SDF of one robot",
    ),
    "no robot": (ARM[ARM.index("<model") :], "</sdf>", "no <model> in <sdf>", "give the SDF of one robot"),
}


def refusal(text: str) -> str:
    """Return the message with which a file other than the arm is refused."""
    assert text != ARM
    with pytest.raises(DescriptionError) as caught:
        SdfFile().read("arm.sdf", text.encode())
    return str(caught.value)


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_not_read_is_refused_with_file_element_and_remedy(name: str) -> None:
    old, new, evidence, remedy = FAULTS[name]
    message = refusal(ARM.replace(old.replace("'", '"'), new, 1))
    assert "arm.sdf" in message and evidence in message and remedy in message and "\n" not in message


TYPOS = {
    "attribute": ("expressed_in", "expresed_in", "attribute 'expresed_in'", "did you mean 'expressed_in'"),
    "frame": ("relative_to", "realtive_to", "attribute 'realtive_to'", "did you mean 'relative_to'"),
    "dynamics": ("dynamics>", "dynamic>", "unknown element <dynamic> in <axis>", "did you mean 'dynamics'"),
    "inertial": ("inertial>", "innertial>", "unknown element <innertial> in <link>", "did you mean 'inertial'"),
    "effort": ("effort>", "efort>", "unknown element <efort> in <limit>", "did you mean 'effort'"),
    "moment": ("ixy>", "lxy>", "unknown element <lxy> in <inertia>", "did you mean 'ixy'"),
}


@pytest.mark.parametrize("name", TYPOS)
def test_mistyped_words_are_refused_with_the_nearest_known_one(name: str) -> None:
    old, new, evidence, remedy = TYPOS[name]
    message = refusal(ARM.replace(old, new))
    assert re.match(r"arm\.sdf: line \d+, <\w+", message)
    assert evidence in message and remedy in message
