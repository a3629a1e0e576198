"""The closed loop of robot and controller as estimators simulate it, with the parameters of the moment.

Source: Gautier, Janot and Vandanjon 2013 (DIDIM: the simulated robot follows the same reference under the same
controller); Janot, Vandanjon and Gautier 2014 (simulated states as instruments). Dynamics depend on the base parameters
alone, so any theta with K theta = beta gives the same motion, possible links or not; what a simulation needs is a
positive definite mass matrix along the motion.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, BoolArray, IntArray
from dynident.data.preprocessing import Prepared
from dynident.errors import BadOption, LogMismatch, NotConsistent, SolverFailed
from dynident.identification.problem.method_run import MethodRun
from dynident.identification.problem.problem import Problem
from dynident.identification.simulated.course import HALVES, Course, LoopOptions, course_of, refuse_states
from dynident.identification.simulated.implicit import NODES, PLACES, RULE
from dynident.model.friction import Motion
from dynident.simulation.plant import MAX_RATE, MIN_RATE, Plant, plant

#: An explicit step times the fastest pole of the joint loops stays below this; times that and the fastest decay of
#: friction below ``STABLE``: the rule is stable up to 2.78, and what friction turns that fast follows the speed.
STEP, STABLE = 0.3, 2.1

#: Steps while friction turns its sign, and explicit steps that take as long as an implicit one.
TURN, IMPLICIT_COST = 4.0, 5.0

#: Stages of the integration rule (four a step) that are held in memory at a time.
STAGES = 8_000

#: Time constants after which the state at the start no longer shows, and the longest share of a log to wait for that.
SETTLED, LONGEST_WAIT = 7.0, 0.25


@dataclass(frozen=True, kw_only=True)
class SimulatingRun(MethodRun):
    """The run of a method that simulates the closed loop.

    Attributes:
        changes: Largest change of a parameter in each round, in standard deviations.
        reference: What the loop follows.
        controller: As stated, or virtual with its bandwidth.
        feedforward: The torque that is fed forward.
        mixed: Rounds that simulated a mixture with the start, since their own parameters had no mass matrix.
        bounded: Steps that went to the best possible robot in place of a free one.
    """

    changes: Sequence[float]
    reference: str
    controller: str
    feedforward: str
    mixed: int | None = None
    bounded: int | None = None


@dataclass(frozen=True)
class SimulatedSegment:
    """Some rows of a simulation, and what its derivative needs.

    Attributes:
        rows: Which samples of the log.
        reference: The motion to follow at every half step, or at the nodes of implicit steps.
        implicit: Whether the steps are implicit.
        counts: Steps per row, steps of held torque, number of the first step.
        step: Length of a step in s.
        out: q, dq, ddq and torque at the rows, shape (rows, 4, n).
        stages: q, dq and ddq at the stages of each step, shape (S, 4, 3, n), or (S, 3, 3, n) where they are implicit.
    """

    rows: slice
    reference: Motion
    implicit: bool
    counts: IntArray
    step: float
    out: Array
    stages: Array

    @property
    def temperature(self) -> Array | None:
        """Of the drives in each step, shape (S, n), in degrees Celsius; None where it is not known."""
        known = self.reference.temperature
        return None if known is None else known[: -1 : len(PLACES if self.implicit else HALVES)]


@dataclass(frozen=True)
class ClosedLoop:
    """The logs of a problem, driven by simulation.

    Attributes:
        problem: Robot, base parameters and logs.
        options: Controller and reference.
        feedforward: The torque fed forward: ``none``, ``gravity``, ``computed`` or ``measured``.
        courses: What is followed, log by log.
        gains: Stiffness and damping of the controller, shape (2, n).
    """

    problem: Problem
    options: LoopOptions
    feedforward: str
    courses: tuple[Course, ...]
    gains: Array

    def simulate(self, beta: Array) -> tuple[Array, ...]:
        """Return q, dq, ddq and torque at all samples of each log, shape (N, 4, n) each.

        Raises:
            NotConsistent: The mass matrix of ``beta`` is not positive definite along the reference.
            SolverFailed: The motion diverged.
        """
        return tuple(
            self.along(course, beta)
            if self.is_exact(course)
            else np.concatenate([segment.out for segment in self.follow(course, beta, tangent=False)])
            for course in self.courses
        )

    def is_exact(self, course: Course) -> bool:
        """Whether the simulated motion is the reference itself: its torque is fed forward, and it starts on it."""
        fed = self.feedforward == "computed" and self.options.control_hz is None
        return fed and np.array_equal(course.start, course.reference[:2, 0])

    def along(self, course: Course, beta: Array) -> Array:
        """Return q, dq, ddq and torque of a course that is followed exactly, shape (N, 4, n), whatever the masses."""
        torque = self._fed(self.still(beta), beta, self.goal(course), None)
        return np.stack([*course.reference, torque], axis=1)

    def goal(self, course: Course) -> Motion:
        """Return the reference of a course, with the load of the problem where friction depends on it."""
        motion, load = Motion(*course.reference, temperature=course.log.log.temperature), self.problem.load
        motion = self.problem.model.with_states(motion, 1.0 / course.rate)
        return motion if load is None else self.problem.model.loaded(motion, self.problem.base.to_standard(load))

    def follow(self, course: Course, beta: Array, tangent: bool = True) -> Iterator[SimulatedSegment]:
        """Simulate one log segment by segment; ``tangent`` keeps the stages of the integration.

        Raises:
            NotConsistent: The mass matrix of ``beta`` is not positive definite along the reference.
            SolverFailed: The motion diverged.
        """
        body = self.body(beta)
        pace = self._pace(body, course)
        track, kinds = _rule(pace.implicit)
        steps, held, joints = pace.steps, pace.held, body.joints
        state, torque, tables = np.array(course.start), np.zeros(joints), body.tables(pace.implicit)
        total, most, step = course.reference.shape[1], max(1, STAGES // (4 * steps)), 1.0 / (course.rate * steps)
        for start in range(0, total, most):
            rows = slice(start, min(start + most, total))
            reference, fed = course.between(rows, steps, PLACES if pace.implicit else HALVES)
            goals = goals_of(reference, self._fed(body, beta, reference, fed))
            counts = np.array([steps, held, start * steps], dtype=np.int64)
            count = rows.stop - rows.start
            out = np.empty((count, 4, joints))
            stages = np.empty((count * steps if tangent else 0, kinds, 3, joints))
            failed = track(tables, self.gains, goals, (counts, step), state, torque, out, stages)
            if failed >= 0:
                at = start / course.rate + failed * step
                evidence = f"the motion is lost at {at:.4g} s"
                raise SolverFailed("the simulated closed loop", evidence, self._advice())
            yield SimulatedSegment(rows, reference, pace.implicit, counts, step, out, stages)

    def body(self, beta: Array) -> Plant:
        """Return the robot with the base parameters ``beta``, shape (b,)."""
        return plant(self.problem.model, self.problem.base.to_standard(beta))

    def still(self, beta: Array) -> Plant:
        """Return the robot with the base parameters ``beta`` without its friction, which no motion then needs."""
        return plant(self.problem.model, self.problem.base.to_standard(beta), is_moved=False)

    def _advice(self) -> str:
        if self.options.kp is None:
            return "state the controller's gains (kp, kd), or another bandwidth_hz"
        return "check kp and kd (N m/rad and N m s/rad at the joints) and q_ref, or filter the log at a lower frequency"

    def check(self, beta: Array) -> None:
        """Check that ``beta`` can be simulated.

        Raises:
            NotConsistent: The mass matrix of a motion that has to be integrated is not positive definite along it.
        """
        for course in self.courses:
            if not self.is_exact(course):
                course.masses(self.still(beta))

    def _pace(self, body: Plant, course: Course) -> _Pace:
        """Return the steps of the integration: implicit ones where explicit ones would be small only to be stable."""
        masses, options = course.masses(body), self.options
        pole = float(np.max(np.abs(_poles(masses, self.gains))))
        stable = max(
            pole / STEP, (pole + body.fastest_decay(masses, course.reference[0], course.reference[1])) / STABLE
        )
        smooth = max(MIN_RATE, TURN * _fastest_turn(body, course))
        implicit = stable > IMPLICIT_COST * smooth
        needed = smooth if implicit else max(smooth, stable)
        if needed > MAX_RATE:
            advice = "give the Coulomb part a greater width, or the controller lower gains"
            raise SolverFailed("the simulated closed loop", f"it needs {needed:.3g} steps a second", advice)
        steps = math.ceil(needed / course.rate)
        if options.control_hz is None:
            return _Pace(steps, 0, implicit)
        ratio = Fraction(options.control_hz / course.rate).limit_denominator(20)
        if ratio == 0 or abs(float(ratio) * course.rate / options.control_hz - 1.0) > 1e-4:
            advice = f"the log has {course.rate:.6g} samples a second; give a simple multiple or part of that, or None"
            raise BadOption("control_hz", options.control_hz, advice)
        steps = math.ceil(steps / ratio.numerator) * ratio.numerator
        return _Pace(steps, steps * ratio.denominator // ratio.numerator, implicit)

    def _fed(self, body: Plant, beta: Array, reference: Motion, measured: Array | None) -> Array:
        if measured is not None:
            return measured
        if self.feedforward == "computed":
            if reference.state is None:
                refuse_states(self.problem.model, "the torque fed forward")
            return self.problem.model.torque(reference, self.problem.base.to_standard(beta))
        return body.gravity(reference.q) if self.feedforward == "gravity" else np.zeros_like(reference.q)

    def settled(self, beta: Array) -> tuple[BoolArray, ...]:
        """Return the problem's masks without the rows at which the state at the start still shows, (N, n) each.

        The first state is not known well, and a controller whose gains are stated takes its time to correct it; a
        virtual one starts on its reference.
        """
        if self.options.kp is None:
            return self.problem.masks
        found = []
        for course, mask in zip(self.courses, self.problem.masks, strict=True):
            slowest = -np.max(_poles(course.masses(self.still(beta)), self.gains).real)
            log = course.log.log
            wait = min(SETTLED / slowest if slowest > 0 else np.inf, LONGEST_WAIT * log.duration)
            found.append(mask & (log.time[course.log.keep] >= log.time[0] + wait)[:, None])
        return tuple(found)

    def run(
        self,
        trace: Sequence[float],
        changes: Sequence[float],
        simulations: int,
        mixed: int | None = None,
        bounded: int | None = None,
    ) -> SimulatingRun:
        """Return the run of a method that simulated this loop so many times with each log."""
        commanded = self.courses[0].log.log.q_ref is not None and self.options.reference == "commanded"
        smooth = self.options.reference_hz
        measured = "measured positions" + (f" below {smooth:g} Hz" if smooth else "")
        known = self.options.kp is not None
        return SimulatingRun(
            iterations=len(changes),
            simulations=simulations * len(self.courses),
            trace=trace,
            changes=changes,
            mixed=mixed,
            bounded=bounded,
            reference="commanded positions" if commanded else measured,
            controller="as stated" if known else f"virtual, {self.options.bandwidth_hz:g} Hz",
            feedforward=self.feedforward,
        )


def closed_loop(
    problem: Problem, options: LoopOptions, beta: Array, unknown: str = "computed", instruments: bool = False
) -> ClosedLoop:
    """Return the closed loop of a problem's logs.

    Args:
        problem: Robot, base parameters and logs.
        options: Controller and reference.
        beta: Base parameters that can be simulated, shape (b,); the virtual controller has the inertia they give each
            joint on average, and keeps it.
        unknown: What is fed forward where no gains are stated and ``feedforward`` is ``auto``.
        instruments: Whether the simulated states need only go with the measured ones: the commanded positions then
            serve where no gains are stated as well.

    Raises:
        BadOption: Gains for another number of joints.
        LogMismatch: A log without the positions or torques that are asked for.
        NotConsistent: The mass matrix of ``beta`` is not positive definite along the reference.
    """
    joints = problem.model.robot.dof
    for name in ("kp", "kd"):
        gains = getattr(options, name)
        if gains is not None and len(gains) != joints:
            raise BadOption(name, gains, f"give one number for each of the {joints} joints")
    known = options.kp is not None
    reference = options.reference
    if reference == "auto":
        told = all(log.log.q_ref is not None for log in problem.logs)
        if known and not told:
            name = next(log.log.name for log in problem.logs if log.log.q_ref is None)
            advice = "map q_ref in the case file, leave kp and kd out, or choose reference: measured"
            raise LogMismatch(name, "controller gains but no commanded positions", advice)
        reference = "commanded" if told and (known or instruments) else "measured"
    chosen = replace(options, reference=reference)
    fed = options.feedforward if options.feedforward != "auto" else "none" if known else unknown
    courses = tuple(course_of(log, chosen, fed, known) for log in problem.logs)
    gains = np.array([options.kp, options.kd], dtype=float) if known else np.empty((0, joints))
    loop = ClosedLoop(problem, chosen, fed, courses, gains)
    if known:
        return loop
    masses = np.concatenate([course.masses(loop.still(beta)) for course in courses])
    inertia, pulsation = np.diagonal(masses, axis1=1, axis2=2).mean(axis=0), 2 * np.pi * options.bandwidth_hz
    return replace(loop, gains=np.array([pulsation**2 * inertia, 2 * pulsation * inertia]))


def goals_of(reference: Motion, fed: Array) -> Array:
    """Return what the compiled loops follow: q, dq, torque fed forward and, if known, temperatures, (S, 3 or 4, n)."""
    rows = (reference.q, reference.dq, fed, reference.temperature)
    return np.stack([row for row in rows if row is not None], axis=1)


@dataclass(frozen=True)
class _Pace:
    """Steps per row, steps that the controller holds its torque (0: none), and whether they are implicit."""

    steps: int
    held: int
    implicit: bool


def _rule(implicit: bool) -> tuple[Callable[..., int], int]:
    """Return the compiled loop of a rule and its number of stages."""
    if not implicit:
        explicit: Any = importlib.import_module("dynident.simulation.tracking_loop")
        return explicit.tracking, 4
    module: Any = importlib.import_module("dynident.identification.simulated.implicit_loop")

    def track(tables: Any, gains: Array, goals: Array, clock: tuple[Any, float], *rest: Any) -> int:
        return module.implicit_tracking(tables, gains, goals, (*clock, RULE), *rest)

    return track, len(NODES)


def _fastest_turn(body: Plant, course: Course) -> float:
    """Return how many times a second friction may turn its sign: acceleration of the drives over the width, in 1/s."""
    accelerations = np.abs(course.reference[2] @ body.coupling.T)
    return float(np.max(np.percentile(accelerations, 99.0, axis=0) * body.friction.sharpness()))


def _poles(masses: Array, gains: Array) -> npt.NDArray[np.complexfloating[Any]]:
    """Return the eigenvalues in 1/s of joint loops over mass matrices (N, n, n), shape (N, 2 n)."""
    joints = masses.shape[1]
    system = np.zeros((len(masses), 2 * joints, 2 * joints))
    system[:, :joints, joints:] = np.eye(joints)
    system[:, joints:, :joints] = -np.linalg.solve(masses, np.diag(gains[0]))
    system[:, joints:, joints:] = -np.linalg.solve(masses, np.diag(gains[1]))
    return np.asarray(np.linalg.eigvals(system), dtype=complex)


def simulated_logs(loop: ClosedLoop, states: tuple[Array, ...]) -> tuple[Prepared, ...]:
    """Return the logs with simulated q, dq, ddq beside the measured torques; filtered alike when they become rows.

    Args:
        loop: The closed loop.
        states: What :meth:`ClosedLoop.simulate` returned.
    """
    return tuple(
        replace(
            course.log,
            log=replace(course.log.log.with_step("states simulated"), q=rows[:, 0], dq=rows[:, 1], ddq=rows[:, 2]),
        )
        for course, rows in zip(loop.courses, states, strict=True)
    )


def possible_beta(loop: ClosedLoop, beta: Array, fallback: Array) -> tuple[Array, bool]:
    """Return parameters that can be simulated: ``beta``, or the first point on the way to ``fallback`` that can.

    Args:
        loop: The closed loop.
        beta: Wanted, shape (b,).
        fallback: Known to have a positive definite mass matrix, shape (b,). The mass matrix is linear in beta, so the
            last point always has one too.

    Returns:
        The parameters, and whether they are ``beta``.
    """
    for share in (0.0, 0.25, 0.5, 0.75, 0.9):
        mixed = (1 - share) * beta + share * fallback
        try:
            loop.check(mixed)
        except NotConsistent:
            continue
        return mixed, share == 0.0
    return fallback, False
