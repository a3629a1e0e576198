"""Clearance against Coal and MuJoCo, finite differences, and laws of distances."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.errors import BadOption, UnknownChoice
from dynident.excitation.collision.clearance import Clearance, clearance_of
from dynident.excitation.collision.workspace import HalfSpace, Tool, Workspace
from dynident.model.joint import Joint, JointLimits, Mimic, rotation_about
from dynident.model.kernels.batched import link_poses
from dynident.model.robot import Frame, Link, Robot
from dynident.model.shapes import Box, Capsule, Shape

X, Y, Z = np.eye(3)


def turn(random: np.random.Generator) -> Array:
    axis = random.normal(size=3)
    return rotation_about(axis / np.linalg.norm(axis), float(random.uniform(-np.pi, np.pi)))


def random_robot(seed: int, count: int = 5) -> Robot:
    """Return a tree with revolute and prismatic joints and one that follows another; capsules on every link."""
    random = np.random.default_rng(seed)
    joints, links = [], []
    for i in range(count):
        parent = -1 if i == 0 else int(random.integers(-1 if i > 2 else 0, i))
        kind = "prismatic" if random.uniform() < 0.3 else "revolute"
        mimic = Mimic("joint0", float(random.uniform(-2, 2)), 0.3) if i == 3 else None
        axis = random.normal(size=3)
        joints.append(
            Joint(f"joint{i}", kind, parent, turn(random), random.uniform(-0.4, 0.4, 3), axis,
                  JointLimits(-0.9, 1.1), mimic=mimic)
        )  # fmt: skip
        own: tuple[Shape, ...] = tuple(random_capsule(random) for _ in range(int(random.integers(1, 3))))
        links.append(Link(f"link{i}", shapes=own))
    return Robot(f"tree{seed}", tuple(links), tuple(joints), base_shapes=(random_capsule(random),))


def random_capsule(random: np.random.Generator) -> Capsule:
    start = random.uniform(-0.2, 0.2, 3)
    end = start if random.uniform() < 0.2 else start + random.uniform(-0.3, 0.3, 3)
    return Capsule(start, end, float(random.uniform(0.01, 0.08)))


def random_workspace(seed: int) -> Workspace:
    random = np.random.default_rng(seed)
    return Workspace(
        {"floor": HalfSpace(Z, -1.0), "wall": HalfSpace(random.normal(size=3), -1.2)},
        {name: Box(random.uniform(0.1, 0.6, 3), turn(random), random.uniform(-0.6, 0.6, 3)) for name in ("a", "b")},
        region=Box(np.array([2.0, 2.0, 3.0]), turn(random)),
        tool=Tool("link4", np.array([0.1, 0.0, 0.2]), 0.03),
        self_clearance=0.0,
        clearance=0.0,
    )


def postures(robot: Robot, count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-0.9, 1.1, (count, robot.dof))


def posed(robot: Robot, capsule: Capsule, name: str, q: Array) -> Capsule:
    """Return a capsule of a link in the base frame."""
    if name == robot.base:
        return capsule
    rotations, translations = link_poses(robot.chain, q[None])
    at = [link.name for link in robot.links].index(name)
    return capsule.moved(rotations[0, at], translations[0, at])


def coal_distance(first: Capsule, second: Capsule | Box) -> float:
    coal = pytest.importorskip("coal")

    def placed(shape: Capsule | Box) -> tuple[object, object]:
        if isinstance(shape, Box):
            return coal.Box(*shape.size), coal.Transform3s(np.array(shape.rotation), np.array(shape.translation))
        along = shape.end - shape.start
        length = float(np.linalg.norm(along))
        z = along / length if length > 1e-12 else Z
        x = np.cross(z, X if abs(z[0]) < 0.9 else Y)
        x /= np.linalg.norm(x)
        frame = np.column_stack([x, np.cross(z, x), z])
        solid = coal.Capsule(shape.radius, length) if length > 1e-12 else coal.Sphere(shape.radius)
        return solid, coal.Transform3s(frame, 0.5 * (shape.start + shape.end))

    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_tolerance = request.epa_tolerance = 1e-12
    return float(coal.distance(*placed(first), *placed(second), request, coal.DistanceResult()))


@pytest.mark.parametrize("seed", range(4))
def test_distances_are_those_of_coal(seed: int) -> None:
    """Nearest of all shapes of a pair; self pairs to 1e-9, boxes to Coal's own tolerance."""
    robot, workspace = random_robot(seed), random_workspace(seed)
    clearance = clearance_of(robot, workspace)
    compared = {"links": 0, "boxes": 0}
    for q in postures(robot, 12):
        found = dict(zip(clearance.names, clearance.distances(q[None])[0], strict=True))
        for name, distance in found.items():
            first, second = name.split(" | ")
            own = [posed(robot, c, first, q) for c in clearance.capsules.get(first, ())]
            if second in clearance.capsules:
                others = [posed(robot, c, second, q) for c in clearance.capsules[second]]
                expected = min(coal_distance(a, b) for a in own for b in others)
                assert distance == pytest.approx(expected, abs=1e-9), name
                compared["links"] += 1
            elif second in workspace.boxes:
                expected = min(coal_distance(a, workspace.boxes[second]) for a in own)
                assert distance == pytest.approx(expected, abs=2e-6), name
                compared["boxes"] += 1
    assert min(compared.values()) >= 100


