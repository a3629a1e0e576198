"""Rows of the observation matrix that are kept between steps, where they fit into memory.

Load friction, the covariance and the diagnostics ask for the same rows again. Where the load of the drives changes, or
is there for the first time, the columns that depend on it are made alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from dynident.arrays import Array, BoolArray
from dynident.data.preprocessing import Prepared
from dynident.identification.problem.regressor_stream import RegressorStream, RowSegment
from dynident.model.base_parameters import BaseParameters

#: Bytes of rows that a problem keeps.
KEPT = 1 << 27


@dataclass(frozen=True)
class KeptRows:
    """The rows of preprocessed logs, whichever of them count.

    Attributes:
        regressor: What made them.
        logs: The logs.
        segments: Of each log, in parts that are reduced by themselves: slices of its kept samples, and [W_i, tau_i]'
            of each joint there.
    """

    regressor: RegressorStream
    logs: tuple[Prepared, ...]
    segments: tuple[tuple[tuple[RowSegment, ...], ...], ...]

    def has_logs(self, logs: Sequence[Prepared]) -> bool:
        """Return whether these are the rows of the very logs."""
        return len(logs) == len(self.logs) and all(own is log for own, log in zip(self.logs, logs, strict=True))

    def are_of(self, logs: Sequence[Prepared], base: BaseParameters, load: Array | None) -> bool:
        """Return whether these are the rows of the very logs, base parameters and load."""
        return self.has_logs(logs) and self.regressor.base is base and self.regressor.load is load

    def of_log(self, number: int) -> Iterator[RowSegment]:
        """Yield the segments of one of the logs."""
        return chain.from_iterable(self.segments[number])

    def updated(self, regressor: RegressorStream) -> KeptRows | None:
        """Return the rows of a model that differs in its load, or in friction that depends on the load beside these.

        None where other columns differ as well.
        """
        if _shared(regressor) != _shared(self.regressor):
            return None
        before, after = _plain(self.regressor), _plain(regressor)
        only, found = regressor.of_load(), list[tuple[tuple[RowSegment, ...], ...]]()

        def put_together(old: Sequence[Array], loads: Sequence[Array]) -> Iterator[Array]:
            for was, own, plain, changed in zip(before, after, old, loads, strict=True):
                block = np.empty((len(own), plain.shape[1]))
                block[own], block[~own] = plain[was], changed[:-1]
                yield block

        for log, parts in zip(self.logs, self.segments, strict=True):
            pairs = [zip(part, loads, strict=True) for part, loads in zip(parts, only.parts(log), strict=True)]
            made = [[(rows, tuple(put_together(old, new))) for (rows, old), (_, new) in pair] for pair in pairs]
            found.append(tuple(map(tuple, made)))
        return KeptRows(regressor, self.logs, tuple(found))


def kept_rows(regressor: RegressorStream, logs: Sequence[Prepared]) -> KeptRows | None:
    """Return the rows of logs; None where they take more than :data:`KEPT` bytes."""
    width = sum(len(columns) + 1 for columns in regressor.columns)
    if 8 * width * sum(len(log.keep) for log in logs) > KEPT:
        return None
    made = (tuple(tuple(part) for part in regressor.parts(log)) for log in logs)
    return KeptRows(regressor, tuple(logs), tuple(made))


def _plain(regressor: RegressorStream) -> list[BoolArray]:
    """Return which of [W_i, tau_i]' of each joint do not depend on the load, shape (K_i + 1,) each."""
    of_load = [np.isin(own, only) for own, only in zip(regressor.columns, regressor.of_load().columns, strict=True)]
    return [np.append(~each, True) for each in of_load]


def _shared(regressor: RegressorStream) -> tuple[object, ...]:
    """Return what two regressors have in common where their columns that do not depend on the load are the same."""
    model, base = regressor.model, regressor.base
    names = [base.parameters[k].name for k in base.independent]
    columns = [
        tuple(names[k] for k in np.setdiff1d(own, only, assume_unique=True))
        for own, only in zip(regressor.columns, regressor.of_load().columns, strict=True)
    ]
    return model.robot, tuple(part for part in model.friction if "torque" not in part.needs), *columns
