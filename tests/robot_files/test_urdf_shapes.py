"""Collision shapes of a URDF against Pinocchio, through fixed joints and locked ones, and every fault in them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.model.documents.robot_data import robot_from_dict, robot_to_dict
from dynident.model.kernels.batched import link_poses
from dynident.model.plausible import shape_points
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from dynident.robot_files import read_robot
from dynident.robot_files.formats.urdf import read_urdf

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def collision(geometry: str, origin: str = "") -> str:
    return f"<collision>{origin}<geometry>{geometry}</geometry></collision>"


def origin(seed: int) -> str:
    values = np.random.default_rng(seed).uniform(-1, 1, 6)
    return (
        f'<origin xyz="{" ".join(map(repr, values[:3].tolist()))}" rpy="{" ".join(map(repr, values[3:].tolist()))}"/>'
    )


#: A stand that is bolted to the base, two moving links, and a gripper that is bolted to the last one.
ARM = f"""<robot name="arm">
  <link name="base">{collision('<box size="0.4 0.5 0.2"/>', origin(1))}</link>
  <link name="stand">{INERTIAL}{collision('<cylinder radius="0.1" length="0.7"/>', origin(2))}</link>
  <link name="upper">{INERTIAL}{collision('<sphere radius="0.15"/>', origin(3))}
    {collision('<box size="0.1 0.2 0.3"/>')}</link>
  <link name="fore">{INERTIAL}{collision('<cylinder radius="0.05" length="0.4"/>', origin(4))}</link>
  <link name="gripper">{INERTIAL}{collision('<box size="0.05 0.06 0.07"/>', origin(5))}</link>
  <joint name="bolts" type="fixed"><parent link="base"/><child link="stand"/>{origin(6)}</joint>
  <joint name="shoulder" type="revolute"><parent link="stand"/><child link="upper"/>{origin(7)}<axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="elbow" type="prismatic"><parent link="upper"/><child link="fore"/>{origin(8)}<axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="flange" type="fixed"><parent link="fore"/><child link="gripper"/>{origin(9)}</joint>
