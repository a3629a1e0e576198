"""Plausible bodies: on real logs beside the robot model and the free fit, and on virtual arms beside the truth.

Real logs: the runs of benchmarks.real_data that have test data. Per moving link the mass over that of the robot model,
the smallest radius of gyration over the extent of the link's geometry, and by how much the ellipsoid of equal density
leaves the geometry; then the total, masses that the data contradict, and the test error over that of the free fit.
Extent and geometry are those of ``dynident.model.plausible``: shapes, or 0.15 of the length to the children, 40 mm at
least. Known truth: an arm whose robot model is the truth disturbed by 30 %, 20 draws; geodesic distance of the
pseudo-inertias to the truth over that of the robot model, of links with a mean data share of 1/2 or more.

Needs the logs under the folder that DYNIDENT_DATA names.
Weights: the same with multiples of the weight of the pull, and beside it what can be known at most: the fit that also
knows the law of the disturbance (maximum a posteriori over its 16 numbers a link, not convex).

Time: the fit within bounds, pulled and proved, over the row ``consistent_fit`` on the same QR factors, processor time.
Shapes: of random bodies that one ellipsoid, its slabs and the least thickness allow, the share that no body in the
ellipsoids about each shape can be (a conic program each), and the share that the quadrics of the link refuse.

Bare: as real, of robot models whose inertias and shapes are taken away.

Run: python -m benchmarks.bodies [real|bare|truth|weights|time|shapes]
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.optimize

from benchmarks.real_data import CASES, RUNS, data_of, how_of
from benchmarks.speed.rows import consistent_fit as row
from benchmarks.strangers.arms import gen3, iiwa, irb, scara, so100, tx2, ur5e, xarm
from benchmarks.strangers.plant import urdf
from dynident import DynamicModel, FourierSeries, Preprocessing, read_case, read_robot
from dynident.case.mesh_bounds import separating, with_quadrics
from dynident.data.log import Log
from dynident.data.preprocessing import preprocess
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.build_problem import build_problem
from dynident.identification.consistency.consistent_fit import MARGIN, consistent_fit, scale_of
from dynident.identification.consistency.plausible_fit import plausible_fit
from dynident.identification.consistency.program import whitened_rows
from dynident.identification.estimate.plausibility import Plausibility
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.estimators.wls import WLS
from dynident.identification.fit import fit
from dynident.identification.problem.prior import PULL
from dynident.identification.validate import validate_prepared
from dynident.model.body_constraints import BodyConstraints
from dynident.model.friction import FRICTION, Motion
from dynident.model.friction.viscous import Viscous
from dynident.model.inertia import Inertia
from dynident.model.plausible import (
    GYRATION_SHARE,
    REACH,
    bounding_ellipsoids,
    extent_of,
    link_points,
    shape_clouds,
    shape_points,
    uniform_body,
)
from dynident.model.robot import Link
from dynident.model.shapes import Box, Capsule
from dynident.studies.benchmark.possible_robots import described_truth, told

PLAUSIBLE = Consistent(bodies="plausible")

STRANGERS = (iiwa, ur5e, irb, tx2, gen3, scara, so100, xarm)

DRAWS, SHARE, NOISE, RATE, DURATION = 20, 0.3, 0.05, 100.0, 20.0

#: Directions in which the extent of an ellipsoid of equal density is compared with the geometry.
_DIRECTIONS = np.random.default_rng(0).normal(size=(400, 3))


def figures_of(robot, theta):
    """Return mass ratios (NaN without a nominal mass), gyration over extent, ellipsoid over geometry, total ratio."""
    rows, masses = [], []
    for i, link in enumerate(robot.links):
        body = Inertia.from_vector(theta[10 * i : 10 * i + 10])
        nominal = np.nan if link.inertia is None or link.inertia.mass <= 0 else link.inertia.mass
        centre = body.centre_of_mass
        covariance = body.pseudo[:3, :3] / body.mass - np.outer(centre, centre)
        space = bounding_ellipsoids([link_points(robot, i)])[0]
        half = np.linalg.norm(_DIRECTIONS @ (space.rotation * space.semi_axes), axis=1)
        reach = np.sqrt(5.0 * np.maximum(np.einsum("ki,ij,kj->k", _DIRECTIONS, covariance, _DIRECTIONS), 0.0))
        ratio = np.max((np.abs(_DIRECTIONS @ (centre - space.centre)) + reach) / half)
        least = np.sqrt(max(np.sum(np.linalg.eigvalsh(covariance)[:2]), 0.0))  # about the axis of the largest spread
        rows.append((body.mass / nominal, least / extent_of(link_points(robot, i)), ratio))
        masses.append((body.mass, nominal))
    known = np.array([pair for pair in masses if pair[1] == pair[1]]).reshape(-1, 2)
    return np.array(rows), known[:, 0].sum() / max(known[:, 1].sum(), 1e-300)


def without_bodies(robot):
    """Return the robot without inertias and shapes, as a DH table states it."""
    links = [replace(link, inertia=None, shapes=(), visuals=(), quadrics=()) for link in robot.links]
    return replace(robot, links=tuple(links))


def real(bare=False):
    """Print the links of each run in the robot model, free and plausible, and the test errors.

    ``bare``: the fits know of the robot model its kinematics alone.
    """
    heads = (
        "case",
        "data",
        "links",
        "mass / model",
        "total",
        "gyration / extent",
        "ellipsoid / geometry",
        "contradicted",
    )
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    ratios = []
    for name, data, change in RUNS:
        case = read_case(CASES / f"{name}.yaml")
        train, test = data_of(case, change)
        if not test:
            continue
        more = tuple(FRICTION.make(part) for part in change.get("friction") or ())
        given = case.model.robot
        known = without_bodies(given) if bare else given
        model = replace(case.model, robot=known, friction=(*case.friction, *more))
        problem = build_problem(model, train, how_of(case, change))
        prepared = [preprocess(log.ordered(model.robot.joint_names), problem.preprocessing) for log in test]
        bodies = {"robot model": given.nominal}
        errors = []
        for kind, estimator in (("free", Consistent(bodies="free")), ("plausible", PLAUSIBLE)):
            estimate = fit(problem, estimator)
            errors.append(validate_prepared(model, problem.base, prepared, estimate.beta).total_relative_error)
            bodies[kind] = estimate.theta
        facts = Plausibility.of(estimate.run)
        contradicted = () if facts is None else facts.contradicted
        named = ", ".join(f"{one.bound} of {one.name} ({100 * one.gain:.2g} %)" for one in contradicted) or "none"
        for kind, theta in bodies.items():
            rows, total = figures_of(given, theta)
            masses = f"{np.nanmin(rows[:, 0]):.2f} to {np.nanmax(rows[:, 0]):.2f}"
            figures = f"{masses} | {total:.2f} | {np.min(rows[:, 1]):.3f} | {np.max(rows[:, 2]):.2f}"
            print(f"| {name} | {data} | {kind} | {figures} | {named if kind == 'plausible' else ''} |", flush=True)
        ratios.append((name, data, errors[0], errors[1]))
    print("\n| case | data | test error, free | plausible | ratio |\n|---|---|---|---|---|")
    for name, data, free, plausible in ratios:
        print(f"| {name} | {data} | {100 * free:.3g} % | {100 * plausible:.3g} % | {plausible / free:.4f} |")
    sets = {name: [b / a for other, _, a, b in ratios if other == name] for name, *_ in ratios}
    means = {name: np.exp(np.mean(np.log(values))) for name, values in sets.items()}
    print(f"\ngeometric mean of the sets: {np.exp(np.mean(np.log(list(means.values())))):.4f}")


def truth():
    """Print the geodesic distance to the truth over that of the robot model."""
    heads = ("arm", "links", "number", "nearer than the model", "median ratio", "90 %", "largest")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    every = {"free": [], "plausible": [], "limit": []}
    for name, robot in robots():
        model = DynamicModel(robot, (Viscous(),))
        theta = described_truth(model)
        found = {"free": [], "plausible": [], "limit": []}
        for seed in range(DRAWS):
            nominal = disturbed(model, theta, seed)
            problem = build_problem(
                told(model, nominal), [log_of(model, theta, seed)], Preprocessing(AsGiven(), rest="keep")
            )
            solutions = {"free": Consistent(bodies="free").solve(problem), "plausible": PLAUSIBLE.solve(problem)}
            informed = Consistent(bodies="free", pull=1.0 / SHARE**2).solve(problem)
            shares = np.array(informed.run.data_share)[: model.inertial_count].reshape(-1, 10)
            limits = limit_ratios(problem, theta, nominal)
            for i in np.flatnonzero(shares.mean(axis=1) >= 0.5):
                found["limit"].append(limits[i])
                for kind, solution in solutions.items():
                    own = [np.asarray(values)[10 * i : 10 * i + 10] for values in (solution.theta, nominal, theta)]
                    found[kind].append(distance(own[0], own[2]) / distance(own[1], own[2]))
        for kind, values in found.items():
            show_ratios(name, kind, values)
            every[kind] += values if name != "er16" else []
    for kind, values in every.items():
        show_ratios("all but er16", kind, values)


def weights(draws=5, factors=(0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)):
    """Print the ratios of :func:`truth` for multiples of the weight, and for a fit that knows the disturbance's law."""
    found = {f"weight x {factor:g}": [] for factor in factors} | {"law of the disturbance known": []}
    heads = ("arms", "fit", "number", "nearer than the model", "median ratio", "90 %", "largest")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for name, robot in robots():
        model = DynamicModel(robot, (Viscous(),))
        theta = described_truth(model)
        for seed in range(draws) if name != "er16" else ():
            nominal = disturbed(model, theta, seed)
            problem = build_problem(
                told(model, nominal), [log_of(model, theta, seed)], Preprocessing(AsGiven(), rest="keep")
            )
            own = WLS().solve(problem).weights
            facts = plausible_fit(problem, own, PULL, MARGIN).facts
            bodies = [
                plausible_fit(problem, own, PULL, MARGIN, replace(facts, weight=factor * facts.weight)).fit.theta
                for factor in factors
            ]
            bodies.append(most_likely(problem, problem.reduced(own), nominal))
            informed = Consistent(bodies="free", pull=1.0 / SHARE**2).solve(problem)
            shares = np.array(informed.run.data_share)[: model.inertial_count].reshape(-1, 10)
            for i in np.flatnonzero(shares.mean(axis=1) >= 0.5):
                for values, kind in zip(bodies, found, strict=True):
                    ten, was, true = (part[10 * i : 10 * i + 10] for part in (values, nominal, theta))
                    found[kind].append(distance(ten, true) / distance(was, true))
    for kind, values in found.items():
        show_ratios("all but er16", kind, values)


