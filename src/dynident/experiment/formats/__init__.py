"""Log formats, a family: one kind of file per part, and the two verbs that choose among them."""

from __future__ import annotations

from pathlib import Path

from dynident.errors import LogFormatError
from dynident.experiment.formats.base import ColumnMap, LogFormat, Units, written_columns
from dynident.experiment.log import Log
from dynident.plugins import Family

FORMATS: Family[LogFormat] = Family("dynident.experiment.formats", LogFormat, "log format")  # type: ignore[type-abstract]

__all__ = ["FORMATS", "ColumnMap", "LogFormat", "Units", "read_header", "read_log", "write_log", "written_columns"]


def read_log(path: str | Path, columns: ColumnMap | None = None, *, form: str | LogFormat | None = None) -> Log:
    """Return the log in a file.

    Args:
        path: The file.
        columns: Which columns are which signals, and their units; None for t, q1, ..., tau1, ... in SI units.
        form: The format, a name or a part with its options; None chooses by the suffix of the file.

    Raises:
        FileError: The file cannot be read at all.
        LogFormatError: It is not a sound log, or no format has its suffix.
        UnknownChoice: No such format.
    """
    return _chosen(path, form).read(path, columns or ColumnMap())


def read_header(path: str | Path, *, form: str | LogFormat | None = None) -> tuple[str, ...]:
    """Return the names of the columns in a log file.

    Raises:
        FileError: The file cannot be read at all.
        LogFormatError: It has no sound header, or no format has its suffix.
    """
    return _chosen(path, form).header(path)


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


def _chosen(path: str | Path, form: str | LogFormat | None) -> LogFormat:
    if form is not None:
        return FORMATS.make(form)
    suffix = Path(path).suffix.lower()
    for name in FORMATS.names():
        if suffix in FORMATS.get(name).suffixes:
            return FORMATS.make(name)
    known = "; ".join(f"{name} ({', '.join(FORMATS.get(name).suffixes)})" for name in FORMATS.names())
    raise LogFormatError(path, None, f"no log format has the suffix '{suffix}'", f"the formats are: {known}")
