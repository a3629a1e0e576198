"""One log to a digest, whatever its size: read, filtered and reduced window by window; its work is kept on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynident.errors import DynidentError, LogMismatch
from dynident.estimation.cutoff.choice import LONGEST_S, with_cutoff
from dynident.estimation.friction.delay import find_delays
from dynident.estimation.friction.held_out_fields import has_choices
from dynident.estimation.friction.variable_projection import has_varying
from dynident.estimation.observer import Observer
from dynident.estimation.streaming.digest import Chunk, Digest
from dynident.estimation.streaming.tally import Segment, Tally
from dynident.estimation.streaming.time_scan import scan_time
from dynident.estimation.streaming.triangle_file import model_hash, read_position, write_digest
from dynident.estimation.streaming.windows import Piece, Window, Windows, steps_of
from dynident.experiment.case_file.case import Case
from dynident.experiment.case_file.log_of_robot import with_meaning
from dynident.experiment.formats import LogStream, stream_log
from dynident.experiment.log import Log
from dynident.experiment.preprocessing import Preprocessing
from dynident.experiment.preprocessing.butterworth import Butterworth
from dynident.model.base_parameters import BaseParameters, base_parameters
from dynident.model.friction import FRICTION
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


def check_streamable(case: Case) -> None:
    """Refuse what needs all rows at once.

    Raises:
        LogMismatch: Friction that is chosen, varied or loaded, or a split.
    """
    model, place = case.model, case.path or "the case"
    state = f"find it on a part of the log, and state it in {place}"
    loaded = ", ".join(FRICTION.name_of(part) for part in model.friction if "torque" in part.needs)
    faults = [
        (evidence, step)
        for asked, evidence, step in (
            (case.choose_friction, "friction: auto needs all rows at once, which a stream does not have", state),
            (has_varying(model), "a friction part that varies a field (vary) needs all rows at once", state),
            (
                has_choices(model),
                "a friction part that leaves a field to the log (choose) needs all rows at once",
                state,
            ),
            (
                loaded,
                "friction that depends on the load takes several passes",
                f"take {loaded} out of friction in {place}",
            ),
            (
                case.split,
                "a log is reduced as a whole, not split",
                f"take split out of {place} and test on another log",
            ),
        )
        if asked
    ]
    if faults:
        evidence, steps = ("; ".join(dict.fromkeys(texts)) for texts in zip(*faults, strict=True))
        raise LogMismatch(case.path or "case", evidence, f"{steps}; or identify a part of the log in memory")


def settled(case: Case, path: Path, progress: Callable[[str], None]) -> Preprocessing:
    """Return the preprocessing with a cut-off and a delay that are numbers, found from the head of a log where open."""
    how = case.preprocessing
    is_open = isinstance(how.filter, Butterworth) and how.filter.cutoff_hz is None
    if not is_open and how.delay_s is not None:
        return how
    head = _head(case, path)
    _check_signals(case, head)
    how = with_cutoff(case.model, [head], how, progress)[0]
    if how.delay_s is None:
        progress("delay of the torque")
        (delay,), _ = find_delays(case.model, base_parameters(case.model), [head], how)
        how = replace(how, delay_s=delay.applied)
    return how


def _head(case: Case, path: Path) -> Log:
    """Return the first minutes of a log."""
    stream, parts, rows = stream_log(path, case.columns), list[Log](), 0
    for block in stream.blocks():
        parts.append(with_meaning(block, case.columns, case.robot, case.locked))
        rows += block.samples
        if parts[-1].time[-1] - parts[0].time[0] >= LONGEST_S or rows >= _HEAD:
            break
    signals = {name: np.concatenate([getattr(p, name) for p in parts]) for name in ("time", *parts[0].signals())}
    return replace(parts[0], **signals)


def reduce_log(
    case: Case,
    path: Path,
    base: BaseParameters,
    observer: Observer,
    progress: Callable[[str, float], None],
    checkpoint: Checkpoint | None,
    number: int,
    threads: int | None = None,
) -> Digest:
    """Return the digest of one log.

    Args:
        case: Model, preprocessing with a cut-off and a delay that are numbers, and meaning of the columns.
        path: The file.
        base: Base parameters of the model.
        observer: What makes its rows.
        progress: Told each step in words, and which share of the windows is done.
        checkpoint: Where the work is kept; None: nowhere.
        number: Of the log among others, for the name of its checkpoint.
        threads: Number of threads that filter windows, which does not change a bit of the result; None: one for each
            processor, three at most.

    Raises:
        LogFormatError: An unsound row.
        LogMismatch: What the case asks for takes all rows at once, or too few are left.
    """
    progress(f"{path}: hash", 0.0)
    stream = stream_log(path, case.columns, folder=None if checkpoint is None else checkpoint.place.parent)
    digest_id = model_hash(case.model, case.preprocessing, base.independent.tolist())
    found = _found(checkpoint, number, stream.table.sha256, digest_id)
    if found is not None and found[1] is None:
        return found[0]
    try:
        return _by_windows(case, stream, base, observer, progress, checkpoint, number, threads, found)
    finally:
        stream.close()


def _by_windows(
    case: Case,
    stream: LogStream,
    base: BaseParameters,
    observer: Observer,
    progress: Callable[[str, float], None],
    checkpoint: Checkpoint | None,
    number: int,
    threads: int | None,
    found: tuple[Digest, tuple[int, int, int, int] | None] | None,
) -> Digest:
    """Return the digest of an opened log, from where ``found`` stands on."""
    path = stream.table.path
    progress(f"{path}: time", 0.0)
    scan = scan_time(stream, case.preprocessing.filter, case.preprocessing.longest_gap_s)
    windows = Windows.of(scan, case.preprocessing, stream.table.path)
    tally, first = Tally(observer, windows.rate / windows.every, scan.count // windows.every), 0
    if found is not None and found[1] is not None:
        first, rows, stretch, stride = found[1]
        tally = Tally.resumed(observer, found[0], rows, stretch, stride)
    meaning = _Meaning(case)
    written = time.monotonic()

    def digest() -> Digest:
        steps = steps_of(windows, meaning.last, scan.source)
        rate = windows.rate / windows.every
        chunk = Chunk(stream.table.path, stream.table.sha256, scan.samples, tally.rows, rate, steps)
        assert tally.states is not None
        how, states = case.preprocessing, tally.states
        return Digest(case.model, base, how, case.columns, tally.joints(), states, tally.sampled(), (chunk,))

    def rows_of(piece: Piece) -> tuple[Window, Sequence[Segment]]:
        window = windows.window(piece)
        return window, list(observer.segments(window.prepared))

    pieces = windows.pieces(stream, meaning, first)
    threads = threads or min(usable_processors(), _THREADS)
    for done, ready in enumerate(in_order(rows_of, pieces, threads), start=first + 1):
        tally.add(*ready)
        progress(f"{path}: {100 * done // windows.count} % of {scan.samples:,} rows", done / windows.count)
        late = checkpoint is not None and time.monotonic() - written >= checkpoint.period_s
        if checkpoint is not None and late and tally.rows and done < windows.count:
            position = {"windows": done, "rows": tally.rows, "stretch": tally.stretch, "stride": tally.stride}
            write_digest(digest(), checkpoint.file(number), position)
            written = time.monotonic()
    if tally.rows < 2:
        raise LogMismatch(stream.table.path, f"{tally.rows} samples are left of {scan.samples}", "trim less")
    whole = digest()
    if checkpoint is not None:
        write_digest(whole, checkpoint.file(number))
    return whole


class _Meaning:
    """What the case makes of rows as they are read; the last of them is kept for its provenance."""

    def __init__(self, case: Case) -> None:
        self._case = case
        self.last: Log

    def __call__(self, log: Log) -> Log:
        self.last = with_meaning(log, self._case.columns, self._case.robot, self._case.locked)
        _check_signals(self._case, self.last)
        return self.last


def _check_signals(case: Case, log: Log) -> None:
    if log.torque is None:
        raise LogMismatch(log.name, "no torques", "map torque columns, or currents with drive gains, in the case file")
    if "temperature" in case.model.needs and log.temperature is None:
        step = "map them in the case file (log: columns: temperature), or leave the friction part out"
        raise LogMismatch(log.name, "no temperatures of the drives", step)


def _found(
    checkpoint: Checkpoint | None, number: int, sha256: str, wanted: str
) -> tuple[Digest, tuple[int, int, int, int] | None] | None:
    """Return what was done of a log before, and how far; None where nothing of use is there."""
    if checkpoint is None or not checkpoint.file(number).is_file():
        return None
    try:
        digest, position = read_position(checkpoint.file(number))
    except DynidentError:
        return None  # of another version, or not ours: the work is done anew
    same = model_hash(digest.model, digest.how, digest.base.independent.tolist()) == wanted
    if not same or digest.chunks[0].sha256 != sha256:
        return None
    if position is None:
        return digest, None
    return digest, (position["windows"], position["rows"], position["stretch"], position["stride"])