def most_likely(problem, reduced, nominal):
    """Return the inertial parameters of least squares in data and in the numbers that :func:`disturbed` draws."""
    model, count = problem.model, problem.model.inertial_count
    seen = reduced.r @ problem.base.matrix / np.sqrt(reduced.rest / reduced.rows)
    aim = reduced.z / np.sqrt(reduced.rest / reduced.rows)
    others = np.linalg.qr(seen[:, count:])[0]
    left = np.eye(len(aim)) - others @ others.T  # friction is free
    seen, aim = left @ seen[:, :count], left @ aim
    frames = [frame_of(model, i) for i in range(len(model.robot.links))]
    pseudo = [Inertia.from_vector(ten).pseudo for ten in nominal[:count].reshape(-1, 10)]

    def bodies(x):
        changes = [
            frame @ np.linalg.inv(np.eye(4) + 0.5 * SHARE * each) @ np.linalg.inv(frame)
            for frame, each in zip(frames, x.reshape(-1, 4, 4), strict=True)
        ]
        pairs = zip(changes, pseudo, strict=True)
        return np.concatenate([Inertia.from_pseudo(change @ body @ change.T).vector for change, body in pairs])

    start = np.zeros(16 * len(frames))
    return bodies(scipy.optimize.least_squares(lambda x: np.append(seen @ bodies(x) - aim, x), start, max_nfev=60).x)


