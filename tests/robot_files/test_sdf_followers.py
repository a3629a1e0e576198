"""SDF: joints that follow another, as SDFormat writes it and as Drake does, and what Drake adds to a model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dynident.errors import DescriptionError
from dynident.model.dynamic_model import DynamicModel
from dynident.model.joint import Mimic
from dynident.model.robot import Robot
from dynident.robot_files.formats.sdf import SdfFile

MOMENTS = "<inertia><ixx>.02</ixx><iyy>.03</iyy><izz>.04</izz><ixy>.001</ixy></inertia>"
BODY = f"<inertial><pose>.1 .02 .03 .1 .2 .3</pose><mass>2</mass>{MOMENTS}</inertial>"
DRAKE = '<drake:mimic joint="a" multiplier="-1.5" offset=".3"/>'
SDFORMAT = '<mimic joint="a"><multiplier>-1.5</multiplier><offset>.5</offset><reference>-.1</reference></mimic>'


def arm(in_joint: str = "", in_axis: str = "", in_model: str = "") -> str:
    """Return an arm of three joints on the world, whose last one slides, with what stands in it and in the arm."""
    axis = "<axis><xyz>0 1 .2</xyz>"
    return f"""<sdf version="1.11" xmlns:drake="d"><model name="m">
<link name="base"/><joint name="w" type="fixed"><parent>world</parent><child>base</child></joint>
<link name="l"><pose>.1 .2 .3 .4 .5 .6</pose>{BODY}</link><link name="k"><pose>.4 .2 .3 .1 .2 .6</pose>{BODY}</link>
<link name="n"><pose>.8 .2 .3 .1 .2 .6</pose>{BODY}</link>
<joint name="a" type="revolute"><parent>base</parent><child>l</child>{axis}</axis></joint>
<joint name="b" type="revolute"><parent>l</parent><child>k</child>{axis}</axis></joint>
<joint name="c" type="prismatic"><parent>k</parent><child>n</child>{axis}{in_axis}</axis>{in_joint}</joint>
{in_model}</model></sdf>"""


def read(text: str) -> Robot:
    return SdfFile().read("arm.sdf", text.encode())


def plant_of(text: str, step: float) -> Any:
    plants = pytest.importorskip("pydrake.multibody.plant", reason="pip install drake")
    parsing: Any = pytest.importorskip("pydrake.multibody.parsing")
    plant: Any = plants.MultibodyPlant(step)
    if step:
        plant.set_discrete_contact_approximation(plants.DiscreteContactApproximation.kSap)
    parsing.Parser(plant).AddModelsFromString(text, "sdf")
    plant.Finalize()
    return plant


@pytest.mark.parametrize(
    "stated", [{"in_axis": SDFORMAT}, {"in_joint": DRAKE}, {"in_axis": SDFORMAT, "in_joint": DRAKE}]
)
def test_a_joint_follows(stated: dict[str, str]) -> None:
    """SDFormat: -1.5 (q + 0.1) + 0.5 is -1.5 q + 0.35."""
    if len(stated) == 2:
        stated["in_joint"] = DRAKE.replace('".3"', '".35"')
    robot = read(arm(**stated))
    mimic = robot.joints[2].mimic
    assert robot.joint_names == ("a", "b") and mimic is not None and (mimic.joint, mimic.multiplier) == ("a", -1.5)
    assert mimic.offset == pytest.approx(0.35 if "in_axis" in stated else 0.3, abs=1e-15)


def test_drake_holds_the_joint_where_it_is_read_to_be() -> None:
    """Simulated by Drake from a state off the coupling: its constraint pulls both joints onto it."""
    plant = plant_of(arm(in_joint=DRAKE), 1e-3)
    analysis: Any = pytest.importorskip("pydrake.systems.analysis")
    simulator = analysis.Simulator(plant)
    context = simulator.get_mutable_context()
    plant.SetPositions(context, [0.4, 0.1, 0.0])
    simulator.AdvanceTo(0.3)
    q = plant.GetPositions(context)
    mimic = read(arm(in_joint=DRAKE)).joints[2].mimic
    assert mimic is not None and abs(q[0] - 0.4) > 0.01
    assert q[2] == pytest.approx(mimic.multiplier * q[0] + mimic.offset, abs=1e-6)


def test_torques_of_a_follower_act_at_its_leader_as_in_drake() -> None:
    plant, robot = plant_of(arm(), 0.0), read(arm(in_axis=SDFORMAT))
    tree: Any = pytest.importorskip("pydrake.multibody.tree")
    states = np.random.default_rng(0).uniform(-1, 1, (3, 6, 2))
    turn, shift = np.array([[1.0, 0.0], [0.0, 1.0], [-1.5, 0.0]]), np.array([0.0, 0.0, 0.35])
    context, nominal = plant.CreateDefaultContext(), DynamicModel(robot).nominal()
    assert nominal is not None
    found = (DynamicModel(robot).regressor(*states) @ nominal).reshape(6, 2)
    for row, (q, dq, ddq) in zip(found, states.swapaxes(0, 1), strict=True):
        plant.SetPositions(context, turn @ q + shift)
        plant.SetVelocities(context, turn @ dq)
        forces: Any = tree.MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        np.testing.assert_allclose(
            row, turn.T @ plant.CalcInverseDynamics(context, turn @ ddq, forces), rtol=0.0, atol=1e-11
        )


def test_a_joint_of_a_nested_model_follows_one_in_it() -> None:
    inner = (
        arm(in_joint=DRAKE).partition('"m">')[2].rpartition("</model>")[0].replace("<parent>world<", "<parent>base<")
    )
    inner = inner.replace('<joint name="w" type="fixed"><parent>base</parent><child>base</child></joint>', "")
    robot = read(f'<sdf version="1.9" xmlns:drake="d"><model name="o"><model name="i">{inner}</model></model></sdf>')
    assert robot.joints[2].mimic == Mimic("i::a", -1.5, 0.3)


FAULTS = {
    "both, and otherwise": ({"in_axis": SDFORMAT, "in_joint": DRAKE}, "follows otherwise by another", "keep one"),
    "nothing by how much": ({"in_axis": '<mimic joint="a"/>'}, "0 <multiplier> in <mimic>", "write one <multiplier>"),
    "a second axis": ({"in_axis": SDFORMAT.replace('"a"', '"a" axis="axis2"')}, "a second axis", "of one axis"),
    "held still": ({"in_joint": DRAKE.replace("-1.5", "0")}, "multiplier 0 holds it still", "make the joint fixed"),
    "no offset": ({"in_joint": DRAKE.replace('offset=".3"', "")}, "no attribute 'offset'", 'write offset="..."'),
    "no such joint": ({"in_joint": DRAKE.replace('"a"', '"d"')}, "follows 'd', which is no joint", "name of a joint"),
    "in the axis": ({"in_axis": DRAKE}, "<drake:mimic> in <axis>", "write it in the <joint>"),
    "mistyped": ({"in_joint": DRAKE.replace("mimic", "mimik")}, "<drake:mimik>", "did you mean 'drake:mimic'"),
    "a planar joint": ({"in_model": '<drake:joint name="p" type="planar"/>'}, "a planar joint", "replace it by"),
    "a loop": ({"in_model": "<drake:ball_constraint/>"}, "closes a loop of links", "only trees are read"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_follows_nothing_is_refused(name: str) -> None:
    stated, evidence, remedy = FAULTS[name]
    with pytest.raises(DescriptionError) as caught:
        read(arm(**stated))
    message = str(caught.value)
    assert message.startswith("arm.sdf: ") and evidence in message and remedy in message and "\n" not in message


def test_springs_of_drake_are_named() -> None:
    spring = (
        "<drake:linear_spring_damper><drake:linear_spring_damper_stiffness>9</drake:linear_spring_damper_stiffness>"
    )
    note = read(arm(in_model=f"{spring}</drake:linear_spring_damper>")).note
    assert note == "read from arm.sdf; without drake:linear_spring_damper"
    assert read(arm()).note == "read from arm.sdf"
