"""Masses in space: the ellipsoid of a body has its inertia, and its outline is that of its projection."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from drawings import check_labels, named, parsed, points
from synthetic import arm, subject_of

from dynident.model.inertia import Inertia
from dynident.model.shapes import Capsule, Mesh
from dynident.results.figures import mass_scene, scene_chart, scene_text
from dynident.results.figures.bodies import FAR
from dynident.results.report import Subject
from dynident.results.report.sections.mass_distribution import MassDistribution


def test_an_ellipsoid_has_the_inertia_of_its_body() -> None:
    """A solid ellipsoid has I = m / 5 diag(b^2 + c^2, a^2 + c^2, a^2 + b^2) about its centre."""
    robot = arm()
    a, b, c, mass = 0.1, 0.2, 0.3, 7.0
    about = mass / 5 * np.diag([b**2 + c**2, a**2 + c**2, a**2 + b**2])
    body = Inertia.from_centre_of_mass(mass, [0.1, 0.2, 0.3], about)
    (found,) = mass_scene(robot, np.zeros(3), [("own", [body, None, None])]).bodies
    assert np.allclose(np.linalg.eigvalsh(found.spread), [a**2, b**2, c**2])
    assert np.allclose(found.centre, np.add(robot.joints[0].translation, [0.1, 0.2, 0.3])) and found.mass == mass


def test_an_outline_encloses_what_it_is_of() -> None:
    robot = arm()
    body = Inertia.from_centre_of_mass(5.0, [0.1, 0.0, 0.05], np.diag([0.05, 0.06, 0.02]))
    scene = mass_scene(robot, np.array([0.3, -0.4, 0.5]), [("own", [None, body, None])])
    root = parsed(scene_chart("View", scene, 0.7, 0.3))
    outline = next(p for p in named(root, "path") if p.get("class") == "c1" and p.attrib["d"].endswith("z"))
    places = points(outline.attrib["d"].rstrip("z"))[0]
    (middle,) = (each.centre for each in scene.bodies)
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(400, 3))
    surface = directions / np.linalg.norm(directions, axis=1)[:, None] @ np.linalg.cholesky(scene.bodies[0].spread).T
    right = np.array([-np.sin(0.7), np.cos(0.7), 0.0])
    across = (surface + middle) @ right
    scale = np.ptp(places[:, 0]) / np.ptp(across)
    shifted = scale * (across - across.mean()) + places[:, 0].mean()
    assert shifted.min() >= places[:, 0].min() - 0.05 * np.ptp(places[:, 0])
    assert np.ptp(places[:, 0]) == pytest.approx(2 * scale * np.sqrt(right @ scene.bodies[0].spread @ right), rel=0.02)


def test_bodies_that_cannot_be_are_named_and_needles_do_not_shrink_the_picture() -> None:
    robot = arm()
    wrong = Inertia(1.0, np.array([0.1, 0.0, 0.0]), np.diag([1.0, 0.0, 0.0]))
    needle = Inertia.from_centre_of_mass(0.01, [0.0, 0.0, 0.0], np.diag([5.0, 5.0, 1e-6]))
    scene = mass_scene(robot, np.zeros(3), [("identified", [wrong, needle, None])])
    assert scene.left_out == ("link of joint1 (identified)",) and len(scene.bodies) == 1
    reach = np.linalg.norm(scene.bones.reshape(-1, 3), axis=1).max()
    assert np.linalg.norm(scene.points, axis=1).max() <= 2 * FAR * reach
    check_labels(scene_chart("View", scene))


def test_a_body_larger_than_the_robot_is_a_line_and_does_not_fill_the_picture() -> None:
    robot = arm()
    small = Inertia.from_centre_of_mass(2.0, [0.0, 0.0, 0.1], np.diag([0.01, 0.01, 0.01]))
    vast = Inertia.from_centre_of_mass(0.01, [0.0, 0.0, 0.0], np.diag([5.0, 5.0, 5.0]))
    scene = mass_scene(robot, np.zeros(3), [("identified", [small, vast, None])])
    filled = [p for p in named(parsed(scene_chart("View", scene)), "path") if p.get("fill-opacity") == "0.14"]
    assert [body.vast for body in scene.bodies] == [False, True] and len(filled) == 1
    assert [body["vast"] for body in json.loads(scene_text(scene))["bodies"]] == [False, True]


def test_the_shapes_of_links_are_drawn_as_thick_as_they_are_where_their_link_is() -> None:
    plain = arm()
    shape, mesh = Capsule(np.zeros(3), np.array([0.0, 0.0, 0.4]), 0.07), Mesh("upper.stl")
    robot = replace(plain, links=(replace(plain.links[0], shapes=(shape, mesh)), *plain.links[1:]))
    scene = mass_scene(robot, np.zeros(3), [("own", [link.inertia for link in robot.links])])
    (found,) = scene.capsules
    assert np.allclose(found.start, plain.joints[0].translation) and np.allclose(found.end - found.start, shape.end)
    (drawn,) = [p for p in named(parsed(scene_chart("View", scene)), "path") if p.get("stroke-linecap") == "round"]
    ((start, end),) = points(drawn.attrib["d"])
    seen = np.linalg.norm(end - start) / np.cos(np.deg2rad(24.0))  # the eye is raised, the capsule upright
    assert float(drawn.attrib["stroke-width"]) / seen == pytest.approx(2 * 0.07 / 0.4, rel=0.01)
    assert json.loads(scene_text(scene))["capsules"][0][2] == 0.07
    assert mass_scene(plain, np.zeros(3), [("own", [None] * 3)]).capsules == ()


def test_the_section_shows_what_was_identified_beside_what_was_described() -> None:
    estimate, _ = subject_of(samples=300)
    found = MassDistribution().context(Subject(estimate))
    data = json.loads(found["scene"])
    assert data["kinds"] == ["identified", "described"] and len(data["bodies"]) == 6
    assert [figure.stem for figure in found["figures"]] == [
        "masses-from-above", "masses-from-the-front", "masses-from-the-side",
    ]  # fmt: skip
    estimate, _ = subject_of(samples=300, standard=False)
    assert json.loads(MassDistribution().context(Subject(estimate))["scene"])["kinds"] == ["described"]
    scene = mass_scene(estimate.model.robot, np.zeros(3), [])
    assert json.loads(scene_text(scene))["bodies"] == []