def show_ratios(name, kind, values):
    """Print a row of :func:`truth`."""
    if not values:
        return
    print(
        f"| {name} | {kind} | {len(values)} | {100 * np.mean(np.array(values) < 1):.0f} % | "
        f"{np.median(values):.2f} | {np.quantile(values, 0.9):.2f} | {np.max(values):.2f} |",
        flush=True,
    )


def limit_ratios(problem, theta, nominal):
    """Return the ratio of each link where all base parameters are known exactly, to first order, shape (l,).

    Data leave what K does not see: the projection of the model's error on the null space of K, in the metric of the
    distance at the truth. Nothing nearer follows from any data without knowing more than the model.
    """
    count = problem.model.inertial_count
    roots = np.linalg.cholesky(np.array([Inertia.from_vector(ten).pseudo for ten in theta[:count].reshape(-1, 10)]))
    rows = whitened_rows(roots, count)
    error = rows @ (nominal - theta)[:count]
    seen = np.linalg.qr(np.linalg.solve(rows.T, problem.base.matrix[:, :count].T))[0]
    left = error - seen @ (seen.T @ error)
    return np.linalg.norm(left.reshape(-1, 10), axis=1) / np.linalg.norm(error.reshape(-1, 10), axis=1)


def robots():
    """Yield names and robots: the strangers as they are described, and the virtual ER-16."""
    for make in STRANGERS:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{make.__name__}.urdf"
            path.write_text(urdf(make.__name__, make()), encoding="utf-8")
            yield make.__name__, read_robot(path)
    yield "er16", read_robot("er16")