def test_half_spaces_and_the_region_are_closed_forms() -> None:
    robot, workspace = random_robot(1), random_workspace(1)
    clearance = clearance_of(robot, workspace)
    region = workspace.region
    assert region is not None
    for q in postures(robot, 20):
        found = dict(zip(clearance.names, clearance.distances(q[None])[0], strict=True))
        for name, plane in workspace.half_spaces.items():
            for link, capsules in clearance.capsules.items():
                ends = [(posed(robot, c, link, q), c.radius) for c in capsules]
                low = min(min(c.start @ plane.normal, c.end @ plane.normal) - r for c, r in ends) - plane.offset
                if f"{link} | {name}" in found:
                    assert found[f"{link} | {name}"] == pytest.approx(low, abs=1e-12)
        tip = posed(robot, Capsule(np.array([0.1, 0.0, 0.2]), np.array([0.1, 0.0, 0.2]), 0.03), "link4", q)
        inside = region.rotation.T @ (tip.start - region.translation)
        assert found["tool | region"] == pytest.approx(float((0.5 * region.size - np.abs(inside)).min()) - 0.03)


@pytest.mark.parametrize("seed", range(6))
def test_gradients_are_those_of_finite_differences(seed: int) -> None:
    """At every sample but the few where two shapes are equally near, inside and outside of bodies."""
    robot = random_robot(seed)
    clearance = clearance_of(robot, random_workspace(seed))
    pool = postures(robot, 1000, seed)
    distances = clearance.distances(pool)
    deep = np.argwhere(distances < 0)[:500]
    others = np.stack([np.arange(1000), np.arange(1000) % len(clearance.names)], axis=1)
    chosen, pair = np.concatenate([deep, others]).T
    q = pool[chosen]
    exact = clearance.gradient(q, pair)
    step, rows = 1e-6, np.arange(len(q))
    for joint in range(robot.dof):
        shift = step * np.eye(robot.dof)[joint]
        ahead, behind = clearance.distances(q + shift)[rows, pair], clearance.distances(q - shift)[rows, pair]
        wrong = np.abs((ahead - behind) / (2 * step) - exact[:, joint]) > 1e-5
        assert wrong.mean() < 0.003


@pytest.mark.parametrize("seed", range(6))
def test_no_distance_changes_faster_than_its_bound(seed: int) -> None:
    robot = random_robot(seed)
    clearance = clearance_of(robot, random_workspace(seed))
    q, other = postures(robot, 400, 1), postures(robot, 400, 2)
    bound = clearance.speed_bound()
    assert bound.shape == (len(clearance.names), robot.dof)
    change = np.abs(clearance.distances(other) - clearance.distances(q))
    assert np.all(change <= np.abs(other - q) @ bound.T + 1e-12)
    pair = np.arange(400) % len(clearance.names)
    assert np.all(np.abs(clearance.gradient(q, pair)) <= bound[pair] + 1e-9)


