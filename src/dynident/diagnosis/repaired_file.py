"""A repaired log as a file: rows of a text with their own names and units, of another kind of file in SI units."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.case.evidence.rows import MOST_LOST
from dynident.data.formats import read_log, write_log, written_columns
from dynident.data.formats._text_header import cells_of, opened
from dynident.data.formats._text_table import TextTable
from dynident.data.formats._units import converted
from dynident.data.formats.csv import Csv
from dynident.diagnosis.checks.time_order import SEVERAL
from dynident.diagnosis.recording import Recording
from dynident.diagnosis.repair import Repaired, broken_rows
from dynident.errors import DynidentError, LogMismatch
from dynident.files import write_atomically


def write_repaired(repaired: Repaired, out: str) -> str:
    """Write a log after its repairs, and return in words how it is to be read.

    A text stays as it is but for what was repaired, so that the same case reads it. Other kinds of file, and positions
    of motors whose turns were taken back, are written in SI units at the joints.

    Args:
        repaired: The log.
        out: The file.

    Raises:
        FileError: The file cannot be written.
        LogMismatch: The log has faults that no safe repair removes; no file is written then.
        LogFormatError: What was written cannot be read back; no file is left then.
    """
    recording = repaired.recording
    _check_sound(recording)
    as_it_was = _is_text(repaired) and Csv.takes(out)
    columns = recording.columns if as_it_was else written_columns(recording.log)
    if as_it_was:
        write_atomically(out, "".join(f"{line}\n" for line in _lines(repaired)))
    else:
        write_log(recording.log, out)
    try:
        read_log(out, columns)
    except DynidentError:
        Path(out).unlink()
        raise
    if as_it_was:
        return "names and units are those of the log, so the case reads it in place of the log"
    return "it is in SI units under t, q1, ...; a case that reads it needs no units, columns and gains"


def _check_sound(recording: Recording) -> None:
    """Refuse a log that no reader would take after its repairs."""
    log = recording.log
    broken, steps = broken_rows(log), np.diff(log.time)
    if broken.any():
        what, sample = f"{broken.sum()} of {log.samples} rows hold values that are not finite", int(np.argmax(broken))
        step = f"more than {MOST_LOST:.0%} of the rows are not left out: repair the recording"
    elif (steps < 0).any():
        what, sample = "time runs back", int(np.argmax(steps < 0)) + 1
        step = "sorting would mix two recordings: split the file there into separate logs"
    elif (steps == 0).any():
        same = int(np.count_nonzero(steps == 0))
        what, sample = f"{same} rows have the time of the row before and other values", int(np.argmax(steps == 0)) + 1
        step = f"more than {MOST_LOST:.0%} of the rows are not left out: {SEVERAL}"
    else:
        return
    evidence = f"no safe repair makes it a sound log: {what}, first in {recording.place(sample)}; nothing was written"
    raise LogMismatch(log.name, evidence, step)


def _is_text(repaired: Repaired) -> bool:
    recording = repaired.recording
    return isinstance(recording.table, TextTable) and not (repaired.turns and "q" in recording.columns.motor)


def _lines(repaired: Repaired) -> Iterator[str]:
    """Yield the lines of a text after the repairs: what stands before its rows, and the rows that are left."""
    table = repaired.recording.table
    assert isinstance(table, TextTable)
    with opened(table.path) as stream:
        for line in islice(stream, table.before):
            yield line.rstrip("\r\n")
    texts = [text for _, text in table.rows()]
    added = _added(repaired)
    for k, row in enumerate(repaired.recording.rows):
        yield _with_added(table, texts[row], {column: float(more[k]) for column, more in added.items() if more[k]})


def _added(repaired: Repaired) -> dict[str, Array]:
    """Return what is added to the positions of some columns, in the unit of each, shape (N,)."""
    columns = repaired.recording.columns
    names = columns.stated()["q"]
    words = columns.units.of("position", len(names))
    found = {}
    for joint, turns in repaired.turns.items():
        k = columns.joints.index(joint)
        one = float(converted(np.ones((1, 1)), "position", words[k : k + 1])[0, 0])
        found[names[k]] = turns * (2 * np.pi / one)
    return found


def _with_added(table: TextTable, text: str, added: dict[str, float]) -> str:
    """Return a row with some of its cells larger by a value."""
    if not added:
        return text
    cells = cells_of(text, table.delimiter)
    for column, more in added.items():
        place = table.header.index(column)
        value = float(cells[place].replace(",", ".") if table.decimal == "," else cells[place]) + more
        cells[place] = repr(value) if table.decimal == "." else repr(value).replace(".", ",")
    if table.delimiter is None:
        return " ".join(cells)
    line = io.StringIO()
    csv.writer(line, delimiter=table.delimiter, lineterminator="").writerow(cells)
    return line.getvalue()
