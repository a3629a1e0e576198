"""A simulated log written as the logs of a case are: with its columns, units, zeros and side of the gears."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dynident.arrays import Array
from dynident.case.simulated_bag import BAGS
from dynident.data.formats import ColumnMap
from dynident.data.formats._column_map import NUMBERED, QUANTITY, RATED
from dynident.data.formats._units import counted_unit, unit_of
from dynident.data.log import Log
from dynident.data.motor_side import gears_of
from dynident.errors import BadOption, MissingDependency
from dynident.files import write_atomically
from dynident.model.robot import Robot

#: Signals of position that a zero is counted from; signals of motion, which turn with the motors.
_PLACES = ("q", "q_ref")
_MOTION = ("q", "dq", "ddq", "q_ref", "dq_ref")


def wants_current(columns: ColumnMap) -> bool:
    """Return whether the logs of a case have currents and no torques."""
    return bool(columns.current) and not columns.torque


def case_columns(log: Log, columns: ColumnMap, robot: Robot, locked: Mapping[str, float]) -> dict[str, Array]:
    """Return the columns (N,) of a log by the names that a case reads them under, in the case's units.

    Signals that the case does not name stand under their numbered names (q_ref1, ...) in SI units.

    Args:
        log: A log of the robot's joints.
        columns: How the case reads its logs.
        robot: The robot, locked joints merged.
        locked: Positions of the locked joints.
    """
    gears = gears_of(robot)
    zero = dict(zip(columns.joints, columns.zero, strict=True)) if columns.zero else {}
    shift = np.array([zero.get(name, 0.0) for name in log.joints])
    joints = columns.joints or log.joints
    found = {columns.time: _per_unit(log.time[:, None], "time", (columns.units.time,))[:, 0]}
    for name, signal in log.signals().items():
        values = signal - shift if name in _PLACES else signal
        if name in columns.motor:
            values = values @ (gears.T if name in _MOTION else np.linalg.inv(gears))
        stated = getattr(columns, name)
        names = stated or tuple(f"{NUMBERED[name]}{k}" for k in range(1, len(joints) + 1))
        own = _all_joints(values, log.joints, joints, locked if name in _PLACES else {})
        if stated or name in ("q", "dq", "torque", "current"):
            words = columns.units.of(QUANTITY[name], len(joints))
            own = _per_unit(own, QUANTITY[name], words)
            shares = [QUANTITY[name] == "torque" and counted_unit(word)[1] in RATED for word in words]
            own = own / np.where(shares, columns.rated, 1.0) if any(shares) else own
        found |= dict(zip(names, own.T, strict=True))
    return found


def write_columns(table: Mapping[str, Array], path: str | Path, decimal: str = ".") -> None:
    """Write columns (N,) as the suffix of the file says: .csv, .txt, .tsv, .npz, .parquet or .mat.

    Args:
        table: The columns by name.
        path: The file.
        decimal: Decimal sign of text files, ``.`` or ``,``.

    Raises:
        BadOption: Another suffix.
        FileError: The file cannot be written.
        MissingDependency: The package that writes it is not installed.
    """
    suffix = Path(path).suffix.lower()
    writers: dict[str, Callable[[Mapping[str, Array]], bytes]] = {
        ".csv": lambda table: _text(table, "," if decimal == "." else ";", decimal),
        ".txt": lambda table: _text(table, "," if decimal == "." else ";", decimal),
        ".tsv": lambda table: _text(table, "\t", decimal),
        ".npz": _npz,
        ".parquet": _parquet,
        ".mat": _mat,
    }
    if suffix not in writers:
        raise BadOption("--output", str(path), f"end the name in one of: {', '.join((*writers, *BAGS))}")
    write_atomically(path, writers[suffix](table))


def _all_joints(values: Array, own: tuple[str, ...], joints: tuple[str, ...], locked: Mapping[str, float]) -> Array:
    """Return values (N, n) with columns for locked joints, shape (N, m)."""
    if own == joints:
        return values
    columns = [
        values[:, own.index(name)] if name in own else np.full(len(values), locked.get(name, 0.0)) for name in joints
    ]
    return np.stack(columns, axis=1)


def _per_unit(values: Array, quantity: str, words: tuple[str, ...]) -> Array:
    """Return SI values (N, k) in the units of their columns."""
    factors = np.array([unit_of(quantity, word)[0] for word in words])
    return values if np.all(factors == 1.0) else values * factors[:, 1] / factors[:, 0]


def _text(table: Mapping[str, Array], separator: str, decimal: str) -> bytes:
    rows = np.column_stack(list(table.values())).tolist()
    lines = [separator.join(table), *(separator.join(map(repr, row)) for row in rows)]
    if decimal == ",":
        lines[1:] = [line.replace(".", ",") for line in lines[1:]]
    return ("\n".join(lines) + "\n").encode()


def _npz(table: Mapping[str, Array]) -> bytes:
    content = io.BytesIO()
    np.savez_compressed(content, **dict(table))  # type: ignore[arg-type]
    return content.getvalue()


def _parquet(table: Mapping[str, Array]) -> bytes:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingDependency("writing Parquet", "pyarrow", "parquet") from error
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(dict(table)), sink)
    return sink.getvalue().to_pybytes()


def _mat(table: Mapping[str, Array]) -> bytes:
    from scipy.io import savemat  # loads slowly

    nested: dict[str, Any] = {}
    for name, values in table.items():
        *groups, last = name.split(".")
        inner = nested
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = values
    content = io.BytesIO()
    savemat(content, nested, long_field_names=True)
    return content.getvalue()
