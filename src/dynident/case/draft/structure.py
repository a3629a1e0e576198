"""Columns without names told by their values: which are the time, positions and their derivatives, and torques.

Columns of one signal stand side by side, or every k-th column is the next joint's. Positions are columns whose
derivative is logged as well, and that are no derivative of others. Torques are what the equations of motion of the
robot model explain, by least squares in base parameters, Coulomb and viscous friction and an offset. What fits twice
is asked.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynident.arrays import Array
from dynident.case.draft.column_groups import Group
from dynident.case.draft.column_words import Meaning, is_unit_of, unit_of
from dynident.case.draft.derivative_columns import MOVE, ONE_CLOCK, derivatives, joint_count, less_line, runs_of
from dynident.case.draft.joint_choice import choose_joints
from dynident.case.draft.readings import band, cutoff_from
from dynident.case.draft.signal_units import position_factors, position_unit
from dynident.case.evidence.positions import STRAYS
from dynident.case.evidence.rows import time_units
from dynident.case.evidence.torques import filtered_rows
from dynident.data.formats._units import UNITS
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot

#: Rows that are looked at.
ROWS = 1 << 15

#: Share of the steps of a time that may not run forward.
STANDS = 0.001

#: Sets of columns that are tried as positions with each other one as torques, where no velocities tell them.
MOST_SETS = 20

#: Share of a signal that the equations of motion must explain, and the difference below which two are as good.
EXPLAINED, AS_GOOD = 0.6, 0.1

#: Rows of a fit that only has to tell torques from other columns.
_FIT_ROWS = 800

_EXPLAINED = "the equations of motion of the robot model"

#: Rates that loggers have, in samples a second.
RATES = (
    10,
    20,
    25,
    30,
    40,
    50,
    60,
    62.5,
    100,
    120,
    125,
    200,
    240,
    250,
    300,
    400,
    500,
    800,
    1000,
    2000,
    4000,
    5000,
    8000,
)


@dataclass(frozen=True)
class TableStructure:
    """What the values of unnamed columns say.

    Attributes:
        time: Column of the time; empty for none.
        rate_hz: Samples a second that velocities and positions agree on, where no column is the time; 0 for none.
        rate_why: What speaks for it.
        groups: Columns of each signal.
        evidence: What speaks for each signal.
        rivals: Columns that fit a signal as well.
        left_out: Signals that are recognised and not read, and why.
        likely_effort: Columns that are as many as the positions and may be torques, where no model tells them; empty
            for none.
    """

    time: str = ""
    rate_hz: float = 0.0
    rate_why: str = ""
    groups: Mapping[str, Group] = field(default_factory=dict)
    evidence: Mapping[str, str] = field(default_factory=dict)
    rivals: Mapping[str, tuple[Group, ...]] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    likely_effort: tuple[str, ...] = ()


def structure_of(robot: Robot, header: Sequence[str], values: Array, time: str = "") -> TableStructure:
    """Return what the values of columns say.

    Args:
        robot: Whose joints stand in the columns in the order of the chain: all of them, or some in a row.
        header: Names of the columns, which say nothing.
        values: Their first rows, shape (N, len(header)).
        time: Column of the time where its name tells it.
    """
    count = robot.dof
    values = values[np.isfinite(values).all(axis=1)][:ROWS]
    place = header.index(time) if time else _time_column(values)
    clock = np.arange(len(values), dtype=float) if place is None else values[:, place]
    usable = [k for k in range(len(header)) if k != place]
    runs = runs_of(usable, count)
    nothing = TableStructure("" if place is None else header[place])
    if len(values) < 50 or len(usable) < 2 or np.any(np.diff(clock) <= 0):
        return nothing
    told = _Names(header)
    pairs = derivatives(clock, values, runs)
    if not pairs and place is not None:
        without = _without_velocities(robot, clock, values, told, nothing)
        if without.groups:
            return without
    if not pairs and (fewer := joint_count(clock, values, usable, count)):
        runs = runs_of(usable, fewer)
        pairs = derivatives(clock, values, runs)
    if pairs and place is not None and not time and np.all(np.diff(clock) == 1.0):  # a counter of rows tells no time
        place, nothing = None, TableStructure()
    followed = {k for pair in pairs for k in pair.by}
    firsts = {pair.of: pair for pair in pairs if followed.isdisjoint(pair.of)}
    if not firsts:
        return nothing
    positions = _same_motion(values, list(firsts))
    first = _measured(clock, values, positions)
    velocity, rivals = firsts[first], {}
    groups, evidence = {"q": told.group("q", first)}, {"q": f"{told.shown(velocity.by)} are their derivative"}
    if len(positions) > 1:
        others = [run for run in positions if run != first]
        rivals["q"] = tuple(told.group("q", run) for run in (first, *others))
        evidence["q"] += f"; they follow {' and '.join(map(told.shown, others))} in time, as measured ones do"
    groups["dq"] = told.group("dq", velocity.by)
    shown = f"the derivative of {told.shown(first)}"
    rate, rate_why = 0.0, ""
    if place is None:
        rate = _common_rate(velocity.factor)
        rate_why = f"samples a second by which {told.shown(velocity.by)} are {shown}"
    evidence["dq"] = rate_why or f"{velocity.factor:.4g} times {shown} by the time's column"
    second = next((pair.by for pair in pairs if pair.of == velocity.by), ())
    left_out = {"ddq": f"{told.shown(second)}: the derivative of {told.shown(velocity.by)}"} if second else {}
    known = {k for run in (*positions, *(pair.by for pair in pairs), second) for k in run}
    seconds = clock / (rate or _clock_unit(velocity.factor))
    efforts = [run for run in runs if not known.intersection(run)]
    moving = _moving(robot, groups["q"], values[:, first])
    if moving is None:
        sets = _whole_sets([k for k in usable if k not in known], len(first))
        likely = told.group("torque", sets[0]).names if len(sets) == 1 else ()
        return TableStructure(nothing.time, rate, rate_why, groups, evidence, rivals, left_out, likely)
    all_told = _with_effort(moving, seconds, values, efforts, told, (groups, evidence, rivals))
    return TableStructure(nothing.time, rate, rate_why, all_told.groups, all_told.evidence, all_told.rivals, left_out)


def _moving(robot: Robot, group: Group, q: Array) -> Robot | None:
    """Return the robot with the joints of the positions' columns, q (N, k) as they stand there; None for unknown."""
    names = choose_joints(robot, group, q).names
    if not names:
        return None
    others = [name for name in robot.joint_names if name not in names]
    return robot.locked(dict.fromkeys(others, 0.0)) if others else robot


