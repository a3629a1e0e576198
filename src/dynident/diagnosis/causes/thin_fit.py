"""The quick fit of a case's log: its model with plain friction, and the log thinned out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.arrays import Array
from dynident.case.case import Case
from dynident.data.log import Log
from dynident.data.preprocessing import FILTERS, Preprocessing, resample
from dynident.data.preprocessing._zero_phase import low_passed
from dynident.diagnosis.causes.quick_fit import ROWS_PER_HZ, QuickFit
from dynident.errors import DynidentError
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION, Friction, default_friction
from dynident.model.friction.rotor_inertia import RotorInertia
from dynident.model.robot import Robot

#: Cut-off of both sides in Hz at most, and samples a second per Hz of it before the filter.
CUTOFF_HZ, SAMPLES_PER_HZ = 5.0, 20.0


def quick_fit(case: Case, log: Log) -> QuickFit | None:
    """Return the fit of a sound log; None where it has no torques or is too short for one."""
    found = thin_fit(case, log)
    return found if found is not None and found.has_rows_enough else None


def thin_fit(case: Case, log: Log) -> QuickFit | None:
    """Return the fit of a sound log, of which no rows are made yet; None where it has no torques or no uniform time."""
    if log.torque is None:
        return None
    known = {joint.name for joint in case.robot.active if joint.drive.reflected_inertia}
    rotors = tuple(name for name in case.robot.joint_names if name in known | asked_inertias(case))
    own = {FRICTION.name_of(part): part for part in case.friction if part.joints is None and part.is_default}
    parts = [own.get(name) or FRICTION.make(name) for name in default_friction()]
    friction = [each for part in parts for each in _by_kind(part, case.robot)]
    if rotors:
        friction.append(RotorInertia(joints=None if len(rotors) == case.robot.dof else rotors))
    friction += _stated_springs(case)
    model = DynamicModel(_without_rotors(case.robot) if known else case.robot, tuple(friction))
    cutoff = min(CUTOFF_HZ, case.preprocessing.filter.bandwidth() or CUTOFF_HZ)
    how = Preprocessing(
        FILTERS.make("butterworth", {"cutoff_hz": cutoff}),
        rate_hz=ROWS_PER_HZ * cutoff,
        trim_s=max(case.preprocessing.trim_s, 1.0 / cutoff),
        standstill=max(case.preprocessing.standstill, 0.01),
    )
    try:
        thin = thinned_log(log, SAMPLES_PER_HZ * cutoff, case.preprocessing.longest_gap_s)
        conversion, zeros = _conversion(case.robot, log), _zeros(case)
        return QuickFit(model, base_parameters(model), thin, how, conversion=conversion, zeros=zeros)
    except DynidentError:
        return None


def _zeros(case: Case) -> tuple[float, ...]:
    """Return the position in rad or m of each joint where its log says 0; nothing where all are 0."""
    own = dict(zip(case.columns.joints or case.robot.joint_names, case.columns.zero, strict=False))
    return tuple(own.get(name, 0.0) for name in case.robot.joint_names) if own else ()


def _conversion(robot: Robot, log: Log) -> Array | None:
    """Return what turned the currents of a log into its torques, shape (n, n); None where these were logged."""
    gains = np.array([np.nan if joint.drive.gain is None else joint.drive.gain for joint in robot.active])
    if log.current is None or log.torque is None or not np.all(gains != 0.0) or np.isnan(gains).any():
        return None
    found = np.asarray(robot.coupling).T * gains
    return found if np.allclose(log.current @ found.T, log.torque, equal_nan=True) else None


def _by_kind(part: Friction, robot: Robot) -> list[Friction]:
    """Return a part whose speeds are for hinges, and one for each slide, which is slower; the part where none is."""
    speeds = {name: getattr(part, name) for name, one in part.ranges.items() if one.is_speed}
    scales = {joint.name: joint.speed_scale for joint in robot.active}
    slides = [joint.name for joint in robot.active if joint.kind == "prismatic"]
    if not slides or not speeds:
        return [part]
    hinges = tuple(name for name in robot.joint_names if name not in slides)
    slow = [
        replace(part, joints=(name,), **{key: scales[name] * speed for key, speed in speeds.items()}) for name in slides
    ]
    return [replace(part, joints=hinges), *slow] if hinges else slow


def asked_inertias(case: Case) -> frozenset[str]:
    """Return the joints for whose rotors the friction of a case has a part, or may choose one."""
    every = case.robot.joint_names
    parts = [every if part.joints is None else part.joints for part in case.friction if all(part.is_inertia)]
    return frozenset(every if case.choose_friction else (name for joints in parts for name in joints))


def beyond_quick_fit(case: Case) -> list[Friction]:
    """Return the friction parts of a case that the quick fit has not."""
    known = [part for part in case.friction if part.is_default or all(part.is_inertia)]
    return [part for part in case.friction if part not in (*known, *_stated_springs(case))]


def _stated_springs(case: Case) -> list[Friction]:
    """Return stated parts that follow the position: springs, balancers, ripple."""
    return [part for part in case.friction if part.is_of_position and not part.is_optional]


def _without_rotors(robot: Robot) -> Robot:
    """Return the robot with no known rotor inertia: a known torque would not go with torques of another unit."""
    drives = {joint.name: replace(joint.drive, rotor_inertia=0.0) for joint in robot.active}
    return robot.with_drives(drives, robot.coupling)


def thinned_log(log: Log, rate: float, longest_gap: float | None = None) -> Log:
    """Return positions and torques on equal steps at about ``rate`` a second, low-passed; see :func:`resample`."""
    plain = Log(log.joints, log.time, log.q, torque=log.torque, source=log.source, gaps=log.gaps)
    even = resample(plain, longest_gap)
    every = max(1, int(even.rate / rate))
    if every == 1:
        return even
    cutoff = 0.4 * even.rate / every
    smooth = {name: low_passed(values, 4, cutoff, even.rate) for name, values in even.signals().items()}
    return replace(even, **smooth).rows(slice(None, None, every), f"one sample in {every}")  # type: ignore[arg-type]
