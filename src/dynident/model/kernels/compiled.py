"""Programs made into machine code when they are first wanted, and kept on disk for the next process."""

from __future__ import annotations

import ctypes
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np

from dynident.arrays import Array, address
from dynident.model.kernels.code_files import kept_code
from dynident.model.kernels.emit import Access, Layout, llvm_assembly
from dynident.model.kernels.trace import TracedProgram

#: Kernels and programs kept ready; the one used longest ago goes first.
KEPT = 64

Made = TypeVar("Made")

_SETTINGS: dict[str, Any] = {"opt": 2}

ready_kernels: OrderedDict[Hashable, Any] = OrderedDict()
_lock = threading.Lock()


class Kernel:
    """Machine code of one program on this processor."""

    def __init__(self, program: TracedProgram, layout: Layout) -> None:
        self.program, self.layout, self.lanes = program, layout, lanes()
        self._engine = machine_code(llvm_assembly(program, layout, self.lanes))
        kind = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p)
        self._call = kind(self._engine.get_function_address("kernel"))
        self._pointers = ctypes.c_void_p * (len(layout.inputs) + len(layout.outputs))

    def run(self, inputs: Sequence[Array], outputs: Sequence[Array], samples: int) -> None:
        """Run over the samples; the interpreter lock is released meanwhile.

        Args:
            inputs: C-contiguous float64 arrays in the order and layout of ``layout.inputs``.
            outputs: The same for ``layout.outputs``; slots that the program lacks become 0 in
                arrays laid out by sample and are not touched in those laid out by row.
            samples: N.
        """
        if 0 < samples < self.lanes:
            self._run_few(inputs, outputs, samples)
        elif samples:
            addresses = [array.ctypes.data for array in inputs] + [address(array) for array in outputs]
            self._call(samples, samples, self._pointers(*addresses))

    def _run_few(self, inputs: Sequence[Array], outputs: Sequence[Array], samples: int) -> None:
        """Run over fewer samples than one step takes, on copies that repeat the last one."""
        picks = np.minimum(np.arange(self.lanes), samples - 1)
        padded = []
        for buffer, array in zip(self.layout.inputs, inputs, strict=True):
            axis = {Access.FIXED: None, Access.BY_SAMPLE: 0, Access.BY_ROW: 1}[buffer.access]
            padded.append(array if axis is None else np.ascontiguousarray(np.take(array, picks, axis)))
        copies = []
        for buffer, array in zip(self.layout.outputs, outputs, strict=True):
            axis = 0 if buffer.access is Access.BY_SAMPLE else 1
            copies.append(np.ascontiguousarray(np.take(array, picks, axis)))
        self.run(padded, copies, self.lanes)
        for buffer, array, copied in zip(self.layout.outputs, outputs, copies, strict=True):
            array[...] = copied[:samples] if buffer.access is Access.BY_SAMPLE else copied[:, :samples]


def kernel(key: Hashable, make: Callable[[], tuple[TracedProgram, Layout] | None]) -> Kernel | None:
    """Return the kernel known by ``key``, compiled now if need be; safe to call from several threads.

    Args:
        key: Tells this kernel from all others.
        make: Returns what to compile, or None where it is not worth it, which is remembered too.
    """
    return kept(key, lambda: None if (made := make()) is None else Kernel(*made))


def kept(key: Hashable, make: Callable[[], Made]) -> Made:
    """Return what is known by ``key``, made now if need be, by one thread at a time; ``make`` must not call this."""
    with _lock:
        if key not in ready_kernels:
            ready_kernels[key] = make()
            while len(ready_kernels) > KEPT:
                ready_kernels.popitem(last=False)
        ready_kernels.move_to_end(key)
        return ready_kernels[key]


def machine_code(assembly: str) -> Any:
    """Return the engine that holds the machine code of LLVM assembly for this processor."""
    import llvmlite.binding as llvm  # the compiler loads with the first kernel, not with the package

    def make() -> bytes:
        module = llvm.parse_assembly(assembly)
        module.verify()
        return _machine().emit_object(module)

    code = kept_code(repr((_SETTINGS, *_processor(), llvm.llvm_version_info)), assembly, make)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


@cache
def lanes() -> int:
    """Return how many samples go into one step on this processor."""
    return 8 if _has_wide_vectors() else 4


@cache
def _has_wide_vectors() -> bool:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return bool(llvm.get_host_cpu_features().get("avx512f"))


def _machine() -> Any:
    """Return a target machine for this processor, with its widest vectors."""
    import llvmlite.binding as llvm

    name, features = _processor()
    return llvm.Target.from_default_triple().create_target_machine(cpu=name, features=features, **_SETTINGS)


@cache
def _processor() -> tuple[str, str]:
    """Return the name and the features of this processor as LLVM knows them."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten() + (",-prefer-256-bit" if _has_wide_vectors() else "")
    return llvm.get_host_cpu_name(), features