def _without_velocities(
    robot: Robot, clock: Array, values: Array, told: _Names, found: TableStructure
) -> TableStructure:
    """Return the positions and torques that explain each other best, of columns that stand in whole sets of joints."""
    step = float(np.median(np.diff(clock)))
    units = time_units(step)
    place = told.header.index(found.time)
    runs = _whole_sets([k for k in range(len(told.header)) if k != place], robot.dof)
    if not units or not 0 < len(runs) <= MOST_SETS:
        return found
    seconds = clock * UNITS["time"][units[0]][0][0] / UNITS["time"][units[0]][0][1]
    tried = []
    for of in runs:
        moves = np.any(less_line(clock, values[:, of]), axis=0)
        if np.mean(moves) < MOVE or not position_unit(values[:, of], robot.active, "").words:
            continue
        others = [run for run in runs if not set(run) & set(of)]
        groups = {"q": told.group("q", of)}
        evidence = {"q": f"within the limits of the joints, and the best positions for {_EXPLAINED}"}
        result = _with_effort(robot, seconds, values, others, told, (groups, evidence, {}))
        if "torque" in result.groups:
            tried.append(result)
    tried.sort(key=lambda one: -one.share)
    if not tried:
        return found
    best = tried[0]
    near = [one.groups["q"] for one in tried[1:] if one.share >= best.share - AS_GOOD]
    rivals = {**best.rivals, **({"q": (best.groups["q"], *near)} if near else {})}
    return replace(found, groups=best.groups, evidence=best.evidence, rivals=rivals)


@dataclass(frozen=True)
class _Efforts:
    """Groups, evidence and rivals with the columns that the equations of motion explain, and the share of the best."""

    groups: dict[str, Group]
    evidence: dict[str, str]
    rivals: dict[str, tuple[Group, ...]]
    share: float = 0.0


@dataclass(frozen=True)
class _Names:
    header: Sequence[str]

    def group(self, signal: str, run: Sequence[int]) -> Group:
        names = [self.header[column] for column in run]
        each = tuple(unit_of([name]) for name in names)
        unit = each[0] if len(set(each)) == 1 and is_unit_of(each[0], signal) else ""
        units = each if len(set(each)) > 1 and all(is_unit_of(one, signal) for one in each) else ()
        return Group(Meaning(signal, unit=unit), dict(enumerate(names)), False, units=units)

    def shown(self, run: Sequence[int]) -> str:
        return self.group("", run).shown()


def _with_effort(
    robot: Robot,
    seconds: Array,
    values: Array,
    runs: Sequence[tuple[int, ...]],
    told: _Names,
    found: tuple[dict[str, Group], dict[str, str], dict[str, tuple[Group, ...]]],
) -> _Efforts:
    """Return groups, evidence and rivals with the columns that the equations of motion explain."""
    groups, evidence, rivals = found
    q = values[:, [told.header.index(name) for name in groups["q"].names]]
    q = q * position_factors(position_unit(q, robot.active, ""), robot.dof)
    cutoff = cutoff_from(band(seconds, q), 1.0 / float(np.median(np.diff(seconds))))
    shares = explained_shares(robot, seconds, q, [values[:, run] for run in runs], cutoff)
    ranked = sorted(zip(shares, runs, strict=True), key=lambda item: -item[0])
    if not ranked or not ranked[0][0] >= EXPLAINED:
        return _Efforts(*found)
    best, run = ranked[0]
    near = [other for share, other in ranked[1:] if share >= best - AS_GOOD and not set(other) & set(run)]
    groups["torque"] = told.group("torque", run)
    evidence["torque"] = f"{_EXPLAINED} explain {100 * best:.4g} % of their variance"
    if near:
        rivals["torque"] = tuple(told.group("torque", other) for other in (run, *near))
        each = " and ".join(f"{100 * share:.4g} % of {told.shown(other)}" for share, other in ranked[: 1 + len(near)])
        evidence["torque"] = f"{_EXPLAINED} explain {each}; torques of a model are explained best"
    return _Efforts(groups, evidence, rivals, best)


