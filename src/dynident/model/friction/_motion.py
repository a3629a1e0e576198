"""The motion of the drives that friction columns see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from dynident.arrays import Array, IntArray


@dataclass(frozen=True)
class Motion:
    """What a friction column may see, at the drives (motor side where motors are coupled).

    Attributes:
        q: Positions, shape (N, n), in rad or m.
        dq: Velocities, shape (N, n), in rad/s or m/s.
        ddq: Accelerations, shape (N, n), in rad/s^2 or m/s^2.
        torque: Torque of the model without friction (rigid bodies and rotors), shape (N, n), in N m or N; None where
            not known.
        temperature: Temperature of each drive, shape (N, n), in degrees Celsius; None where the log has none.
        state: States of all friction parts in their order, shape (N, n, s); None where they are not known.
    """

    q: Array
    dq: Array
    ddq: Array
    torque: Array | None = None
    temperature: Array | None = None
    state: Array | None = None

    @cached_property
    def runs(self) -> list[tuple[list[float], IntArray, Array, Array]]:
        """Of each drive from reversal to reversal: ways between, samples, signs (r,); way of each sample since (N,)."""
        found = []
        for q in np.ascontiguousarray(self.q.T):
            starts = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(np.diff(q)))) + 1])
            turns, samples = q[starts], np.diff(starts, append=len(q))
            side = np.where(np.diff(turns, append=q[-1]) >= 0, 1.0, -1.0)
            found.append((np.diff(turns).tolist(), samples, side, np.abs(q - np.repeat(turns, samples))))
        return found

    def at_motors(self, coupling: Array) -> Motion:
        """Return the motion of the motors: positions, velocities and accelerations times C', torques times C^-1."""
        torque = None if self.torque is None else np.linalg.solve(coupling.T, self.torque.T).T
        moved = (self.q @ coupling.T, self.dq @ coupling.T, self.ddq @ coupling.T)
        return Motion(*moved, torque, self.temperature, self.state)

    def of_drives(self, drives: Sequence[int] | IntArray) -> Motion:
        """Return the motion of some of the drives, in the order given."""
        chosen = np.asarray(drives, dtype=np.int64)
        if np.array_equal(chosen, np.arange(self.q.shape[1])):
            return self  # with the runs that it may have made
        return self._each(lambda signal: signal[:, chosen])

    def rows(self, part: slice | IntArray) -> Motion:
        """Return the motion of some of the samples."""
        return self._each(lambda signal: signal[part])

    def _each(self, cut: Callable[[Array], Array]) -> Motion:
        known = (getattr(self, own.name) for own in fields(self))
        return Motion(*(None if signal is None else cut(signal) for signal in known))  # type: ignore[arg-type]
