"""MJCF: each element that is read against MuJoCo, and each that is not refused with file, element and remedy."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from benchmarks.mujoco_oracle import mujoco_regressor

from dynident.api.given_robots import robot_of
from dynident.arrays import Array
from dynident.errors import DescriptionError
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from dynident.robot_files import read_robot
from dynident.robot_files.meshes import mesh_triangles

mujoco = pytest.importorskip("mujoco")

BODY = '<inertial pos=".1 .02 .03" mass="2" diaginertia=".02 .03 .04"/>'
#: A second body with everything asymmetric, to carry what is under test.
LAST = f'<body name="last" pos=".2 .1 .3"><joint name="z" axis="1 2 3" pos=".01 .02 .03"/>{BODY}</body>'


def arm(inside: str, head: str = "", tail: str = "", attributes: str = "") -> str:
    """Return a model whose first body has the elements ``inside``."""
    return (
        f'<mujoco model="arm">{head}<worldbody><body name="first" {attributes}>{inside}{LAST}</body></worldbody>'
        f"{tail}</mujoco>"
    )


HINGE = '<joint name="a" axis="0 1 0"/>'
RADIAN = '<compiler angle="radian"/>'
TIED = arm(
    HINGE + BODY + f'<body name="b" pos=".3 0 0"><joint name="b" axis="0 0 1" ref="20"/>{BODY}</body>',
    tail='<equality><joint joint1="b" joint2="z" polycoef="0.3 -2 0 0 0"/></equality>',
)
#: One file for each element.
FILES = {
    "angles in degrees by default": arm(HINGE.replace("/>", ' range="-90 45" ref="30"/>') + BODY),
    "angles in rad": arm(HINGE.replace("/>", ' range="-1 2" ref=".3"/>') + BODY, RADIAN, attributes='euler=".1 .2 .3"'),
    "order of Euler angles": arm(HINGE + BODY, '<compiler eulerseq="ZXy"/>', attributes='euler="10 20 30"'),
    "quaternion that is not a unit one": arm(HINGE + BODY, attributes='quat="1 2 3 4"'),
    "axis and angle": arm(HINGE + BODY, attributes='axisangle="1 2 2 40"'),
    "two axes": arm(HINGE + BODY, attributes='xyaxes="1 2 0 0 1 1"'),
    "a z axis": arm(HINGE + BODY, attributes='zaxis="1 2 -3"'),
    "a z axis that is down": arm(HINGE + BODY, attributes='zaxis="0 0 -2"'),
    "full inertia": arm(HINGE + '<inertial pos="1 2 3" mass="2" fullinertia="5 6 7 .1 .2 .3"/>'),
    "turned inertia": arm(HINGE + '<inertial pos="1 2 3" mass="2" euler="10 20 30" diaginertia="5 6 7"/>'),
    "a slide and two hinges in one body": arm(
        '<joint name="s" type="slide" axis="1 1 0" pos=".1 0 0" ref=".2"/><joint name="h" pos="0 .3 0" ref="30"/>'
        + HINGE
        + BODY
    ),
    "all primitive geoms": arm(
        HINGE + '<geom type="sphere" size=".1" pos=".1 .2 .3"/><geom type="capsule" size=".05 .2" euler="10 20 30"/>'
        '<geom type="cylinder" size=".05 .2" pos="1 0 0" mass="3"/><geom type="box" size=".1 .2 .3" density="200"/>'
        '<geom type="ellipsoid" size=".1 .2 .3" pos="0 0 1"/>'
    ),
    "geoms between two points": arm(
        HINGE
        + "".join(
            f'<geom type="{kind}" fromto=".1 .2 .3 .4 -.1 .2" size=".05"/>'
            for kind in ("capsule", "cylinder", "box", "ellipsoid")
        )
    ),
    "shells": arm(
        HINGE
        + "".join(
            f'<geom type="{kind}" size=".1 .2 .3" pos=".1 .2 .3" euler="10 20 30" shellinertia="true" density="10"/>'
            for kind in ("sphere", "capsule", "cylinder", "box")
        )
    ),
    "geoms in spite of inertial": arm(
        HINGE + BODY + '<geom size=".1" pos="1 0 0"/>', '<compiler inertiafromgeom="true"/>'
    ).replace(BODY + "</body></body>", BODY + '<geom size=".1"/></body></body>'),
    "groups of geoms": arm(
        HINGE + '<geom size=".1" pos="1 0 0" group="3"/><geom size=".1" pos="0 1 0" group="1"/>',
        '<compiler inertiagrouprange="0 2"/>',
    ),
    "least mass and inertia": arm(HINGE + BODY, '<compiler boundmass="3" boundinertia=".035"/>'),
    "balanced inertia": arm(
        HINGE + '<inertial pos="1 2 3" mass="2" diaginertia=".1 .1 .5"/>', '<compiler balanceinertia="true"/>'
    ),
    "total mass": arm(HINGE + BODY, '<compiler settotalmass="10"/>'),
    "defaults and classes": arm(
        '<joint name="a" class="deep"/><geom class="deep"/><geom class="wide" size=".3"/>'
        '<geom name="plain" size=".2"/>',
        '<default><geom density="500"/><joint axis="1 0 0" armature=".3"/><default class="wide"><geom type="box" '
        'size=".1 .2 .3" pos="0 0 1"/><default class="deep"><geom size=".2 .2 .4" euler="0 30 0"/><joint damping="2"/>'
        "</default></default></default>",
    ).replace('size=".3"/>', 'size=".3 .3 .3"/>'),
    "classes of children": arm(
        HINGE + '<geom/><frame childclass="b"><geom/></frame>',
        '<default><default class="a"><geom size=".1"/></default>'
        '<default class="b"><geom size=".2"/></default></default>',
        attributes='childclass="a"',
    ),
    "frames in frames": arm(
        '<frame pos="1 0 0" euler="0 0 40"><joint name="a" axis="1 0 0" pos=".1 .2 0"/><geom size=".1" pos="1 0 0"/>'
        '<frame quat="1 1 0 0" pos="0 1 0"><geom type="box" size=".1 .2 .3"/>'
        f'<body name="in" pos="1 2 3"><joint name="i"/>{BODY}</body></frame></frame>'
    ),
    "replicas": arm(
        HINGE
        + BODY
        + '<replicate count="4" offset=".1 .2 0" euler="10 20 30" sep="-"><geom size=".1" pos=".4 0 0"/>'
        + f'<body name="r" pos="1 0 0"><joint name="r"/>{BODY}</body></replicate>'
    ),
    "no replica": arm(HINGE + BODY + f'<replicate count="0" offset="1 0 0">{BODY}</replicate>'),
    "fixed bodies with sites": arm(
        HINGE + f'{BODY}<body name="f" pos="1 2 3" euler="10 20 30">{BODY}<site name="s"/></body>'
    ),
    "joints without names": arm(f"<joint/>{BODY}<body><joint axis='1 0 0'/>{BODY}</body>"),
    "a joint that follows another": TIED,
    "gravity": arm(HINGE + BODY, '<option gravity="1 2 -3"/>'),
    "gravity that is switched off": arm(HINGE + BODY, '<option gravity="1 2 -3"><flag gravity="disable"/></option>'),
    "gears": arm(
        HINGE.replace("/>", ' armature=".2" damping="1" frictionloss=".5" actuatorfrcrange="-9 9"/>') + BODY,
        tail='<actuator><motor joint="a" gear="50" ctrlrange="-.1 .1" armature="1e-4" damping="2e-4"/>'
        '<position joint="z" kp="9" '
        'forcerange="-4 5"/></actuator>',
    ),
    "a mesh whose points are written": arm(
        HINGE + '<geom type="mesh" mesh="m" pos=".1 0 0" euler="10 20 30"/>',
        '<asset><mesh name="m" inertia="exact" scale="1 2 -1" vertex="0 0 0 1 0 0 0 1 0 0 0 1" '
        'face="0 2 1 0 1 3 1 2 3 2 0 3"/></asset>',
    ),
    "a mesh of points alone": arm(
        HINGE + '<geom type="mesh" mesh="m" pos=".1 0 0" euler="10 20 30"/>',
        '<asset><mesh name="m" scale="1 2 -1" vertex="0 0 .1 1.1 0 0 0 .9 0 .3 0 1.3 .1 .1 .1 1 1.2 1"/></asset>',
    ),
}


def robot(text: str, folder: Path) -> tuple[Robot, Path]:
    path = folder / "arm.xml"
    path.write_text(text)
    return read_robot(path), path


def states(found: Robot, count: int = 6) -> tuple[Array, Array, Array]:
    random = np.random.default_rng(0)
    q, dq, ddq = random.normal(size=(3, count, found.dof))
    return q, dq, ddq


def assert_as_mujoco(found: Robot, path: Path, tolerance: float = 1e-9) -> None:
    """Compare the torque, through the values of the compiled model, and the regressor, through bodies put into it."""
    q, dq, ddq = states(found)
    model = mujoco.MjModel.from_xml_path(str(path))
    known = robot_of(model)
    assert found.nominal is not None and known.nominal is not None
    assert [joint.name for joint in found.joints] == [joint.name for joint in known.joints]
    torque, expected = (
        batched.inverse_dynamics(one.chain, one.nominal, q, dq, ddq) + ddq @ one.reflected_inertia
        for one in (found, known)
        if one.nominal is not None
    )
    np.testing.assert_allclose(torque, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())
    for own, other in zip(found.joints, known.joints, strict=True):
        stated = (own.damping, own.friction, own.limits.lower, own.limits.upper)
        np.testing.assert_allclose(
            np.array(stated, float),
            np.array((other.damping, other.friction, other.limits.lower, other.limits.upper), float),
        )
    np.testing.assert_allclose(found.gravity, known.gravity)
    columns = DynamicModel(found, ()).regressor(Motion(q, dq, ddq))
    by_bodies = mujoco_regressor(path, found, q, dq, ddq)
    is_body = ~np.isnan(by_bodies[0, 0])
    assert is_body.sum() >= 10
    size = np.abs(columns).max()
    np.testing.assert_allclose(columns[..., is_body], by_bodies[..., is_body], rtol=0.0, atol=1e-9 * size)


@pytest.mark.parametrize("name", FILES)
def test_each_element_is_read_as_mujoco_reads_it(name: str, tmp_path: Path) -> None:
    found, path = robot(FILES[name], tmp_path)
    if name.startswith("gravity that"):
        assert not found.gravity.any()
        return
    assert_as_mujoco(found, path)


def test_includes_stand_where_they_are_included(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "defaults.xml").write_text('<mujoco><default><joint armature=".7"/></default></mujoco>')
    (tmp_path / "last.xml").write_text(f'<mujocoinclude>{LAST}<include file="parts/more.xml"/></mujocoinclude>')
    (tmp_path / "parts" / "more.xml").write_text(f'<mujoco><body name="more"><joint name="m"/>{BODY}</body></mujoco>')
    text = arm(HINGE + BODY, '<include file="parts/defaults.xml"/>').replace(LAST, '<include file="last.xml"/>')
    found, path = robot(text, tmp_path)
    assert found.joint_names == ("a", "z", "m") and found.reflected_inertia[2, 2] == 0.7
    assert_as_mujoco(found, path)


GRIPPER = f"""<mujoco model="hand"><compiler angle="radian"/>
<default><motor armature=".3"/></default><worldbody>
<body name="palm" pos=".1 .2 .3"><joint name="p" axis="0 1 0"/>{BODY}
<body name="left" pos="0 .1 0"><joint name="l" axis="1 0 0"/>{BODY}</body>
<body name="right" pos="0 -.1 0"><joint name="r" axis="1 0 0"/>{BODY}</body></body>
<body name="aside"><joint name="s"/>{BODY}</body></worldbody>
<actuator><motor joint="p" gear="2" damping=".7" forcerange="-9 9"/><motor joint="l"/><motor joint="s"/></actuator>
<equality><joint joint1="r" joint2="l" polycoef=".1 -1 0 0 0"/><joint joint1="s" joint2="l"/></equality></mujoco>"""


@pytest.mark.parametrize(
    ("attached", "leader"),
    [
        ('<attach model="hand" body="palm" prefix="h_"/>', "h_l"),
        ('<attach model="hand" prefix="h_"/>', "h_l"),
        (
            '<replicate count="2" offset="1 0 0" sep="-"><attach model="hand" body="palm" prefix="h_"/></replicate>',
            "h_l-1",
        ),
        ('<attach model="hand" body="palm" prefix="a_"/><attach model="hand" body="palm" prefix="b_"/>', "b_l"),
    ],
    ids=["a body", "its world", "replicas", "twice"],
)
def test_actuators_and_equalities_come_with_attached_models(tmp_path: Path, attached: str, leader: str) -> None:
    (tmp_path / "hand.xml").write_text(GRIPPER)
    found, path = robot(arm(HINGE + BODY + attached, '<asset><model name="hand" file="hand.xml"/></asset>'), tmp_path)
    assert_as_mujoco(found, path)
    joints = {joint.name: joint for joint in found.joints}
    follower = joints[leader.replace("_l", "_r")]
    assert follower.mimic is not None and follower.mimic.joint == leader
    assert joints[leader.replace("_l", "_p")].limits.effort == 18.0
    assert [name for name in joints if name.startswith("h_s")] == (["h_s"] if "body" not in attached else [])


def _stl(path: Path, seed: int, count: int = 40) -> None:
    """Write the hull of some points with a dent, as a closed surface."""
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(seed).normal(size=(count, 3)) * [0.1, 0.2, 0.3]
    hull = ConvexHull(points)
    corners = points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flipped = np.einsum("ki,ki->k", normals, hull.equations[:, :3]) < 0
    corners[flipped] = corners[flipped][:, ::-1]
    corners = np.where(
        np.all(np.isclose(corners, points[hull.vertices[0]]), axis=2)[..., None], [0.01, 0.02, 0.03], corners
    )
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *map(float, triangle.ravel()), 0) for triangle in corners)
    path.write_bytes(bytes(80) + struct.pack("<I", len(corners)) + rows)


@pytest.mark.parametrize(
    ("kind", "form"), [("legacy", "stl"), ("convex", "stl"), ("exact", "stl"), ("shell", "stl"), ("exact", "msh")]
)
def test_meshes_give_inertia_in_each_of_the_four_ways(kind: str, form: str, tmp_path: Path) -> None:
    """MuJoCo keeps points in single precision: 1e-6 of the torque."""
    (tmp_path / "meshes").mkdir()
    _stl(tmp_path / "meshes" / "m.stl", 3)
    corners = mesh_triangles(Mesh("m.stl"), [tmp_path / "meshes"]).reshape(-1, 3)
    counts, faces = np.array([len(corners), 0, 0, len(corners) // 3], "<i4"), np.arange(len(corners), dtype="<i4")
    (tmp_path / "meshes" / "m.msh").write_bytes(counts.tobytes() + corners.astype("<f4").tobytes() + faces.tobytes())
    head = (
        f'<compiler meshdir="meshes"/><asset><mesh file="m.{form}" inertia="{kind}" scale="1 1.5 1" refpos=".1 .2 .3" '
        'refquat="1 .1 .2 .3"/></asset>'
    )
    found, path = robot(arm(HINGE + '<geom type="mesh" mesh="m" pos=".1 0 0" density="50"/>', head), tmp_path)
    assert_as_mujoco(found, path, 1e-6)


def test_shapes_are_those_that_touch(tmp_path: Path) -> None:
    _stl(tmp_path / "m.stl", 1)
    geoms = (
        '<geom type="sphere" size=".1"/><geom type="capsule" size=".1 .2"/><geom type="box" size=".1 .2 .3"/>'
        '<geom type="cylinder" size=".1 .2"/><geom type="ellipsoid" size=".1 .2 .3"/><geom type="mesh" mesh="m"/>'
        '<geom size=".5" contype="0" conaffinity="0"/><geom type="plane" size="1 1 1"/>'
    )
    found, _ = robot(arm(HINGE + BODY + geoms, '<asset><mesh file="m.stl"/></asset>'), tmp_path)
    assert [type(shape) for shape in found.links[0].shapes] == [Sphere, Capsule, Box, Cylinder, Box, Mesh]
    np.testing.assert_allclose(found.links[0].shapes[2].size, [0.2, 0.4, 0.6])  # type: ignore[union-attr]
    (shown,) = found.links[0].visuals
    assert isinstance(shown, Sphere) and shown.radius == 0.5


def test_points_that_are_written_are_a_shape_in_their_box(tmp_path: Path) -> None:
    """A mesh of four points, stretched along y and turned by a quarter about z."""
    head = '<asset><mesh name="m" scale="1 2 1" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .2"/></asset>'
    geom = '<geom type="mesh" mesh="m" pos="1 0 0" euler="0 0 90" density="500"/>'
    found, _ = robot(arm(HINGE + geom, head), tmp_path)
    (box,) = found.links[0].shapes
    assert isinstance(box, Box)
    np.testing.assert_allclose(
        [box.corners.min(axis=0), box.corners.max(axis=0)], [[0.8, 0, 0], [1, 0.1, 0.2]], atol=1e-12
    )


def test_gears_and_limits_of_torque(tmp_path: Path) -> None:
    found, _ = robot(FILES["gears"], tmp_path)
    one, two = (joint for joint in found.active if joint.name in ("a", "z"))
    assert one.drive.gear_ratio == 50 and np.isclose(one.drive.reflected_inertia, 0.2 + 1e-4 * 50**2)
    assert one.limits.effort == 5.0 and two.limits.effort == 5.0 and two.drive.gear_ratio == 1.0
    assert one.damping is not None and np.isclose(one.damping, 1.0 + 2e-4 * 50**2) and one.friction == 0.5


def test_a_joint_that_an_equality_holds_is_fixed(tmp_path: Path) -> None:
    text = TIED.replace('joint2="z" polycoef="0.3 -2 0 0 0"', 'polycoef="0.3"')
    found, path = robot(text, tmp_path)
    assert found.joint_names == ("a", "z")
    free, _ = robot(TIED.replace("<equality>", "<equality><!--").replace("</equality>", "--></equality>"), tmp_path)
    held = free.locked({"b": np.radians(20) + 0.3})
    q, dq, ddq = states(found)
    assert found.nominal is not None and held.nominal is not None
    np.testing.assert_allclose(
        batched.inverse_dynamics(found.chain, found.nominal, q, dq, ddq),
        batched.inverse_dynamics(held.chain, held.nominal, q, dq, ddq),
        atol=1e-12,
    )
    assert path.is_file()


def test_the_note_names_what_has_a_torque_in_mujoco_and_none_here(tmp_path: Path) -> None:
    text = arm(
        '<joint name="a" stiffness="3" damping="1 .1 0"/>' + BODY,
        '<option density="1.2"/>',
        '<tendon><fixed name="t" damping="2"><joint joint="a" coef="1"/></fixed></tendon>',
        'gravcomp="1"',
    )
    found, _ = robot(text, tmp_path)
    for word in (
        "springs of joints (a)",
        "second and third order (a)",
        "a fluid",
        "tendons (t)",
        "gravity compensation",
    ):
        assert word in found.note
    assert "without" not in robot(FILES["gravity"], tmp_path)[0].note


MUSCLE = '<actuator><muscle name="m" joint="a"/></actuator>'
FAULTS = {
    "a muscle": (arm(HINGE + BODY, tail=MUSCLE), "line 1, <muscle name='m'>", "replace it by a motor"),
    "a muscle by its parameters": (
        arm(HINGE + BODY, tail='<actuator><general joint="a" gaintype="muscle"/></actuator>'),
        "<general>",
        "replace it by a motor",
    ),
    "a flexible body": (
        arm(HINGE + BODY, tail='<deformable><flex name="f" dim="1"/></deformable>'),
        "<flex name='f'>",
        "remove it",
    ),
    "flexible bodies": (arm(HINGE + BODY + '<flexcomp name="f" type="grid"/>'), "<flexcomp name='f'>", "remove it"),
    "a composite": (arm(HINGE + BODY + '<composite type="cable"/>'), "<composite>", "remove it"),
    "a joint tied twice": (
        TIED.replace("</equality>", '<joint joint1="b" joint2="a"/></equality>'),
        "tied twice, at line 1 too: redundant equalities",
        "keep one of the two",
    ),
    "joints tied in a ring": (
        TIED.replace("</equality>", '<joint joint1="z" joint2="b"/></equality>'),
        "redundant equalities",
        "remove one of them",
    ),
    "a loop of bodies": (
        arm(HINGE + BODY, tail='<equality><weld body1="first" body2="last"/></equality>'),
        "<weld> closes a loop",
        'active="false"',
    ),
    "an equality that is not linear": (TIED.replace("-2 0 0 0", "-2 1 0 0"), "is not linear", "the last three numbers"),
    "a missing include": (
        arm(HINGE + BODY, '<include file="none.xml"/>'),
        "<include>: the file 'none.xml' is missing",
        "correct the name",
    ),
    "an include that includes itself": (
        arm(HINGE + BODY, '<include file="arm.xml"/>'),
        "<include>: the file 'arm.xml' is included twice",
        "include each file once",
    ),
    "an unknown unit of angles": (
        arm(HINGE + BODY, '<compiler angle="gradian"/>'),
        "<compiler>: angle 'gradian' is not known",
        "choose one of: degree, radian; did you mean 'radian'?",
    ),
    "an order of axes that is none": (arm(HINGE + BODY, '<compiler eulerseq="xyw"/>'), "eulerseq", "three of x y z"),
    "a free joint in a body": (
        arm(HINGE + BODY + f"<body name='k'><freejoint/>{BODY}</body>"),
        "<freejoint>: body 'k' floats freely",
        "remove the joint to fix the base",
    ),
    "a ball joint": (arm('<joint type="ball" name="k"/>' + BODY), "<joint name='k'>", "three hinges"),
    "a ball joint in a loop": (
        arm('<joint type="ball" name="k"/>' + BODY, "<equality><connect body1='a' anchor='0 0 0'/></equality>"),
        "<joint name='k'>",
        "a parallel robot, such as a Delta, cannot be identified",
    ),
    "an unknown attribute": (
        arm('<joint armatur="1"/>' + BODY),
        "unknown attribute 'armatur'",
        "did you mean 'armature'",
    ),
    "an unknown element": (arm(HINGE + BODY + "<gem/>"), "<gem>", "did you mean 'geom'"),
    "an unknown section": (arm(HINGE + BODY, "<defaults/>"), "<defaults>", "did you mean 'default'"),
    "an unknown class": (arm('<joint class="x"/>' + BODY), "no defaults class 'x'", "add it to <default>"),
    "a missing mesh": (
        arm(HINGE + '<geom type="mesh" mesh="m"/>', '<asset><mesh name="m" file="m.stl"/></asset>'),
        "the mesh 'm' gives no inertia: m.stl: no such mesh file",
        "write the <inertial> of the body",
    ),
    "an unknown mesh": (arm(HINGE + '<geom type="mesh" mesh="m"/>'), "there is no mesh 'm'", "add it to <asset>"),
    "two orientations": (
        arm(HINGE + BODY, attributes='quat="1 0 0 0" euler="1 2 3"'),
        "both quat and euler",
        "keep one",
    ),
    "a file that leads elsewhere": (
        arm(HINGE + BODY, '<include file="/etc/hostname"/>'),
        "leads elsewhere",
        "relative to the folder of the main file",
    ),
    "no joint": (arm(BODY).replace('<joint name="z" axis="1 2 3" pos=".01 .02 .03"/>', ""), "no joint moves", "arm"),
    "limits without the word": (
        arm('<joint name="a" range="-1 1"/>' + BODY, '<compiler autolimits="false"/>'),
        "range without limited",
        'limited="true"',
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_not_read_is_refused_with_file_element_and_remedy(name: str, tmp_path: Path) -> None:
    text, evidence, remedy = FAULTS[name]
    with pytest.raises(DescriptionError) as caught:
        robot(text, tmp_path)
    message = str(caught.value)
    assert "arm.xml" in message and evidence in message and remedy in message and "\n" not in message


def test_a_gear_next_to_zero_gives_no_torque(tmp_path: Path) -> None:
    found, _ = robot(arm(HINGE + BODY, tail='<actuator><motor joint="a" gear="5e-324"/></actuator>'), tmp_path)
    assert found.joints[0].drive.gear_ratio == 1.0


def test_the_first_element_says_the_format(tmp_path: Path) -> None:
    text = f"<?xml version='1.0'?>\n<!-- <robot> -->\n{FILES['gravity']}"
    (tmp_path / "arm.urdf").write_text(text)
    assert read_robot(tmp_path / "arm.urdf").joint_names == ("a", "z")
