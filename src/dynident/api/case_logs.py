"""The logs of a case: named, read and split, or compressed where they are too large for memory.

Names stand for files, folders of logs, patterns, and addresses of a bucket.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynident.case.case import Case
from dynident.data.formats import FORMATS, LARGE
from dynident.data.log import Log, Source
from dynident.data.log_places import is_address, reached, size_of
from dynident.data.preprocessing import check_gaps
from dynident.errors import BadOption, DescriptionError, FileError, LogMismatch
from dynident.identification.estimators import Estimator

if TYPE_CHECKING:
    from dynident.identification.estimate.estimate import Estimate
    from dynident.identification.streaming.digest import Digest


@dataclass(frozen=True)
class CaseData:
    """Logs to learn from and logs to test on."""

    train: tuple[Log, ...]
    test: tuple[Log, ...]


def with_logs(case: Case, train: Sequence[str] | None, test: Sequence[str] | None) -> tuple[Case, tuple[str, ...]]:
    """Return the case with logs in place of its own, each a file or an address, and what was left out as no log.

    Folders, patterns and folders of buckets are replaced by the logs that they stand for.

    Args:
        case: The case.
        train: Logs to learn from; None for those of the case.
        test: Logs to test on; None for those of the case.

    Raises:
        FileError: A pattern or a folder without logs, or an address that cannot be reached.
        MissingDependency: An address, and fsspec is not installed.
    """
    learned, others = logs_named(case.train if train is None else train, case.find)
    tested, more = logs_named(case.test if test is None else test, case.find)
    return replace(case, train=tuple(learned), test=tuple(tested)), (*others, *more)


def check_distinct(contents: Iterable[tuple[str, str]]) -> None:
    """Refuse a log that counts twice, by names and hashes: its samples would look like new ones."""
    seen: dict[str, str] = {}
    for name, content in contents:
        if content in seen:
            step = "give each log once, and test on logs that are not trained on"
            raise LogMismatch(name, f"the same content as {seen[content]}", step)
        seen[content] = name


def read_data(case: Case) -> CaseData:
    """Read the logs of a case, and split them where that is asked.

    Raises:
        DynidentError: No log named, or any fault of a log.
    """
    if case.split is not None and case.test:
        raise DescriptionError(case.path, "split", "it stands beside 'test'", "keep one of the two")
    if not case.train:
        raise BadOption("LOG", "", "name a log on the command line, or under train: in the case file")
    train, given = ([case.read(name) for name in names] for names in (case.train, case.test))
    check_distinct((log.name, log.source.sha256) for log in (*train, *given))
    if not given and case.split is not None:
        parts = [case.split.apply(log) for log in train]
        train, given = [a for a, _ in parts], [b for _, b in parts]
    for log in (*train, *given):
        check_gaps(log, case.preprocessing.longest_gap_s)  # else a test log is refused after the fit only
    return CaseData(tuple(train), tuple(given))


def is_streamed(case: Case, estimator: Estimator, needs_rows: str, progress: Callable[[str], None]) -> bool:
    """Return whether the logs of a case are too large for memory and can be reduced as a stream.

    Args:
        case: The case.
        estimator: What will fit them.
        needs_rows: What else is asked for that needs rows, in words; empty for nothing.
        progress: Called with why logs are read into memory although they are large.
    """
    size = sum(size_of(str(case.place(name))) for name in case.train)
    if size <= LARGE:
        return False
    why = _why_not_streamed(case, estimator) or (f"{needs_rows} needs the samples" if needs_rows else "")
    if why:
        progress(f"logs of {size >> 20} MiB are read into memory: {why}")
    return not why


def reduced_logs(case: Case, progress: Callable[[str], None]) -> Digest:
    """Return the training logs of a case, reduced as a stream.

    Raises:
        DynidentError: Any fault of a log.
    """
    from dynident.identification.streaming.reduction import reduce_logs

    progress("reducing the logs as a stream")
    return reduce_logs(case.stream_setup(), [case.place(name) for name in case.train])


def _why_not_streamed(case: Case, estimator: Estimator) -> str:
    """Return why a stream cannot do what is asked for, and what to do; empty where it can."""
    try:
        case.stream_setup().check()
    except LogMismatch as error:
        return f"{error.evidence}; {error.step}"
    if case.split is not None:
        return "the test part is needed as well"
    if case.preprocessing.filter.span(1000.0) is None:
        return "the filter needs the whole log at once"
    return "" if estimator.from_triangles else "the estimator needs the samples"


def digest_of_file(case: Case, path: str, estimator: Estimator) -> Digest:
    """Return the compressed logs of a file, once they are found to be of the model and preprocessing of a case.

    Raises:
        BadOption: The estimator needs rows.
        DynidentError: The file is of another model, or damaged.
    """
    from dynident.api.matching_digests import check_case
    from dynident.identification.streaming.estimate import check_estimator
    from dynident.identification.streaming.triangle_file import read_digest

    check_estimator(estimator)
    digest = read_digest(path)
    check_case(digest, path, case.model, case.preprocessing)
    return digest


def test_logs(case: Case, digest: Digest) -> tuple[Log, ...]:
    """Return the logs of a case to test on, none of which is in the digest.

    Raises:
        LogMismatch: One is.
        DynidentError: Any fault of a log.
    """
    seen = {chunk.sha256: chunk.path for chunk in digest.chunks}
    logs = tuple(case.read(name) for name in case.test)
    for log in logs:
        if log.source.sha256 in seen:
            evidence = f"the same content as {seen[log.source.sha256]}"
            raise LogMismatch(log.name, evidence, "test on logs that are not trained on")
    return logs


def seen_logs(estimate: Estimate, logs: Sequence[Log], parts_apart: bool = False) -> list[str]:
    """Return the names of logs with the content of one that trained the estimate, whole or in part.

    With ``parts_apart`` the rest of a log that was split is none of them: the steps to it are others.
    """
    trained = [(log.get("sha256"), tuple(log.get("steps", ()))) for log in estimate.provenance.get("logs", ())]

    def trains(own: Source) -> bool:
        steps = [each for sha256, each in trained if sha256 and sha256 == own.sha256]
        return any(not parts_apart or each[: len(own.steps)] == own.steps for each in steps)

    return [log.name for log in logs if trains(log.source)]


def check_unseen(estimate: Estimate, logs: Sequence[Log]) -> None:
    """Refuse a log that trained the estimate where a report would call it unseen.

    Raises:
        LogMismatch: A log has the content of one of the fit.
    """
    for name in seen_logs(estimate, logs)[:1]:
        step = "test on another log, or on the rest of this one with --split as in the fit"
        raise LogMismatch(name, "the log is among the training logs", step)


_MAGIC = "*?["


def logs_named(names: Sequence[str], find: Callable[[str], Path]) -> tuple[list[str], list[str]]:
    """Return the logs that names stand for, and the files of folders that are no logs.

    A folder stands for the logs in it, in the order of their names, a data set of LeRobot for those under ``data``,
    unless a format takes it as one recording; a pattern with ``*``, ``?`` or ``[...]`` for the files that match it. A
    log that is named twice is there twice.

    Args:
        names: Files, folders, patterns, addresses.
        find: Where a file is that a case names.

    Raises:
        FileError: A pattern or a folder without logs, or an address that cannot be reached.
        MissingDependency: An address, and fsspec is not installed.
    """
    logs, others = list[str](), list[str]()
    for name in names:
        found = _remote(name) if is_address(name) else _local(name, find)
        if found is None:
            logs.append(name)
            continue
        taken = [one for one in found if _is_log(one)]
        if not taken:
            evidence = f"{len(found)} files, none of which is a log" if found else "there is no log"
            raise FileError(name, evidence, "check the name; 'dynident list formats' shows the suffixes of logs")
        logs += taken
        others += [one for one in found if one not in taken]
    return logs, others


def _local(name: str, find: Callable[[str], Path]) -> list[str] | None:
    """Return the files that a folder or a pattern stands for; None for a single log."""
    place = find(name)
    if os.path.isdir(place):
        if (place / "meta" / "info.json").exists():  # a data set of LeRobot
            return sorted(str(item) for item in place.glob("data/*/*.parquet"))
        return None if _is_log(str(place)) else sorted(str(item) for item in place.iterdir() if item.is_file())
    if os.path.exists(place) or not any(sign in name for sign in _MAGIC):
        return None
    parts = Path(name).parts
    fixed = next(k for k, part in enumerate(parts) if any(sign in part for sign in _MAGIC))
    root = find(str(Path(*parts[:fixed]))) if fixed else find(".")
    return sorted(str(item) for item in root.glob(str(Path(*parts[fixed:]))))


def _remote(name: str) -> list[str] | None:
    """Return the addresses that a folder or a pattern of a bucket stands for; None for a single log."""

    def listed(system: Any, path: str) -> list[str] | None:
        if any(sign in path for sign in _MAGIC):
            return sorted(system.unstrip_protocol(one) for one in system.glob(path))
        if not system.isdir(path):
            return None
        return sorted(system.unstrip_protocol(one["name"]) for one in system.ls(path) if one["type"] == "file")

    return reached(name, listed)


def _is_log(name: str) -> bool:
    return any(FORMATS.get(form).takes(name) for form in FORMATS.names())
