"""SDF: what joints and frames are fixed to, nested and included models; against Drake, and the same in plain words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.errors import DescriptionError
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot
from dynident.robot_files import read_robot

MOMENTS = "<inertia><ixx>.02</ixx><iyy>.03</iyy><izz>.04</izz></inertia>"
BODY = f"<inertial><pose>.1 .02 .03 0 0 0</pose><mass>2</mass>{MOMENTS}</inertial>"


def link(name: str, pose: str = "0 0 0 0 0 0") -> str:
    return f'<link name="{name}"><pose>{pose}</pose>{BODY}</link>'


def joint(name: str, parent: str, child: str, pose: str = "", axis: str = "<xyz>0 1 0</xyz>") -> str:
    ends = f"<parent>{parent}</parent><child>{child}</child>"
    return f'<joint name="{name}" type="revolute">{pose}{ends}<axis>{axis}</axis></joint>'


def frame(attached: str = "", pose: str = ".1 .2 .3 0 .2 .4") -> str:
    return f'<frame name="F"{attached}><pose>{pose}</pose></frame>'


def hand(attributes: str = "", pose: str = "<pose>0 0 7 0 .2 .3</pose>", name: str = "n", axis: str = "") -> str:
    inside = (
        link("p", ".1 .2 0 .3 0 0") + link("q", "1 0 0 0 .1 0") + joint("c", "p", "q", "", axis or "<xyz>0 1 0</xyz>")
    )
    return f'<model name="{name}"{attributes}>{pose}{inside}</model>'


ARM = link("base") + link("up", "1 2 3 0 0 .5") + joint("a", "base", "up")
OF_F, IN_N = '<pose relative_to="F"/>', '<pose relative_to="n::__model__"/>'
ON_N = ' attached_to="n"'
CARRIED = ARM + hand() + joint("b", "up", "n::p") + frame(ON_N) + link("tip", "2 1 5 0 0 0")
#: What stands in a model, and the same with links as parents and children, and with poses of joints.
SAME = {
    "a child that is a frame": (
        link("base") + link("up", "1 2 3 0 0 .5") + frame(' attached_to="up"') + joint("a", "base", "F"),
        link("base") + link("up", "1 2 3 0 0 .5") + frame(' attached_to="up"') + joint("a", "base", "up", OF_F),
    ),
    "a frame on nothing": (
        link("base") + link("up", "1 2 3 0 0 .5") + frame() + joint("a", "F", "up"),
        link("base") + link("up", "1 2 3 0 0 .5") + joint("a", "base", "up"),
    ),
    "the model as parent": (
        link("base") + link("up", "1 2 3 0 0 .5") + joint("a", "__model__", "up"),
        link("base") + link("up", "1 2 3 0 0 .5") + joint("a", "base", "up"),
    ),
    "a joint as parent": (
        ARM + link("tip", "5 0 0 0 .3 0") + joint("b", "a", "tip"),
        ARM + link("tip", "5 0 0 0 .3 0") + joint("b", "up", "tip"),
    ),
    "a frame on a joint": (
        ARM + link("tip", "5 0 0 0 .3 0") + frame(' attached_to="a"') + joint("b", "F", "tip"),
        ARM + link("tip", "5 0 0 0 .3 0") + joint("b", "up", "tip"),
    ),
    "a nested model as child": (
        ARM + hand() + joint("b", "up", "n"),
        ARM + hand() + joint("b", "up", "n::p", IN_N),
    ),
    "a stated canonical link": (
        CARRIED.replace('name="n"', 'name="n" canonical_link="q"') + joint("d", "F", "tip"),
        CARRIED + joint("d", "n::q", "tip"),
    ),
    "a frame on a nested model": (
        ARM + hand() + frame(ON_N) + joint("b", "up", "F"),
        ARM + hand() + frame(ON_N) + joint("b", "up", "n::p", OF_F),
    ),
    "models of models alone": (
        f'<model name="z">{ARM}</model>{hand()}' + joint("b", "z::up", "n"),
        f'<model name="z">{ARM}</model>{hand()}' + joint("b", "z::up", "n::p", IN_N),
    ),
    "an axis in a nested frame": (
        ARM + hand() + joint("b", "up", "n::p", "", '<xyz expressed_in="n::q">0 1 0</xyz>'),
        ARM + hand() + joint("b", "up", "n::p", "", '<xyz expressed_in="n::c">0 1 0</xyz>'),
    ),
    "a nested model placed by its frame": (
        ARM + hand(' placement_frame="p"', '<pose relative_to="up">1 2 3 .3 0 0</pose>') + joint("b", "up", "n::p"),
        ARM + hand("", '<pose relative_to="up">.9 1.8 3 0 0 0</pose>') + joint("b", "up", "n::p"),
    ),
    "an included model": (
        ARM + "<include><uri>hand.sdf</uri></include>" + joint("b", "up", "n::p"),
        ARM + hand() + joint("b", "up", "n::p"),
    ),
    "an include with name and pose": (
        f'{ARM}<include><uri>hand.sdf</uri><name>k</name><pose relative_to="up">1 2 3 0 0 1</pose></include>'
        + joint("b", "up", "k::p"),
        ARM + hand(name="k", pose='<pose relative_to="up">1 2 3 0 0 1</pose>') + joint("b", "up", "k::p"),
    ),
    "an include with a placement frame": (
        f"{ARM}<include><uri>hand.sdf</uri><placement_frame>q</placement_frame><pose>1 2 3 0 0 1</pose></include>"
        + joint("b", "up", "n::p"),
        ARM + hand(' placement_frame="q"', "<pose>1 2 3 0 0 1</pose>") + joint("b", "up", "n::p"),
    ),
    "an included folder": (
        ARM + "<include><uri>model://pack</uri></include>" + joint("b", "up", "n::p"),
        ARM + hand() + joint("b", "up", "n::p"),
    ),
    "one model twice, in a model": (
        f"{ARM}<model name='o'><pose>1 1 1 0 0 1</pose><include><uri>hand.sdf</uri></include>"
        "<include><uri>hand.sdf</uri><name>k</name></include></model>"
        + joint("b", "up", "o::n::p") + joint("d", "up", "o::k::p"),
        f"{ARM}<model name='o'><pose>1 1 1 0 0 1</pose>{hand()}{hand(name='k')}</model>"
        + joint("b", "up", "o::n::p") + joint("d", "up", "o::k::p"),
    ),
    "an include of an older version": (
        ARM + "<include><uri>old.sdf</uri></include>" + joint("b", "up", "n::p"),
        ARM + hand(axis='<xyz expressed_in="__model__">0 1 0</xyz>') + joint("b", "up", "n::p"),
    ),
}  # fmt: skip


def written(folder: Path, inside: str, name: str = "arm.sdf") -> Path:
    """Write a model, and files that it may include; ``hand.sdf`` is found as a file and in a folder."""
    (folder / "pack").mkdir(exist_ok=True)
    (folder / "pack" / "model.config").write_text(
        '<model><name>h</name><sdf version="1.4">old.sdf</sdf><sdf version="1.9">hand.sdf</sdf></model>'
    )
    for place in (folder, folder / "pack"):
        (place / "hand.sdf").write_text(f'<sdf version="1.9">{hand()}</sdf>')
        (place / "old.sdf").write_text(f'<sdf version="1.4">{hand()}</sdf>')
    (folder / name).write_text(f'<sdf version="1.9"><model name="m">{inside}</model></sdf>')
    return folder / name


@pytest.mark.parametrize("name", SAME)
def test_joints_and_frames_are_fixed_to_links(name: str, tmp_path: Path) -> None:
    one, other = (read_robot(written(tmp_path, text)) for text in SAME[name])
    assert one.joint_names == other.joint_names
    states = np.random.default_rng(0).uniform(-1, 1, (3, 6, one.dof))
    expected = DynamicModel(other).regressor(*states)
    np.testing.assert_allclose(
        DynamicModel(one).regressor(*states), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )
    nominal = DynamicModel(one).nominal()
    assert nominal is not None
    np.testing.assert_allclose(nominal, np.asarray(DynamicModel(other).nominal()), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", SAME)
def test_torques_are_those_of_drake(name: str, tmp_path: Path) -> None:
    """Includes are those of packages for Drake, which finds no others."""
    text = SAME[name][0].replace("model://pack", "package://sdf/hand.sdf").replace("<uri>h", "<uri>package://sdf/h")
    path = written(tmp_path, text.replace("<uri>o", "<uri>package://sdf/o"))
    (tmp_path / "package.xml").write_text("<package><name>sdf</name></package>")
    robot = read_robot(path)
    states = np.random.default_rng(0).uniform(-1, 1, (3, 6, robot.dof))
    nominal = DynamicModel(robot).nominal()
    assert nominal is not None
    expected = drake_torque(path, robot, states)
    found = (DynamicModel(robot).regressor(*states) @ nominal).reshape(expected.shape)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(
    "inside",
    [
        "<axis><xyz>0 1 .3</xyz></axis>",
        "<axis><xyz>0 1 .3</xyz><use_parent_model_frame>true</use_parent_model_frame></axis>",
    ],
)
@pytest.mark.parametrize("version", ["1.4", "1.5", "1.6", "1.11"])
def test_older_versions_and_a_base_on_the_world_are_those_of_drake(version: str, inside: str, tmp_path: Path) -> None:
    held = '<joint name="w" type="fixed"><parent>world</parent><child>base</child></joint>'
    arm = joint("a", "base", "up", "<pose>.1 .2 .3 .4 .5 .6</pose>").replace("<axis><xyz>0 1 0</xyz></axis>", inside)
    if version == "1.11":
        arm = arm.replace("<use_parent_model_frame>true</use_parent_model_frame>", "")
    both = link("base", ".1 .2 .3 .1 .2 .3") + link("up", "1 2 3 0 0 .5")
    path = tmp_path / "arm.sdf"
    path.write_text(
        f'<sdf version="{version}"><model name="m"><pose>1 2 3 .4 .5 .6</pose>{held}{both}{arm}</model></sdf>'
    )
    robot = read_robot(path)
    states = np.random.default_rng(0).uniform(-1, 1, (3, 6, 1))
    nominal = DynamicModel(robot).nominal()
    assert nominal is not None and robot.base == "world"
    expected = drake_torque(path, robot, states)
    found = (DynamicModel(robot).regressor(*states) @ nominal).reshape(expected.shape)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def drake_torque(path: Path, robot: Robot, states: Any) -> Any:
    """Return the torques of an SDF by Drake, its base held in the world as the robot has it."""
    plants = pytest.importorskip("pydrake.multibody.plant", reason="pip install drake")
    parsing: Any = pytest.importorskip("pydrake.multibody.parsing")
    tree: Any = pytest.importorskip("pydrake.multibody.tree")
    transforms: Any = pytest.importorskip("pydrake.math")
    plant: Any = plants.MultibodyPlant(0.0)
    parser = parsing.Parser(plant)
    parser.package_map().Add("sdf", str(path.parent))
    parser.AddModels(str(path))
    if robot.base == "world":
        plant.Finalize()
        return _inverse(plant, tree, robot, states)
    bodies = [plant.get_body(tree.BodyIndex(k)) for k in range(plant.num_bodies())]
    base = next(body for body in bodies if f"::{body.scoped_name().get_full()}".endswith(f"::{robot.base}"))
    plant.WeldFrames(plant.world_frame(), base.body_frame(), transforms.RigidTransform())
    plant.mutable_gravity_field().set_gravity_vector(robot.gravity)
    plant.Finalize()
    return _inverse(plant, tree, robot, states)


def _inverse(plant: Any, tree: Any, robot: Robot, states: Any) -> Any:
    joints = [plant.get_joint(number) for number in plant.GetJointIndices()]
    scopes = {
        f"{plant.GetModelInstanceName(one.child_body().model_instance())}::{one.name()}": one.velocity_start()
        for one in joints
    }
    at = [
        next(
            start
            for full, start in scopes.items()
            if full.endswith(f"::{name.rpartition('::')[2]}") and ("::k::" in f"::{name}") <= ("::k::" in full)
        )
        for name in robot.joint_names
    ]
    context, found = plant.CreateDefaultContext(), []
    for values in zip(*states, strict=True):
        q, dq, ddq = np.zeros((3, plant.num_velocities()))
        q[at], dq[at], ddq[at] = values
        plant.SetPositions(context, q)
        plant.SetVelocities(context, dq)
        forces: Any = tree.MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        found.append(plant.CalcInverseDynamics(context, ddq, forces)[at])
    return np.array(found)


class Draw:
    """Random models: links, nested models and frames placed by and attached to each other, joints between any."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._count = 0

    def word(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}"

    def pick(self, names: list[str]) -> str:
        return names[int(self._random.integers(len(names)))]

    def pose(self, names: list[str]) -> str:
        name, numbers = self.pick(["", *names]), " ".join(f"{x:.2f}" for x in self._random.uniform(-1, 1, 6))
        return f"<pose{f' relative_to={name!r}' if name else ''}>{numbers}</pose>"

    def model(self, depth: int) -> tuple[str, list[str], str]:
        """Return what stands in a model, the names in it, and its first link."""
        names, text, parts = ["__model__"], "", []
        for _ in range(int(self._random.integers(1, 4))):
            name = self.word("l")
            text += f'<link name="{name}">{self.pose(names)}{BODY}</link>'
            names.append(name)
            parts.append((name, [name]))
        for _ in range(int(self._random.integers(0, 3)) if depth else 0):
            name, (inside, inner, root) = self.word("m"), self.model(depth - 1)
            placed = f' placement_frame="{self.pick(inner[1:])}"' if self._random.random() < 0.4 else ""
            text += f'<model name="{name}" canonical_link="{root}"{placed}>{self.pose(names)}{inside}</model>'
            names += [name, *(f"{name}::{one}" for one in inner)]
            parts.append((f"{name}::{root}", [name, f"{name}::{root}", f"{name}::__model__"]))
        for _ in range(int(self._random.integers(0, 3))):
            name, attached = self.word("f"), self.pick(names)
            text += f'<frame name="{name}" attached_to="{attached}">{self.pose(names)}</frame>'
            names.append(name)
        done = [parts[0][0]]
        for link_name, ends in parts[1:]:
            name, kind = self.word("j"), self.pick(["revolute", "prismatic", "fixed", "continuous"])
            axis = f"<axis><xyz expressed_in='{self.pick(names)}'>.3 1 -.4</xyz></axis>" if kind != "fixed" else ""
            stated = f"<parent>{self.pick(done)}</parent><child>{self.pick(ends)}</child>{axis}"
            text += f'<joint name="{name}" type="{kind}">{self.pick(["", self.pose(names)])}{stated}</joint>'
            done.append(link_name)
            names.append(name)
        return text, names, parts[0][0]


