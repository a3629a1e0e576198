"""The robots of a fleet: each an estimate file or a triangle file, all of one model."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynident.applications.fleet.population import Member
from dynident.arrays import Array
from dynident.diagnosis.earlier import deviations_left, fit_determined
from dynident.errors import BadOption
from dynident.excitation.design.prior import prior_of_covariance
from dynident.identification.consistency.consistent_fit import scale_of
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimators.consistent import Consistent
from dynident.identification.files.saved_values import model_to_dict
from dynident.identification.problem.estimator import Solution
from dynident.identification.problem.prior import Scale, natural_scale
from dynident.identification.problem.problem import Problem
from dynident.identification.streaming.digest import Digest
from dynident.identification.streaming.estimate import assembled
from dynident.identification.streaming.stretch_statistics import StretchStatistics
from dynident.model.base_parameters import BaseParameters
from dynident.model.dynamic_model import DynamicModel

#: How the difference of two robots begins that were estimated with other friction.
_OTHER_FRICTION = "other friction than"


@dataclass(frozen=True)
class FleetRobot:
    """One robot.

    Attributes:
        name: In the results.
        member: What its log says.
        own: Its own estimate; None for triangles, which need not determine all base parameters.
        digest: Its triangles; None for an estimate.
    """

    name: str
    member: Member
    own: Estimate | None = None
    digest: Digest | None = None

    @property
    def model(self) -> DynamicModel:
        """Robot, drives and friction."""
        return self.own.model if self.own is not None else self._digest.model

    @property
    def base(self) -> BaseParameters:
        """Its base parameters."""
        return self.own.base if self.own is not None else self._digest.base

    @property
    def rows(self) -> int:
        """Samples of its log, all joints."""
        if self.own is not None:
            return self.own.samples * self.model.robot.dof
        return sum(joint.triangle.rows for joint in self._digest.joints)

    @property
    def contents(self) -> frozenset[str]:
        """Hashes of the logs that it stands on."""
        if self.own is not None:
            return frozenset(str(log["sha256"]) for log in self.own.provenance.get("logs", ()) if log.get("sha256"))
        return frozenset(chunk.sha256 for chunk in self._digest.chunks)

    @property
    def _digest(self) -> Digest:
        assert self.digest is not None  # a robot has the one or the other
        return self.digest

    @property
    def scale(self) -> Scale:
        """Natural sizes of the standard parameters."""
        if self.own is None:
            return scale_of(_problem(self._digest))
        seen = self.own.envelope
        torque = np.sqrt(np.mean(np.asarray(self.own.train.measured) ** 2, axis=0))
        accelerations = np.ones(len(torque)) if seen is None else 0.35 * (seen.high[2] - seen.low[2])
        return natural_scale(self.model, torque, accelerations)

    def estimate(self, beta: Array, covariance: Array, theta: Array) -> Estimate:
        """Return the robot's estimate with other parameters, shapes (b,), (b, b) and (p,).

        From triangles the figures of the fit are those of these parameters; from an estimate those of its own fit.
        """
        if self.own is not None:
            return replace(
                self.own, beta=beta, covariance=covariance, theta=theta, diagnostics=None, standard_deviations=None
            )
        problem = _problem(self._digest)
        weights = 1.0 / problem.joint_deviations(beta)
        return assembled(
            self._digest, problem, Consistent(bodies="free"), Solution(beta, weights, theta, covariance), {}
        )


def robot_of_estimate(name: str, estimate: Estimate) -> FleetRobot:
    """Return a robot from its estimate.

    Raises:
        BadOption: The covariance of the estimate is singular.
    """
    known = prior_of_covariance(estimate.covariance, estimate.beta, name)
    return FleetRobot(name, Member(name, known.information, known.information @ estimate.beta), own=estimate)


def robot_of_digest(name: str, digest: Digest) -> FleetRobot:
    """Return a robot from its triangles; each joint's rows count as what its residual makes them worth."""
    problem, left = _problem(digest), StretchStatistics(digest)
    noise, beta = np.ones(len(problem.triangles)), np.zeros(digest.base.count)
    for _ in range(2):
        beta, rank = fit_determined(problem.triangles, digest.base, noise)
        noise = deviations_left(problem.triangles, beta, rank)
    reduced = problem.reduced(1.0 / (noise * np.sqrt(left.factors(beta))))
    return FleetRobot(name, Member(name, reduced.r.T @ reduced.r, reduced.r.T @ reduced.z), digest=digest)


