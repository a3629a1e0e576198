"""JointColumns: chosen columns of the regressor, joint by joint, for streaming."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, IntArray
from dynident.model.kernels.compiled import Kernel, kept, kernel
from dynident.model.kernels.emit import Access, Buffer, Layout
from dynident.model.kernels.generated import by_sample, chain_key, is_small
from dynident.model.kernels.inputs import column_indices, kernel_choice, samples
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Scalar, TracedProgram, gradient
from dynident.model.robot import Chain

_MOTION = ("q", "dq", "ddq")


class JointColumns:
    """Chosen columns of the regressor, joint by joint, without the entries that are zero at every motion.

    The fast path that identification streams through: sample index fastest, in chunks that the caller sizes. Chunks of
    200 to 1000 samples stay in the processor's cache; their number should not be a power of two, which would put the
    rows of a block on the same cache lines.

    Attributes:
        chain: The robot.
        wanted: Indices of the wanted columns among the 10 l standard ones, shape (b,).
        columns: Per joint, the positions in ``wanted`` that are not structurally zero on that joint's row.
        any_gravity: Whether robots that differ in their gravity alone share these columns and their machine code.
    """

    def __init__(self, chain: Chain, columns: npt.ArrayLike, any_gravity: bool = False) -> None:
        """Choose columns of the regressor of ``chain``.

        Args:
            chain: The robot.
            columns: Indices into the 10 l standard columns, each at most once; any order.
            any_gravity: See above; a few operations more, worth it where several directions of gravity are tried.

        Raises:
            ValueError: An index is out of range or stands twice.
        """
        self.chain, self.wanted = chain, column_indices(columns, 10 * chain.links)
        self.any_gravity = any_gravity
        width = 10 * chain.links
        self._program = kept(("program", *self._key), lambda: _moving_entries(chain, self.wanted, any_gravity))
        used = self._program.outputs.keys()
        self._is_small = is_small(self._program)
        found = [[k for k, c in enumerate(self.wanted) if j * width + c in used] for j in range(chain.joints)]
        self.columns: tuple[IntArray, ...] = tuple(np.array(row, dtype=np.int64) for row in found)
        self._places = {
            int(j * width + self.wanted[k]): (j, row) for j, kept in enumerate(found) for row, k in enumerate(kept)
        }

    def __reduce__(self) -> tuple[type[JointColumns], tuple[Chain, IntArray, bool]]:
        return JointColumns, (self.chain, self.wanted, self.any_gravity)  # machine code stays in its process

    def buffers(self, count: int) -> tuple[Array, ...]:
        """Return empty buffers for ``out``: one array (K_i, count) per joint."""
        return tuple(np.empty((len(found), count)) for found in self.columns)

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
        motion = samples(self.chain, {"q": q, "dq": dq, "ddq": ddq})
        count = len(motion[0])
        blocks = self.buffers(count) if out is None else self._checked(out, count, "out")
        kernel = self._kernel()
        if kernel is None:
            self._evaluate_generic(motion, blocks)
        else:
            kernel.run([*motion, self.chain.gravity] if self.any_gravity else motion, blocks, count)
        return blocks

    def pullback(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, weights: Sequence[Array]
    ) -> tuple[Array, Array, Array]:
        """Return the derivatives by q, dq and ddq of the weighted sum of all entries, each (N, n).

        Exact, by reverse accumulation, at less than twice the cost of :meth:`evaluate`: the gradient of any criterion
        of the columns follows from its derivative by the entries. Always generated, whatever the size.

        Args:
            q: Positions, shape (N, n).
            dq: Velocities, shape (N, n).
            ddq: Accelerations, shape (N, n).
            weights: Derivative of the criterion by each entry, arrays (K_i, N) as :meth:`evaluate` returns them.

        Raises:
            ValueError: A shape, type or order is wrong.
        """
        motion = samples(self.chain, {"q": q, "dq": dq, "ddq": ddq})
        count = len(motion[0])
        found = (np.empty_like(motion[0]), np.empty_like(motion[0]), np.empty_like(motion[0]))
        assert self._pullback is not None  # its size is not limited
        self._pullback.run([*motion, *self._checked(weights, count, "weights")], found, count)
        return found

    def _kernel(self) -> Kernel | None:
        """Return the generated kernel, or None where the generic one is to be used."""
        choice = kernel_choice()
        generated = choice == "generated" or (choice == "auto" and self._is_small)
        return self._generated if generated else None

    @cached_property
    def _generated(self) -> Kernel | None:
        return kernel(("columns", *self._key), lambda: (self._program, self._layout()))

    @cached_property
    def _pullback(self) -> Kernel | None:
        return kernel(("pullback", *self._key, chain_key(self.chain)), self._gradient)

    @cached_property
    def _key(self) -> tuple[object, ...]:
        chain = replace(self.chain, gravity=np.zeros(3)) if self.any_gravity else self.chain
        return self.wanted.tobytes(), self.any_gravity, chain_key(chain)

    def _layout(self) -> Layout:
        rows = tuple(Buffer(f"joint{j}", Access.BY_ROW) for j in range(self.chain.joints))
        names = (*_MOTION, "gravity") if self.any_gravity else _MOTION
        return Layout(by_sample(self.chain, names), rows, self._places)

    def _gradient(self) -> tuple[TracedProgram, Layout]:
        """Return the program of :meth:`pullback`."""
        joints = range(self.chain.joints)
        traced = TracedChain(self.chain)
        trace = traced.trace
        values = {slot: v for slot, v in traced.regressor(self.wanted).items() if slot in self._places}
        weights = {slot: trace.input(f"weight{joint}", row) for slot, (joint, row) in self._places.items()}
        inputs: list[Scalar] = [trace.input(name, joint) for name in _MOTION for joint in joints]
        slopes = gradient(trace, values, weights, inputs)
        program = trace.program(dict(enumerate(slopes)))
        rows = tuple(Buffer(f"weight{j}", Access.BY_ROW) for j in joints)
        outputs = tuple(Buffer(f"by_{name}", Access.BY_SAMPLE, self.chain.joints) for name in _MOTION)
        places = {slot: divmod(slot, self.chain.joints) for slot in program.outputs}
        return program, Layout((*by_sample(self.chain, _MOTION), *rows), outputs, places)

    def _evaluate_generic(self, motion: Sequence[Array], blocks: Sequence[Array]) -> None:
        """Write the blocks with the generic kernel."""
        from dynident.model.kernels import generic_batches  # numba loads with the first call

        q, dq, ddq = motion
        links, reals, gravity, entries = self._tables
        stacked = np.empty((sum(len(block) for block in blocks), len(q)))
        generic_batches.columns(links, reals, gravity, entries, q, dq, ddq, stacked)
        start = 0
        for block in blocks:
            block[:] = stacked[start : start + len(block)]
            start += len(block)

    @cached_property
    def _tables(self) -> tuple[IntArray, Array, Array, IntArray]:
        """The first four arguments of the generic kernel."""
        from dynident.model.kernels.generic import pack

        starts = np.cumsum([0, *(len(found) for found in self.columns)])
        width = 10 * self.chain.links
        entries = [
            (starts[joint] + row, link * width + slot % width)
            for slot, (joint, row) in self._places.items()
            for link in np.flatnonzero(self.chain.joint == joint)
        ]
        places = np.array(entries, dtype=np.int64).reshape(-1, 2)
        places.setflags(write=False)
        return (*pack(self.chain), places)

    def _checked(self, arrays: Sequence[Array], count: int, name: str) -> tuple[Array, ...]:
        shapes, wanted = [array.shape for array in arrays], [(len(found), count) for found in self.columns]
        if shapes != wanted:
            raise ValueError(f"{name} has the shapes {shapes}, expected {wanted}")
        for joint, array in enumerate(arrays):
            flags = array.flags
            if not (flags.c_contiguous and array.dtype == np.float64 and (flags.writeable or name != "out")):
                raise ValueError(
                    f"{name}[{joint}] must be a C-contiguous float64 array{', writeable' * (name == 'out')}"
                )
        return tuple(arrays)


def _moving_entries(chain: Chain, wanted: IntArray, any_gravity: bool) -> TracedProgram:
    """Return the program of the entries of the regressor that are not zero at every motion, nor in every gravity."""
    traced = TracedChain(chain, reads={"gravity": "gravity"} if any_gravity else None)
    values = traced.regressor(wanted)
    draft = traced.trace.program(values)
    used = draft.outputs.keys() - draft.rounding_only(_random_motion(chain.joints))
    return traced.trace.program({slot: values[slot] for slot in sorted(used)})


def _random_motion(joints: int) -> dict[str, Array]:
    """Return a few states at which an entry of the regressor that can move does; the same ones each time."""
    random = np.random.default_rng(20)
    found: dict[str, Array] = {name: random.uniform(-3.0, 3.0, (joints, 12)) for name in _MOTION}
    return found | {"gravity": random.uniform(-3.0, 3.0, (3, 12))}