</robot>"""


def placed(shapes: tuple[Shape, ...], rotation: Array, translation: Array) -> dict[str, Shape]:
    """Return shapes in the base frame by what they are."""
    found: dict[str, Shape] = {}
    for shape in shapes:
        size = shape.size.tolist() if isinstance(shape, Box) else getattr(shape, "radius", None)
        found[f"{type(shape).__name__} {size}"] = shape.moved(rotation, translation)
    return found


def in_base(robot: Robot, q: Array) -> dict[str, Shape]:
    rotations, translations = link_poses(robot.chain, q[None])
    found = placed(robot.base_shapes, np.eye(3), np.zeros(3))
    for i, link in enumerate(robot.links):
        found |= placed(link.shapes, rotations[0, i], translations[0, i])
    return found


def test_shapes_are_where_pinocchio_has_them() -> None:
    """Place and kind of each shape in random postures."""
    pin = pytest.importorskip("pinocchio")
    robot = read_urdf("arm.urdf", ARM.encode())
    model = pin.buildModelFromXML(ARM)
    geometry = pin.buildGeomFromUrdfString(model, ARM, pin.GeometryType.COLLISION)
    data, places = model.createData(), geometry.createData()
    assert len(geometry.geometryObjects) == 6
    for q in np.random.default_rng(0).uniform(-1, 1, (5, 2)):
        pin.updateGeometryPlacements(model, data, geometry, places, q)
        ours = in_base(robot, q)
        for item, pose in zip(geometry.geometryObjects, places.oMg, strict=True):
            solid = item.geometry
            kind = type(solid).__name__
            size = (2 * solid.halfSide).tolist() if kind == "Box" else solid.radius
            match = next(s for name, s in ours.items() if name.startswith(kind) and _same(name, size))
            centre = match.centre if isinstance(match, Sphere) else getattr(match, "translation", None)
            assert centre == pytest.approx(pose.translation, abs=1e-12)
            if isinstance(match, Box | Cylinder):
                assert match.rotation == pytest.approx(pose.rotation, abs=1e-12)
            if isinstance(match, Cylinder):
                assert match.length == pytest.approx(2 * solid.halfLength)


def _same(name: str, size: float | list[float]) -> bool:
    return np.allclose(json.loads(name.partition(" ")[2]), size)


def test_a_locked_joint_leaves_every_shape_where_it_is() -> None:
    robot = read_urdf("arm.urdf", ARM.encode())
    before = in_base(robot, np.array([0.7, -0.3]))
    for locked, q in (({"elbow": -0.3}, [0.7]), ({"shoulder": 0.7}, [-0.3])):
        after = in_base(robot.locked(locked), np.array(q))
        assert after.keys() == before.keys()
        for name, shape in before.items():
            for key, value in vars(shape).items():
                assert getattr(after[name], key) == pytest.approx(value, abs=1e-12), (name, key)
    assert len(robot.locked({"shoulder": 0.7}).base_shapes) == 4


def test_what_shows_a_link_is_where_its_shapes_would_be_and_touches_nothing() -> None:
    """Of fixed links too, and with a joint locked; a faulty one is passed over: nothing moves by it."""
    touching, shown = (read_urdf("arm.urdf", text.encode()) for text in (ARM, ARM.replace("collision", "visual")))
    for robot, other in ((touching, shown), (touching.locked({"elbow": -0.3}), shown.locked({"elbow": -0.3}))):
        assert other.base_shapes == () and any(link.shapes for link in robot.links)
        for link, own in zip(robot.links, other.links, strict=True):
            assert own.shapes == () == link.visuals
            np.testing.assert_array_equal(shape_points(own), shape_points(link))
    assert shapes_of(shown_by('<sphere radius="-1"/>')) == shapes_of(shown_by("")) == ()
    assert len(shapes_of(shown_by('<sphere radius="1"/>'))) == 1


def shown_by(geometry: str) -> Robot:
    visual = f"<visual><geometry>{geometry}</geometry></visual>"
    text = (
        f'<robot name="r"><link name="b"/><link name="hand">{visual}</link>'
        '<joint name="j" type="continuous"><parent link="b"/><child link="hand"/></joint></robot>'
    )
    return read_urdf("arm.urdf", text.encode())


def shapes_of(robot: Robot) -> tuple[Shape, ...]:
    return robot.links[0].visuals


def one(geometry: str, at: str = "") -> tuple[Shape, ...]:
    text = (
        f'<robot name="r"><link name="b"/><link name="hand">{collision(geometry, at)}</link>'
        '<joint name="j" type="continuous"><parent link="b"/><child link="hand"/></joint></robot>'
    )
    return read_urdf("arm.urdf", text.encode()).links[0].shapes


def test_a_capsule_of_urdf_1_1() -> None:
    """Its length is that of the straight part, along z."""
    (capsule,) = one('<capsule radius="0.1" length="0.6"/>', '<origin xyz="1 2 3" rpy="1.5707963267948966 0 0"/>')
    assert isinstance(capsule, Capsule) and capsule.radius == 0.1
    assert capsule.start == pytest.approx([1, 2.3, 3]) and capsule.end == pytest.approx([1, 1.7, 3])


def test_a_mesh_is_kept_by_name() -> None:
    """No file is looked for on reading."""
    (mesh,) = one('<mesh filename="package://../../etc/x.stl" scale="0.001 0.001 -0.001"/>', '<origin xyz="1 0 0"/>')
    assert isinstance(mesh, Mesh) and mesh.file == "package://../../etc/x.stl"
    assert mesh.scale.tolist() == [0.001, 0.001, -0.001] and mesh.translation.tolist() == [1, 0, 0]
    (plain,) = one('<mesh filename="x.dae"/>')
    assert isinstance(plain, Mesh) and plain.scale.tolist() == [1, 1, 1]


FAULTS = {
    "no size": ("<box/>", "<box> has no attribute 'size'; write <box size=\"...\">"),
    "two edges": ('<box size="1 2"/>', "box size '1 2' is not 3 numbers; write 3 numbers with spaces between them"),
    "no number": ('<box size="1 2 x"/>', "box size 'x' is not a number; write one plain number, without a unit"),
    "flat box": ('<box size="1 0 1"/>', "box size '1 0 1' has an edge that is not above 0; write three lengths in m"),
    "no radius": ("<sphere/>", "<sphere> has no attribute 'radius'; write <sphere radius=\"...\">"),
    "radius": ('<sphere radius="-1"/>', "sphere radius -1 is not above 0; write a length in m"),
    "nan": ('<sphere radius="nan"/>', "sphere radius 'nan' is not a finite number; write a finite number"),
    "length": ('<cylinder radius="1" length="0"/>', "cylinder length 0 is not above 0; write a length in m"),
    "capsule": ('<capsule radius="1"/>', "<capsule> has no attribute 'length'; write <capsule length=\"...\">"),
    "file": ("<mesh/>", "<mesh> has no attribute 'filename'; write <mesh filename=\"...\">"),
    "empty file": ('<mesh filename=" "/>', "mesh filename is empty; give it a name"),
    "scale": ('<mesh filename="a" scale="1 0 1"/>', "mesh scale '1 0 1' has a zero; write three factors"),
    "none": (
        "<plane/>",
        (
            "the <geometry> of a <collision> has 0 known shapes (line 1); write one of <box>, <sphere>, <cylinder>, "
            "<capsule>, <mesh> in it, or remove the <collision>"
        ),
    ),
    "two": (
        '<sphere radius="1"/><sphere radius="2"/>',
        (
            "the <geometry> of a <collision> has 2 known shapes (line 1); write one of <box>, <sphere>, <cylinder>, "
            "<capsule>, <mesh> in it, or remove the <collision>"
        ),
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_message(fault: str) -> None:
    geometry, message = FAULTS[fault]
    with pytest.raises(DescriptionError) as caught:
        one(geometry)
    assert str(caught.value) == f"arm.urdf: link 'hand': {message}"


def test_other_faults_name_the_link() -> None:
    with pytest.raises(DescriptionError, match="link 'hand': origin xyz '1 2' is not 3 numbers"):
        one('<sphere radius="1"/>', '<origin xyz="1 2"/>')
    text = '<robot name="r"><link name="hand"><collision/></link></robot>'
    with pytest.raises(DescriptionError, match=r"link 'hand': <collision> has no <geometry>; add <geometry"):
        read_urdf("arm.urdf", text.encode())


def test_the_json_carries_every_shape_exactly(tmp_path: Path) -> None:
    extra = collision('<capsule radius="0.1" length="0.6"/>', origin(10)) + collision('<mesh filename="a b.stl"/>')
    robot = read_urdf("arm.urdf", ARM.replace('<link name="gripper">', f'<link name="gripper">{extra}').encode())
    data = robot_to_dict(robot)
    file = tmp_path / "arm.json"
    file.write_text(json.dumps(data, allow_nan=False))
    back = read_robot(file)
    assert robot_to_dict(back) == data
    for link, other in zip(robot.links, back.links, strict=True):
        assert [type(shape) for shape in link.shapes] == [type(shape) for shape in other.shapes]
        for shape, twin in zip(link.shapes, other.shapes, strict=True):
            for key, value in vars(shape).items():
                assert np.array_equal(getattr(twin, key), value)
    assert len(back.base_shapes) == 2 and len(back.links[1].shapes) == 4


def test_a_robot_without_shapes_has_no_such_keys() -> None:
    data = robot_to_dict(read_robot("er16"))
    assert "base_shapes" not in data and not any("shapes" in link for link in data["links"])
    assert robot_from_dict(data).links[0].shapes == ()


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ("ball", "links.1.shapes: a list is needed, not 'ball'; write a list"),
        ([{"kind": "ball"}], "links.1.shapes.1.kind: 'ball' is not known here; choose one of: sphere, capsule, box,"),
        (
            [{"kind": "sphere", "radius": 1, "centre": [0, 0, 0], "size": [1, 1, 1]}],
            "links.1.shapes.1: unknown key 'size'; known keys: kind, radius, centre",
        ),
        ([{"kind": "sphere", "radius": 0, "centre": [0, 0, 0]}], "links.1.shapes.1.radius: 0 is not above 0;"),
        ([{"kind": "capsule", "start": [0, 0, 0], "end": [0, 0], "radius": 1}], "links.1.shapes.1.end: 3 numbers"),
        ([{"kind": "box", "size": [1, 1, 1], "rotation": [[1, 0, 0]] * 3}], "links.1.shapes.1.rotation: the matrix"),
    ],
)
def test_faults_of_the_json(shape: object, message: str) -> None:
    data = robot_to_dict(read_robot("er16"))
    data["links"][0]["shapes"] = shape
    with pytest.raises(DescriptionError) as caught:
        robot_from_dict(data, "arm.json")
    assert str(caught.value).startswith(f"arm.json: {message}")