@pytest.mark.battery
@pytest.mark.parametrize("seed", range(40))
def test_torques_of_random_models_are_those_of_drake(seed: int, tmp_path: Path) -> None:
    path = written(tmp_path, Draw(seed).model(2)[0])
    try:
        robot = read_robot(path)
    except DescriptionError as problem:
        assert "no joint moves" in str(problem)
        return
    states = np.random.default_rng(0).uniform(-1, 1, (3, 6, robot.dof))
    nominal = DynamicModel(robot).nominal()
    assert nominal is not None
    expected = drake_torque(path, robot, states)
    found = (DynamicModel(robot).regressor(*states) @ nominal).reshape(expected.shape)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * max(1.0, np.abs(expected).max()))


FAULTS = {
    "no such file": ("<uri>gone.sdf</uri>", "'gone.sdf' is missing beside", "put it there"),
    "a name too long": (f"<uri>{'hand' * 100}.sdf</uri>", "is missing beside", "put it there"),
    "no such model": ("<uri>model://gone</uri>", "'model://gone' is missing in GZ_SIM_RESOURCE_PATH", "put it there"),
    "another machine": ("<uri>https://fuel.gazebosim.org/1.0/x</uri>", "is not on this machine", "download it"),
    "an absolute path": ("<uri>/etc/passwd</uri>", "is missing", "correct the <uri>"),
    "itself": ("<uri>arm.sdf</uri>", "includes itself", "remove this include"),
    "a word of its own": (
        "<uri>hand.sdf</uri><nam>k</nam>",
        "unknown element <nam> in <include>",
        "did you mean 'name'",
    ),
    "no sdf": ("<uri>pack/model.config</uri>", "begins with <model>, not with <sdf>", "give a SDF"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_includes_that_cannot_be_read_are_refused(name: str, tmp_path: Path) -> None:
    stated, evidence, remedy = FAULTS[name]
    with pytest.raises(DescriptionError) as caught:
        read_robot(written(tmp_path, f"{ARM}<include>{stated}</include>"))
    message = str(caught.value)
    assert evidence in message and remedy in message and "line 1" in message and "\n" not in message


@pytest.mark.parametrize(
    ("inside", "told"),
    [
        (
            ARM + hand(' canonical_link="r"') + joint("b", "up", "n"),
            r"<model name='n'>: its canonical_link 'r' is no link",
        ),
        (ARM + "<model name='n'/>" + joint("b", "up", "n"), r"<model name='n'>: a model without links; write a <link>"),
        (ARM + joint("b", "up", "n::__model__"), r"<joint name='b'>: its child 'n::__model__' is no link and no frame"),
        (
            ARM + joint("b", "a::__model__", "up"),
            r"<joint name='b'>: its parent 'a::__model__' is no link and no frame",
        ),
        (ARM + joint("b", "up", "nn"), r"<joint name='b'>: its child 'nn' is no link and no frame"),
        (
            ARM + frame(' attached_to="F"') + joint("b", "up", "F"),
            r"<joint name='b'>: its child 'F' is fixed to itself",
        ),
        (ARM + hand(' placement_frame="r"') + joint("b", "up", "n::p"), r"<model name='n'>: there is no frame 'n::r'"),
    ],
)
def test_frames_that_are_fixed_to_nothing_are_refused(inside: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=told):
        read_robot(written(tmp_path, inside))


def test_a_merged_include_is_refused_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"line 1, <include>: a merged include is not read; expand it first"):
        read_robot(written(tmp_path, f'{ARM}<include merge="true"><uri>hand.sdf</uri></include>'))


def test_includes_that_grow_without_end_are_refused(tmp_path: Path) -> None:
    """Each file includes the next one twice: 2^20 models."""
    for number in range(20):
        both = "".join(f"<include><uri>m{number + 1}.sdf</uri><name>{name}</name></include>" for name in "ab")
        text = both if number < 19 else link("l")
        (tmp_path / f"m{number}.sdf").write_text(f'<sdf version="1.9"><model name="m">{text}</model></sdf>')
    with pytest.raises(DescriptionError, match="more than 200 includes"):
        read_robot(tmp_path / "m0.sdf")
    many = "".join(link(f"l{number}") for number in range(999))
    (tmp_path / "m19.sdf").write_text(f'<sdf version="1.9"><model name="m">{many}</model></sdf>')
    with pytest.raises(DescriptionError, match="more than 1000 links"):
        read_robot(tmp_path / "m18.sdf")


def test_scenery_of_a_world_is_no_robot(tmp_path: Path) -> None:
    written(tmp_path, ARM)
    (tmp_path / "sun.sdf").write_text('<sdf version="1.9"><light type="directional" name="sun"/></sdf>')
    ground = f'<model name="ground"><static>true</static>{link("l")}</model>'
    world = f"{ground}<include><uri>sun.sdf</uri></include><include><uri>arm.sdf</uri></include>"
    (tmp_path / "w.sdf").write_text(
        f'<sdf version="1.9"><world name="w"><gravity>0 0 -1</gravity>{world}</world></sdf>'
    )
    robot = read_robot(tmp_path / "w.sdf")
    assert robot.name == "m" and robot.joint_names == ("a",) and robot.gravity[2] == -1.0


def test_models_are_found_in_the_resource_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home, models = tmp_path / "home" / "of" / "the" / "robot", tmp_path / "models"
    home.mkdir(parents=True)
    models.mkdir()
    written(models, ARM)
    path = home / "arm.sdf"
    path.write_text(written(models, ARM + "<include><uri>model://pack</uri></include>").read_text())
    with pytest.raises(DescriptionError, match="is missing in GZ_SIM_RESOURCE_PATH"):
        read_robot(path)
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", f"/nowhere:{models}")
    with pytest.raises(DescriptionError, match="links have no parent joint"):
        read_robot(path)  # found: the hand is not joined to the arm
