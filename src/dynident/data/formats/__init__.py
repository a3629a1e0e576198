"""Log formats, a family: one kind of file per part, and the two verbs that choose among them."""

from __future__ import annotations

import os
from pathlib import Path

from dynident.data.formats._clocked_table import with_made
from dynident.data.formats._column_map import ColumnMap, Units
from dynident.data.formats._stream import LogStream
from dynident.data.formats._unrepeated_table import unrepeated
from dynident.data.formats.base import LARGE, LogFormat, LogTable, bytes_of, log_of, written_columns
from dynident.data.log import Log
from dynident.errors import LogFormatError
from dynident.plugins import Family

FORMATS: Family[LogFormat] = Family("dynident.data.formats", LogFormat, "log format", ("dynident.actuators.formats",))

__all__ = [
    "FORMATS",
    "LARGE",
    "ColumnMap",
    "LogFormat",
    "LogStream",
    "LogTable",
    "Units",
    "bytes_of",
    "open_log",
    "read_header",
    "read_log",
    "stream_log",
    "write_log",
    "written_columns",
]

#: Suffixes of texts of records, one a sample, and the Python that writes them as a table, a column for each of a list.
_RECORDS = (".jsonl", ".ndjson")
_AS_COLUMNS = (
    "import json, pandas, pathlib; pandas.DataFrame([{{f'{{k}}[{{i}}]' if isinstance(v, list) else k: x "
    "for k, v in row.items() for i, x in enumerate(v if isinstance(v, list) else [v])}} for row in map(json.loads, "
    "pathlib.Path({!r}).read_text().splitlines())]).to_csv({!r}, index=False)"
)

#: Suffixes of packed files, which are not unpacked here.
_PACKED = (".gz", ".bz2", ".xz", ".zst", ".zip", ".7z")


def read_log(path: str | Path, columns: ColumnMap | None = None, *, form: str | LogFormat | None = None) -> Log:
    """Return the log in a file.

    Args:
        path: The file.
        columns: Which columns are which signals, and their units; None for t, q1, ..., tau1, ... in SI units.
        form: The format, a name or a part with its options; None for the one that the columns state, or by the suffix.

    Raises:
        FileError: The file cannot be read at all.
        LogFormatError: It is not a sound log, or no format has its suffix.
        UnknownChoice: No such format.
    """
    chosen = columns or ColumnMap()
    return log_of(_as_mapped(_chosen(path, _form(chosen) if form is None else form).open(path), chosen), chosen)


def stream_log(path: str | Path, columns: ColumnMap | None = None, *, folder: Path | None = None) -> LogStream:
    """Return the log in a file, to be read block by block.

    Args:
        path: The file.
        columns: As for :func:`read_log`.
        folder: Where rows of a format that is slow to decode are kept meanwhile; None for the system's own folder.

    Raises:
        FileError: The file cannot be read at all.
        LogFormatError: It has no sound header, lacks a column, or no format has its suffix.
    """
    chosen = columns or ColumnMap()
    table = _as_mapped(_chosen(path, _form(chosen)).open(path), chosen)
    return LogStream(table, chosen.resolved(table.header, table.path, table.line), folder)


def open_log(path: str | Path, columns: ColumnMap | None = None) -> LogTable:
    """Return the table of a log file, with its faults: its values are read but not checked.

    Args:
        path: The file.
        columns: The map whose format it has; None for the format by its suffix.

    Raises:
        FileError: The file cannot be read at all.
        LogFormatError: It has no sound header, or no format has its suffix.
    """
    table = _chosen(path, None if columns is None else _form(columns)).open(path)
    return table if columns is None else _as_mapped(table, columns)


def read_header(path: str | Path, *, form: str | LogFormat | None = None) -> tuple[str, ...]:
    """Return the names of the columns in a log file.

    Raises:
        FileError: The file cannot be read at all.
        LogFormatError: It has no sound header, or no format has its suffix.
    """
    return _chosen(path, form).open(path).header


def write_log(log: Log, path: str | Path, *, form: str | LogFormat | None = None) -> None:
    """Write a log in SI units; :func:`written_columns` is the map that reads it back.

    Args:
        log: The log.
        path: The file.
        form: The format, a name or a part with its options; None chooses by the suffix of the file.

    Raises:
        FileError: The file cannot be written.
        LogFormatError: No format has the suffix.
        LogMismatch: The log holds a value that is not finite.
    """
    _chosen(path, form).write(log, path)


def _as_mapped(table: LogTable, columns: ColumnMap) -> LogTable:
    """Return the table with the time, and without the rows, that a map of columns says."""
    if table.has_frames:
        from dynident.data.formats._simulated_bag import numbered  # of recordings alone

        table = numbered(table, columns)
    return unrepeated(with_made(table, columns), columns)


def _form(columns: ColumnMap) -> LogFormat | None:
    """Return the format that a map of columns states; None where it states none."""
    if columns.form:
        options = dict(columns.form_options)
        if columns.form == "csv":
            options.setdefault("decimal", columns.decimal)
        return FORMATS.make_from_text(columns.form, options)
    return None if columns.decimal == "." else FORMATS.make("csv", {"decimal": columns.decimal})


def _chosen(path: str | Path, form: str | LogFormat | None) -> LogFormat:
    if form is not None:
        return FORMATS.make(form)
    if not str(path):
        raise LogFormatError("a log", None, "its name is empty", "name its file")
    for name in FORMATS.names():
        if FORMATS.get(name).takes(path):
            return FORMATS.make(name)
    known = "; ".join(f"{name} ({', '.join(FORMATS.get(name).suffixes) or 'by name only'})" for name in FORMATS.names())
    suffix = Path(path).suffix.lower()
    step = "unpack it first" if suffix in _PACKED else f"the formats are: {known}"
    if suffix in _RECORDS:
        name = os.path.basename(path)
        step = f"write its records as a table: {_AS_COLUMNS.format(name, f'{name}.csv')}"
    what = f"no log format has the suffix '{suffix}'" if suffix or os.path.exists(path) else "no such file"
    raise LogFormatError(path, None, what, step)
