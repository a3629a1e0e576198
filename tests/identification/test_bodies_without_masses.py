"""Robots given by a DH table alone: bodies within what the kinematics allow, masses that nothing determines named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.exports.models import export_model
from dynident.identification.build_problem import PriorKnowledge, build_problem
from dynident.identification.consistency.conditions import conditions_of
from dynident.identification.consistency.consistent_fit import MARGIN, scale_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import Plausibility
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.fit import fit
from dynident.identification.problem.problem import Problem
from dynident.model.body_constraints import BodyConstraints, Constraints, ValueRange
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion
from dynident.model.inertia import Inertia
from dynident.model.plausible import plausible_constraints
from dynident.model.robot import Robot
from dynident.results.plausibility import plausibility_lines
from dynident.results.report.sections import SECTIONS
from dynident.results.report.subject import Subject
from dynident.robot_files import read_robot

MakeLog = Callable[..., Log]

GIVEN = Preprocessing(AsGiven(), rest="keep")

SEEDS = range(4)


def dh_robot(folder: Path, seed: int, kinds: str = "rrrrrr") -> Robot:
    """Return a robot of a random DH table, a wrist at its end: its arm 0.4 to 1.2 m long."""
    generator = np.random.default_rng(seed)
    length = generator.uniform(0.4, 1.2)
    lines = []
    for i, kind in enumerate(kinds):
        a = length * generator.uniform(0.8, 1.2) if i in (2, 3) else 0.1 * length * generator.uniform()
        d = 0.2 * length * generator.uniform() if i < 4 else 0.0
        alpha = (0, -90, 0, -90, 90, -90)[i]
        lines.append(f"  - {{name: A{i + 1}, kind: {'revolute' if kind == 'r' else 'prismatic'}, a: {a:.3f}, ")
        lines[-1] += f"alpha: {alpha}*pi/180, d: {d:.3f}, theta: 0}}"
    path = folder / "robot.yaml"
    path.write_text("name: random\nconvention: modified\njoints:\n" + "\n".join(lines), encoding="utf-8")
    return read_robot(path)


def with_bodies(robot: Robot, seed: int) -> Robot:
    """Return the robot with ellipsoids of links along their children, a fifth to a third of its arm thick."""
    generator = np.random.default_rng([seed, 1])
    arm = max(float(np.linalg.norm(joint.translation)) for joint in robot.joints)
    links = []
    for i, link in enumerate(robot.links):
        end = next((joint.translation for joint in robot.joints if joint.parent == i), np.zeros(3))
        half = arm * generator.uniform(0.1, 0.18, 3) + np.abs(end) / 2
        centre = end / 2 + 0.3 * half * generator.uniform(-1, 1, 3)
        mass = generator.uniform(800, 2500) * 4 / 3 * np.pi * np.prod(half)
        spread = mass / 5 * np.diag(np.sum(half**2) - half**2)
        links.append(replace(link, inertia=Inertia.from_centre_of_mass(mass, centre, spread)))
    return replace(robot, links=tuple(links))


def logged(
    robot: Robot, make: MakeLog, parts: tuple[str, ...] = ("rotor_inertia",), rotor: float = 0.1
) -> tuple[DynamicModel, Log, Log]:
    """Return the model of the DH table with two logs of a robot with bodies, rotors a share of joint 1's inertia."""
    whole = DynamicModel(robot, (FRICTION.make("viscous"), FRICTION.make("rotor_inertia")))
    posture = replace(whole.random_motion(1, 0), q=np.zeros((1, robot.dof)), dq=np.zeros((1, robot.dof)))
    theta = np.append(robot.nominal, np.zeros(2 * robot.dof))
    unit = replace(posture, ddq=np.eye(1, robot.dof))
    inertia = float((whole.torque(unit, theta) - whole.torque(replace(unit, ddq=0 * unit.ddq), theta))[0, 0])
    sizes = {"viscous": 0.1 * inertia, "rotor": rotor * inertia}
    kinds = ["rotor" if p.kind == "rotor" else "viscous" for p in whole.parameters[whole.inertial_count :]]
    theta[whole.inertial_count :] = [sizes[kind] for kind in kinds]
    noise = 0.02 * np.std(np.asarray(make(whole, theta).torque), axis=0)
    bare = replace(robot, links=tuple(replace(link, inertia=None) for link in robot.links))
    model = DynamicModel(bare, (FRICTION.make("viscous"), *map(FRICTION.make, parts)))
    return model, make(whole, theta, noise=noise, seed=1), make(whole, theta, noise=noise, seed=2, rate=30.0)


