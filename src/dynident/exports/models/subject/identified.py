"""An estimate made ready for export: physically consistent standard parameters with the same base parameters."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dynident.arrays import Array
from dynident.diagnosis.culprit import culprit
from dynident.errors import NotConsistent
from dynident.exports.models.subject.source import OwnDescription
from dynident.identification.consistency.verdicts import broken_conditions, deepest_consistent, describe_reasons
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.inertia import Inertia
from dynident.robot_files.tree import weightless

#: Largest change of a base parameter, as a share of its terms, with which projected parameters are still the same.
SAME = 1e-9

#: Where theta is from.
OWN, PROJECTED, NONE = "of the estimate", "chosen behind its base parameters", "none"


@dataclass(frozen=True)
class Identified:
    """What exporters write.

    Attributes:
        estimate: The estimate.
        theta: Standard parameters behind its base parameters, shape (p,); possible bodies and friction >= 0 unless
            ``origin`` is none: then they are zero outside the base parameters.
        origin: Where theta is from: the estimate, chosen here behind its base parameters, or none.
        source: The robot model of the user; None where there is none.
    """

    estimate: Estimate
    theta: Array
    origin: str
    source: OwnDescription | None = None

    @property
    def model(self) -> DynamicModel:
        """The model of the estimate."""
        return self.estimate.model

    @cached_property
    def bodies(self) -> tuple[Inertia, ...]:
        """The inertia of each link about its frame, l of them."""
        return tuple(Inertia.from_vector(self.theta[10 * i : 10 * i + 10]) for i in range(len(self.model.robot.links)))

    @cached_property
    def between(self) -> frozenset[int]:
        """The links of next to no mass, shape and frame that only carry the next joint: both are of one body."""
        robot = self.model.robot
        names = [link.name for link in robot.links]
        light = weightless(dict(zip(names, self.bodies, strict=True)))
        held = [joint.parent for joint in robot.joints]
        marked = {frame.link for frame in robot.frames.values()}
        return frozenset(
            i
            for i, link in enumerate(robot.links)
            if link.name in light and held.count(i) == 1 and i not in marked and not link.shapes and not link.visuals
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader has to know about theta."""
        if self.origin != PROJECTED:
            return ()
        return (
            f"'{self.estimate.estimator}' gives no physically consistent links: these were chosen well inside the "
            "bounds, with the same base parameters; the torque is that of the estimate, single masses are not measured",
        )

    @property
    def slipped(self) -> tuple[str, ...]:
        """What the reader has to know about friction that remembers in a format without a memory."""
        parts = {FRICTION.name_of(own): own for own in self.model.friction if own.states and not own.needs_memory}
        lags = (
            "is there Coulomb friction at its full level; right after a reversal the torque differs by up to twice that"
        )
        cold = "adds nothing: friction is that at the start of a log"
        return tuple(
            f"{name}: a joint of this format has no history, so the part {lags if part.lags else cold}"
            for name, part in parts.items()
        )


def identified(estimate: Estimate, source: OwnDescription | None = None, needs_bodies: bool = True) -> Identified:
    """Return an estimate with possible standard parameters.

    Those of the estimate are taken where they are possible. Else some are chosen that have the same base parameters,
    deep inside the conditions P_i > 0 and friction >= 0 (Wensing, Kim and Slotine 2018, (12)).

    Args:
        estimate: The estimate.
        source: The robot model of the user.
        needs_bodies: Whether nothing can be exported without them.

    Raises:
        NotConsistent: They are needed, and no robot has these base parameters.
    """
    model, base = estimate.model, estimate.base
    if estimate.theta is not None and not broken_conditions(model, estimate.theta):
        return Identified(estimate, estimate.theta, OWN, source)
    theta = _projected(estimate)
    if theta is not None:
        return Identified(estimate, theta, PROJECTED, source)
    if not needs_bodies:
        return Identified(estimate, base.to_standard(estimate.beta), NONE, source)
    owner = culprit(model, base, estimate.beta) or culprit(model, base, estimate.beta, estimate.theta) or "the robot"
    known = broken_conditions(model, estimate.theta) if estimate.theta is not None else ()
    evidence = describe_reasons(known) or "these base parameters are physically inconsistent, most of all here"
    raise NotConsistent(owner, evidence, f"identify again with '{_command(estimate)}' and export that")


def _projected(estimate: Estimate) -> Array | None:
    """Return possible parameters with K theta = beta to rounding, shape (p,); None where there are none."""
    model, base, beta = estimate.model, estimate.base, np.asarray(estimate.beta)
    theta = deepest_consistent(model, base, beta)
    if theta is None:
        return None
    sizes = np.maximum(np.abs(theta), 1e-9 * np.abs(theta).max())
    scaled = base.matrix * sizes  # the solver leaves 1e-8 of K theta = beta: mended by the smallest relative change
    theta = theta + sizes * np.linalg.lstsq(scaled, beta - base.matrix @ theta)[0]
    left = np.abs(base.matrix @ theta - beta) / np.maximum(np.abs(base.matrix) @ np.abs(theta), 1e-300)
    signs = np.array([p.nonnegative for p in model.parameters])
    theta = np.where(signs & (theta < 0) & (theta > -SAME * sizes.max()), 0.0, theta)
    return theta if left.max() <= SAME and not broken_conditions(model, theta) else None


def _command(estimate: Estimate) -> str:
    """Return the command that gives a consistent estimate of the same case."""
    case = str(estimate.provenance.get("case", {}).get("path", "")) or "CASE"
    logs = [str(log.get("path") or "LOG") for log in estimate.provenance.get("logs", ())] or ["LOG"]
    named = [word if word in ("CASE", "LOG") else shlex.quote(word) for word in (case, *logs)]
    return f"dynident identify {' '.join(named)} --estimator consistent -o estimate.json"
