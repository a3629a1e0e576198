"""Which programs a chain has, and when their kernels are generated."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Literal, TypeAlias

import numpy as np

from dynident.arrays import Array
from dynident.model.kernels.compiled import Kernel, kept, kernel
from dynident.model.kernels.emit import Access, Buffer, Layout
from dynident.model.kernels.inputs import kernel_choice
from dynident.model.kernels.recursion import TracedChain
from dynident.model.kernels.trace import Number, TracedProgram
from dynident.model.robot import Chain

Quantity: TypeAlias = Literal["regressor", "torque", "weight", "mass", "frames"]

#: Operations above which a program is left to the generic kernels: about ten joints in general position, half a second
#: of compiling, which grows faster than the program.
LARGEST = 6000

#: Samples up to which NumPy evaluates what is asked for once: every operation of a program keeps an array of them.
FEW = 4000

_READS: dict[Quantity, tuple[str, ...]] = {
    "regressor": ("q", "dq", "ddq"),
    "torque": ("theta", "q", "dq", "ddq"),
    "weight": ("theta", "gravity", "q"),
    "mass": ("theta", "q"),
    "frames": ("q",),
}


def chain_kernel(chain: Chain, quantity: Quantity) -> Kernel | None:
    """Return the kernel of a quantity over samples, or None where the generic one is to be used.

    Its inputs are, in this order, those of theta, gravity, q, dq and ddq that the quantity depends on; its output is
    (N, width) as the methods of :class:`TracedChain` number it.
    """
    choice = kernel_choice()
    if choice == "generic":
        return None
    forced = choice == "generated"
    return kernel((quantity, forced, chain_key(chain)), lambda: compiled_quantity(chain, quantity, forced))


def evaluated_once(chain: Chain, quantity: Quantity, inputs: Mapping[str, Array]) -> Array | None:
    """Return a quantity at a few samples, (N, width), by NumPy: nothing is compiled, a program takes milliseconds.

    Which way the numbers are made hangs on the caller alone, not on what was compiled before, so that they repeat.

    Args:
        chain: The robot.
        quantity: What is wanted.
        inputs: Those of theta (10 l,), q, dq and ddq (N, n) that it depends on.

    Returns:
        None where the environment asks for a kernel by name, or the samples are too many.
    """
    if kernel_choice() != "auto" or len(inputs["q"]) > FEW:
        return None
    program, width = kept(("once", quantity, chain_key(chain)), lambda: _program(chain, quantity))
    found = np.zeros((len(inputs["q"]), width))
    for slot, values in program.evaluate({name: values.T for name, values in inputs.items()}).items():
        found[:, slot] = values
    return found


def chain_key(chain: Chain) -> Hashable:
    """Return what tells one chain from another."""
    arrays = (chain.parent, chain.kind, chain.joint, chain.rotation, chain.translation, chain.axis)
    more = (chain.multiplier, chain.offset, chain.gravity)
    return (chain.joints, *(array.tobytes() for array in (*arrays, *more)))


def by_sample(chain: Chain, names: tuple[str, ...]) -> tuple[Buffer, ...]:
    """Return the layout of q, dq, ddq (N, n), theta and gravity."""
    return tuple(
        Buffer(name, Access.FIXED) if name in ("theta", "gravity") else Buffer(name, Access.BY_SAMPLE, chain.joints)
        for name in names
    )


def is_small(program: TracedProgram) -> bool:
    """Say whether a program is worth compiling."""
    return program.operations <= LARGEST


def compiled_quantity(chain: Chain, quantity: Quantity, forced: bool) -> tuple[TracedProgram, Layout] | None:
    """Return code and layout of a quantity; None where it is too large: a regressor has l^2 / 2 blocks of ten."""
    if not forced and chain.links > LARGEST // 100:
        return None
    program, width = _program(chain, quantity)
    if not (forced or is_small(program)):
        return None
    output = Buffer("out", Access.BY_SAMPLE, width)
    return program, Layout(by_sample(chain, _READS[quantity]), (output,), {slot: (0, slot) for slot in program.outputs})


def _program(chain: Chain, quantity: Quantity) -> tuple[TracedProgram, int]:
    """Return the program of a quantity, and how many slots it has."""
    traced = TracedChain(chain, reads={"dq": "", "ddq": "", "gravity": "gravity"} if quantity == "weight" else None)
    values, width = _values(traced, quantity)
    return traced.trace.program(values), width


def _values(traced: TracedChain, quantity: Quantity) -> tuple[dict[int, Number], int]:
    """Return the values of a quantity by slot, and how many slots it has."""
    joints, links = traced.chain.joints, traced.chain.links
    match quantity:
        case "regressor":
            return traced.regressor(range(10 * links)), joints * 10 * links
        case "torque" | "weight":
            return traced.torque(), joints
        case "mass":
            return traced.mass(), joints * joints
        case "frames":
            return traced.frames(), 12 * links
