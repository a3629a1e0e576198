"""Machine code on disk may only cost time: missing, full, damaged, of another processor, it is made again."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np
import pytest

from dynident.model.kernels import code_files, compiled
from dynident.model.kernels.code_files import KEPT, WORTH_KEEPING, kept_code
from dynident.model.kernels.emit import llvm_assembly
from dynident.model.kernels.generated import compiled_quantity
from dynident.robot_files import read_robot

LONG = "; a comment\n" * WORTH_KEEPING


class Maker:
    """Makes code and counts how often."""

    def __init__(self, code: bytes = b"code of this processor") -> None:
        self.code, self.times = code, 0

    def __call__(self) -> bytes:
        self.times += 1
        return self.code


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder in which code is kept."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    return tmp_path / "kept"


def test_what_was_made_is_not_made_again(folder: Path) -> None:
    first, second = Maker(), Maker(b"not asked for")
    assert kept_code("cpu", LONG, first) == kept_code("cpu", LONG, second) == first.code
    assert (first.times, second.times, len(list(folder.iterdir()))) == (1, 0, 1)


def test_another_processor_or_assembly_has_code_of_its_own(folder: Path) -> None:
    makers = [Maker(bytes([k])) for k in range(3)]
    asked = [("cpu", LONG), ("other cpu", LONG), ("cpu", LONG + "ret void")]
    for _ in range(2):
        found = [kept_code(*words, maker) for words, maker in zip(asked, makers, strict=True)]
        assert found == [maker.code for maker in makers]
    assert [maker.times for maker in makers] == [1, 1, 1]


def test_damaged_files_are_made_again(folder: Path) -> None:
    maker = Maker()
    kept_code("cpu", LONG, maker)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    for damaged in (b"", whole[:20], whole[:-1], whole[:-1] + b"?", bytes(len(whole))):
        file.write_bytes(damaged)
        assert kept_code("cpu", LONG, maker) == maker.code
        assert file.read_bytes() == whole
    assert maker.times == 6


@pytest.mark.parametrize("place", ["a file", "/proc/none"])
def test_no_place_is_no_error(place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / place))
    maker = Maker()
    assert kept_code("cpu", LONG, maker) == kept_code("cpu", LONG, maker) == maker.code
    assert maker.times == 2


def test_a_full_disk_is_no_error_and_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    assert kept_code("cpu", LONG, Maker()) == Maker().code
    assert list(folder.iterdir()) == []


def test_without_a_stated_folder_the_users_own_comes_after_that_of_the_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    beside, own = code_files.cache_folders()
    assert beside == Path(code_files.__file__).parent / "__pycache__"
    assert own.is_absolute() and own.name == "dynident"
    monkeypatch.setattr("os.path.expanduser", lambda name: name)  # nobody's home
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.delenv("LOCALAPPDATA", raising=False)
    assert list(code_files.cache_folders()) == [beside]


def test_the_oldest_files_go(folder: Path) -> None:
    folder.mkdir()
    for k in range(KEPT + 3):
        file = folder / f"{k}.dynident-code"
        file.write_bytes(b"old")
        os.utime(file, (k, k))
    (folder / "of_numba.nbc").write_bytes(b"not ours")
    kept_code("cpu", LONG, Maker())
    left = {file.name for file in folder.iterdir()}
    assert len(left) == KEPT + 1 and "of_numba.nbc" in left
    assert not left & {f"{k}.dynident-code" for k in range(4)} and "4.dynident-code" in left


def test_short_assembly_leaves_no_file(folder: Path) -> None:
    maker = Maker()
    assert kept_code("cpu", "ret void", maker) == kept_code("cpu", "ret void", maker) == maker.code
    assert maker.times == 2 and not folder.exists()


def test_threads_on_one_empty_folder(folder: Path) -> None:
    code = Maker(bytes(range(256)) * 100)
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda _: kept_code("cpu", LONG, code), range(64)))
    assert set(found) == {code.code}
    assert [file.suffix for file in folder.iterdir()] == [".dynident-code"]


def test_a_kernel_from_the_disk_is_the_kernel(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The regressor of an arm by code just made and by code read, bit by bit; the compiler is asked once."""
    made = compiled_quantity(read_robot("generic-6r").chain, "regressor", forced=False)
    assert made is not None
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 50, 6))
    parsed: list[str] = []
    parse = llvm.parse_assembly
    monkeypatch.setattr(llvm, "parse_assembly", lambda text: parsed.append(text) or parse(text))
    found = []
    for _ in range(2):
        out = np.zeros((50, 360))
        compiled.Kernel(*made).run((q, dq, ddq), (out,), 50)
        found.append(out)
    assert np.array_equal(*found) and np.count_nonzero(found[0]) > 1000
    assert parsed.count(llvm_assembly(*made, compiled.lanes())) == 1
