"""Drive gains from logs of currents: from two runs with and without a payload, or against a known description.

Where the gains fit poorly, columns of the logs are read otherwise too: signs and units of positions, order of currents.
A gain follows whatever motion its current is put beside, and the bodies are shared: a position of the wrong sign made
gains of other joints wrong, with narrow intervals. Each other reading is fitted anew, and told where the currents are
explained far better by it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from dynident.applications.drive_gains.drive_gains import IDENTIFIED, NOT_DETERMINED, DriveGains
from dynident.applications.drive_gains.gain_solve import GainOptions, GainSolve, PreparedRuns, Progress, Runs, misfit_of
from dynident.applications.drive_gains.methods import METHODS
from dynident.applications.drive_gains.payload import CarriedBody
from dynident.applications.drive_gains.unknowns import (
    Unknowns,
    base_in_any_direction,
    unknowns_with_payload,
    unknowns_with_prior,
)
from dynident.arrays import Array, vector_text
from dynident.data.log import Log
from dynident.data.preprocessing import Prepared, Preprocessing, default_preprocessing
from dynident.diagnosis.causes.column_readings import GAIN, variance_falls
from dynident.diagnosis.causes.gravity_direction import LEAN, degrees_off, other_mountings
from dynident.errors import BadOption, LogMismatch, SolverFailed
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot

STANDARD = GainOptions()


def gains_from_payload(
    model: DynamicModel,
    without: Sequence[Log],
    loaded: Sequence[Log],
    payload: CarriedBody,
    preprocessing: Preprocessing | None = None,
    options: GainOptions = STANDARD,
    progress: Progress = lambda step: None,
) -> DriveGains:
    """Return the drive gains from runs without and with a payload of which at least the mass is known.

    Inertial parameters, friction of each run, the gains and what is not known of the payload are found in one fit, of
    all joints at once (Gautier and Briot 2014): the known mass sets the scale. Positions are taken to be exact.

    Args:
        model: Robot and friction; the gains of its drives are not used.
        without: Logs with currents, without the payload.
        loaded: Logs with currents, with it.
        payload: What is known of it.
        preprocessing: How logs become rows; default: ``default_preprocessing``.
        options: Method, signs and confidence.
        progress: Called with each step in words.

    Raises:
        BadOption: A level that is none, or a payload that does not move.
        LogMismatch: A log without currents, with a constant one, or given twice.
        SolverFailed: The method did not converge.
        UnknownChoice: No such method, or frame of the payload.
    """
    base = base_parameters(model)
    unknowns = unknowns_with_payload(model, base, payload)
    runs = _checked(model, (tuple(without), tuple(loaded)))
    share = payload.deviation / payload.mass
    solve = GainSolve(model, base, unknowns, preprocessing or default_preprocessing(), options, progress)
    words = f"a payload of {payload.described(model.robot)}"
    ready = solve.prepared(runs)
    found = solve.gains(ready, share, words, "payload", _payload_found(payload))
    if options.method != METHODS[0]:
        return found
    fewer = [replace(payload, inertia=None)] if payload.inertia is not None else []
    less = [*fewer, replace(payload, centre=None, inertia=None)] if payload.centre is not None else []
    others = _otherwise(found, solve, ready, lambda free: unknowns_with_payload(model, free, payload))
    for unknown in less:
        free = replace(solve, unknowns=unknowns_with_payload(model, base, unknown), progress=lambda step: None)
        try:
            other = free.gains(ready, share, words, "payload", _payload_found(unknown))
        except (BadOption, SolverFailed):  # the mass alone does nothing about these axes
            continue
        if any(gain.is_apart_from(each) for gain, each in zip(found.gains, other.gains, strict=True)):
            others.append((free.misfit(ready.sparser()), _other_payload(other, unknown, model.robot)))
            break
    return _agreed(found, others)


def _other_payload(other: DriveGains, unknown: CarriedBody, robot: Robot) -> str:
    """Return in words that with less known of the payload the same logs have other gains."""
    frame = f"in the frame '{unknown.frame_in(robot)}'"
    if unknown.centre is None:
        place = ", ".join(f"{value:.3g}" for value in other.found.values())
        return (
            f"the stated centre contradicts the logs: they place it at {place} m {frame}; name the frame that it is"
            " stated in (--frame), or leave it out (--com)"
        )
    return (
        "the stated inertia contradicts the logs: without it other gains are found; give it about the centre of"
        f" mass {frame}, or leave it out (--inertia)"
    )


def _otherwise(
    found: DriveGains, solve: GainSolve, runs: PreparedRuns, unknowns_of: Callable[[BaseParameters], Unknowns]
) -> list[tuple[float, str]]:
    """Return the misfit with gravity in another direction, or columns read otherwise, and that in words."""
    sparse, plain = runs.sparser(), misfit_of(np.array([gain.residual**2 for gain in found.gains]))
    return [*_leaning(found, plain, solve, sparse, unknowns_of), *other_readings(found, plain, solve, sparse)]


def _leaning(
    found: DriveGains,
    plain: float,
    solve: GainSolve,
    runs: PreparedRuns,
    unknowns_of: Callable[[BaseParameters], Unknowns],
) -> list[tuple[float, str]]:
    """Return the misfit with gravity in the direction that fits best, and that in words, where it fits far better.

    Where fewer than half of the gains are identified, axes of the base that are other mountings are tried as well.
    """
    stated = np.asarray(solve.model.robot.gravity)
    if not np.any(stated):
        return []
    poor = 2 * sum(gain.label == IDENTIFIED for gain in found.gains) < len(found.gains)
    tried, starts = list[tuple[float, Array]](), list[tuple[float, Array]]()
    free = base_in_any_direction(solve.model)
    solve = replace(solve, base=free, unknowns=unknowns_of(free))
    for axis in other_mountings(stated) if poor else ():
        with suppress(BadOption, SolverFailed):
            starts.append((solve.misfit(runs, axis), axis))
    for start in (stated, *(axis for _, axis in sorted(starts, key=lambda each: each[0])[:1])):
        with suppress(BadOption, SolverFailed):
            there, misfit_there = solve.under_free_gravity(runs, start)
            tried.append((misfit_there, there))
    if not tried:
        return []
    size, gravity = min(tried, key=lambda each: each[0])
    angle, gain = degrees_off(gravity, stated), 2.0 * (plain - size)
    if gain < GAIN or angle < LEAN:
        return []
    vector = vector_text(gravity, 3)
    return [
        (
            size,
            f"the stated gravity contradicts the logs: with gravity [{vector}], {angle:.1f} degrees off it, "
            f"{variance_falls(gain)}; state how the arm is mounted (gravity: [{vector}] in the frame of the base)",
        )
    ]


def _agreed(found: DriveGains, others: Sequence[tuple[float, str]]) -> DriveGains:
    """Return gains, none of which is determined where the same logs have others with less known beforehand.

    Args:
        found: The gains.
        others: Misfit and reason of each way to know less that has other gains; the best fit is told.
    """
    if not others:
        return found
    none = {"low": -np.inf, "high": np.inf, "deviation": np.inf, "label": NOT_DETERMINED, "reason": min(others)[1]}
    return replace(found, gains=tuple(replace(gain, **none) for gain in found.gains))


def gains_from_prior(
    model: DynamicModel,
    logs: Sequence[Log],
    theta: npt.ArrayLike | None = None,
    share: float = 0.0,
    preprocessing: Preprocessing | None = None,
    options: GainOptions = STANDARD,
    progress: Progress = lambda step: None,
) -> DriveGains:
    """Return the drive gains of an arm whose bodies are known: gravity and inertia against the currents.

    Friction and rotors are found along with the gains. What is wrong about the bodies is wrong about the gains; with
    a share each link is a factor off and each of its parameters by an error of its own, which the intervals take in.

    Args:
        model: Robot and friction.
        logs: Logs with currents.
        theta: Standard parameters, shape (10 l,) or longer; None for those of the robot model.
        share: Relative standard deviation of links and of their parameters; 0 takes the bodies for exact.
        preprocessing: How logs become rows.
        options: Method, signs and confidence.
        progress: Called with each step in words.

    Raises:
        BadOption: No inertias are known, or a share or level that is none.
        LogMismatch: A log without currents or with a constant one.
        SolverFailed: The method did not converge.
        UnknownChoice: No such method.
    """
    known = model.robot.nominal if theta is None else np.asarray(theta, dtype=float)
    if known is None:
        lacking = next(link.name for link in model.robot.links if link.inertia is None)
        raise BadOption("prior", f"none for {lacking}", "give a robot model or an estimate with all inertias")
    if share and options.method in METHODS[1:]:
        raise BadOption("method", options.method, "only 'structured' takes bodies that are trusted to a share")
    base = base_parameters(model)
    unknowns = unknowns_with_prior(model, base, known, share)
    runs = _checked(model, (tuple(logs),))
    trusted = f"each link within {100 * share:g} % (std)" if share else "taken to be exact"
    solve = GainSolve(model, base, unknowns, preprocessing or default_preprocessing(), options, progress, share)
    ready = solve.prepared(runs)
    found = solve.gains(ready, 0.0, f"known bodies, {trusted}", "bodies", lambda names, z: {})
    if options.method != METHODS[0]:
        return found
    return _agreed(found, _otherwise(found, solve, ready, lambda free: unknowns_with_prior(model, free, known, share)))


def _payload_found(payload: CarriedBody) -> Callable[[Sequence[str], Array], dict[str, float]]:
    """Return what tells the centre of a payload of which only the mass is known."""

    def found(names: Sequence[str], z: Array) -> dict[str, float]:
        if payload.centre is not None:
            return {}
        at = dict(zip(names, z.tolist(), strict=True))
        return {f"centre {axis} [m]": at[f"m{axis} of the payload"] / payload.mass for axis in "xyz"}

    return found


def _checked(model: DynamicModel, runs: Runs) -> Runs:
    """Return the logs in the order of the joints, with torques C' i; refuse those that cannot serve."""
    robot = model.robot
    coupling = np.asarray(robot.coupling)
    seen: dict[str, str] = {}
    found: list[tuple[Log, ...]] = []
    for run, words in zip(runs, ("without the payload", "with the payload"), strict=False):
        if not run:
            raise LogMismatch("drive gains", f"no log {words if len(runs) > 1 else ''}".rstrip(), "give one")
        ordered = []
        for log in run:
            one = log.ordered(robot.joint_names)
            if one.current is None:
                step = "map the columns of the currents (log: columns: {current: ...}); torques need no gains"
                raise LogMismatch(log.name, "no motor currents", step)
            if log.source.sha256 and log.source.sha256 in seen:
                step = "give each log once, and a run with the payload beside one without"
                raise LogMismatch(log.name, f"the same content as {seen[log.source.sha256]}", step)
            seen[log.source.sha256] = log.name
            for name, column in zip(robot.joint_names, np.asarray(one.current).T, strict=True):
                if np.ptp(column) <= 1e-12 * np.max(np.abs(column), initial=0.0):
                    step = "map the right column, or leave the joint out (locked:)"
                    raise LogMismatch(log.name, f"the current of {name} is {column[0]:.4g} A throughout", step)
            ordered.append(replace(one, torque=np.asarray(one.current) @ coupling, raw_torque=None))
        found.append(tuple(ordered))
    return tuple(found)


