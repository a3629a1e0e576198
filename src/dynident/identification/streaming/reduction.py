"""Logs to a digest: each log on its own, in this process or by workers, merged as a fixed tree."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dynident.data.formats import open_log
from dynident.data.log_places import as_named, at_hand, size_of
from dynident.data.preprocessing import Preprocessing
from dynident.errors import DynidentError, FileError, LogFormatError, LogMismatch, PoolFailed
from dynident.identification.problem.problem import check_motion, check_torque
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.streaming.digest import Digest, MergeTree
from dynident.identification.streaming.one_log import Checkpoint, reduce_log, settled
from dynident.identification.streaming.stream_setup import StreamSetup
from dynident.identification.streaming.triangle_file import model_hash, read_digest, write_digest
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.workers.processes import Here, Pool, Tell

#: Parts into which many logs are cut at most, twice over: each is reduced and merged by one worker.
PARTS = 256

#: Logs that an error names.
_NAMED = 20


@dataclass(frozen=True)
class Standing:
    """How far a reduction is.

    Attributes:
        share: Of all bytes, between 0 and 1.
        finished: Logs that are done, or cannot be.
        logs: All logs.
    """

    share: float
    finished: int
    logs: int


def reduce_logs(
    setup: StreamSetup,
    logs: Sequence[str | Path],
    progress: Callable[[str], None] = lambda step: None,
    checkpoint: Checkpoint | None = None,
    *,
    pool: Pool | None = None,
    skipped: Callable[[str, DynidentError], None] | None = None,
    standing: Callable[[Standing], None] = lambda state: None,
) -> Digest:
    """Reduce logs, each on its own, to one digest; memory of a worker holds one window and a few triangles.

    The result is that of :func:`make_problem` on the whole logs, and the same to the last bit whatever the pool, where
    versions and processors are alike. A cut-off and a delay of the torque that are left open are those of the first
    two minutes of the first log. Formats that are slow to decode are decoded once and kept meanwhile in a temporary
    file of 8 bytes a number beside the result. Of logs that the case splits, the training parts are reduced.

    Args:
        setup: Model, preprocessing and meaning of the columns; of a case file: ``case.stream_setup()``.
        logs: Files, or addresses such as ``s3://bucket/run.parquet``.
        progress: Called with each step in words.
        checkpoint: Where the work is kept; None, or logs that the case splits: nowhere.
        pool: Where logs are reduced; None for this process.
        skipped: Called with each log that cannot be reduced, which is left out; None refuses them, after all others.
        standing: Called with how far the work is.

    Raises:
        LogFormatError: An unsound row.
        LogMismatch: What is asked for takes all rows at once, a log is twice in the list, several logs cannot be
            reduced, a joint never moved, or its torque never changed.
        PoolFailed: Workers were lost again and again.
    """
    setup.check()
    checkpoint = checkpoint if setup.split is None else None  # what is kept does not say which part of a log it is of
    if not logs:
        raise LogMismatch("reduce", "no log", "give at least one log")
    places = [str(log) for log in logs]
    pool = pool or Here()
    setup = replace(setup, preprocessing=_settled(setup, places, skipped is not None, progress))
    threads = None if isinstance(pool, Here) else 1
    work = _LogWork(setup, checkpoint if pool.is_local else None, threads, "" if pool.is_local else os.getcwd())
    gathering = _Gathering(work, places, None if pool.is_local else checkpoint, progress, standing)
    blocks = _blocks(places, pool, gathering.kept)
    with closing(pool.run(work, blocks, news=gathering.hear)) as ended:
        for done in ended:
            if done.failure:
                step = "give the same command again: what is done is kept where --checkpoint is not 0"
                raise PoolFailed("the reduction", f"{done.task.places[0]}: {done.failure}", step)
            gathering.take(done.task, done.result)
    gathering.check_whole()
    for position, error in sorted(gathering.bad.items()):
        if skipped is not None:
            skipped(places[position], error)
    whole = gathering.tree.merged()
    if whole is None or (gathering.bad and skipped is None):
        raise _refusal(gathering.bad, len(places))
    robot, paths = whole.model.robot, ", ".join(chunk.path for chunk in whole.chunks)
    check_motion(robot, np.diff(whole.states.positions, axis=0)[0], paths)
    check_torque(robot, whole.states.torques, paths)
    return whole


def _settled(setup: StreamSetup, places: Sequence[str], skip: bool, progress: Callable[[str], None]) -> Preprocessing:
    """Return the preprocessing with all figures, from the first log; from the first sound one where bad ones may be."""
    for number, place in enumerate(places, start=1):
        try:
            with at_hand(place) as path:
                return settled(setup, path, progress)
        except (LogFormatError, LogMismatch, FileError):
            if not skip or number == len(places):
                raise
    raise AssertionError("no log")


@dataclass(frozen=True)
class _Block:
    """Successive logs that one worker reduces and merges.

    Attributes:
        first: Position of the first of them among all.
        size: Positions of a block; the last block may have fewer logs.
        places: The logs.
        kept: Hashes of those of them that are done, from an earlier run; empty for none.
    """

    first: int
    size: int
    places: tuple[str, ...]
    kept: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Part:
    """What came of a block: a digest of its sound logs, or that they are those which are done; and the bad ones."""

    digest: Digest | None
    unchanged: bool
    bad: tuple[tuple[int, DynidentError], ...]


@dataclass(frozen=True)
class _News:
    """How far a log is, in words and as a share."""

    position: int
    text: str
    share: float


def _blocks(places: Sequence[str], pool: Pool, kept: Callable[[int], tuple[str, ...]]) -> Iterator[_Block]:
    size = 1
    while not pool.is_local and len(places) // size > 2 * PARTS:
        size *= 2
    for first in range(0, len(places), size):
        yield _Block(first, size, tuple(places[first : first + size]), kept(first))


@dataclass(frozen=True, eq=False)
class _LogWork:
    """Reduces blocks of logs, as pools take it.

    Attributes:
        setup: Model, preprocessing and meaning of the columns.
        checkpoint: Where a worker keeps its work.
        threads: Of a worker; None for as many as pay.
        root: Folder that names of logs start from; empty for that of the process.
    """

    setup: StreamSetup
    checkpoint: Checkpoint | None
    threads: int | None
    root: str

    @cached_property
    def base(self) -> BaseParameters:
        """Base parameters of the model."""
        return base_parameters(self.setup.model)

    @cached_property
    def _regressor(self) -> RegressorStream:
        return RegressorStream(self.setup.model, self.base)

    def __getstate__(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in ("setup", "checkpoint", "threads", "root")}  # no compiled code

    def prepare(self) -> None:
        """Do nothing: a log has no time limit."""

    def do(self, task: _Block, tell: Tell) -> _Part:
        """Return what comes of a block of logs."""
        if task.kept and task.kept == self._hashes(task.places):
            return _Part(None, True, ())
        tree, bad, seen = MergeTree(), list[tuple[int, DynidentError]](), dict[str, str]()
        for place_in_block, place in enumerate(task.places):
            digest = self._reduced(place, task.first + place_in_block, tell, bad)
            if digest is not None:
                _check_once(digest, seen)
            tree.add(place_in_block, 1, digest)
            tell(_News(task.first + place_in_block, "", 1.0))
        return _Part(tree.merged(), False, tuple(bad))

    def _hashes(self, places: Sequence[str]) -> tuple[str, ...]:
        """Return the hashes of logs; none where one cannot be read."""
        found = []
        for place in places:
            try:
                with at_hand(place, self.root) as path:
                    found.append(open_log(path, self.setup.columns).sha256)
            except DynidentError:
                return ()
        return tuple(found)

    def _reduced(self, place: str, position: int, tell: Tell, bad: list[tuple[int, DynidentError]]) -> Digest | None:
        """Return the digest of a log; None where it is a bad one, which is then told in the list."""
        try:
            with at_hand(place, self.root) as path, as_named(path, place):

                def said(text: str, share: float) -> None:
                    tell(_News(position, text.replace(str(path), place), share))

                digest = reduce_log(self.setup, path, self._regressor, said, self.checkpoint, position, self.threads)
        except (LogFormatError, LogMismatch, FileError) as error:
            if isinstance(error, FileError) and error.path != place:
                raise  # the checkpoint cannot be written: no fault of the log
            bad.append((position, error))
            return None
        return replace(digest, chunks=(replace(digest.chunks[0], path=place),))


class _Gathering:
    """What has come of the blocks so far.

    Attributes:
        tree: Their digests.
        bad: Why logs cannot be reduced, by position.
    """

    def __init__(
        self,
        work: _LogWork,
        places: Sequence[str],
        checkpoint: Checkpoint | None,
        progress: Callable[[str], None],
        standing: Callable[[Standing], None],
    ) -> None:
        self.tree, self.bad = MergeTree(), dict[int, DynidentError]()
        self._checkpoint, self._progress, self._standing = checkpoint, progress, standing
        self._places, self._sizes = places, np.array([max(size_of(place), 1) for place in places], dtype=np.float64)
        self._shares, self._finished = np.zeros(len(places)), 0
        self._kept, self._seen = dict[int, Digest](), dict[str, str]()
        model, preprocessing = work.setup.model, work.setup.preprocessing
        self._wanted = model_hash(model, preprocessing, work.base.independent.tolist())

    def kept(self, first: int) -> tuple[str, ...]:
        """Return the hashes of the logs whose digest an earlier run has kept for the block at a position."""
        if self._checkpoint is None or not self._checkpoint.file(first).is_file():
            return ()
        try:
            digest = read_digest(self._checkpoint.file(first))
        except DynidentError:
            return ()  # of another version, or cut short: the work is done anew
        if _hash_of(digest) != self._wanted:
            return ()
        self._kept[first] = digest
        return tuple(chunk.sha256 for chunk in digest.chunks)

    def hear(self, news: _News) -> None:
        """Tell how far a log is."""
        if news.text:
            self._progress(news.text)
        self._shares[news.position] = news.share
        self._tell()

    def take(self, block: _Block, part: _Part) -> None:
        """Take what came of a block: every log of it, once."""
        kept = self._kept.pop(block.first, None)
        digest = kept if part.unchanged else part.digest
        paths = [] if digest is None else [chunk.path for chunk in digest.chunks]
        bad = dict(part.bad)
        wanted = [place for k, place in enumerate(block.places, start=block.first) if k not in bad]
        if paths != wanted or (digest is not None and _hash_of(digest) != self._wanted):
            step = "the worker has another version of dynident; install the same everywhere"
            raise PoolFailed("the reduction", f"a worker sent QR factors of {paths} for {wanted}", step)
        if digest is not None:
            _check_once(digest, self._seen)
            if self._checkpoint is not None and not part.unchanged:
                write_digest(digest, self._checkpoint.file(block.first))
        self.bad |= {k: _told_apart(error, self._places[k]) for k, error in bad.items()}
        self.tree.add(block.first, block.size, digest)
        self._finished += len(block.places)
        self._shares[block.first : block.first + len(block.places)] = 1.0
        self._tell()

    def check_whole(self) -> None:
        """Refuse an end with logs that never came back."""
        if self._finished != len(self._places):
            evidence = f"{self._finished} of {len(self._places)} logs came back"
            raise PoolFailed("the reduction", evidence, "give the same command again")

    def _tell(self) -> None:
        share = float(self._shares @ self._sizes / self._sizes.sum())
        self._standing(Standing(share, self._finished, len(self._places)))


def _hash_of(digest: Digest) -> str:
    return model_hash(digest.model, digest.how, digest.base.independent.tolist())


def _check_once(digest: Digest, seen: dict[str, str]) -> None:
    """Refuse a log whose content has been seen: its rows would count twice."""
    for chunk in digest.chunks:
        if chunk.sha256 in seen:
            raise LogMismatch(chunk.path, f"the same content as {seen[chunk.sha256]}", "give each log once")
        seen[chunk.sha256] = chunk.path


def _told_apart(error: DynidentError, place: str) -> DynidentError:
    """Return the error for a log that is here, and that a worker elsewhere did not find."""
    if isinstance(error, FileError) and "no such file" in error.evidence and Path(place).exists():
        step = "put logs where all workers see them under the same name: a shared folder, or a bucket"
        return FileError(place, "there is no such file where the worker runs", step)
    return error


def _refusal(bad: Mapping[int, DynidentError], count: int) -> DynidentError:
    """Return the error that names all bad logs."""
    errors = [bad[position] for position in sorted(bad)]
    if len(errors) == 1:
        return errors[0]
    named = "; ".join(map(str, errors[:_NAMED]))
    more = f"; and {len(errors) - _NAMED} more" if len(errors) > _NAMED else ""
    step = "fix them or leave them out (--skip-bad); the others are not compressed again"
    return LogMismatch(f"{len(errors)} of {count} logs", f"they cannot be compressed: {named}{more}", step)