def disturbed(model, theta, seed):
    """Return theta with bodies changed by 30 %: masses, and lengths by 30 % of half the extent of the link."""
    generator = np.random.default_rng([seed, len(theta)])
    found = theta.copy()
    for i in range(len(model.robot.links)):
        frame = frame_of(model, i)
        change = frame @ (np.eye(4) + 0.5 * SHARE * generator.normal(size=(4, 4))) @ np.linalg.inv(frame)
        body = Inertia.from_vector(theta[10 * i : 10 * i + 10])
        found[10 * i : 10 * i + 10] = Inertia.from_pseudo(change @ body.pseudo @ change.T).vector
    return found


def frame_of(model, i):
    """Return the frame in the middle of a link, half its extent the unit."""
    points = link_points(model.robot, i)
    frame = np.eye(4)
    frame[:3, :3] *= extent_of(points) / 2
    frame[:3, 3] = bounding_ellipsoids([points])[0].centre
    return frame


def distance(a, b):
    """Return the affine-invariant distance of two bodies (Lee and Park 2018, (9)), up to a factor."""
    values = scipy.linalg.eigh(Inertia.from_vector(a).pseudo, Inertia.from_vector(b).pseudo, eigvals_only=True)
    return np.sqrt(np.sum(np.log(np.maximum(values, 1e-300)) ** 2))


def log_of(model, theta, seed):
    """Return a log of a fifth-order Fourier motion with exact derivatives and white noise in the torques."""
    generator = np.random.default_rng(seed)
    sine, cosine = 0.4 * generator.normal(size=(2, model.robot.dof, 5)) / np.arange(1, 6)
    time = np.arange(int(RATE * DURATION)) / RATE
    q, dq, ddq = FourierSeries(np.zeros(model.robot.dof), sine, cosine, DURATION / 4).evaluate(time)
    torque = model.torque(Motion(q, dq, ddq), theta)
    torque = torque + NOISE * np.std(torque, axis=0) * generator.normal(size=torque.shape)
    return Log(model.robot.joint_names, time, q, dq, ddq, torque)


def ratios_of_time(repeats=5):
    """Print the least processor time of each fit of an arm, in turns, and the ratio."""
    print("| arm | consistent_fit | plausible, ms | ratio |\n|---|---|---|---|")
    for name, problem in timed_problems():
        weights = WLS().solve(problem).weights
        reduced, scale = problem.reduced(weights), scale_of(problem)
        fits = (
            lambda problem=problem, reduced=reduced, scale=scale: consistent_fit(
                problem.model, problem.base, reduced, scale
            ),
            lambda problem=problem, weights=weights: plausible_fit(problem, weights, PULL, MARGIN),
        )
        spent = np.full((repeats, 2), np.inf)
        for turn in range(repeats):
            for k, run in enumerate(fits):
                start = time.process_time()
                run()
                spent[turn, k] = 1000 * (time.process_time() - start)
        free, plausible = spent.min(axis=0)
        print(f"| {name} | {free:.1f} | {plausible:.1f} | {plausible / free:.1f} |", flush=True)


