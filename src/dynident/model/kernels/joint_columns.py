"""JointColumns: chosen columns of the regressor, joint by joint, for streaming."""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from dynident.arrays import Array, IntArray
from dynident.model.kernels.inputs import column_indices, kernel_choice, samples
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Scalar, gradient, is_zero
from dynident.model.robot import Chain

if TYPE_CHECKING:
    from dynident.model.kernels.compiled import Kernel
    from dynident.model.kernels.emit import Layout
    from dynident.model.kernels.trace import Program

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
    """

    def __init__(self, chain: Chain, columns: npt.ArrayLike) -> None:
        """Choose columns of the regressor of ``chain``.

        Args:
            chain: The robot.
            columns: Indices into the 10 l standard columns, each at most once; any order.

        Raises:
            ValueError: An index is out of range or stands twice.
        """
        self.chain, self.wanted = chain, column_indices(columns, 10 * chain.links)
        width = 10 * chain.links
        traced = TracedChain(chain)
        values = traced.regressor(self.wanted)
        self._program = traced.trace.program(values)
        used = {slot for slot, value in values.items() if not is_zero(value)}
        found = [[k for k, c in enumerate(self.wanted) if j * width + c in used] for j in range(chain.joints)]
        self.columns: tuple[IntArray, ...] = tuple(np.array(row, dtype=np.int64) for row in found)
        self._places = {
            int(j * width + self.wanted[k]): (j, row) for j, kept in enumerate(found) for row, k in enumerate(kept)
        }

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
        motion = samples(self.chain, q=q, dq=dq, ddq=ddq)
        count = len(motion[0])
        blocks = self.buffers(count) if out is None else self._checked(out, count, "out")
        kernel = self._kernel()
        if kernel is None:
            self._evaluate_generic(motion, blocks)
        else:
            kernel.run(motion, blocks, count)
        return blocks

    def pullback(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, weights: Sequence[Array]
    ) -> tuple[Array, Array, Array]:
        """Return the derivatives by q, dq and ddq of the weighted sum of all entries, each (N, n).

        Exact, by reverse accumulation, at about two and a half times the cost of :meth:`evaluate`: the gradient of any
        criterion of the columns follows from its derivative by the entries. Always generated, whatever the size.

        Args:
            q: Positions, shape (N, n).
            dq: Velocities, shape (N, n).
            ddq: Accelerations, shape (N, n).
            weights: Derivative of the criterion by each entry, arrays (K_i, N) as :meth:`evaluate` returns them.

        Raises:
            ValueError: A shape, type or order is wrong.
        """
        motion = samples(self.chain, q=q, dq=dq, ddq=ddq)
        count = len(motion[0])
        found = (np.empty_like(motion[0]), np.empty_like(motion[0]), np.empty_like(motion[0]))
        self._gradient_kernel().run([*motion, *self._checked(weights, count, "weights")], found, count)
        return found

    def _kernel(self) -> Kernel | None:
        """Return the generated kernel, or None where the generic one is to be used."""
        choice = kernel_choice()
        if choice == "generic":
            return None
        compiled, generated = _module("compiled"), _module("generated")
        if choice == "auto" and not generated.is_small(self._program):
            return None
        return compiled.kernel(self._key("columns"), lambda: (self._program, self._layout()))

    def _key(self, what: str) -> tuple[object, ...]:
        return what, self.wanted.tobytes(), _module("generated").chain_key(self.chain)

    def _layout(self) -> Layout:
        emit = _module("emit")
        rows = tuple(emit.Buffer(f"joint{j}", emit.Access.BY_ROW) for j in range(self.chain.joints))
        return emit.Layout(_module("generated").by_sample(self.chain, _MOTION), rows, self._places)

    def _gradient_kernel(self) -> Kernel:
        return _module("compiled").kernel(self._key("gradient"), self._gradient)

    def _gradient(self) -> tuple[Program, Layout]:
        """Return the program of :meth:`pullback`."""
        emit, joints = _module("emit"), range(self.chain.joints)
        traced = TracedChain(self.chain)
        trace = traced.trace
        values = traced.regressor(self.wanted)
        weights = {slot: trace.input(f"weight{joint}", row) for slot, (joint, row) in self._places.items()}
        inputs: list[Scalar] = [trace.input(name, joint) for name in _MOTION for joint in joints]
        slopes = gradient(trace, values, weights, inputs)
        program = trace.program(dict(enumerate(slopes)))
        rows = tuple(emit.Buffer(f"weight{j}", emit.Access.BY_ROW) for j in joints)
        outputs = tuple(emit.Buffer(f"by_{name}", emit.Access.BY_SAMPLE, self.chain.joints) for name in _MOTION)
        places = {slot: divmod(slot, self.chain.joints) for slot in program.outputs}
        return program, emit.Layout((*_module("generated").by_sample(self.chain, _MOTION), *rows), outputs, places)

    def _evaluate_generic(self, motion: Sequence[Array], blocks: Sequence[Array]) -> None:
        """Write the blocks with the generic kernel."""
        starts = np.cumsum([0, *(len(block) for block in blocks)])
        width = 10 * self.chain.links
        entries = np.array(
            [
                (starts[joint] + row, link * width + slot % width)
                for slot, (joint, row) in self._places.items()
                for link in np.flatnonzero(self.chain.joint == joint)
            ],
            dtype=np.int64,
        ).reshape(-1, 2)
        used = np.zeros(self.chain.links, dtype=np.int64)
        used[self.wanted // 10] = 1
        for array in (entries, used):
            array.setflags(write=False)
        stacked = np.empty((int(starts[-1]), len(motion[0])))
        tables = _module("generic").pack(self.chain)
        _module("generic_batches").columns(*tables, entries, used, *motion, stacked)
        for block, (start, stop) in zip(blocks, itertools.pairwise(starts), strict=True):
            block[:] = stacked[start:stop]

    def _checked(self, arrays: Sequence[Array], count: int, name: str) -> tuple[Array, ...]:
        shapes, wanted = [array.shape for array in arrays], [(len(found), count) for found in self.columns]
        if shapes != wanted:
            raise ValueError(f"{name} has the shapes {shapes}, expected {wanted}")
        for joint, array in enumerate(arrays):
            flags = array.flags
            if not (flags.c_contiguous and array.dtype == np.float64 and (flags.writeable or name != "out")):
                raise ValueError(f"{name}[{joint}] must be a C-contiguous float64 array{', writeable' * (name == 'out')}")
        return tuple(arrays)


def _module(name: str):  # noqa: ANN202
    """Return a module of this folder that loads a compiler, when it is first needed."""
    return importlib.import_module(f"dynident.model.kernels.{name}")