def test_the_bound_is_reached_by_an_arm_that_is_stretched_out(planar_2r: Robot) -> None:
    """The tip of two links of 0.5 m and 0.4 m moves with 0.9 m/rad and 0.4 m/rad."""
    workspace = Workspace({"wall": HalfSpace(-Y, -2.0)}, tool=Tool("link2", 0.4 * X), joint_radius=0.01)
    clearance = clearance_of(planar_2r, workspace)
    row = clearance.names.index("link2 | wall")
    assert clearance.speed_bound()[row] == pytest.approx([0.9, 0.4])
    assert clearance.gradient([[1e-3, 0.0]], [row])[0] == pytest.approx([-0.9, -0.4], abs=1e-5)


def test_a_turn_about_the_vertical_changes_no_height(spatial_3r: Robot) -> None:
    """So the first joint has no part in the bound of a floor, and the first link none of the floor to keep."""
    tilted = HalfSpace(np.array([0.6, 0.0, 0.8]), -0.5)
    workspace = Workspace({"floor": HalfSpace(Z, 0.0), "slope": tilted}, joint_radius=0.05)
    clearance = clearance_of(spatial_3r, workspace)
    bound = dict(zip(clearance.names, clearance.speed_bound(), strict=True))
    assert clearance.ignored["link1 | floor"] == "kept in every posture: no joint changes the distance"
    assert bound["link3 | floor"][0] == 0.0 < bound["link3 | floor"][1]
    assert bound["link1 | slope"] == pytest.approx([0.6 * 0.1, 0.0, 0.0])
    q, other = postures(spatial_3r, 300, 1), postures(spatial_3r, 300, 2)
    change = np.abs(clearance.distances(other) - clearance.distances(q))
    assert np.all(change <= np.abs(other - q) @ clearance.speed_bound().T + 1e-12)


def one_slide(capsule: Capsule, workspace: Workspace) -> tuple[Clearance, Array]:
    """Return a capsule that moves freely along three axes, and the postures of a walk through the origin."""
    joints = tuple(
        Joint(f"j{k}", "prismatic", k - 1, np.eye(3), np.zeros(3), np.eye(3)[k], JointLimits(-2, 2)) for k in range(3)
    )
    robot = Robot("gantry", (Link("a"), Link("b"), Link("c", shapes=(capsule,))), joints)
    direction = np.array([0.3, -0.8, 0.5])
    return clearance_of(robot, workspace), np.linspace(-1.2, 1.2, 4001)[:, None] * direction


@pytest.mark.parametrize("seed", range(8))
def test_a_way_through_a_box_is_continuous_and_its_depth_is_the_least_shift_out(seed: int) -> None:
    random = np.random.default_rng(seed)
    capsule = Capsule(random.uniform(-0.3, 0.3, 3), random.uniform(-0.3, 0.3, 3), 0.02)
    box = Box(random.uniform(0.2, 0.8, 3), turn(random))
    clearance, way = one_slide(capsule, Workspace(boxes={"box": box}, clearance=0.0))
    distances = clearance.distances(way)[:, 0]
    assert np.abs(np.diff(distances)).max() <= 1.0000001 * np.linalg.norm(way[1] - way[0])
    deepest = way[int(np.argmin(distances))]
    depth, normal = distances.min() + 0.02, clearance.gradient(deepest[None], [0])[0]
    assert depth < -0.02 and np.linalg.norm(normal) == pytest.approx(1.0)
    out = deepest - (depth - 1e-9) * normal
    assert clearance.distances(out[None])[0, 0] == pytest.approx(-0.02, abs=1e-8)
    for direction in random.normal(size=(200, 3)):
        shift = deepest + (0.98 * -depth) * direction / np.linalg.norm(direction)
        assert clearance.distances(shift[None])[0, 0] < -0.02  # no shorter shift takes it out


