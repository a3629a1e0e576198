"""The dynamics of a chain over many samples: the calls that the rest of the package uses.

Shapes: N samples, n joints, l links; q in rad or m, dq and ddq its derivatives, theta (10 l,) in SI units about the
link frames. Every call accepts N = 0 and ``threads``, which shares the samples among Python threads (the kernels hold
no interpreter lock). Nothing is compiled or imported from numba before the first call.
"""

from __future__ import annotations

import importlib
import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, IntArray
from dynident.errors import SolverFailed
from dynident.model.robot import Chain

#: Fewer samples than this are not worth a thread of their own.
SHARE = 512


def torque_regressor(chain: Chain, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, threads: int = 1) -> Array:
    """Return Y with tau = Y theta.

    Args:
        chain: The robot.
        q: Positions, shape (N, n).
        dq: Velocities, shape (N, n).
        ddq: Accelerations, shape (N, n).
        threads: Number of threads.

    Returns:
        Shape (N, n, 10 l), the columns of each link in the order of :data:`dynident.model.inertia.TEN`.

    Raises:
        ValueError: A shape is wrong.
    """
    q, dq, ddq = _samples(chain, q=q, dq=dq, ddq=ddq)
    size = chain.links
    out = np.empty((len(q), size * 10 * size))
    tables = _tables(chain)
    _share(len(q), threads, lambda s: _loops().regressor(*tables, q[s], dq[s], ddq[s], out[s]))
    rows = out.reshape(len(q), size, 10 * size)
    if np.array_equal(chain.joint, np.arange(chain.joints)):
        return rows
    summed = np.zeros((len(q), chain.joints, 10 * size))
    for link, joint in enumerate(chain.joint):
        summed[:, joint] += rows[:, link]
    return summed


def inverse_dynamics(
    chain: Chain, theta: npt.ArrayLike, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, threads: int = 1
) -> Array:
    """Return the joint torques tau = M ddq + c + g, shape (N, n), in N m or N.

    Args:
        chain: The robot.
        theta: Inertial parameters, shape (10 l,); physical or not.
        q: Positions, shape (N, n).
        dq: Velocities, shape (N, n).
        ddq: Accelerations, shape (N, n).
        threads: Number of threads.

    Raises:
        ValueError: A shape is wrong.
    """
    q, dq, ddq = _samples(chain, q=q, dq=dq, ddq=ddq)
    theta = _parameters(chain, theta)
    out = np.empty((len(q), chain.joints))
    tables = _tables(chain)
    _share(len(q), threads, lambda s: _loops().inverse_dynamics(*tables, theta, q[s], dq[s], ddq[s], out[s]))
    return out


def mass_matrix(chain: Chain, theta: npt.ArrayLike, q: npt.ArrayLike, threads: int = 1) -> Array:
    """Return the joint-space mass matrices M(q), shape (N, n, n), symmetric.

    Args:
        chain: The robot.
        theta: Inertial parameters, shape (10 l,); physical or not.
        q: Positions, shape (N, n).
        threads: Number of threads.

    Raises:
        ValueError: A shape is wrong.
    """
    (q,) = _samples(chain, q=q)
    theta = _parameters(chain, theta)
    out = np.empty((len(q), chain.joints, chain.joints))
    links, reals, _ = _tables(chain)
    _share(len(q), threads, lambda s: _loops().mass_matrix(links, reals, theta, q[s], out[s]))
    return out


