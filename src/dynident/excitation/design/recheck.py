"""A plan looked at again: its motion is sampled anew, and what its file says is compared with that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.errors import BadOption
from dynident.excitation.collision.clearance import Clearance
from dynident.excitation.criteria import CRITERIA
from dynident.excitation.design.bounds import BoundLabel, smooth_parameters
from dynident.excitation.design.finishing import FINER
from dynident.excitation.design.limits import (
    TOLERANCE,
    LimitRow,
    MotionLimits,
    ToolLimit,
    check_limits,
    limits_of,
    worst_row,
)
from dynident.excitation.design.observation import Observation, TorqueUncertainty
from dynident.excitation.design.plan import Plan
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Motion

#: Difference of a figure from that of the file that is worth a word, as a share of the larger one.
DIFFERENCE = 1e-3

_NAMED = 3  # pairs that are named before they are only counted


@dataclass(frozen=True)
class Recheck:
    """What the motion of a plan does, computed again as far as was possible.

    Attributes:
        rows: The worst of every quantity of every joint, pair and tool; those of the file where ``again`` says no.
        again: Which rows were computed again, one for each row.
        values: Figures of criteria that were computed again; empty without a model.
        findings: Where the file says otherwise than its motion or the robot, in words; empty where it does not.
        remarks: How it was checked and what was not, in words.
    """

    rows: tuple[LimitRow, ...]
    again: tuple[bool, ...]
    values: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def kept(self) -> bool:
        """Whether every bound is kept."""
        return all(row.kept for row in self.rows)

    @property
    def worst(self) -> LimitRow:
        """The row that uses its bound most."""
        return worst_row(self.rows)

    @property
    def clearances(self) -> tuple[LimitRow, ...]:
        """The rows of pairs of shapes, the nearest to its required distance first."""
        pairs = [row for row in self.rows if row.quantity == "clearance"]
        return tuple(sorted(pairs, key=lambda row: row.value - row.limit))


def recheck(
    plan: Plan,
    model: DynamicModel | None = None,
    *,
    theta: Array | None = None,
    uncertainty: TorqueUncertainty | None = None,
    clearance: Clearance | None = None,
    tool: ToolLimit | None = None,
) -> Recheck:
    """Check a plan again, on as many samples as when it was made.

    Position to jerk need the plan alone. With a model the torques, their rates, the figures of the criteria and the
    limits of the robot model are looked at as well; with a clearance the distances.

    Args:
        plan: The plan.
        model: Robot, drives and friction; None for what needs no model.
        theta: Parameters of the torque, shape (p,); None for those of the robot model.
        uncertainty: Chance margin of the torque; None for none.
        clearance: Pairs of shapes to be kept apart; None leaves them as the file has them.
        tool: Largest speed of the tool point; None leaves it as the file has it.

    Raises:
        BadOption: A robot with other joints than the plan.
    """
    remarks = [f"position to jerk: sampled again at {plan.samples} times"]
    findings: list[str] = []
    asked: dict[str, Any] = {"distances": clearance, "tool": tool}
    values: dict[str, float] = {}
    if model is not None:
        _check_robot(plan, model)
        theta = model.nominal() if theta is None else theta
        base = base_parameters(model)
        asked |= _torques(plan.limits, model, base, theta, uncertainty)
        values = _values(plan, model, base)
        findings += _against_robot(plan, model)
    computed = check_limits(plan.motion(), plan.limits, plan.samples, **asked)
    rows, again = _merged(plan.rows, computed)
    findings += _differences(plan, computed, values)
    if clearance is not None:
        findings += _pairs(plan, clearance)
        remarks.append(f"clearances: {len(clearance.names)} pairs, what is certain between the samples too")
    left = dict.fromkeys(row.quantity for row, fresh in zip(rows, again, strict=True) if not fresh)
    if left:
        remarks.append(f"as the file states, not computed again: {', '.join(left)}")
    untold = [name for name in plan.values if model is not None and name not in values]
    if untold:
        remarks.append(f"as the file states, because earlier runs or unknown noise count in them: {', '.join(untold)}")
    return Recheck(rows, again, values, tuple(findings), tuple(remarks))


def with_friction_of(plan: Plan, model: DynamicModel) -> DynamicModel:
    """Return the model with the friction parts that the plan was designed with, where its own are others.

    Options of parts are not in a plan; those of the model stay where the names agree.

    Raises:
        UnknownChoice: The plan names a part that is not there.
    """
    names = plan.settings.get("friction")
    if names is None or list(names) == [FRICTION.name_of(part) for part in model.friction]:
        return model
    return replace(model, friction=tuple(FRICTION.make(str(name)) for name in names))


def _check_robot(plan: Plan, model: DynamicModel) -> None:
    robot = model.robot
    kinds = tuple(joint.kind == "revolute" for joint in robot.active)
    if robot.joint_names != plan.joints or kinds != plan.limits.revolute:
        evidence = f"its joints are {', '.join(robot.joint_names)}"
        step = f"those of the plan are {', '.join(plan.joints)}; give the case or robot that it was designed for"
        raise BadOption("robot", robot.name, f"{evidence}, {step}")


def _torques(
    limits: MotionLimits,
    model: DynamicModel,
    base: BaseParameters,
    theta: Array | None,
    uncertainty: TorqueUncertainty | None,
) -> dict[str, Any]:
    """Return the arguments of the check that come from a model."""
    if theta is None:
        return {}
    smooth = theta * smooth_parameters(model)
    asked: dict[str, Any] = {"torque": lambda motion: model.torque(motion, theta)}
    if np.any(np.isfinite(limits.torque_rate)):
        asked["smooth_torque"] = lambda motion: model.torque(motion, smooth)
    if uncertainty is not None:
        observation = Observation(model, base)
        factors = uncertainty.factors(observation.columns)
        asked["spread"] = lambda motion: observation.spread(motion, factors)
    return asked


def _values(plan: Plan, model: DynamicModel, base: BaseParameters) -> dict[str, float]:
    """Return the figures of the criteria on the grid of the check, those that no earlier run counts in."""
    facts, motion = plan.settings, plan.trajectory
    noise, outlook, options = facts.get("noise"), facts.get("outlook"), facts.get("criterion_options")
    known = isinstance(outlook, Mapping) and outlook.get("before", "nothing") != "nothing"
    samples = facts.get("samples")
    count = FINER * (samples if isinstance(samples, int) and samples > 0 else 200)
    grid = Motion(*motion.evaluate(np.arange(count) * motion.period / count))
    observation = Observation(model, base)
    triangles = {False: observation.triangle(grid, np.ones(len(plan.joints)))}
    if isinstance(noise, list) and len(noise) == len(plan.joints) and all(isinstance(v, float | int) for v in noise):
        triangles[True] = observation.triangle(grid, np.array(noise, dtype=float))
    found = {}
    for name in plan.values:
        if name not in CRITERIA.names():
            continue
        chosen = name == plan.criterion
        part = CRITERIA.make(name, options if chosen and isinstance(options, Mapping) else {})
        if part.weighted in triangles and not (chosen and known and part.weighted):
            found[name] = part.value(triangles[part.weighted])
    return found


def _merged(
    stated: tuple[LimitRow, ...], computed: tuple[LimitRow, ...]
) -> tuple[tuple[LimitRow, ...], tuple[bool, ...]]:
    """Return the rows of the file, computed ones in their places, then those that the file does not have."""
    fresh = {(row.joint, row.quantity): row for row in computed}
    keys = list(dict.fromkeys([*((row.joint, row.quantity) for row in stated), *fresh]))
    old = {(row.joint, row.quantity): row for row in stated}
    return tuple(fresh.get(key) or old[key] for key in keys), tuple(key in fresh for key in keys)


def _differences(plan: Plan, computed: tuple[LimitRow, ...], values: Mapping[str, float]) -> Iterator[str]:
    """Say where the file has other figures than its motion."""
    old = {(row.joint, row.quantity): row for row in plan.rows}
    for row in computed:
        stated = old.get((row.joint, row.quantity))
        if stated is not None and _other(stated, row):
            what = BoundLabel(row.joint, row.quantity).text
            yield f"{what}: {stated.value:.5g} {row.unit} in the file, {row.value:.5g} {row.unit} computed again"
    for name, value in values.items():
        if _differ(plan.values[name], value):
            yield f"{name}: {plan.values[name]:.5g} in the file, {value:.5g} computed again"


def _other(stated: LimitRow, found: LimitRow) -> bool:
    """Whether two rows differ; the same share of a bound at its two ends does not count."""
    if found.quantity != "clearance" and np.isfinite(found.limit) and not _differ(stated.used, found.used):
        return False
    pair = found.quantity == "clearance"
    return _differ(stated.value, found.value) if pair else _differ(abs(stated.value), abs(found.value))


def _differ(stated: float, found: float) -> bool:
    return not (stated == found or np.isclose(stated, found, rtol=DIFFERENCE, atol=1e-9, equal_nan=True))


def _against_robot(plan: Plan, model: DynamicModel) -> Iterator[str]:
    """Say where the robot's description allows less than the limits of the plan."""
    robot, own = model.robot, plan.limits
    if robot.name != plan.robot:
        yield f"the plan is of the robot '{plan.robot}', and this one is called '{robot.name}'"
    try:
        full = limits_of(robot, 0.0, 0.0)
    except BadOption:
        return  # limits that the robot model does not state were given when the plan was made
    for i, joint in enumerate(plan.joints):
        for name in ("velocity", "acceleration", "jerk", "torque", "torque_rate"):
            bound, stated = float(getattr(own, name)[i]), float(getattr(full, name)[i])
            if bound > stated * (1 + TOLERANCE):
                word = name.replace("_", " ")
                yield f"{word} of {joint}: the plan may use {bound:.5g}, the robot model allows {stated:.5g}"
        if own.lower[i] < full.lower[i] - TOLERANCE or own.upper[i] > full.upper[i] + TOLERANCE:
            ends = f"{own.lower[i]:.5g} to {own.upper[i]:.5g}", f"{full.lower[i]:.5g} to {full.upper[i]:.5g}"
            yield f"position of {joint}: the plan may use {ends[0]}, the robot model allows {ends[1]}"


def _pairs(plan: Plan, clearance: Clearance) -> Iterator[str]:
    """Say which pairs only the file or only the workspace has."""
    stated = [row.joint for row in plan.rows if row.quantity == "clearance"]
    for names, words in (
        ([name for name in stated if name not in clearance.names], "in the file, not of this workspace"),
        ([name for name in clearance.names if name not in stated], "of this workspace, not in the file"),
    ):
        if names:
            more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
            count = f"{len(names)} clearances" if len(names) > 1 else "a clearance"
            yield f"{count} {words}: {', '.join(names[:_NAMED])}{more}"
