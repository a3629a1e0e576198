"""What every log format must do, whoever writes it: one battery for the whole folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynident.data.formats import FORMATS, ColumnMap, LogFormat, read_header, read_log, write_log, written_columns
from dynident.data.log import Log
from dynident.errors import DynidentError, FileError, LogFormatError, LogMismatch

PARTS = FORMATS.names()
N = 25


@pytest.fixture(params=PARTS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def part(name: str) -> LogFormat:
    return FORMATS.make(name)


@pytest.fixture
def suffix(part: LogFormat) -> str:
    return part.suffixes[0] if part.suffixes else ".txt"


def log() -> Log:
    generator = np.random.default_rng(5)
    q, tau = generator.normal(size=(2, N, 3))
    return Log(("a", "b", "c"), np.cumsum(generator.uniform(0.001, 0.01, N)), q, torque=tau)


def written(part: LogFormat, path: Path) -> bool:
    try:
        part.write(log(), path)
    except LogFormatError as error:
        assert "only read" in str(error) and not path.exists()
        return False
    return True


def test_no_two_formats_take_one_suffix() -> None:
    suffixes = [suffix for name in PARTS for suffix in FORMATS.get(name).suffixes]
    assert len(suffixes) == len(set(suffixes))


def test_the_suffix_finds_the_format_in_any_case(name: str, part: LogFormat) -> None:
    for suffix in part.suffixes:
        assert suffix.startswith(".") and suffix == suffix.lower()
        assert FORMATS.get(name).takes(f"run{suffix.upper()}") and not FORMATS.get(name).takes("run.unknown")


def test_a_missing_file_is_named(part: LogFormat, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"missing{suffix}"
    with pytest.raises(FileError) as caught:
        read_header(path, form=part)
    assert str(path) in str(caught.value) and "check the path" in str(caught.value)


def test_a_folder_is_refused(part: LogFormat, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"folder{suffix}"
    path.mkdir()
    with pytest.raises((FileError, LogFormatError), match="folder"):
        read_header(path, form=part)


@pytest.mark.parametrize("content", [b"", b"\0" * 64, b"some text\nand more\n", bytes(range(256)) * 4])
def test_foreign_bytes_are_an_error_on_one_line(part: LogFormat, suffix: str, tmp_path: Path, content: bytes) -> None:
    path = tmp_path / f"foreign{suffix}"
    path.write_bytes(content)
    with pytest.raises(DynidentError) as caught:
        read_log(path, form=part)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_what_is_written_reads_back_bit_for_bit(part: LogFormat, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    if not written(part, path):
        return
    found = read_log(path, written_columns(log()), form=part)
    np.testing.assert_array_equal(found.time, log().time)
    np.testing.assert_array_equal(found.q, log().q)
    np.testing.assert_array_equal(found.torque, log().torque)  # type: ignore[arg-type]
    assert len(found.source.sha256) == 64 and found.source.rows == N and found.source.steps[0].startswith("read as ")
    assert set(read_header(path, form=part)) == {"t", *(f"{w}{k}" for w in ("q", "tau") for k in (1, 2, 3))}


def test_a_cut_file_is_an_error_or_shorter(part: LogFormat, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    if not written(part, path):
        return
    data = path.read_bytes()
    for share in (0.3, 0.6, 0.9):
        path.write_bytes(data[: int(share * len(data))])
        try:
            found = read_log(path, written_columns(log()), form=part)
        except DynidentError as error:
            assert "\n" not in str(error)
        else:
            assert found.samples <= N


def test_columns_that_are_not_there_and_values_that_are_not_finite(
    part: LogFormat, suffix: str, tmp_path: Path
) -> None:
    path = tmp_path / f"run{suffix}"
    if not written(part, path):
        return
    with pytest.raises(LogFormatError, match="no column 'q9'"):
        read_log(path, ColumnMap(q=("q1", "q2", "q9"), torque=()), form=part)
    q = np.array(log().q)
    q[3, 1] = np.inf
    with pytest.raises(LogMismatch, match="q2 of sample 4 is not finite"):
        write_log(Log(log().joints, log().time, q), tmp_path / f"bad{suffix}", form=part)
