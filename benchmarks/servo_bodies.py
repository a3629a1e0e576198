"""Robot models whose bodies are off, for benchmarks.servos --bodies, and what intervals of free bodies hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dynident.actuators.estimate import ActuatorEstimate
from dynident.actuators.free_bodies import NORMAL_95, with_bodies
from dynident.actuators.parameters import PLACE, SCALE_POWER
from dynident.arrays import Array
from dynident.identification.consistency.conditions import conditions_of
from dynident.identification.consistency.consistent_fit import MARGIN
from dynident.identification.problem.prior import natural_scale
from dynident.model.body_constraints import Constraints
from dynident.model.dynamic_model import DynamicModel
from dynident.model.inertia import Inertia
from dynident.model.plausible import plausible_constraints
from dynident.model.robot import Robot

#: Standard deviation of the logarithms of mass and second moments of each link, and of its centre of mass in radii of
#: gyration.
SHARE = 0.3


def disturbed(robot: Robot, random: np.random.Generator) -> Robot:
    """Return a robot model whose bodies are off, each by draws of its own: mass, centre of mass, inertia about it.

    Draws whose plausible bounds do not hold the true bodies are made again: nothing within these bounds is right there.
    """
    while True:
        found = with_bodies(robot, np.array([_off(link.inertia, random) for link in robot.links]))
        model, still = DynamicModel(found), np.zeros(found.dof)
        sizes = natural_scale(model, still, still)
        rules = conditions_of(model, sizes, MARGIN, plausible_constraints(found, Constraints()))
        if rules.shortfall(np.asarray(robot.nominal) / sizes.parameters) <= 0.0:
            return found


def _off(body: Inertia | None, random: np.random.Generator) -> Array:
    """Return a body that is off, (10,)."""
    assert body is not None
    mass = body.mass * np.exp(SHARE * random.standard_normal())
    radius = np.sqrt(0.5 * np.trace(body.about_centre) / body.mass)
    centre = body.centre_of_mass + SHARE * radius * random.standard_normal(3) / np.sqrt(3.0)
    about = body.about_centre * mass / body.mass * np.exp(SHARE * random.standard_normal())
    return Inertia.from_centre_of_mass(mass, centre, about).vector


def held(found: ActuatorEstimate, robot: Robot, true: Array) -> dict[str, object]:
    """Return what ratios and standard parameters say beside the truth, as plain data.

    Args:
        found: With free bodies.
        robot: With the true bodies.
        true: True parameters of the drives, shape (n, COUNT).
    """
    rows = [
        (one.name, one.value, float(own[PLACE[one.name]]) + _emf(joint.known, one.name, own), one.ratio)
        for joint, own in zip(found.joints, true, strict=True)
        for one in joint.known
        if one.ratio is not None and SCALE_POWER[PLACE[one.name]] > 0
    ]
    values, truths, halves = (np.array([row[k] for row in rows], dtype=float) for k in (1, 2, 3))
    weights = truths / halves**2
    scale = float(weights @ values / (weights @ truths))  # of all torques, over the true one
    assert found.bodies is not None
    body = found.bodies
    truth = np.asarray(robot.nominal).reshape(-1, 10)
    known = np.array(body.labels)
    errors = np.abs(body.theta - truth) <= NORMAL_95 * body.deviations
    shapes = {label: [int(errors[known == label].sum()), int((known == label).sum())] for label in np.unique(known)}
    return {
        "scale": scale,
        "scale_deviation": body.scale,
        "nominal": float(np.mean(np.asarray(body.nominal)[:, 9] / truth[:, 9])),
        "ratios": [
            [name, float(abs(value - scale * own) / half)]
            for (name, value, own, _), half in zip(rows, halves, strict=True)
        ],
        "parameters": shapes,
        "at_bounds": list(body.bounds),
    }


def _emf(known: Sequence, name: str, own: Array) -> float:
    """Return the back-EMF that viscous friction stands for too where the logs do not tell it."""
    alone = name == "viscous" and "back_emf" not in [one.name for one in known]
    return float(own[PLACE["back_emf"]]) if alone else 0.0


def lines_of(lines: Sequence[Mapping]) -> list[str]:
    """Return the figures over seeds as lines of text."""
    own = [line["bodies"] for line in lines if "bodies" in line]
    if not own:
        return []
    ratios = np.array([ratio for one in own for _, ratio in one["ratios"]])
    scale = np.array([np.log(one["scale"]) / one["scale_deviation"] for one in own])
    error = 100 * np.median([abs(one["scale"] - 1) for one in own])
    found = [
        f"ratios of drive parameters: {100 * np.mean(ratios <= 1):.1f} % of {len(ratios)} intervals hold the truth, "
        f"1.96 rms of error over half width {NORMAL_95 * np.sqrt(np.mean(ratios**2)):.2f}",
        f"scale of torques: within 1.96 standard deviations in {np.sum(np.abs(scale) <= NORMAL_95)} of {len(scale)} "
        f"seeds, rms {np.sqrt(np.mean(scale**2)):.2f} standard deviations; median error {error:.2g} %",
    ]
    for label in sorted({label for one in own for label in one["parameters"]}):
        holds, count = np.sum([one["parameters"].get(label, [0, 0]) for one in own], axis=0)
        found.append(
            f"standard parameters, {label}: {100 * holds / count:.1f} % of {count} within 1.96 standard deviations"
        )
    found.append(f"masses at a bound: {sum(bool(one.get('at_bounds')) for one in own)} of {len(own)} seeds")
    return found
