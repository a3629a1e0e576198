"""Robots, logs and whole estimates for the tests of the results, built without reading or identifying anything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.data.log import Log, Source
from dynident.data.preprocessing import FILTERS, Preprocessing
from dynident.excitation.design.limits import MotionLimits, check_limits
from dynident.excitation.design.plan import Plan
from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.identification.estimate.estimate import Consistency, Estimate
from dynident.identification.estimate.validation import Validation, compare_torques
from dynident.identification.problem.method_run import MethodRun
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, JointLimits
from dynident.model.robot import Frame, Link, Robot

HOSTILE = (
    "<script>alert('x')</script>",
    '"><img src=x onerror="alert(1)">',
    "{{ 7 * 7 }}{% raw %}",
    "مفصل الكتف\u202eabc",
    "",
    "a" * 400,
    "]]>&amp;\x00\n'",
)


def arm(names: Sequence[str] = ("joint1", "joint2", "joint3"), name: str = "arm", sliding: bool = False) -> Robot:
    """Return an arm whose joints turn about z, y, x, y, x, y, ...; the last one slides if asked."""
    axes = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]], float)
    reach = np.array(
        [[0, 0, 0.3], [0.05, 0.1, 0.1], [0.35, 0, 0.05], [0.3, 0, 0], [0.1, 0, 0], [0.1, 0, 0], [0.1, 0, 0]]
    )
    joints, links = [], []
    for k, joint in enumerate(names):
        kind = "prismatic" if sliding and k == len(names) - 1 else "revolute"
        limits = JointLimits(-np.pi, np.pi, 3.0, effort=200.0)
        joints.append(Joint(joint, kind, k - 1, np.eye(3), reach[k % 7], axes[k % 7], limits, Drive(100.0, 1e-5, 12.5)))
        body = Inertia.from_centre_of_mass(6.0 - 0.6 * k, [0.12, 0.01, 0.03], np.diag([0.04, 0.06, 0.05]))
        links.append(Link(f"link of {joint}", body))
    tool = Frame(len(links) - 1, np.eye(3), np.array([0.12, 0.0, 0.05]))
    return Robot(name, tuple(links), tuple(joints), frames={"tool": tool}, tool="tool", note="made for tests")


def recorded(model: DynamicModel, theta: Array, samples: int, rate: float, seed: int, name: str, noise: float) -> Log:
    """Return a log of sines with the torques of the model and noise in N m."""
    generator = np.random.default_rng(seed)
    n = model.robot.dof
    time = np.arange(samples) / rate
    rates = generator.uniform(0.3, 1.6, (3, 1, n))
    sizes, phases = generator.uniform(0.2, 0.5, (3, 1, n)), generator.uniform(0, 6, (3, 1, n))
    angle = rates * time[None, :, None] + phases
    q, dq = np.sum(sizes * np.sin(angle), axis=0), np.sum(sizes * rates * np.cos(angle), axis=0)
    ddq = -np.sum(sizes * rates**2 * np.sin(angle), axis=0)
    torque = model.torque(Motion(q, dq, ddq), theta)
    seen = torque + generator.normal(0, noise, torque.shape)
    source = Source(name, f"{seed:064x}", samples, ("five-point cubic smoothing, 10 times",))
    raw = seen + generator.normal(0, noise, torque.shape)
    return Log(model.robot.joint_names, time, q, dq, ddq, seen, raw_torque=raw, source=source)


def predicted(estimate: Estimate, logs: Sequence[Log]) -> Validation:
    """Return the validation of an estimate on prepared logs."""
    return _compared(estimate.model, estimate.base.to_standard(estimate.beta), logs, estimate.preprocessing)


def _compared(model: DynamicModel, theta: Array, logs: Sequence[Log], how: Preprocessing) -> Validation:
    predictions = [model.torque(Motion(log.q, log.dq, log.ddq), theta) for log in logs]  # type: ignore[arg-type]
    moving = [np.abs(np.asarray(log.dq)) > 0.02 for log in logs]
    return compare_torques(logs, predictions, moving, model.robot.units, 0.02, how.statement())


def subject_of(
    robot: Robot | None = None,
    samples: int = 1500,
    rate: float = 100.0,
    friction: tuple[str, ...] = ("coulomb", "viscous", "offset"),
    logs: Sequence[str] = ("runs/train.csv",),
    consistent: bool = True,
    standard: bool = True,
    noise: float = 0.4,
    provenance: Mapping[str, Any] | None = None,
) -> tuple[Estimate, Validation]:
    """Return an estimate near its truth, with the deviations that such noise leaves, and a test of it."""
    robot = robot or arm()
    model = DynamicModel(robot, friction)  # type: ignore[arg-type]
    base = base_parameters(model)
    nominal = model.nominal()
    assert nominal is not None
    size = {"Fc": 4.0, "Fv": 6.0, "F0": 0.3}
    theta = np.array([size.get(p.symbol, v) for p, v in zip(model.parameters, nominal, strict=True)])
    made = [recorded(model, theta, samples, rate, seed, name, noise) for seed, name in enumerate(logs)]
    log = made[0]
    rows = model.regressor(Motion(log.q[::20], log.dq[::20], log.ddq[::20]))[..., base.independent]  # type: ignore[index]
    stacked = rows.reshape(-1, base.count)
    covariance = noise**2 * np.linalg.pinv(stacked.T @ stacked)
    generator = np.random.default_rng(7)
    values, directions = np.linalg.eigh(covariance)
    spread = (directions * np.sqrt(np.maximum(values, 0.0))) @ directions.T  # whatever the signs of the directions
    beta = base.from_standard(theta) + spread @ generator.normal(size=base.count)
    how = Preprocessing(FILTERS.make("five_point"), standstill=0.02)
    train = _compared(model, base.to_standard(beta), made, how)
    reasons = () if consistent else ("link1: the mass is -2 kg", "Fc[joint1] = -0.1 N m is negative")
    estimate = Estimate(
        model=model,
        base=base,
        beta=beta,
        covariance=covariance,
        theta=theta if standard else None,
        joint_deviations=np.std(train.residual, axis=0),
        correlation_factors=np.full(robot.dof, 1.7),
        condition_number=48.3,
        samples=train.samples,
        inertial_base_parameters=base_parameters(model, inertial_only=True).count,
        estimator="abc",
        options={"colony": 30, "limit": 15, "seed": 0},
        consistency=Consistency(consistent, reasons, 0.031),
        train=train,
        preprocessing=how,
        run=MethodRun(trace=list(2.0 + 30 * np.exp(-np.arange(50) / 9)), optimum=1.9, gap=0.06),
        provenance={
            "versions": {"dynident": "0.1.0", "numpy": "2.4.6"},
            "logs": [vars(log.source) for log in made],
            "command": "dynident identify case.yaml --estimator abc",
            "log_quality": [examined(name) for name in logs],
            **(provenance or {}),
        },
    )
    return estimate, predicted(estimate, [recorded(model, theta, samples, rate, 99, "runs/test.csv", noise)])


def examined(log: str) -> dict[str, Any]:
    """Return findings on a log, as plain data."""
    finding = {
        "severity": "note",
        "name": "time jitter",
        "joint": "",
        "evidence": "steps of 8 to 13 ms around 10 ms",
        "remedy": "log the time of the measurement",
        "numbers": {"rms_share": 0.1},
    }
    return {"path": log, "sound": True, "left_out": "", "findings": [finding]}


def renamed(estimate: Estimate, validation: Validation, names: Sequence[str]) -> Validation:
    """Return the validation with the logs called otherwise."""
    return replace(validation, logs=tuple(names))


def plan_of(robot: Robot, **facts: Any) -> Plan:
    """Return a plan of a robot with three joints, with a run-in, checked against round bounds."""
    sine, cosine = 0.12 * np.random.default_rng(3).normal(size=(2, 3, 3))
    motion = FourierSeries(0.1 * np.ones(3), sine, cosine, 4.0)
    kinds = tuple(joint.kind == "revolute" for joint in robot.active)
    reach, free = 1.5 * np.ones(3), np.full(3, np.inf)
    acceleration = np.array([40.0, 40.0, np.inf])
    limits = MotionLimits(robot.joint_names, kinds, -reach, reach, 2 * reach, acceleration, free, 500 * np.ones(3))
    settings = {"noise": [1.0, 1.0, 2.0], "noise_source": "given", "seed": 4, "starts": 2, "samples": 50, **facts}
    draft = Plan(robot.name, motion, 1.0, "condition", {"condition": 12.5, "odd": 3.0}, limits, (), 601, settings)
    return replace(draft, rows=check_limits(draft.motion(), limits, draft.samples))