def _whole_sets(columns: Sequence[int], count: int) -> list[tuple[int, ...]]:
    """Return sets of ``count`` columns that follow each other without a rest: block by block, or joint by joint."""
    sets, rest = divmod(len(columns), count)
    found: dict[tuple[int, ...], None] = {}
    for lead in dict.fromkeys((0, rest)):
        inside = columns[lead : lead + sets * count]
        for k in range(sets):
            found.setdefault(tuple(inside[k * count : (k + 1) * count]))
            found.setdefault(tuple(inside[k::sets]))
    return list(found)


def _time_column(values: Array) -> int | None:
    """Return the column that runs forward at the most even steps; None for none."""
    best, place = 1.0, None
    for k, column in enumerate(values.T):
        steps = np.diff(column)
        if not len(steps) or np.mean(steps <= 0) > STANDS:
            continue
        spread = float(np.std(steps) / max(np.mean(steps), 1e-300))
        spread = max(spread, 1e-9) + float(np.all(steps == 1.0))  # a counter of rows: if nothing else is there
        if spread < best or place is None:
            best, place = spread, k
    return place


def _same_motion(values: Array, runs: Sequence[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """Return the runs that hold the motion of the first: measured and commanded positions, or link and motor."""
    first = values[:, runs[0]]
    size = np.maximum(first.std(axis=0), 1e-300)
    return [
        run
        for run in runs
        if np.all(np.sqrt(np.mean((values[:, run] - first) ** 2, axis=0)) <= STRAYS * size) or run == runs[0]
    ]


def _measured(clock: Array, values: Array, runs: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """Return the run that comes last in time: a drive follows what it is commanded."""
    first = values[:, runs[0]]
    slope = np.gradient(first, clock, axis=0)
    lags = [-np.sum((values[:, run] - first) * slope) / max(np.sum(slope**2), 1e-300) for run in runs]
    return runs[int(np.argmax(lags))]


def _clock_unit(factor: float) -> float:
    """Return how many units of the time's column are a second, from the factor that its derivatives need."""
    return next((unit for unit in (1e3, 1e6, 1e9) if abs(factor / unit - 1) < ONE_CLOCK), 1.0)


def _common_rate(factor: float) -> float:
    """Return the rate of loggers near a factor between positions' steps and velocities; else three digits of it."""
    near = min(RATES, key=lambda rate: abs(np.log(rate / factor)))
    return float(near if abs(near / factor - 1) < 0.02 else f"{factor:.3g}")


def explained_shares(
    robot: Robot, time: Array, q: Array, efforts: Sequence[Array], cutoff_hz: float, has_friction: bool = True
) -> list[float]:
    """Return how well columns follow the equations of motion of the robot model, whatever its inertias.

    Args:
        robot: With the joints of the columns only.
        time: In s, shape (N,).
        q: Positions in rad or m, shape (N, n).
        efforts: Columns that may be torques or currents, (N, n) each.
        cutoff_hz: Cut-off of the filter.
        has_friction: Whether Coulomb and viscous friction count, or else the inertia of rotors.

    Returns:
        Share of the variance of each that base parameters, friction and an offset explain, the joints weighted alike;
        0 where a log is too poor.
    """
    parts = {"coulomb": {"width": 0.01}, "viscous": {}} if has_friction else {"rotor_inertia": {}}
    model = DynamicModel(robot, tuple(FRICTION.make(name, each) for name, each in {**parts, "offset": {}}.items()))
    base = base_parameters(model)
    shares: list[float] = []
    columns = grams = np.empty(0)
    for effort in efforts:
        rows = filtered_rows(robot, time, q, effort, cutoff_hz)
        if rows is None:
            shares.append(0.0)
            continue
        kept = slice(None, None, 1 + len(rows[1]) // _FIT_ROWS)
        if not columns.size:
            columns = model.regressor(rows[0].rows(kept))[:, :, base.independent].swapaxes(0, 1)
            grams = columns.swapaxes(1, 2) @ columns
        torque = rows[1][kept] - rows[1][kept].mean(axis=0)
        weights = np.where(torque.any(axis=0), 1.0 / np.maximum(np.mean(torque**2, axis=0), 1e-300), 0.0)
        right = np.einsum("jnb,nj,j->b", columns, torque, weights)
        solved = np.linalg.lstsq(np.tensordot(weights, grams, 1), right, rcond=1e-12)[0]
        shares.append(float(right @ solved) / max(len(torque) * float(np.count_nonzero(weights)), 1.0))
    return shares