def forward_dynamics(
    chain: Chain,
    theta: npt.ArrayLike,
    q: npt.ArrayLike,
    dq: npt.ArrayLike,
    tau: npt.ArrayLike,
    armature: npt.ArrayLike | None = None,
    threads: int = 1,
) -> Array:
    """Return the accelerations ddq with (M + armature) ddq + c + g = tau, shape (N, n), in rad/s^2 or m/s^2.

    The system is solved by LU, so that a mass matrix that is not positive definite (non-physical parameters) works.

    Args:
        chain: The robot.
        theta: Inertial parameters, shape (10 l,); physical or not.
        q: Positions, shape (N, n).
        dq: Velocities, shape (N, n).
        tau: Joint torques, shape (N, n).
        armature: Added to the mass matrix (rotor inertia seen at the joints), shape (n, n); None for none.
        threads: Number of threads.

    Raises:
        ValueError: A shape is wrong.
        SolverFailed: The mass matrix of a sample is singular or not finite.
    """
    q, dq, tau = _samples(chain, q=q, dq=dq, tau=tau)
    theta = _parameters(chain, theta)
    size = chain.joints
    added = np.zeros((size, size)) if armature is None else np.array(armature, dtype=np.float64)
    if added.shape != (size, size):
        raise ValueError(f"armature has shape {added.shape}, expected {(size, size)}")
    added.setflags(write=False)
    out = np.empty((len(q), size))
    tables = _tables(chain)

    def work(s: slice) -> None:
        failed = _loops().forward_dynamics(*tables, theta, added, q[s], dq[s], tau[s], out[s])
        if failed >= 0:
            sample = s.start + failed
            raise SolverFailed(
                "forward dynamics",
                f"the mass matrix of sample {sample} is singular or not finite, q = {np.round(q[sample], 6).tolist()}",
                "check the inertial parameters: a joint moves no inertia there (a known rotor inertia would help)",
            )

    _share(len(q), threads, work)
    return out


def link_poses(chain: Chain, q: npt.ArrayLike, threads: int = 1) -> tuple[Array, Array]:
    """Return the poses of the link frames in the base frame.

    Args:
        chain: The robot.
        q: Positions, shape (N, n).
        threads: Number of threads.

    Returns:
        Rotations (N, l, 3, 3) and translations (N, l, 3) in m.

    Raises:
        ValueError: A shape is wrong.
    """
    (q,) = _samples(chain, q=q)
    rotations, translations = np.empty((len(q), chain.links, 3, 3)), np.empty((len(q), chain.links, 3))
    links, reals, _ = _tables(chain)
    _share(len(q), threads, lambda s: _loops().link_poses(links, reals, q[s], rotations[s], translations[s]))
    return rotations, translations