def facts_of(estimate: Estimate) -> Plausibility:
    facts = Plausibility.of(estimate.run)
    assert facts is not None
    return facts


def error(problem: Problem, log: Log, estimate: Estimate) -> float:
    left = np.asarray(log.torque) - problem.model.torque(Motion(log.q, log.dq, log.ddq), estimate.theta)
    return float(np.linalg.norm(left / np.std(np.asarray(log.torque), axis=0)))


def test_bodies_of_a_dh_table_are_within_what_its_lengths_allow(tmp_path: Path, exact_log: MakeLog) -> None:
    beyond = 0
    for seed in SEEDS:
        robot = with_bodies(dh_robot(tmp_path, seed), seed)
        model, log, test = logged(robot, exact_log)
        problem = build_problem(model, [log], GIVEN)
        free, found = fit(problem, Consistent(bodies="free")), fit(problem, Consistent())
        facts, bounds, scale = facts_of(found), plausible_constraints(model.robot), scale_of(problem)
        assert not facts.contradicted and facts.uniform == tuple(link.name for link in robot.links)
        assert found.theta is not None and free.theta is not None
        rules = conditions_of(model, scale, MARGIN, bounds)
        assert rules.shortfall(found.theta / scale.parameters) < 1e-6
        assert rules.shortfall(np.append(robot.nominal, np.ones(12)) / scale.parameters) == 0.0  # the truth is too
        assert error(problem, test, found) < 1.02 * error(problem, test, free)
        beyond += int(rules.shortfall(free.theta / scale.parameters) > 0.01)
    assert beyond == len(SEEDS)


def test_masses_that_nothing_determines_are_named_and_no_others(tmp_path: Path, exact_log: MakeLog) -> None:
    robot = with_bodies(dh_robot(tmp_path, 0), 0)
    model, log, _ = logged(robot, exact_log)
    names = tuple(link.name for link in robot.links)
    found = fit(build_problem(model, [log], GIVEN), Consistent())
    assert facts_of(found).massless == names
    (line,) = [line for line in plausibility_lines(found, None) if line.startswith("masses of")]
    assert "masses of all links are not known: the log does not determine them" in line
    answer = SECTIONS.make("verdict").context(Subject(found))["answers"][1]
    assert answer.tone == "fair" and "masses of all links are not known" in answer.detail
    notes = export_model(found, "urdf", tmp_path / "a.urdf").notes
    assert any(note.startswith("masses of all links are not known") for note in notes)
    stated = Constraints({names[1]: BodyConstraints(mass=ValueRange(1.0, 1e4))})
    partly = fit(build_problem(model, [log], GIVEN, knowledge=PriorKnowledge(stated)), Consistent())
    assert facts_of(partly).massless == (names[0], *names[2:])
    known = fit(build_problem(replace(model, robot=robot), [log], GIVEN), Consistent())
    assert facts_of(known).massless == ()
    assert SECTIONS.make("verdict").context(Subject(known))["answers"][1].tone == "good"
    assert not [line for line in plausibility_lines(known, None) if line.startswith("masses of")]


def test_a_mass_that_the_log_determines_is_known(tmp_path: Path, exact_log: MakeLog) -> None:
    """A slide carries all: the mass of its last link, the only one, follows from forces."""
    robot = with_bodies(dh_robot(tmp_path, 0, "p"), 0)
    model, log, _ = logged(robot, exact_log, parts=())
    found = fit(build_problem(model, [log], GIVEN), Consistent())
    assert facts_of(found).massless == () and found.theta is not None


@pytest.mark.parametrize("parts", [("rotor_inertia",), ()])
def test_rotors_are_no_matter_of_links(tmp_path: Path, exact_log: MakeLog, parts: tuple[str, ...]) -> None:
    """Twenty times the inertia of the arm: stated as rotors no link holds it, else the size of a link is named."""
    robot = with_bodies(dh_robot(tmp_path, 1), 1)
    model, log, _ = logged(robot, exact_log, parts, rotor=20.0)
    found = fit(build_problem(model, [log], GIVEN), Consistent())
    sizes = [one.name for one in facts_of(found).contradicted if "size" in one.bound]
    assert bool(sizes) == (not parts)
    if sizes:
        assert any(
            line.startswith(f"size of {sizes[0]}: the data contradict") for line in plausibility_lines(found, None)
        )