def test_parallel_and_crossing_segments() -> None:
    """Distances at the special places of two segments, each with a closed form."""
    capsule = Capsule(np.zeros(3), X, 0.1)

    def distance(other: Capsule) -> float:
        joint = Joint("j", "prismatic", -1, np.eye(3), np.zeros(3), Y, JointLimits(-3, 3))
        second = Joint("k", "prismatic", -1, np.eye(3), np.zeros(3), Z, JointLimits(-3, 3))
        robot = Robot("two", (Link("a", shapes=(capsule,)), Link("b", shapes=(other,))), (joint, second))
        return float(clearance_of(robot, Workspace(self_clearance=0.0)).distances(np.zeros((1, 2)))[0, 0])

    assert distance(Capsule(0.5 * X + Y, 3 * X + Y, 0.2)) == pytest.approx(0.7, abs=1e-12)  # parallel, side by side
    assert distance(Capsule(2 * X, 3 * X, 0.2)) == pytest.approx(0.7, abs=1e-12)  # in one line
    assert distance(Capsule(0.5 * X - Y, 0.5 * X + Y, 0.2)) == pytest.approx(-0.3, abs=1e-9)  # crossing
    assert distance(Capsule(0.5 * X - Y + Z, 0.5 * X + Y + Z, 0.2)) == pytest.approx(0.7, abs=1e-12)
    nearly = X + 1e-9 * Y
    assert distance(Capsule(0.2 * Y, 0.2 * Y + nearly, 0.0)) == pytest.approx(0.1, abs=1e-9)
    assert distance(Capsule(-X + Y, -X + Y, 0.0)) == pytest.approx(np.sqrt(2) - 0.1, abs=1e-12)  # a point


def test_what_is_checked_and_what_is_not(spatial_3r: Robot) -> None:
    workspace = Workspace({"floor": HalfSpace(Z, 0.2)}, joint_radius=0.05, ignore=(("link2", "floor"),))
    clearance = clearance_of(spatial_3r, workspace)
    assert clearance.names == ("base | link2", "base | link3", "link1 | link3", "link3 | floor")
    assert clearance.required == pytest.approx([0.02, 0.02, 0.02, 0.05])
    assert clearance.ignored == {
        "base | link1": "a joint connects them",
        "link1 | link2": "a joint connects them",
        "link2 | link3": "a joint connects them",
        "link2 | floor": "listed under ignore",
        "link1 | floor": "nearer than required in every posture, as mounted",
    }
    text = "\n".join(clearance.summary())
    assert "at least 0.05 m: link3 | floor" in text and "not checked, listed under ignore: link2 | floor" in text


def test_the_first_link_may_stand_on_the_floor(spatial_3r: Robot) -> None:
    clearance = clearance_of(spatial_3r, Workspace({"floor": HalfSpace(Z, 0.29)}, joint_radius=0.05))
    assert clearance.ignored["link1 | floor"] == "nearer than required in every posture, as mounted"
    assert {"link2 | floor", "link3 | floor"} <= set(clearance.names)


def test_a_link_that_can_never_be_clear_is_refused(spatial_3r: Robot) -> None:
    box = Box(np.full(3, 5.0))
    with pytest.raises(BadOption, match=r"link2 \| cell .*no posture keeps this far apart.*under ignore"):
        clearance_of(spatial_3r, Workspace(boxes={"cell": box}, joint_radius=0.05))


def test_a_robot_without_shapes_needs_a_radius(spatial_3r: Robot) -> None:
    with pytest.raises(BadOption, match="'spatial-3r' has no shapes: give the radius of its links"):
        clearance_of(spatial_3r, Workspace())


def test_unknown_names_are_refused(spatial_3r: Robot) -> None:
    for workspace in (
        Workspace(joint_radius=0.05, ignore=(("link1", "link9"),)),
        Workspace(joint_radius=0.05, shapes={"link9": ()}),
        Workspace(joint_radius=0.05, tool=Tool("link9")),
    ):
        with pytest.raises(UnknownChoice, match=r"'link9'.*did you mean 'link"):
            clearance_of(spatial_3r, workspace)


def test_links_without_shapes_are_named(spatial_3r: Robot) -> None:
    workspace = Workspace(shapes={"link3": (Capsule(np.zeros(3), 0.3 * X, 0.05),)}, boxes={"box": Box(np.ones(3))})
    clearance = clearance_of(spatial_3r, workspace)
    assert clearance.unchecked == ("base", "link1", "link2")
    assert clearance.names == ("link3 | box",)
    assert "not checked, they have no shape: base, link1, link2" in clearance.summary()


def test_a_link_that_is_stated_to_have_no_shape_has_none(spatial_3r: Robot) -> None:
    clearance = clearance_of(spatial_3r, Workspace(shapes={"link1": ()}, joint_radius=0.05))
    assert clearance.unchecked == ("link1",) and set(clearance.capsules) == {"base", "link2", "link3"}


