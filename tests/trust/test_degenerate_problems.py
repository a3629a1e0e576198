"""Problems at the edge of what can be asked, for every estimator: a right answer within its stated deviations, or a
refusal that says why; never a traceback and never a number that is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import scipy.stats

from dynident.arrays import Array
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import DynidentError, LogMismatch, PoorExcitation
from dynident.identification.estimators import ESTIMATORS
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.robot import Robot

GIVEN = Preprocessing(AsGiven(), rest="keep")
PARTS = ESTIMATORS.names()

#: Searches return the certified optimum, which is what they are asked for here.
OPTIONS: dict[str, dict[str, Any]] = {name: {"polish": True, "iterations": 5} for name in ("abc", "de", "ga", "pso")}

#: How unlikely an error may be by the intervals stated, over all parameters of all cases here.
CHANCE = 1e-7

#: The filter's start has a deviation of its own, by default too small for directions that a motion hardly shows.
WIDER = {("kalman", "joints as one"): {"spread": 1.0}}


@dataclass(frozen=True)
class Task:
    """A model, a log of it and, where there is one, the truth."""

    model: DynamicModel
    log: Log
    theta: Array | None = None

    def with_motion(self, q: Array, dq: Array, ddq: Array, noise: float = 1e-3) -> Task:
        """Return the same model along another motion."""
        assert self.theta is not None
        torque = self.model.torque(Motion(q, dq, ddq), self.theta)
        torque = torque + noise * np.random.default_rng(3).normal(size=q.shape)
        return replace(self, log=replace(self.log, q=q, dq=dq, ddq=ddq, torque=torque))

    def with_signal(self, name: str, change: Callable[[Array], Array]) -> Task:
        """Return the task with a signal changed, and no truth."""
        return Task(self.model, replace(self.log, **{name: change(np.array(getattr(self.log, name)))}))


Make = Callable[..., Task]


@pytest.fixture(scope="module")
def make(planar_2r: Robot, exact_log: Callable[..., Log]) -> Make:
    """Return what makes a sound task with 2 % of noise: robot, friction parts and their values, samples in 4 s."""

    def made(
        robot: Robot = planar_2r,
        friction: tuple[str, ...] = ("coulomb", "viscous"),
        values: Array | None = None,
        samples: int = 200,
    ) -> Task:
        model = DynamicModel(robot, friction)  # type: ignore[arg-type]
        assert robot.nominal is not None
        theta = np.append(robot.nominal, np.tile([1.0, 0.5], robot.dof) if values is None else values)
        clean = exact_log(model, theta, samples=samples, rate=samples / 4)
        noise = 0.02 * np.std(np.asarray(clean.torque), axis=0)
        return Task(model, exact_log(model, theta, noise=noise, samples=samples, rate=samples / 4), theta)

    return made


def at_rest(task: Task) -> Task:
    still = np.zeros_like(task.log.q)
    return task.with_motion(still + 0.3, still, still)


def one_joint(task: Task) -> Task:
    log, one = task.log, np.array([1.0, 0.0])
    assert log.dq is not None and log.ddq is not None
    return task.with_motion(log.q * one, log.dq * one, log.ddq * one)


def collinear(task: Task) -> Task:
    speed, zero = np.array([0.1, -0.1]), np.zeros_like(task.log.q)
    return task.with_motion(task.log.time[:, None] * speed, zero + speed, zero)


def put(row: int, joint: int, value: float) -> Callable[[Array], Array]:
    def change(signal: Array) -> Array:
        signal[row, joint] = value
        return signal

    return change


def standing_clock(task: Task) -> Task:
    time = np.array(task.log.time)
    time[20] = time[19]
    return Task(task.model, replace(task.log, time=time))


#: Refused before any estimator is asked: the error and what it names.
REFUSED: dict[str, tuple[Callable[[Task], Task], type[DynidentError], str]] = {
    "all at rest": (at_rest, LogMismatch, "joint1, joint2 never moved"),
    "one joint moves": (one_joint, LogMismatch, "joint2 never moved"),
    "collinear": (collinear, PoorExcitation, "the log determines 6 of 10 base parameters .*undetermined: Izz"),
    "one sample": (lambda t: Task(t.model, t.log.rows(slice(0, 1), "one")), LogMismatch, "only 1 samples"),
    "position is no number": (
        lambda t: t.with_signal("q", put(17, 1, np.nan)), LogMismatch, "q of joint2 is nan at sample 18",
    ),
    "torque is no number": (
        lambda t: t.with_signal("torque", put(17, 1, np.nan)), LogMismatch, "torque of joint2 is nan at sample 18",
    ),
    "infinite acceleration": (
        lambda t: t.with_signal("ddq", put(17, 0, np.inf)), LogMismatch, "ddq of joint1 is inf at sample 18",
    ),
    "no torque": (lambda t: t.with_signal("torque", np.zeros_like), LogMismatch, "joint1 moves but its torque is 0"),
    "no torque of one joint": (
        lambda t: t.with_signal("torque", lambda x: x * [1.0, 0.0]), LogMismatch, "joint2 moves but its torque is 0",
    ),
    "a clock that stands": (standing_clock, LogMismatch, "time does not run forward at sample 21"),
}  # fmt: skip


def joints_as_one(make: Make) -> Task:
    task, way = make(), np.array([0.5, -1.0])
    time = task.log.time[:, None]
    return task.with_motion(np.sin(time) * way, np.cos(time) * way, -np.sin(time) * way, noise=0.1)


def offset(make: Make, size: float) -> Task:
    return make(friction=("viscous", "offset"), values=np.array([0.5, size, 0.5, -size]))


def many_turns(make: Make) -> Task:
    task = make()
    return replace(task, log=replace(task.log, q=task.log.q + 2 * np.pi * np.array([1000.0, -250.0])))


def of_size(make: Make, robot: Robot) -> Task:
    assert robot.nominal is not None
    return make(robot, ("viscous",), np.full(2, 0.1 * np.abs(robot.nominal[:6]).max()))


def tonne_and_gram(make: Make, robot: Robot) -> Task:
    scaled = [
        replace(link, inertia=type(link.inertia).from_vector(link.inertia.vector * size))
        for link, size in zip(robot.links, (300.0, 5e-4), strict=True)
        if link.inertia is not None
    ]
    return make(replace(robot, links=tuple(scaled)), ("viscous",), np.array([50.0, 1e-4]))


def one_joint_exact(make: Make) -> Task:
    task = make()
    assert task.theta is not None and task.log.dq is not None and task.log.ddq is not None
    torque = task.model.torque(Motion(task.log.q, task.log.dq, task.log.ddq), task.theta)
    torque[:, 1] += 0.05 * np.random.default_rng(1).normal(size=len(torque))
    return replace(task, log=replace(task.log, torque=torque))


def noise_alone(make: Make) -> Task:
    task = make()
    assert task.theta is not None
    torque = np.random.default_rng(1).normal(size=task.log.q.shape)
    return Task(task.model, replace(task.log, torque=torque), np.zeros_like(task.theta))


def epoch(make: Make) -> Task:
    task = make()
    return replace(task, log=replace(task.log, time=task.log.time + 1.7e9))


def held(make: Make) -> Task:
    task = make()
    rows = task.log.rows(np.repeat(np.arange(0, 200, 20), 20), "held")
    return Task(task.model, replace(rows, time=task.log.time))


#: Solved, or refused by those estimators that cannot.
CASES: dict[str, Callable[[Make, Robot, Callable[..., Robot]], Task]] = {
    "joints as one": lambda make, *_: joints_as_one(make),
    "offset of 1e3 N m": lambda make, *_: offset(make, 1e3),
    "offset of 1e6 N m": lambda make, *_: offset(make, 1e6),
    "a thousand turns away": lambda make, *_: many_turns(make),
    "milligrams": lambda make, arm, scaled: of_size(make, scaled(arm, 1e-6, 1e-3, 1.0)),
    "grams": lambda make, arm, scaled: of_size(make, scaled(arm, 1e-3, 0.1, 1.0)),
    "tonnes": lambda make, arm, scaled: of_size(make, scaled(arm, 1e3, 10.0, 1.0)),
    "a tonne carries a gram": lambda make, arm, _: tonne_and_gram(make, arm),
    "10 samples": lambda make, *_: make(samples=10),
    "24 samples": lambda make, *_: make(samples=24),
    "one joint without noise": lambda make, *_: one_joint_exact(make),
    "noise alone": lambda make, *_: noise_alone(make),
    "time since 1970": lambda make, *_: epoch(make),
    "offset not in the model": lambda make, *_: make().with_signal("torque", lambda x: x + np.array([1e6, -1e6])),
    "torques of 1e-30 N m": lambda make, *_: make().with_signal("torque", lambda x: 1e-30 * x),
    "one torque of 9e6 N m": lambda make, *_: make().with_signal("torque", put(50, 0, 9e6)),
    "torque of two values": lambda make, *_: make().with_signal("torque", lambda x: 5.0 * np.sign(x)),
    "signals held": lambda make, *_: held(make),
    "torque of the other sign": lambda make, *_: make().with_signal("torque", lambda x: -x),
}

#: Cases that have told most.
OFTEN = ("10 samples", "one joint without noise")


def check(name: str, case: str, task: Task) -> None:
    """Answer within the intervals stated, but for rounding, or an error of dynident's own with a next step."""
    options = OPTIONS.get(name, {}) | WIDER.get((name, case), {})
    try:
        estimate = identify(task.model, [task.log], ESTIMATORS.make(name, options), GIVEN)
    except DynidentError as error:
        assert "; " in str(error) and "nan" not in str(error).split()
        return
    deviations = estimate.std
    assert np.all(np.isfinite(estimate.beta)) and np.all(np.isfinite(deviations)) and np.all(deviations > 0)
    if task.theta is None:
        return
    truth = estimate.base.from_standard(task.theta)
    degrees = np.inf if estimate.degrees is None else estimate.degrees
    room = scipy.stats.t.isf(CHANCE / 2, degrees) * deviations
    away = np.abs(estimate.beta - truth)
    assert np.all(away <= room + 1e-9 * np.abs(truth).max()), (away / deviations, degrees)


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_asked_is_refused(case: str, make: Make) -> None:
    change, kind, words = REFUSED[case]
    task = change(make())
    with pytest.raises(kind, match=words):
        identify(task.model, [task.log], "wls", GIVEN)


@pytest.mark.parametrize("case", OFTEN)
@pytest.mark.parametrize("name", PARTS)
def test_an_answer_is_right_or_refused(
    name: str, case: str, make: Make, planar_2r: Robot, scaled: Callable[..., Robot]
) -> None:
    check(name, case, CASES[case](make, planar_2r, scaled))


@pytest.mark.battery
@pytest.mark.parametrize("case", [case for case in CASES if case not in OFTEN])
@pytest.mark.parametrize("name", PARTS)
def test_an_answer_to_any_case_is_right_or_refused(
    name: str, case: str, make: Make, planar_2r: Robot, scaled: Callable[..., Robot]
) -> None:
    check(name, case, CASES[case](make, planar_2r, scaled))


@pytest.mark.battery
@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.parametrize("name", PARTS)
def test_every_estimator_refuses_it(name: str, case: str, make: Make) -> None:
    change, kind, words = REFUSED[case]
    task = change(make())
    with pytest.raises(kind, match=words):
        identify(task.model, [task.log], ESTIMATORS.make(name, OPTIONS.get(name, {})), GIVEN)
