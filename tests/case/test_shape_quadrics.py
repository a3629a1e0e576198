"""Shapes as bounds: bodies of random and of known density in seeded links are never refused, others are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pytest
from tests.case.test_mesh_bounds import box_triangles, write_stl

from dynident import read_robot
from dynident.arrays import Array
from dynident.case.mesh_bounds import separating, shape_quadrics, with_mesh_points, with_quadrics
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.build_problem import build_problem
from dynident.identification.consistency.plausible_fit import plausible_fit
from dynident.identification.estimators.wls import WLS
from dynident.model.body_constraints import BodyConstraints, Constraints, ValueRange
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import Inertia
from dynident.model.joint import rotation_about
from dynident.model.plausible import bounding_ellipsoids, plausible_constraints, shape_clouds
from dynident.model.robot import Link, Robot
from dynident.model.shapes import Box, Capsule, Cylinder, Sphere
from dynident.robot_files.solids import solid_of

#: An L of two boxes, as a link of an arm that turns a corner.
L_SHAPE = (
    Box(np.array([0.4, 0.08, 0.08]), translation=np.array([0.2, 0.0, 0.0])),
    Box(np.array([0.08, 0.08, 0.4]), translation=np.array([0.4, 0.0, 0.2])),
)

DENSITY = 2700.0

Solid: TypeAlias = Box | Capsule | Cylinder | Sphere


def second_moment(points: Array, weights: Array) -> Array:
    """Return the pseudo-inertia of point masses."""
    lifted = np.column_stack([points, np.ones(len(points))])
    return (lifted.T * weights) @ lifted


def points_in(shape: Solid, generator: np.random.Generator, count: int) -> Array:
    """Return points all over a shape."""
    if isinstance(shape, Box):
        return (generator.uniform(-0.5, 0.5, (count, 3)) * shape.size) @ shape.rotation.T + shape.translation
    if isinstance(shape, Cylinder):
        radius, turn = shape.radius * np.sqrt(generator.uniform(size=count)), generator.uniform(0.0, 2 * np.pi, count)
        along = shape.length * generator.uniform(-0.5, 0.5, count)
        own = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), along])
        return own @ shape.rotation.T + shape.translation
    ball = generator.normal(size=(count, 3))
    ball *= generator.uniform(size=(count, 1)) ** (1 / 3) / np.linalg.norm(ball, axis=1, keepdims=True)
    if isinstance(shape, Sphere):
        return shape.centre + shape.radius * ball
    return shape.start + generator.uniform(size=(count, 1)) * (shape.end - shape.start) + shape.radius * ball


def turned_to(along: Array) -> Array:
    """Return a rotation that turns z to a direction."""
    axis = np.cross([0.0, 0.0, 1.0], along)
    return rotation_about(axis / np.linalg.norm(axis), np.arctan2(np.linalg.norm(axis), along[2]))


def random_shapes(generator: np.random.Generator, kinds: int = 4) -> tuple[Solid, ...]:
    """Return a chain of two to five shapes that bends at random."""
    place, shapes = 0.2 * generator.normal(size=3), []
    for _ in range(generator.integers(2, 6)):
        step = generator.normal(size=3)
        step *= generator.uniform(0.15, 0.4) / np.linalg.norm(step)
        girth = generator.uniform(0.03, 0.08)
        kind, length = generator.integers(kinds), float(np.linalg.norm(step))
        if kind == 0:
            shapes.append(Box(np.array([girth, girth, length]), turned_to(step), place + step / 2))
        elif kind == 3:
            shapes.append(Cylinder(girth, length, turned_to(step), place + step / 2))
        else:
            shapes.append(Capsule(place, place + step, girth) if kind == 1 else Sphere(girth, place))
        place = place + step
    return tuple(shapes)


def test_all_matter_in_the_shapes_is_allowed() -> None:
    """Points and bodies of random density in seeded chains of boxes, capsules and balls: none is refused."""
    generator, coarse = np.random.default_rng(5), 0
    for _ in range(16):
        shapes = random_shapes(generator, 3)
        found = np.array(with_quadrics(Link("link", shapes=shapes)).quadrics)
        coarse += len(found) > 0
        if not len(found):
            continue
        points = np.vstack([points_in(shape, generator, 300) for shape in shapes])
        lifted = np.column_stack([points, np.ones(len(points))])
        assert np.min(np.einsum("ni,kij,nj->kn", lifted, found, lifted)) >= 0.0
        for _ in range(20):
            body = second_moment(points, generator.dirichlet(np.full(len(points), 0.01)))
            assert np.min(np.sum(body * found, axis=(1, 2))) >= 0.0
    assert coarse >= 6


def test_a_body_beside_the_shapes_is_refused_that_one_ellipsoid_allows() -> None:
    """A ball in the notch of an L; every body that quadrics refuse is proven to be outside by a quadric of its own."""
    clouds = shape_clouds(Link("link", shapes=L_SHAPE))
    whole, *parts = bounding_ellipsoids([np.concatenate(clouds), *clouds])
    found = np.array(shape_quadrics(clouds))
    ball = second_moment(np.array([0.22, 0.0, 0.18]) + 0.02 * np.vstack([np.eye(3), -np.eye(3)]), np.full(6, 1 / 6))
    assert np.sum(ball * whole.quadric) > 0.3 and np.min(np.sum(ball * found, axis=(1, 2))) < -0.1
    forms, inside = np.array([part.quadric for part in parts]), second_moment(np.vstack(clouds), np.full(16, 1 / 16))
    generator, refused = np.random.default_rng(2), 0
    turns = generator.normal(size=(400, 3))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    points = np.vstack([part.centre + (turns * part.semi_axes) @ part.rotation.T for part in parts])
    surface = np.column_stack([points, np.ones(len(points))])
    for _ in range(60):
        points = whole.centre + (generator.normal(size=(3, 3)) * 0.4 * whole.semi_axes) @ whole.rotation.T
        body = second_moment(points, generator.dirichlet(np.ones(3)))
        proof = separating(forms, body, inside)
        is_refused = np.min(np.sum(body * found, axis=(1, 2))) < 0.0
        refused += is_refused
        assert not is_refused or np.sum(proof * body) < 0.0
        assert np.min(np.einsum("ni,ij,nj->n", surface, proof, surface)) > -1e-9 * np.abs(proof).max()
    assert 10 <= refused <= 50


@pytest.mark.parametrize("shapes", [L_SHAPE[:1], (L_SHAPE[0], replace(L_SHAPE[0], translation=np.array([0.4, 0, 0])))])
def test_one_ellipsoid_is_enough_for_what_has_no_corner(shapes: tuple[Box, ...]) -> None:
    assert with_quadrics(Link("link", shapes=shapes)).quadrics == ()


def test_shapes_that_do_not_hold_the_nominal_body_have_one_ellipsoid() -> None:
    """Neither is proof against the other."""
    ball = Inertia.from_centre_of_mass(2.0, [0.22, 0.0, 0.18], 2.0 * 0.02**2 * np.eye(3))
    assert with_quadrics(Link("link", ball, shapes=L_SHAPE)).quadrics == ()
    assert with_quadrics(Link("link", shapes=L_SHAPE)).quadrics


def shape_xml(shape: Solid, folder: Path, unit: float, is_open: bool, number: int) -> str:
    """Return a URDF geometry with its pose; a box may be a mesh file in metres or millimetres, closed or open."""
    turn, place, text = np.eye(3), np.zeros(3), ""
    if isinstance(shape, Sphere):
        place, text = np.asarray(shape.centre), f'<sphere radius="{shape.radius}"/>'
    elif isinstance(shape, Capsule):
        place, turn = (shape.start + shape.end) / 2, turned_to(shape.end - shape.start)
        text = f'<capsule radius="{shape.radius}" length="{shape.length}"/>'
    elif isinstance(shape, Cylinder):
        turn, place = np.asarray(shape.rotation), np.asarray(shape.translation)
        text = f'<cylinder radius="{shape.radius}" length="{shape.length}"/>'
    else:
        turn, place = np.asarray(shape.rotation), np.asarray(shape.translation)
        text = f'<box size="{" ".join(map(repr, shape.size.tolist()))}"/>'
        if number % 2:
            name, triangles = f"part{number}.stl", box_triangles(shape.size * unit, np.zeros(3))
            write_stl(folder / name, triangles[2 * is_open :])
            text = f'<mesh filename="{name}" scale="{1 / unit} {1 / unit} {1 / unit}"/>'
    pitch = np.arcsin(-turn[2, 0])
    angles = np.arctan2(turn[2, 1], turn[2, 2]), pitch, np.arctan2(turn[1, 0], turn[0, 0])
    pose = f'xyz="{" ".join(map(repr, place.tolist()))}" rpy="{" ".join(repr(float(one)) for one in angles)}"'
    return f"<collision><origin {pose}/><geometry>{text}</geometry></collision>"


def volume_of(shape: Solid) -> float:
    if isinstance(shape, Box):
        return float(np.prod(shape.size))
    if isinstance(shape, Cylinder):
        return float(np.pi * shape.radius**2 * shape.length)
    length = shape.length if isinstance(shape, Capsule) else 0.0
    return float(np.pi * shape.radius**2 * (length + 4 / 3 * shape.radius))


def robot_of(generator: np.random.Generator, folder: Path, states_bodies: bool) -> tuple[Robot, list[Array]]:
    """Return a robot of three links of known density as its URDF tells it, and their pseudo-inertias."""
    unit, is_open = (1.0, 1000.0)[generator.integers(2)], bool(generator.integers(2))
    links, joints, bodies = ['<link name="base"/>'], [], []
    for i in range(3):
        shapes = random_shapes(generator)[: generator.integers(1, 6)]
        points = [points_in(shape, generator, 2000) for shape in shapes]
        weights = [np.full(2000, DENSITY * volume_of(shape) / 2000) for shape in shapes]
        bodies.append(second_moment(np.vstack(points), np.concatenate(weights)))
        body = Inertia.from_pseudo(bodies[-1])
        moments = body.about_centre
        keys = ("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2), ("izz", 2, 2)
        stated = " ".join(f'{key}="{float(moments[a, b])!r}"' for key, a, b in keys)
        centre = " ".join(map(repr, body.centre_of_mass.tolist()))
        inertial = f'<inertial><origin xyz="{centre}"/><mass value="{body.mass!r}"/><inertia {stated}/></inertial>'
        parts = "".join(shape_xml(s, folder, unit, is_open, 10 * i + k) for k, s in enumerate(shapes))
        links.append(f'<link name="link{i}">{inertial if states_bodies else ""}{parts}</link>')
        parent = f"link{i - 1}" if i else "base"
        joints.append(
            f'<joint name="joint{i}" type="revolute"><parent link="{parent}"/><child link="link{i}"/>'
            '<origin xyz="0.3 0.2 0.1"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    path = folder / "robot.urdf"
    path.write_text(f'<robot name="seeded">{"".join(links)}{"".join(joints)}</robot>')
    robot, faults = with_mesh_points(read_robot(path), str(path))
    assert faults == ()
    return robot, bodies


@pytest.mark.parametrize("count", [4, pytest.param(200, marks=pytest.mark.battery)])
def test_bodies_of_known_density_meet_the_bounds_of_their_shapes(tmp_path: Path, count: int) -> None:
    """Seeded robots with boxes, capsules, cylinders, balls and meshes, in metres and millimetres, closed and open."""
    generator, coarse = np.random.default_rng(8), 0
    for k in range(count):
        robot, bodies = robot_of(generator, tmp_path, bool(k % 2))
        bounds = plausible_constraints(robot)
        for link, body in zip(robot.links, bodies, strict=True):
            known, mass = bounds.links[link.name], body[3, 3]
            assert known.body_ellipsoid is not None
            rows = [known.body_ellipsoid.quadric, *known.body_ellipsoid.slabs(known.reach), *known.quadrics]
            assert min(np.sum(body * row) for row in rows) >= 0.0
            assert spread_of(body) >= known.thickness**2
            assert known.mass.low <= mass <= known.mass.high
            coarse += len(known.quadrics) > 0
    assert coarse >= count / 2


def spread_of(body: Array) -> float:
    """Return the least mean square distance of a pseudo-inertia from a plane through its centre of mass."""
    second = body / body[3, 3]
    return float(np.linalg.eigvalsh(second[:3, :3] - np.outer(second[:3, 3], second[:3, 3]))[0])


def test_matter_at_the_ends_of_one_mesh_is_allowed(tmp_path: Path) -> None:
    """Four blocks on a thin cross and mast: their body reaches further than the bounds of one ellipsoid allow."""
    ends = [0.2 * sign * np.eye(3)[axis] for axis in (0, 1) for sign in (-1, 1)]
    parts = [Box(np.full(3, 0.06), translation=end) for end in ends]
    parts += [Box(np.array(size)) for size in ([0.34, 0.01, 0.01], [0.01, 0.34, 0.01], [0.01, 0.01, 0.46])]
    write_stl(tmp_path / "cross.stl", np.vstack([box_triangles(one.size, one.translation) for one in parts]))
    path = tmp_path / "robot.urdf"
    path.write_text(
        '<robot name="cross"><link name="base"/><link name="cross"><collision><geometry><mesh filename="cross.stl"/>'
        '</geometry></collision></link><joint name="joint" type="continuous"><parent link="base"/><child link="cross"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    read, faults = with_mesh_points(read_robot(path), str(path))
    body = sum((solid_of(part).pseudo for part in parts), np.zeros((4, 4)))
    for robot, is_allowed in ((read, True), (replace(read, links=(replace(read.links[0], solids=()),)), False)):
        known = plausible_constraints(robot).links["cross"]
        assert known.body_ellipsoid is not None and known.thickness**2 <= spread_of(body)
        assert bool(np.all(np.sum(known.body_ellipsoid.slabs(known.reach) * body, axis=(1, 2)) >= 0.0)) is is_allowed
    assert faults == ()


@pytest.mark.parametrize("long", [2.0, 8.0, 12.0, 30.0])
def test_a_slender_link_is_as_thin_as_its_shape(long: float) -> None:
    """Uniform boxes and cylinders, closed forms: the covariance across is g^2 / 12 and r^2 / 4."""
    robot = read_robot("generic-6r")
    shapes = Box(np.array([0.05, 0.05, 0.05 * long])), Cylinder(0.025, 0.05 * long)
    for shape, square in zip(shapes, (0.05**2 / 12, 0.025**2 / 4), strict=True):
        first = replace(robot.links[0], shapes=(shape,), inertia=None)
        known = plausible_constraints(replace(robot, links=(first, *robot.links[1:]))).links[first.name]
        assert 0.0 < known.thickness**2 <= square


def test_a_fit_keeps_to_its_shapes_and_names_what_data_contradict(
    spatial_3r: Robot, exact_log: Callable[..., Log]
) -> None:
    """The truth is a ball in the notch of an L: with little noise, data contradict its shapes and its stated mass."""
    ball = Inertia.from_centre_of_mass(3.0, [0.22, 0.0, 0.18], 3.0 * 0.04**2 * np.eye(3))
    first = [replace(link, shapes=(Sphere(0.5, 0.2 * np.ones(3)),)) for link in spatial_3r.links[:2]]
    model = DynamicModel(replace(spatial_3r, links=(*first, Link("link3", ball))), (Viscous(),))
    assert model.robot.nominal is not None
    theta = np.append(model.robot.nominal, np.ones(3))
    told = with_quadrics(Link("link3", shapes=L_SHAPE))
    robot = replace(model.robot, links=(*model.robot.links[:2], told))
    deviations = np.std(np.asarray(exact_log(model, theta).torque), axis=0)
    for noise, contradicted in ((0.3, False), (0.001, True)):
        log = exact_log(model, theta, noise=noise * deviations)
        problem = build_problem(replace(model, robot=robot), [log], Preprocessing(AsGiven(), rest="keep"))
        problem = replace(problem, constraints=Constraints({"link3": BodyConstraints(mass=ValueRange(3.0, 3.0))}))
        found = plausible_fit(problem, np.asarray(WLS().solve(problem).weights), 0.01, 1e-8)
        body = Inertia.from_vector(found.fit.theta[20:30]).pseudo
        missed = min(np.sum(body * quadric) for quadric in told.quadrics) / body[3, 3]
        named = [(one.name, one.bound) for one in found.facts.contradicted]
        assert named == ([("link3", "mass")] if contradicted else []) and missed > -1e-6
        assert found.facts.uniform == ("link3",) and found.facts.fitted == ()
