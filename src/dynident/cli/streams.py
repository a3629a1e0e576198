"""Which triangles an identification starts from: those of a file, those of logs too large for memory, or none."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynident.estimation.estimators import Estimator
    from dynident.estimation.streaming.digest import Digest
    from dynident.experiment.case_file.case import Case
    from dynident.experiment.log import Log

#: Bytes of all logs of a fit together above which they are reduced as a stream.
LARGE = 512 << 20


def digest_for(
    case: Case, options: argparse.Namespace, estimator: Estimator, progress: Callable[[str], None]
) -> Digest | None:
    """Return the triangles to identify from; None where the logs are read into memory.

    Raises:
        DynidentError: Triangles of another model, options that need rows, or any fault of a log.
    """
    if options.triangles:
        return _from_file(case, options, estimator)
    names = tuple(options.logs) or case.train
    if not names or not _is_large(case, names) or not _streams(case, options, estimator):
        return None
    from dynident.estimation.streaming.reduction import reduce_logs

    progress("reducing the logs as a stream")
    return reduce_logs(case, names)


def test_logs(case: Case, options: argparse.Namespace, digest: Digest) -> tuple[Log, ...]:
    """Return the logs to test on, none of which is in the digest.

    Raises:
        LogMismatch: One is.
        DynidentError: Any fault of a log.
    """
    from dynident.errors import LogMismatch

    seen = {chunk.sha256: chunk.path for chunk in digest.chunks}
    logs = tuple(case.read(name) for name in options.test or (() if options.logs else case.test))
    for log in logs:
        if log.source.sha256 in seen:
            evidence = f"the same content as {seen[log.source.sha256]}"
            raise LogMismatch(log.name, evidence, "test on logs that are not trained on")
    return logs


def _from_file(case: Case, options: argparse.Namespace, estimator: Estimator) -> Digest:
    from dynident.errors import BadOption
    from dynident.estimation.streaming.estimate import check_estimator
    from dynident.estimation.streaming.triangle_file import check_case, read_digest

    for given, name in (
        (options.logs, "LOG"),
        (options.bootstrap, "--bootstrap"),
        (options.cross_validate, "--cross-validate"),
    ):
        if given:
            raise BadOption(name, given, "it needs the rows of logs, and --from has triangles of them; leave one out")
    check_estimator(estimator)
    digest = read_digest(options.triangles)
    check_case(digest, options.triangles, case.model, case.preprocessing)
    return digest


def _is_large(case: Case, names: Sequence[str | Path]) -> bool:
    total = 0
    for name in names:
        place = case.find(str(name))
        files = [item for item in place.iterdir() if item.is_file()] if place.is_dir() else [place]
        total += sum(file.stat().st_size for file in files if file.is_file())
    return total > LARGE


def _streams(case: Case, options: argparse.Namespace, estimator: Estimator) -> bool:
    """Return whether a stream can do what is asked for."""
    from dynident.errors import LogMismatch
    from dynident.estimation.streaming.reduction import check_streamable

    try:
        check_streamable(case)
    except LogMismatch:
        return False
    local = case.preprocessing.filter.span(1000.0) is not None
    return local and estimator.from_triangles and not options.bootstrap and not options.cross_validate