def test_capsules_of_a_frame_come_in_addition(spatial_3r: Robot) -> None:
    frames = {"flange": Frame(2, rotation_about(Y, np.pi / 2), 0.4 * X)}
    own, more = Capsule(np.zeros(3), 0.3 * X, 0.05), Capsule(np.zeros(3), 0.1 * Z, 0.02)
    robot = replace(spatial_3r, frames=frames)
    workspace = Workspace(shapes={"flange": (more,), "link3": (own,)}, tool=Tool("flange", 0.2 * Z, 0.01))
    first, second, tool = clearance_of(robot, workspace).capsules["link3"]
    assert first is own
    assert second.end == pytest.approx(0.5 * X) and second.radius == 0.02
    assert tool.start == pytest.approx(0.4 * X) and tool.end == pytest.approx(0.6 * X)


def test_joint_to_joint_capsules(spatial_3r: Robot) -> None:
    """From each joint to the next one; the last link to its farthest frame; a slide has its travel as a rod."""
    robot = replace(spatial_3r, frames={"near": Frame(2, np.eye(3), 0.1 * X), "flange": Frame(2, np.eye(3), 0.4 * X)})
    capsules = clearance_of(robot, Workspace(joint_radius=0.05)).capsules
    assert [own[0].end.tolist() for own in capsules.values()] == [[0, 0, 0.3], [0.1, 0, 0.2], [0.5, 0, 0], [0.4, 0, 0]]
    slide = Joint("q", "prismatic", 2, np.eye(3), 0.4 * X, Z, JointLimits(0.0, 0.25))
    robot = replace(robot, links=(*robot.links, Link("rod")), joints=(*robot.joints, slide), frames={}, coupling=None)
    rod = clearance_of(robot, Workspace(joint_radius=0.05)).capsules["rod"]
    assert {tuple(np.round(c.end, 9) + 0.0) for c in rod} == {(0.0, 0.0, 0.0), (0.0, 0.0, -0.25)}


def test_a_sliding_joint_without_limits_has_no_bound_beyond_it() -> None:
    slide = Joint("x", "prismatic", -1, np.eye(3), np.zeros(3), X)
    hinge = Joint("turn", "revolute", -1, np.eye(3), np.zeros(3), Z)
    capsule = Capsule(np.zeros(3), 0.3 * X, 0.05)
    box = Workspace(boxes={"box": Box(np.full(3, 0.2), translation=3 * Y)})
    robot = Robot("cart", (Link("a"), Link("b", shapes=(capsule,))), (hinge, replace(slide, parent=0)))
    assert clearance_of(robot, box).speed_bound().tolist() == [[np.inf, 1.0]]
    robot = Robot("cart", (Link("a"), Link("b", shapes=(capsule,))), (slide, replace(hinge, parent=0)))
    assert clearance_of(robot, box).speed_bound()[0] == pytest.approx([1.0, 0.3])


def test_bad_arguments_and_numbers(spatial_3r: Robot) -> None:
    clearance = clearance_of(spatial_3r, Workspace({"floor": HalfSpace(Z, 0.0)}, joint_radius=0.05))
    assert clearance.distances(np.zeros((0, 3))).shape == (0, len(clearance.names))
    assert clearance.gradient(np.zeros((0, 3)), []).shape == (0, 3)
    for q, pair, match in (
        (np.zeros((2, 2)), [0, 0], "q has shape"),
        (np.zeros((2, 3)), [0], "pair has shape"),
        (np.zeros((1, 3)), [99], "pair reaches from 99"),
        (np.zeros((1, 3)), [-1], "pair reaches from -1"),
    ):
        with pytest.raises(ValueError, match=match):
            clearance.gradient(q, pair)
    q = np.zeros((3, 3))
    q[1, 1] = np.nan
    found = clearance.distances(q)
    assert np.isnan(found[1, clearance.names.index("link3 | floor")]) and not np.isnan(found[[0, 2]]).any()


def test_a_clearance_travels_to_other_processes(spatial_3r: Robot) -> None:
    clearance = clearance_of(spatial_3r, Workspace({"floor": HalfSpace(Z, 0.0)}, joint_radius=0.05))
    q = postures(spatial_3r, 10)
    again = pickle.loads(pickle.dumps(clearance))
    assert again.distances(q).tolist() == clearance.distances(q).tolist()