def _problem(digest: Digest) -> Problem:
    triangles = tuple(joint.triangle for joint in digest.joints)
    return Problem(digest.model, digest.base, (), (), triangles, left=StretchStatistics(digest))


def check_alike(robots: Sequence[FleetRobot]) -> None:
    """Refuse a fleet of different robots, of one robot twice, or of too few.

    Raises:
        BadOption: Which robot does not go with the first, and in what.
    """
    if len(robots) < 2:
        step = "a fleet has two or more robots of one type; one alone is what 'dynident identify' is for"
        raise BadOption("robots", len(robots), step)
    first = robots[0]
    named: set[str] = set()
    logs: dict[str, str] = {}
    for robot in robots:
        if robot.name in named:
            raise BadOption("robots", robot.name, "two files have this name; give each robot a file name of its own")
        named.add(robot.name)
        for content in robot.contents:
            if content in logs:
                evidence = f"{robot.name}, which stands on a log that {logs[content]} stands on too"
                step = "give each robot once: identify it from all of its logs, or merge their QR factors"
                raise BadOption("robots", evidence, step)
            logs[content] = robot.name
        difference = _difference(first, robot)
        if difference:
            step = "a fleet is of one type of robot, identified with one description and one friction"
            step = _one_friction(robots) if difference.startswith(_OTHER_FRICTION) else step
            raise BadOption("robots", f"{robot.name}, which has {difference}", step)


def _one_friction(robots: Sequence[FleetRobot]) -> str:
    """Return how the friction of a fleet becomes one: by the case line of the robot with most parts."""
    most = max(robots, key=lambda robot: len(robot.model.friction))
    parts = list[str]()
    for part in model_to_dict(most.model)["friction"]:
        ((name, options),) = part.items()
        options = {key: _rounded(value) for key, value in options.items() if value is not None and key != "choose"}
        values = ", ".join(f"{key}: {json.dumps(value)}" for key, value in options.items())
        parts.append(f"{{{name}: {{{values}}}}}" if values else name)
    line = f"friction: [{', '.join(parts)}]"
    return f"a draft chooses friction by each log; state that of {most.name} in all cases and estimate again: {line}"


def _rounded(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value


def _difference(first: FleetRobot, robot: FleetRobot) -> str:
    """Return in words in what the model of a robot is another one than that of the first; empty where it is not."""
    one, other = model_to_dict(first.model), model_to_dict(robot.model)
    if one["friction"] != other["friction"]:
        kinds = [" ".join(dict.fromkeys(name for part in each["friction"] for name in part)) for each in (one, other)]
        told = f": {kinds[1] or 'none'}, there {kinds[0] or 'none'}" if kinds[0] != kinds[1] else " in its fields"
        return f"{_OTHER_FRICTION} {first.name}{told}"
    ours, theirs = first.model.robot, robot.model.robot
    if ours.joint_names != theirs.joint_names:
        return f"other joints than {first.name}: {', '.join(theirs.joint_names)}, there {', '.join(ours.joint_names)}"
    if ours.units != theirs.units:
        return f"torques in other units than {first.name}: {', '.join(theirs.units)}, there {', '.join(ours.units)}"
    if first.base.names != robot.base.names:
        odd = next(name for name in robot.base.names + first.base.names if name not in _shared(first, robot))
        return f"other base parameters than {first.name}, such as {odd}: another geometry, gravity or mounting"
    alike = np.allclose(first.base.matrix, robot.base.matrix, rtol=1e-6, atol=1e-9)
    return "" if alike else f"another geometry than {first.name}"


def _shared(first: FleetRobot, robot: FleetRobot) -> set[str]:
    return set(first.base.names) & set(robot.base.names)