class JointColumns:
    """Chosen columns of the regressor, joint by joint, without the entries that are zero at every motion.

    The fast path that identification streams through: sample index fastest, in chunks that the caller sizes (some
    hundred samples stay in the processor's cache).

    Attributes:
        chain: The robot.
        wanted: Indices of the wanted columns among the 10 l standard ones, shape (b,).
        columns: Per joint, the positions in ``wanted`` that are not structurally zero on that joint's row.
    """

    def __init__(self, chain: Chain, columns: npt.ArrayLike) -> None:
        """Choose columns of the regressor of ``chain``.

        Args:
            chain: The robot.
            columns: Indices into the 10 l standard columns, each at most once; any order.

        Raises:
            ValueError: An index is out of range or stands twice.
        """
        self.chain = chain
        self.wanted = _indices(columns, 10 * chain.links)
        moved = np.zeros((chain.joints, chain.links), dtype=bool)
        for link, other in itertools.product(range(chain.links), repeat=2):
            moved[chain.joint[link], other] |= _carries(chain, link, other)
        self.columns: tuple[IntArray, ...] = tuple(np.flatnonzero(row[self.wanted // 10]) for row in moved)
        self._ends = np.cumsum([len(found) for found in self.columns])[:-1]
        self._rows = sum(len(found) for found in self.columns)
        self._entries = self._places()
        self._used = np.zeros(chain.links, dtype=np.int64)
        self._used[self.wanted // 10] = 1
        for array in (self._entries, self._used):
            array.setflags(write=False)

    def buffers(self, samples: int) -> tuple[Array, ...]:
        """Return empty buffers for ``out``: one array (K_i, samples) per joint."""
        return tuple(np.empty((len(found), samples)) for found in self.columns)

    def evaluate(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, out: Sequence[Array] | None = None
    ) -> tuple[Array, ...]:
        """Return the entries of the regressor: per joint i an array (K_i, N), row k for ``columns[i][k]``.

        Args:
            q: Positions, shape (N, n).
            dq: Velocities, shape (N, n).
            ddq: Accelerations, shape (N, n).
            out: Where to write: one C-contiguous float64 array (K_i, N) per joint; fresh ones if None.

        Raises:
            ValueError: A shape, type or order is wrong.
        """
        q, dq, ddq = _samples(self.chain, q=q, dq=dq, ddq=ddq)
        blocks = self.buffers(len(q)) if out is None else self._checked(out, len(q))
        stacked = np.empty((self._rows, len(q)))
        _loops().columns(*_tables(self.chain), self._entries, self._used, q, dq, ddq, stacked)
        for block, part in zip(blocks, np.split(stacked, self._ends), strict=True):
            block[:] = part
        return blocks

    def _places(self) -> IntArray:
        """Return (row of the stacked blocks, entry of the link regressor) for every link a joint moves, (k, 2)."""
        width, row, places = 10 * self.chain.links, 0, []
        for joint, found in enumerate(self.columns):
            for column in self.wanted[found]:
                movers = np.flatnonzero(self.chain.joint == joint)
                places += [
                    (row, link * width + column)
                    for link in movers
                    if _carries(self.chain, int(link), int(column) // 10)
                ]
                row += 1
        return np.array(places, dtype=np.int64).reshape(-1, 2)

    def _checked(self, out: Sequence[Array], samples: int) -> tuple[Array, ...]:
        wanted = [(len(found), samples) for found in self.columns]
        if [block.shape for block in out] != wanted:
            raise ValueError(f"out has the shapes {[block.shape for block in out]}, expected {wanted}")
        for joint, block in enumerate(out):
            if not (block.flags.c_contiguous and block.flags.writeable and block.dtype == np.float64):
                raise ValueError(f"out[{joint}] must be a writeable C-contiguous float64 array")
        return tuple(out)


def _loops() -> Any:
    """Return the compiled loops; numba is imported here, on the first call."""
    return importlib.import_module("dynident.model.kernels.generic_batches")


def _tables(chain: Chain) -> tuple[IntArray, Array, Array]:
    return importlib.import_module("dynident.model.kernels.generic").pack(chain)


def _samples(chain: Chain, **arrays: npt.ArrayLike) -> list[Array]:
    """Return the arrays as read-only C-contiguous float64 views (N, n), so that one compiled version serves all."""
    found = []
    length: int | None = None
    for name, values in arrays.items():
        array = np.ascontiguousarray(values, dtype=np.float64).view()
        if array.ndim != 2 or array.shape[1] != chain.joints or length not in (None, len(array)):
            rows = "N" if length is None else str(length)
            raise ValueError(f"{name} has shape {array.shape}, expected ({rows}, {chain.joints})")
        length = len(array)
        array.setflags(write=False)
        found.append(array)
    return found


def _parameters(chain: Chain, theta: npt.ArrayLike) -> Array:
    array = np.ascontiguousarray(theta, dtype=np.float64).view()
    if array.shape != (10 * chain.links,):
        raise ValueError(f"theta has shape {array.shape}, expected ({10 * chain.links},)")
    array.setflags(write=False)
    return array


def _indices(columns: npt.ArrayLike, limit: int) -> IntArray:
    """Return the wanted columns as a read-only int array, checked."""
    given = np.asarray(columns)
    array = np.array(given, dtype=np.int64)
    if array.ndim != 1 or (array.size and not np.array_equal(array, given)):
        raise ValueError(f"columns must be a list of whole numbers, got shape {given.shape} of {given.dtype}")
    if array.size and (array.min() < 0 or array.max() >= limit):
        raise ValueError(f"columns reach from {array.min()} to {array.max()}, expected 0 to {limit - 1}")
    if len(np.unique(array)) != len(array):
        raise ValueError("a column stands twice in columns")
    array.setflags(write=False)
    return array


def _carries(chain: Chain, link: int, other: int) -> bool:
    """Say whether the joint of ``link`` moves the link ``other``."""
    while other > link:
        other = int(chain.parent[other])
    return other == link


def _share(samples: int, threads: int, work: Callable[[slice], None]) -> None:
    """Call ``work`` on slices that cover the samples, on up to ``threads`` threads."""
    if threads < 1:
        raise ValueError(f"threads is {threads}, expected 1 or more")
    parts = min(threads, max(1, samples // SHARE), os.cpu_count() or 1)
    if parts == 1:
        work(slice(0, samples))
        return
    edges = np.linspace(0, samples, parts + 1).astype(int)
    with ThreadPoolExecutor(parts) as pool:
        for done in [pool.submit(work, slice(int(a), int(b))) for a, b in itertools.pairwise(edges)]:
            done.result()
