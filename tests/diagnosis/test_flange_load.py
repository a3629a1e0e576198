"""The mass of a load at the flange that stands off it: arms and torques by Pinocchio, robot models that are off."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from benchmarks.faults.clean import told
from benchmarks.faults.loads import named
from benchmarks.faults.trials import RATE, virtual

from dynident.case.case import read_case
from dynident.diagnosis.causes.flange_load import FAR, TOLD, carried, own_inertia
from dynident.diagnosis.causes.known_bodies import known_bodies
from dynident.identification.estimate.estimate import Estimate
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint, rotation_about
from dynident.model.robot import Link, Robot

pytest.importorskip("pinocchio")


def inertia_of_point(values: np.ndarray) -> np.ndarray:
    first, mass = values[:3], values[3]
    distance = np.hypot(mass, np.linalg.norm(first) / FAR)
    about = first @ first * np.eye(3) - np.outer(first, first)
    return np.sign(mass) * about[np.triu_indices(3)] / distance


@pytest.mark.parametrize("mass", [1.5, -1.5, 0.01])
def test_moments_of_inertia_follow_mass_and_first_moments(mass: float) -> None:
    """The slopes are those of finite differences, and the straight lines go through the point itself."""
    values, step = np.array([0.1, -0.2, 0.3, mass]), 1e-6
    slopes = carried(values)[TOLD:, :TOLD]
    for k, unit in enumerate(np.eye(TOLD)):
        rise = inertia_of_point(values + step * unit) - inertia_of_point(values - step * unit)
        np.testing.assert_allclose(slopes[:, k], rise / (2 * step), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(slopes @ values, inertia_of_point(values), rtol=1e-12, atol=1e-15)


def test_nothing_goes_with_a_load_that_is_none() -> None:
    np.testing.assert_array_equal(carried(np.zeros(TOLD)), np.eye(10))
    assert own_inertia(np.zeros(TOLD)) > 0.0


@pytest.mark.parametrize("seed", [5, 16, *(pytest.param(k, marks=pytest.mark.battery) for k in (2, 7, 14, 18))])
def test_the_interval_holds_the_mass_of_a_load_off_the_flange(seed: int, tmp_path: Path) -> None:
    """Its centre is 0.1 m off in each direction; without its inertia the mass came out 10 to 20 % too small."""
    mass, found = named(seed, 2.0, tmp_path)
    assert found is not None and found.severity == "warning"
    half = float(found.evidence.split("+- ")[1].split()[0])
    assert abs(found.numbers["mass_kg"] - mass) < half < 0.35 * mass
    assert found.numbers["mass_kg"] == pytest.approx(mass, rel=0.12)


@pytest.mark.parametrize("seed", [5, 16, *(pytest.param(k, marks=pytest.mark.battery) for k in (2, 7, 8, 14, 18))])
def test_errors_of_the_last_link_are_no_load(seed: int, tmp_path: Path) -> None:
    found = named(seed, 0.0, tmp_path)[1]
    assert found is None or found.severity == "note"


def test_the_branch_of_a_tree_that_carries_a_load_is_named(tmp_path: Path) -> None:
    """Against an earlier estimate a load on the first of two arms had been wrong gains of four joints of it."""
    case = read_case("generic-6r")
    arm = case.robot.locked({name: 0.4 for name in case.robot.joint_names[3:]})
    links, joints = list[Link](), list[Joint]()
    for side in ("left", "right"):
        first = len(links)
        links += [replace(link, name=f"{side}_{link.name}") for link in arm.links]
        parents = [joint.parent + first if joint.parent >= 0 else -1 for joint in arm.joints]
        joints += [replace(j, name=f"{side}_{j.name}", parent=k) for j, k in zip(arm.joints, parents, strict=True)]
    columns = replace(case.columns, joints=tuple(joint.name for joint in joints))
    both = replace(case, robot=Robot("two arms", tuple(links), tuple(joints)), columns=columns)
    earlier = virtual(both, 1, RATE).estimate(tmp_path)
    assert not [one for one in virtual(both, 2, RATE).examined(tmp_path, earlier).findings if "load" in one.name]
    for end in (2, 5):
        body = Inertia.from_centre_of_mass(0.8, np.array([0.05, 0.1, -0.1]), 0.002 * np.eye(3))
        own = links[end].inertia
        assert own is not None
        carried_by = replace(links[end], inertia=own + body)
        robot = Robot("two arms", (*links[:end], carried_by, *links[end + 1 :]), tuple(joints))
        trial = replace(virtual(replace(both, robot=robot), 2, RATE), case=both)
        found = [one for one in trial.examined(tmp_path, earlier).findings if one.name != "scale not determined"]
        assert [(one.name, one.joint) for one in found] == [("load at the flange", joints[end].name)]
        assert found[0].numbers["mass_kg"] == pytest.approx(0.8, rel=0.05)


def test_a_heavy_load_is_no_unit_of_the_torques(tmp_path: Path) -> None:
    case = read_case("generic-6r")
    arm = case.robot.locked({name: 0.4 for name in case.robot.joint_names[4:]})
    case = replace(case, robot=arm, columns=replace(case.columns, joints=arm.joint_names))
    earlier = virtual(case, 1, RATE).estimate(tmp_path)
    *others, last = arm.links
    assert last.inertia is not None
    mass = 0.95 * sum(link.inertia.mass for link in arm.links if link.inertia is not None)
    body = Inertia.from_centre_of_mass(mass, np.array([0.01, 0.02, 0.2]), 0.01 * mass * np.eye(3))
    heavy = replace(arm, links=(*others, replace(last, inertia=last.inertia + body)))
    trial = replace(virtual(replace(case, robot=heavy), 2, RATE), case=case)
    found = [one for one in trial.examined(tmp_path, earlier).findings if one.severity != "note"]
    assert [one.name for one in found] == ["load at the flange"]
    assert found[0].numbers["mass_kg"] == pytest.approx(mass, rel=0.02)


def test_bodies_are_known_where_frames_are_rounded() -> None:
    """Maps of base parameters of such frames differ by rounding; left free, bodies hid the mass of a load."""
    case = read_case("generic-7r")
    robot = case.robot
    turn = rotation_about(np.eye(3)[0], 3e-6)
    robot = replace(robot, joints=tuple(replace(one, rotation=one.rotation @ turn) for one in robot.joints))
    theirs, ours = (DynamicModel(robot, case.friction[:count]) for count in (2, 3))
    base, own = base_parameters(theirs), base_parameters(ours)
    estimate = SimpleNamespace(model=theirs, base=base, beta=np.ones(base.count), covariance=np.eye(base.count))
    known = known_bodies(cast("Estimate", estimate), ours, own)
    assert known is not None and len(known.places) == np.sum(own.independent < ours.inertial_count)


@pytest.mark.parametrize(("seed", "kind"), [(6007, "RPRR"), (23, "RRR")])
def test_errors_of_the_robot_model_of_a_short_arm_are_no_load(seed: int, kind: str, tmp_path: Path) -> None:
    """A load has to explain more combinations of bodies than it has parameters, and is no warning beside a scale."""
    found, arm = told(seed, tmp_path)
    assert arm.startswith(kind) and not [one for one in found if one.name == "load at the flange"]
