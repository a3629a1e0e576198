"""A program of its own that calls a functional mock-up unit by FMI 3.0 on given states; only the standard library.

It runs in a process of its own, so that a library that crashes does not take the export with it.
Arguments: a JSON file with ``library``, ``token``, ``exchange`` (whether Model Exchange, else Co-Simulation),
``inputs`` and ``outputs`` (value references), a file of states (rows of double) and the file to write.
"""

from __future__ import annotations

import ctypes
import json
import sys
from array import array
from pathlib import Path
from typing import Any

_BOOL = ctypes.c_bool
_DOUBLE = ctypes.c_double


class Unit:
    """One instance of a unit.

    Args:
        library: Its shared library.
        token: The instantiation token of its description.
        exchange: Whether it is used for Model Exchange.
    """

    def __init__(self, library: str, token: str, exchange: bool) -> None:
        self.calls, self.exchange, self.now = ctypes.CDLL(library), exchange, 0.0
        none = ctypes.c_void_p(None)
        if exchange:
            create = self.calls.fmi3InstantiateModelExchange
            given: tuple[Any, ...] = (b"arm", token.encode(), None, _BOOL(False), _BOOL(False), none, none)
        else:
            create = self.calls.fmi3InstantiateCoSimulation
            flags = [_BOOL(False)] * 4
            given = (b"arm", token.encode(), None, *flags, none, ctypes.c_size_t(0), none, none, none)
        create.restype = ctypes.c_void_p
        self.instance = ctypes.c_void_p(create(*given))
        if not self.instance:
            raise RuntimeError("the unit gives no instance")
        self.call("fmi3EnterInitializationMode", _BOOL(False), _DOUBLE(0), _DOUBLE(0), _BOOL(False), _DOUBLE(0))
        self.call("fmi3ExitInitializationMode")
        if exchange:
            self.call("fmi3EnterContinuousTimeMode")

    def call(self, name: str, *given: Any) -> None:
        """Call a function.

        Raises:
            RuntimeError: It gives another status than OK.
        """
        if status := getattr(self.calls, name)(self.instance, *given):
            raise RuntimeError(f"{name} gives the status {status}")

    def torque(self, inputs: Any, state: Any, outputs: Any, found: Any) -> None:
        """Set the inputs to a state, step, and read the outputs."""
        self.call("fmi3SetFloat64", inputs, ctypes.c_size_t(len(inputs)), state, ctypes.c_size_t(len(state)))
        if not self.exchange:
            flags = [_BOOL() for _ in range(3)]
            passed = (_DOUBLE(self.now), _DOUBLE(0.001), _BOOL(True), *map(ctypes.byref, flags))
            self.call("fmi3DoStep", *passed, ctypes.byref(_DOUBLE()))
            self.now += 0.001
        else:
            self.call("fmi3SetTime", _DOUBLE(self.now))
            self.now += 0.001
            self.call("fmi3CompletedIntegratorStep", _BOOL(True), *(ctypes.byref(_BOOL()) for _ in range(2)))
        self.call("fmi3GetFloat64", outputs, ctypes.c_size_t(len(outputs)), found, ctypes.c_size_t(len(found)))


def run(task: str, states: str, target: str) -> None:
    """Evaluate a unit on the rows of a file of states."""
    asked = json.loads(Path(task).read_text(encoding="utf-8"))
    rows, width = array("d", Path(states).read_bytes()), len(asked["inputs"])
    unit = Unit(asked["library"], asked["token"], asked["exchange"])
    inputs = (ctypes.c_uint32 * width)(*asked["inputs"])
    outputs = (ctypes.c_uint32 * len(asked["outputs"]))(*asked["outputs"])
    found, state = (_DOUBLE * len(outputs))(), (_DOUBLE * width)()
    with Path(target).open("wb") as stream:
        for start in range(0, len(rows), width):
            state[:] = rows[start : start + width]
            unit.torque(inputs, state, outputs, found)
            stream.write(bytes(found))
    unit.call("fmi3Terminate")
    unit.calls.fmi3FreeInstance(unit.instance)


if __name__ == "__main__":
    run(*sys.argv[1:4])