def timed_problems():
    """Yield the problems of :func:`truth` in their first draw, and that of the row ``consistent_fit``."""
    how = Preprocessing(AsGiven(), rest="keep")
    for name, robot in robots():
        model = DynamicModel(robot, (Viscous(),))
        theta = described_truth(model)
        yield name, build_problem(told(model, disturbed(model, theta, 0)), [log_of(model, theta, 0)], how)
    model = DynamicModel(read_robot("generic-6r"), ("coulomb", "viscous", "rotor_inertia"))
    motion = model.random_motion(row.ROWS // model.robot.dof, 0)
    theta = model.nominal()
    assert theta is not None
    torque = model.torque(motion, theta) + row.NOISE * np.random.default_rng(0).normal(size=motion.q.shape)
    log = Log(model.robot.joint_names, np.arange(len(torque)) / RATE, motion.q, motion.dq, motion.ddq, torque)
    yield "generic-6r", build_problem(model, [log], how)


def shapes(count=400):
    """Print what quadrics about shapes refuse, and how long they take."""
    beam, ends = (
        Box(np.array([0.4, 0.08, 0.08]), translation=np.array([0.2, 0, 0])),
        [Box(np.array([0.08, 0.08, 0.4]), translation=np.array([x, 0, 0.2])) for x in (0.4, 0)],
    )
    corners = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.0, 0.3], [0.3, 0.2, 0.3]])
    bent = tuple(Capsule(*pair, 0.05) for pair in pairwise(corners))
    links = {"L of two boxes": (beam, ends[0]), "U of three boxes": (beam, *ends), "three capsules": bent}
    heads = ("link", "ellipsoids / one", "outside", "refused", "refused / outside", "quadrics", "ms")
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    for name, parts in links.items():
        link = Link(name, shapes=parts)
        whole, *each = bounding_ellipsoids([shape_points(link), *shape_clouds(link)])
        start = time.process_time()
        found = with_quadrics(link).quadrics
        spent = 1000 * (time.process_time() - start)
        inside = np.sum([uniform_body(BodyConstraints(body_ellipsoid=part)).pseudo for part in each], axis=0)
        forms = np.array([part.quadric for part in each])
        bodies = allowed_bodies(whole, extent_of(shape_points(link)), count)
        outside = np.array([np.sum(separating(forms, body, inside) * body) < 0.0 for body in bodies])
        refused = np.array([min(np.sum(form * body) for form in found) < 0.0 for body in bodies])
        size = sum(np.prod(part.semi_axes) for part in each) / np.prod(whole.semi_axes)
        shares = f"{outside.mean():.2f} | {refused.mean():.2f} | {refused[outside].mean():.2f}"
        print(f"| {name} | {size:.2f} | {shares} | {len(found)} | {spent:.0f} |", flush=True)


def allowed_bodies(space, extent, count):
    """Yield pseudo-inertias of 1 kg that an ellipsoid, its slabs and the least thickness of an extent allow."""
    generator, rows = np.random.default_rng(0), np.array([space.quadric, *space.slabs(REACH)])
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = np.asarray(space.rotation) * space.semi_axes, space.centre
    found = []
    while len(found) < count:
        points = generator.normal(size=(generator.integers(1, 4), 3))
        points *= generator.uniform(size=(len(points), 1)) ** (1 / 3) / np.linalg.norm(points, axis=1)[:, None]
        lifted = np.column_stack([points, np.ones(len(points))])
        body = (lifted.T * generator.dirichlet(np.ones(len(points)))) @ lifted
        body[:3, :3] += generator.uniform(0.0, 0.1) * np.eye(3)
        body = place @ body @ place.T
        spread = np.linalg.eigvalsh(body[:3, :3] - np.outer(body[:3, 3], body[:3, 3]))[0]
        if np.min(np.sum(rows * body, axis=(1, 2))) >= 0.0 and spread >= (GYRATION_SHARE * extent) ** 2 / 2.0:
            found.append(body)
    return found


def main() -> None:
    wanted = sys.argv[1:] or ["real", "truth"]
    if "real" in wanted:
        real()
    if "bare" in wanted:
        real(bare=True)
    if "truth" in wanted:
        print()
        truth()
    if "weights" in wanted:
        weights()
    if "time" in wanted:
        ratios_of_time()
    if "shapes" in wanted:
        shapes()


if __name__ == "__main__":
    main()
