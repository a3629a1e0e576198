"""Random arms, and the same arms built in Pinocchio and MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.model.inertia import Inertia
from dynident.model.robot import PRISMATIC, Chain

#: Shape of an arm: links, does it branch, share of prismatic joints.
SHAPES = {
    "pendulum": (1, False, 0.0),
    "slide": (1, False, 1.0),
    "six revolute": (6, False, 0.0),
    "mixed": (5, False, 0.4),
    "tree": (7, True, 0.3),
}


@dataclass(frozen=True)
class Arm:
    """A random arm: its chain and one possible body per link."""

    chain: Chain
    bodies: tuple[Inertia, ...]

    @property
    def theta(self) -> Array:
        return np.concatenate([body.vector for body in self.bodies])

    def states(self, count: int, seed: int = 1) -> tuple[Array, Array, Array]:
        """Return random q, dq, ddq (count, n)."""
        random = np.random.default_rng(seed)
        return tuple(random.normal(scale=2.0, size=(3, count, self.chain.joints)))


def random_arm(links: int, branches: bool, prismatic: float, seed: int = 0) -> Arm:
    """Return an arm with any axes and placements; links are numbered depth first, as Pinocchio wants them."""
    random = np.random.default_rng([links, seed])
    parents = [-1]
    for i in range(1, links):
        carriers = [i - 1]
        while carriers[-1] >= 0:
            carriers.append(parents[carriers[-1]])
        parents.append(int(random.choice(carriers)) if branches else i - 1)
    turns = np.linalg.qr(random.normal(size=(links, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    axes = random.normal(size=(links, 3))
    chain = Chain(
        parent=np.array(parents),
        kind=(random.random(links) < prismatic).astype(np.int64),
        rotation=turns,
        translation=random.normal(scale=0.4, size=(links, 3)),
        axis=axes / np.linalg.norm(axes, axis=1)[:, None],
        joint=np.arange(links),
        multiplier=np.ones(links),
        offset=np.zeros(links),
        gravity=np.array([1.0, -2.0, -9.0]),
        joints=links,
    )
    bodies = (Inertia.from_log_cholesky(random.normal(scale=0.4, size=10)) for _ in range(links))
    return Arm(chain, tuple(bodies))


def pinocchio_model(arm: Arm) -> tuple[Any, Any]:
    """Return Pinocchio and the arm as its model; skips where Pinocchio is not installed."""
    pin: Any = pytest.importorskip("pinocchio")
    chain, model = arm.chain, pin.Model()
    for i in range(chain.links):
        kind = pin.JointModelPrismaticUnaligned if chain.kind[i] == PRISMATIC else pin.JointModelRevoluteUnaligned
        place = pin.SE3(chain.rotation[i], chain.translation[i])
        number = model.addJoint(int(chain.parent[i]) + 1, kind(chain.axis[i]), place, f"j{i}")
        body = arm.bodies[i]
        inertia = pin.Inertia(body.mass, body.centre_of_mass, body.about_centre)
        model.appendBodyToJoint(number, inertia, pin.SE3.Identity())
    model.gravity.linear = chain.gravity
    return pin, model
