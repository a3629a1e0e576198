"""How fast the tool point moves, with its derivatives: what a limit on the tool speed is checked with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, frozen
from dynident.excitation.collision.workspace import Workspace
from dynident.model.chain import PRISMATIC, Chain
from dynident.model.kernels.batched import link_poses
from dynident.model.kernels.inputs import samples
from dynident.model.robot import Robot

#: Below this speed, in m/s, the tool point stands still and the derivative of its speed is taken as zero.
STILL = 1e-12


@dataclass(frozen=True)
class ToolPoint:
    """A point fixed to a link.

    Attributes:
        chain: The kinematics.
        link: The link that carries it, -1 the base.
        offset: The point in the frame of that link, shape (3,), in m.
    """

    chain: Chain
    link: int
    offset: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", frozen(self.offset, (3,), "offset"))

    def position(self, q: npt.ArrayLike) -> Array:
        """Return the point in the base frame, shape (N, n) -> (N, 3), in m."""
        (q,) = samples(self.chain, {"q": q})
        if self.link < 0:
            return np.tile(self.offset, (len(q), 1))
        rotations, translations = link_poses(self.chain, q)
        return rotations[:, self.link] @ self.offset + translations[:, self.link]

    def speed(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> Array:
        """Return the speed of the point, shape (N,), in m/s.

        Args:
            q: Positions, shape (N, n).
            dq: Velocities, shape (N, n).
        """
        q, dq = samples(self.chain, {"q": q, "dq": dq})
        _, columns = self._jacobian(q)
        return np.linalg.norm(self._velocity(columns, dq), axis=1)

    def gradient(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> tuple[Array, Array]:
        """Return the derivatives of :meth:`speed` by q and by dq, shape (N, n) each.

        A column J_i of the Jacobian turns with a revolute joint k at or before i, by z_k x J_i; where k comes after i,
        the point of a revolute joint i moves, by z_i x J_k (Siciliano et al. 2009, section 3.1, differentiated).

        Args:
            q: Positions, shape (N, n).
            dq: Velocities, shape (N, n).
        """
        q, dq = samples(self.chain, {"q": q, "dq": dq})
        axes, columns = self._jacobian(q)
        velocity = self._velocity(columns, dq)
        size = np.linalg.norm(velocity, axis=1, keepdims=True)
        towards = np.where(size > STILL, velocity / np.where(size > STILL, size, 1.0), 0.0)
        by_q, by_dq = np.zeros_like(q), np.zeros_like(q)
        rest, turning = velocity, np.zeros_like(velocity)  # of the joints from k on; of those before k
        for link, column in columns.items():
            joint, factor = int(self.chain.joint[link]), float(self.chain.multiplier[link])
            rate = factor * dq[:, joint, None]
            change = np.cross(turning, column)
            if self.chain.kind[link] != PRISMATIC:
                change += np.cross(axes[link], rest)
                turning = turning + rate * axes[link]
            rest = rest - rate * column
            by_q[:, joint] += factor * np.sum(towards * change, axis=1)
            by_dq[:, joint] += factor * np.sum(towards * column, axis=1)
        return by_q, by_dq

    def _jacobian(self, q: Array) -> tuple[Mapping[int, Array], Mapping[int, Array]]:
        """Return axis and column (N, 3) of each link between base and point, base first."""
        path, link = [], self.link
        while link >= 0:
            path.append(link)
            link = int(self.chain.parent[link])
        rotations, translations = link_poses(self.chain, q)
        point = self.position(q)
        axes = {link: rotations[:, link] @ self.chain.axis[link] for link in reversed(path)}
        columns = {
            link: axis if self.chain.kind[link] == PRISMATIC else np.cross(axis, point - translations[:, link])
            for link, axis in axes.items()
        }
        return axes, columns

    def _velocity(self, columns: Mapping[int, Array], dq: Array) -> Array:
        total = np.zeros((len(dq), 3))
        for link, column in columns.items():
            total += self.chain.multiplier[link] * dq[:, self.chain.joint[link], None] * column
        return total


def tool_point_of(robot: Robot, workspace: Workspace) -> ToolPoint:
    """Return the tool point of a robot in its workspace.

    Raises:
        UnknownChoice: The tool names no link or frame.
    """
    frame = workspace.tool_frame(robot)
    offset = np.zeros(3) if workspace.tool is None else workspace.tool.offset
    return ToolPoint(robot.chain, frame.link, frame.rotation @ offset + frame.translation)
