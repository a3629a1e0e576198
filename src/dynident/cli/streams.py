"""Which triangles an identification starts from: those of a file, those of logs too large for memory, or none."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import TYPE_CHECKING

from dynident.experiment.formats import LARGE
from dynident.experiment.log_places import is_address, size_of

if TYPE_CHECKING:
    from dynident.estimation.estimators import Estimator
    from dynident.estimation.streaming.digest import Digest
    from dynident.experiment.case_file.case import Case
    from dynident.experiment.log import Log


def digest_for(
    case: Case, options: argparse.Namespace, estimator: Estimator, progress: Callable[[str], None]
) -> Digest | None:
    """Return the triangles to identify from; None where the logs are read into memory.

    Raises:
        DynidentError: Triangles of another model, options that need rows, or any fault of a log.
    """
    if options.triangles:
        return _from_file(case, options, estimator)
    size = sum(size_of(name if is_address(name) else str(case.find(name))) for name in case.train)
    if size <= LARGE:
        return None
    why = _why_not(case, options, estimator)
    if why:
        progress(f"logs of {size >> 20} MiB are read into memory: {why}")
        return None
    from dynident.estimation.streaming.reduction import reduce_logs

    progress("reducing the logs as a stream")
    return reduce_logs(case, case.train)


def test_logs(case: Case, digest: Digest) -> tuple[Log, ...]:
    """Return the logs to test on, none of which is in the digest.

    Raises:
        LogMismatch: One is.
        DynidentError: Any fault of a log.
    """
    from dynident.errors import LogMismatch

    seen = {chunk.sha256: chunk.path for chunk in digest.chunks}
    logs = tuple(case.read(name) for name in case.test)
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


def _why_not(case: Case, options: argparse.Namespace, estimator: Estimator) -> str:
    """Return why a stream cannot do what is asked for, and what to do; empty where it can."""
    from dynident.errors import LogMismatch
    from dynident.estimation.streaming.one_log import check_streamable

    try:
        check_streamable(case)
    except LogMismatch as error:
        return f"{error.evidence}; {error.step}"
    if case.preprocessing.filter.span(1000.0) is None:
        return "the filter needs the whole log at once"
    if not estimator.from_triangles:
        return "the estimator needs the rows"
    asked = "--bootstrap" * bool(options.bootstrap) or "--cross-validate" * bool(options.cross_validate)
    return f"{asked} needs the rows" if asked else ""