#: Share of its current that the fit of a drive leaves above which columns are read otherwise, and that of one of two
#: drives whose currents are exchanged.
DOUBTFUL, POOR = 0.1, 0.25


def other_readings(found: DriveGains, plain: float, solve: GainSolve, runs: PreparedRuns) -> list[tuple[float, str]]:
    """Return the misfit with columns read otherwise, and that in words, where they explain the currents far better.

    Args:
        found: The gains.
        plain: Their misfit.
        solve: What found them.
        runs: The logs, with few rows.
    """
    left = np.array([gain.residual / max(gain.current, 1e-100) for gain in found.gains])
    if left.max() < DOUBTFUL or any(gain.sign for gain in found.gains):
        return []
    told = []
    for positions, order, reason, remedy in _readings(solve, left):
        try:
            size = solve.misfit(_read(runs, positions, order, np.asarray(solve.model.robot.coupling)))
        except (BadOption, SolverFailed):
            continue
        gain = 2.0 * (plain - size)
        if gain > GAIN:
            told.append((size, f"{reason}, {variance_falls(gain)}; {remedy}"))
    return told


def _readings(solve: GainSolve, left: Array) -> Iterator[tuple[Array, list[int], str, str]]:
    """Yield factors of the positions (n,), which current is whose, what that is in words, and what to do."""
    robot = solve.model.robot
    names, joints = robot.joint_names, robot.dof
    ones, plain = np.ones(joints), list(range(joints))
    for i, name in enumerate(names):
        turned = np.where(np.arange(joints) == i, -1.0, 1.0)
        yield turned, plain, f"with the position of {name} reversed", "negate the column of its position, or the axis"
    for i, k in combinations(np.flatnonzero(left > DOUBTFUL).tolist(), 2):
        if max(left[i], left[k]) < POOR:
            continue
        order = [k if j == i else i if j == k else j for j in plain]
        remedy = "name the current columns in the order of the joints (log: columns: current)"
        yield ones, order, f"with the currents of {names[i]} and {names[k]} exchanged", remedy
    if np.mean(left > DOUBTFUL) >= 0.5 and all(joint.kind == "revolute" for joint in robot.active):
        for unit, other, factor in (("deg", "radians", np.pi / 180.0), ("rad", "degrees", 180.0 / np.pi)):
            remedy = f"state the unit (log: units: {{position: {unit}}})"
            yield factor * ones, plain, f"with positions in {unit} that were read as {other}", remedy


def _read(runs: PreparedRuns, positions: Array, order: list[int], coupling: Array) -> PreparedRuns:
    """Return the logs with positions times factors (n,) and currents in an order; their torques are C' i."""
    mixing = np.linalg.inv(coupling)[:, order] @ coupling

    def read(prepared: Prepared) -> Prepared:
        log = prepared.log
        motion = {key: np.asarray(getattr(log, key)) * positions for key in ("q", "dq", "ddq")}
        how = replace(prepared.how, standstill=prepared.how.standstill * float(np.abs(positions).min()))
        return replace(prepared, log=replace(log, **motion, torque=np.asarray(log.torque) @ mixing), how=how)

    return PreparedRuns(tuple(tuple(read(log) for log in run) for run in runs.logs), runs.delays)
