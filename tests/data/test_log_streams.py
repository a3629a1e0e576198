"""Logs in blocks: the rows of the whole log, the same errors, and memory that does not grow with the file."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.data.formats import (
    FORMATS,
    ColumnMap,
    LogStream,
    _arrays,
    read_log,
    stream_log,
    write_log,
    written_columns,
)
from dynident.data.log import Log
from dynident.errors import LogFormatError

N = 1000
GENERATOR = np.random.default_rng(3)
TIME, Q, TAU = np.cumsum(GENERATOR.uniform(0.001, 0.002, N)), *GENERATOR.normal(size=(2, N, 3))
COLUMNS = ColumnMap()


def check_stream(path: Path, columns: ColumnMap = COLUMNS, rows: int = 64) -> LogStream:
    """Check that blocks are the whole log, with its provenance, as often as they are asked for."""
    whole = read_log(path, columns)
    stream = stream_log(path, columns, folder=path.parent)
    times = stream.times(rows)
    np.testing.assert_array_equal(np.concatenate(list(times)), whole.time)
    for _ in range(2):
        blocks = stream.blocks(rows)
        logs = list(blocks)
        assert all(log.samples <= rows for log in logs) or not stream.table.rereads
        np.testing.assert_array_equal(np.concatenate([log.time for log in logs]), whole.time)
        for name, values in whole.signals().items():
            np.testing.assert_array_equal(np.concatenate([getattr(log, name) for log in logs]), values)
        assert blocks.result == whole.source == times.result
    assert not stream.table.rereads or not stream.kept
    stream.close()
    return stream


@pytest.mark.parametrize("name", FORMATS.names())
def test_blocks_of_what_a_format_writes_are_the_whole(name: str, tmp_path: Path) -> None:
    log = Log(("a", "b", "c"), TIME, Q, torque=TAU)
    suffixes = FORMATS.get(name).suffixes
    if not suffixes:
        pytest.skip("chosen by name only")
    path = tmp_path / f"run{suffixes[0]}"
    try:
        write_log(log, path, form=name)
    except LogFormatError:
        pytest.skip("only read")
    check_stream(path, written_columns(log))


@pytest.mark.parametrize("kept", ["C", "F", "turned", "single", "packed", "big-endian"])
def test_npz_of_every_layout(kept: str, tmp_path: Path) -> None:
    q: Any = {"F": np.asfortranarray(Q), "turned": Q.T, "single": Q.astype(np.float32)}.get(kept, Q)
    q = q.astype(">f8") if kept == "big-endian" else q
    save: Any = np.savez_compressed if kept == "packed" else np.savez
    save(tmp_path / "run.npz", t=TIME, q=q, tau=np.asfortranarray(TAU.T))
    found = read_log(tmp_path / "run.npz")
    np.testing.assert_array_equal(found.q, Q.astype(np.float32) if kept == "single" else Q)
    np.testing.assert_array_equal(np.asarray(found.torque), TAU)
    check_stream(tmp_path / "run.npz")


def test_a_damaged_npz_is_named_where_the_damage_is_read(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, t=TIME, q=Q, tau=TAU)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(LogFormatError, match="a damaged NumPy archive"):
        list(stream_log(path).blocks(50))


def test_mat_files_of_both_kinds(tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(tmp_path / "old.mat", {"t": TIME, "q": Q, "tau": TAU.T})
    check_stream(tmp_path / "old.mat")
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "new.mat", "w", userblock_size=512) as file:
        file["t"], file["tau"] = TIME[None], TAU
        file.create_dataset("q", data=Q.T, chunks=(3, 100), compression="gzip")
    with (tmp_path / "new.mat").open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(512))
    found = read_log(tmp_path / "new.mat")
    np.testing.assert_array_equal(found.q, Q)
    check_stream(tmp_path / "new.mat")


def test_text_with_comments_and_blank_lines_and_decimal_commas(tmp_path: Path) -> None:
    lines = ["t;q1;tau1"]
    for k in range(N):
        lines += [f"{TIME[k]!r};{Q[k, 0]!r};{TAU[k, 0]!r}".replace("np.float64(", "").replace(")", "")]
        lines += ["", "# a remark"] if k % 7 == 0 else []
    (tmp_path / "point.csv").write_text("\n".join(lines))
    (tmp_path / "comma.csv").write_text("\n".join(line.replace(".", ",") for line in lines))
    check_stream(tmp_path / "point.csv")
    check_stream(tmp_path / "comma.csv", ColumnMap(decimal=","))


FAULTS = {
    "word": ((500, 1, "oops"), "q1' holds 'oops', which is not a number"),
    "empty": ((701, 2, ""), "column 'tau1' holds no number"),
    "infinite": ((702, 2, "inf"), "column 'tau1' holds inf"),
    "back": ((640, 0, "0.0"), "runs back"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named_by_their_line_as_in_the_whole_log(fault: str, tmp_path: Path) -> None:
    cells = [[repr(float(x)) for x in row] for row in np.column_stack([TIME, Q[:, 0], TAU[:, 0]])]
    (row, column, text), words = FAULTS[fault]
    cells[row][column] = text
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["t,q1,tau1", *(",".join(line) for line in cells)]))
    with pytest.raises(LogFormatError, match=words) as whole:
        read_log(path)
    stream = stream_log(path, folder=tmp_path)
    with pytest.raises(LogFormatError) as caught:
        list(stream.times(64))
    assert str(caught.value) == str(whole.value) and caught.value.line == row + 2


def test_too_few_rows(tmp_path: Path) -> None:
    np.savez(tmp_path / "run.npz", t=TIME[:5], q=Q[:5], tau=TAU[:5])
    with pytest.raises(LogFormatError, match="only 5 rows"):
        list(stream_log(tmp_path / "run.npz").times(2))


def test_a_log_that_is_too_large_to_be_read_at_once_names_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.savez(tmp_path / "run.npz", t=TIME, q=Q, tau=TAU)
    monkeypatch.setattr(_arrays, "MAX_CELLS", 6999)
    with pytest.raises(LogFormatError, match=r"1,000 rows of 7 columns, more .* dynident reduce"):
        read_log(tmp_path / "run.npz")
    assert sum(log.samples for log in stream_log(tmp_path / "run.npz").blocks()) == N


@pytest.mark.parametrize("suffix", [".parquet", ".npz", ".csv"])
def test_memory_does_not_grow_with_the_file(suffix: str, tmp_path: Path) -> None:
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    peaks = []
    for samples in (20_000, 80_000):
        path = tmp_path / f"run{samples}{suffix}"
        log = Log(("a",), np.arange(samples) / 1000, np.ones((samples, 1)), torque=np.ones((samples, 1)))
        write_log(log, path)
        stream = stream_log(path, written_columns(log), folder=tmp_path)
        tracemalloc.start()
        assert sum(len(time) for time in stream.times(2000)) == samples
        assert sum(block.samples for block in stream.blocks(2000)) == samples
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        stream.close()
    assert peaks[1] < 1.3 * peaks[0] + 100_000
