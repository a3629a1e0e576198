"""Distances of a seven-joint arm from itself, a table, a cell and a floor: the compiled kernel beside Coal, same pairs.

The arm has the Denavit-Hartenberg parameters that the maker of the Panda publishes, with capsules of our own. Coal is
called as Pinocchio does it, one posture at a time (``computeDistances``), with the same capsules and boxes; half-spaces
are compared as boxes of 4 m. Without Coal only the kernel is timed. Run: python -m benchmarks.clearance
"""

from __future__ import annotations

import time

import numpy as np

from dynident.excitation.collision.clearance import clearance_of
from dynident.excitation.collision.workspace import Workspace
from dynident.model.inertia import Inertia
from dynident.model.joint import Joint, JointLimits, rotation_about
from dynident.model.robot import Link, Robot
from dynident.model.shapes import Box, Capsule

SAMPLES, REPEATS, SLOW = 20_000, 9, 1000
#: a (m), alpha (rad), d (m) of the modified convention, then the positions that each joint may take.
TABLE = (
    (0.0, 0.0, 0.333, -2.9, 2.9),
    (0.0, -np.pi / 2, 0.0, -1.76, 1.76),
    (0.0, np.pi / 2, 0.316, -2.9, 2.9),
    (0.0825, np.pi / 2, 0.0, -3.07, -0.07),
    (-0.0825, -np.pi / 2, 0.384, -2.9, 2.9),
    (0.0, np.pi / 2, 0.0, -0.02, 3.75),
    (0.088, np.pi / 2, 0.0, -2.9, 2.9),
)
#: Start, end and radius of the capsules of the base and of each link.
CAPSULES = (
    [((-0.1, 0, 0.05), (0.02, 0, 0.1), 0.09)],
    [((0, 0, -0.2), (0, 0, -0.05), 0.07)],
    [((0, 0, -0.06), (0, 0, 0.06), 0.07)],
    [((0, 0, -0.15), (0, 0, -0.1), 0.06), ((0.0825, 0, 0), (0.0825, 0.02, 0), 0.06)],
    [((0, 0, -0.05), (0, 0, 0.05), 0.06), ((-0.08, 0.05, 0), (-0.08, 0.1, 0), 0.06)],
    [((0, 0, -0.26), (0, 0.04, -0.2), 0.06), ((0, 0.08, -0.06), (0, 0.08, 0), 0.045)],
    [((0, 0, -0.03), (0.088, 0.01, 0), 0.06)],
    [((0, 0, 0.05), (0, 0, 0.16), 0.07)],
)
BOXES = {
    "floor": Box([4.0, 4.0, 4.0], translation=[0.0, 0.0, -2.05]),
    "wall": Box([4.0, 4.0, 4.0], translation=[-2.7, 0.0, 0.0]),
    "table": Box([0.5, 1.0, 0.2], translation=[0.7, 0.0, 0.1]),
}


def arm() -> Robot:
    joints, links = [], []
    body = Inertia.from_centre_of_mass(3.0, [0, 0, 0], 0.02 * np.eye(3))
    for i, (a, alpha, d, lower, upper) in enumerate(TABLE):
        turn = rotation_about([1.0, 0.0, 0.0], alpha)
        place = np.array([a, 0.0, 0.0]) + turn @ [0.0, 0.0, d]
        joints.append(Joint(f"joint{i + 1}", "revolute", i - 1, turn, place, [0, 0, 1], JointLimits(lower, upper)))
        links.append(
            Link(f"link{i + 1}", body, shapes=tuple(Capsule(*map(np.array, c[:2]), c[2]) for c in CAPSULES[i + 1]))
        )
    base = tuple(Capsule(*map(np.array, c[:2]), c[2]) for c in CAPSULES[0])
    return Robot("seven", tuple(links), tuple(joints), base_shapes=base)


def coal_model(robot, clearance):
    """Return model and geometry of Pinocchio with the same pairs, and for each of its pairs ours."""
    import coal
    import pinocchio

    from benchmarks.speed.arms import as_pinocchio

    model, geometry = as_pinocchio(robot, np.zeros((robot.dof, robot.dof))), pinocchio.GeometryModel()
    names = ["base", *(link.name for link in robot.links)]
    indices: dict[str, list[int]] = {}
    for name, capsules in clearance.capsules.items():
        for k, capsule in enumerate(capsules):
            z = capsule.end - capsule.start
            length = float(np.linalg.norm(z))
            turn = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), z / length).toRotationMatrix()
            pose = pinocchio.SE3(turn, 0.5 * (capsule.start + capsule.end))
            shape = coal.Capsule(capsule.radius, length)
            item = pinocchio.GeometryObject(f"{name} {k}", names.index(name), pose, shape)
            indices.setdefault(name, []).append(geometry.addGeometryObject(item))
    for name, box in BOXES.items():
        pose = pinocchio.SE3(np.array(box.rotation), np.array(box.translation))
        item = pinocchio.GeometryObject(name, 0, pose, coal.Box(*box.size))
        indices[name] = [geometry.addGeometryObject(item)]
    owners = []
    for row, name in enumerate(clearance.names):
        first, second = name.split(" | ")
        for a in indices[first]:
            for b in indices[second]:
                geometry.addCollisionPair(pinocchio.CollisionPair(a, b))
                owners.append(row)
    return pinocchio, model, geometry, np.array(owners)


def best(call, repeats: int = REPEATS) -> float:
    """Return the shortest processor time of a call, in s."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    robot = arm()
    clearance = clearance_of(robot, Workspace(boxes=BOXES, self_clearance=0.0, clearance=0.0))
    limits = [joint.limits for joint in robot.active]
    lower, upper = ([getattr(limit, end) for limit in limits] for end in ("lower", "upper"))
    q = np.random.default_rng(0).uniform(lower, upper, (SAMPLES, robot.dof))
    pair = np.arange(SAMPLES) % len(clearance.names)
    clearance.distances(q[:2]), clearance.gradient(q[:2], pair[:2])
    print(f"{len(clearance.names)} pairs, {len(clearance.tests)} tests of shapes; processor time, one thread")
    ours = best(lambda: clearance.distances(q)) / SAMPLES
    print(f"distances of all pairs: {1e6 * ours:.2f} us a posture")
    print(f"gradient of one pair:   {1e6 * best(lambda: clearance.gradient(q, pair)) / SAMPLES:.2f} us a posture")
    try:
        pinocchio, model, geometry, owners = coal_model(robot, clearance)
    except ImportError:
        print("coal: not installed, left out")
        return
    data, places = model.createData(), geometry.createData()
    for request in places.distanceRequests:
        request.enable_signed_distance = True

    def run() -> None:
        for state in q[:SLOW]:
            pinocchio.computeDistances(model, data, geometry, places, state)

    print(f"coal, same tests:       {1e6 * best(run, 3) / SLOW:.2f} us a posture")
    worst, found = 0.0, clearance.distances(q[:200])
    for state, row in zip(q, found, strict=False):
        pinocchio.computeDistances(model, data, geometry, places, state)
        least = np.full(len(row), np.inf)
        np.minimum.at(least, owners, [result.min_distance for result in places.distanceResults])
        worst = max(worst, float(np.abs(least - row)[row > 0].max()))
    print(f"largest difference where nothing touches: {worst:.1e} m")


if __name__ == "__main__":
    main()
