"""One log to a digest, whatever its size: read, filtered and reduced window by window; its work is kept on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynident.data.formats import LogStream
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.errors import DynidentError, LogMismatch
from dynident.identification.problem.regressor_stream import RegressorStream
from dynident.identification.selection.cutoff.choice import LONGEST_S, with_cutoff
from dynident.identification.selection.delay import find_delays
from dynident.identification.streaming.digest import Chunk, Digest
from dynident.identification.streaming.stream_setup import StreamSetup
from dynident.identification.streaming.tally import Segment, Tally
from dynident.identification.streaming.time_scan import scan_time
from dynident.identification.streaming.training_part import training_part
from dynident.identification.streaming.triangle_file import model_hash, read_position, write_digest
from dynident.identification.streaming.windows import Piece, Window, Windows, steps_of
from dynident.model.base_parameters import base_parameters
from dynident.model.threads import in_order, usable_processors

#: Rows of the head of a log at most, from which the cut-off is chosen.
_HEAD = 1 << 19

#: Seconds between two checkpoints.
PERIOD_S = 30.0

#: Threads that filter windows at most where their number is not stated; each holds one in memory.
_THREADS = 3


@dataclass(frozen=True)
class Checkpoint:
    """Where work that takes long is kept, so that it goes on where it was cut short.

    Attributes:
        place: File that the result will be written to; one file beside it for each log, while the work goes on.
        period_s: Time between two writings, in s.
    """

    place: Path
    period_s: float = PERIOD_S

    def file(self, number: int) -> Path:
        """Return the file for a log."""
        return self.place.with_name(f"{self.place.name}.{number}.partial")

    def remove(self, count: int) -> None:
        """Remove the files of ``count`` logs."""
        for number in range(count):
            with suppress(FileNotFoundError):
                self.file(number).unlink()


def settled(setup: StreamSetup, path: Path, progress: Callable[[str], None]) -> Preprocessing:
    """Return the preprocessing with a cut-off and a delay that are numbers, found from the head of a log where open."""
    model, preprocessing = setup.model, setup.preprocessing
    if not preprocessing.filter.is_open and preprocessing.delay_s is not None:
        return preprocessing
    head = head_of(setup, path)
    setup.check_signals(head)
    preprocessing = with_cutoff(model, [head], preprocessing, progress)[0]
    if preprocessing.delay_s is None:
        progress("time delay between torque and position")
        (delay,), _ = find_delays(model, base_parameters(model), [preprocess(head, preprocessing)], may_lag=False)
        preprocessing = replace(preprocessing, delay_s=delay.applied)
    return preprocessing


def head_of(setup: StreamSetup, path: Path) -> Log:
    """Return the first two minutes of a log, of the part that trains, 2^19 rows at most; any fault of it is raised."""
    stream, parts, rows = training_part(setup, path), list[Log](), 0
    with closing(stream):
        for block in stream.blocks():
            parts.append(setup.with_meaning(block))
            rows += block.samples
            if parts[-1].time[-1] - parts[0].time[0] >= LONGEST_S or rows >= _HEAD:
                break
    signals = {name: np.concatenate([getattr(p, name) for p in parts]) for name in ("time", *parts[0].signals())}
    return replace(parts[0], **signals)


def reduce_log(
    setup: StreamSetup,
    path: Path,
    regressor: RegressorStream,
    progress: Callable[[str, float], None],
    checkpoint: Checkpoint | None,
    number: int,
    threads: int | None = None,
) -> Digest:
    """Return the digest of one log, of the part that trains where the case splits its logs.

    Args:
        setup: Model, preprocessing with a cut-off and a delay that are numbers, and meaning of the columns.
        path: The file.
        regressor: What makes its rows, for the base parameters of the model.
        progress: Called with each step in words, and which share of the windows is done.
        checkpoint: Where the work is kept; None: nowhere.
        number: Of the log among others, for the name of its checkpoint.
        threads: Number of threads that filter windows, which does not change a bit of the result; None: one for each
            processor, three at most.

    Raises:
        LogFormatError: An unsound row.
        LogMismatch: Too few rows are left, or the log lacks a signal or a joint.
    """
    progress(f"{path}: hash", 0.0)
    stream = training_part(setup, path, None if checkpoint is None else checkpoint.place.parent)
    digest_id = model_hash(setup.model, setup.preprocessing, regressor.base.independent.tolist())
    file = None if checkpoint is None else checkpoint.file(number)
    found = None if file is None else _found(file, stream.table.sha256, digest_id)
    if found is not None and found[1] is None:
        return found[0]
    keeping = None if checkpoint is None or file is None else (file, checkpoint.period_s)
    try:
        return _by_windows(setup, stream, regressor, progress, keeping, threads, found)
    finally:
        stream.close()


def _by_windows(
    setup: StreamSetup,
    stream: LogStream,
    regressor: RegressorStream,
    progress: Callable[[str, float], None],
    keeping: tuple[Path, float] | None,
    threads: int | None,
    found: tuple[Digest, tuple[int, int, int, int] | None] | None,
) -> Digest:
    """Return the digest of an opened log from where ``found`` ends; ``keeping``: where work is kept, and how often."""
    path = stream.table.path
    progress(f"{path}: time", 0.0)
    scan = scan_time(stream, setup.preprocessing.filter, setup.preprocessing.longest_gap_s)
    scan = replace(scan, gaps=np.vstack([scan.gaps, scan.first + setup.columns.spells_left_out(path)]))
    windows = Windows.of(scan, setup.preprocessing, stream.table.path)
    tally, first = Tally(regressor, windows.rate / windows.every, scan.count // windows.every), 0
    if found is not None and found[1] is not None:
        first, rows, stretch, stride = found[1]
        tally = Tally.resumed(regressor, found[0], rows, stretch, stride)
    meaning = _Meaning(setup)
    written = time.monotonic()

    def digest() -> Digest:
        steps = steps_of(windows, meaning.last, scan.source)
        rate = windows.rate / windows.every
        chunk = Chunk(stream.table.path, stream.table.sha256, scan.samples, tally.rows, rate, steps, scan.source.split)
        assert tally.states is not None
        own = (setup.model, regressor.base, setup.preprocessing, setup.columns)
        return Digest(*own, tally.joints(), tally.states, tally.sampled(), (chunk,))

    def rows_of(piece: Piece) -> tuple[Window, Sequence[Segment]]:
        window = windows.window(piece)
        return window, list(regressor.segments(window.prepared))

    pieces = windows.pieces(stream, meaning, first)
    threads = threads or min(usable_processors(), _THREADS)
    for done, ready in enumerate(in_order(rows_of, pieces, threads), start=first + 1):
        tally.add(*ready)
        progress(f"{path}: {100 * done // windows.count} % of {scan.samples:,} rows", done / windows.count)
        is_due = keeping is not None and time.monotonic() - written >= keeping[1]
        if keeping is not None and is_due and tally.rows and done < windows.count:
            position = {"windows": done, "rows": tally.rows, "stretch": tally.stretch, "stride": tally.stride}
            write_digest(digest(), keeping[0], position)
            written = time.monotonic()
    if tally.rows < 2:
        evidence = f"it is too short: {tally.rows} of {scan.samples} samples are left after trimming"
        raise LogMismatch(stream.table.path, evidence, "give a longer log, or trim less")
    whole = digest()
    if keeping is not None:
        write_digest(whole, keeping[0])
    return whole


class _Meaning:
    """What the setup makes of rows as they are read; the last of them is kept for its provenance."""

    def __init__(self, setup: StreamSetup) -> None:
        self._setup = setup
        self.last: Log

    def __call__(self, log: Log) -> Log:
        self.last = self._setup.with_meaning(log)
        self._setup.check_signals(self.last)
        return self.last


def _found(file: Path, sha256: str, wanted: str) -> tuple[Digest, tuple[int, int, int, int] | None] | None:
    """Return what was done of a log before, and how far; None where nothing of use is there."""
    if not file.is_file():
        return None
    try:
        digest, position = read_position(file)
    except DynidentError:
        return None  # of another version, or not ours: the work is done anew
    same = model_hash(digest.model, digest.how, digest.base.independent.tolist()) == wanted
    if not same or digest.chunks[0].sha256 != sha256:
        return None
    if position is None:
        return digest, None
    return digest, (position["windows"], position["rows"], position["stretch"], position["stride"])
