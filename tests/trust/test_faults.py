"""Faults of the world around: processes that are killed, full disks, folders that are read-only, no home, no reader."""

from __future__ import annotations

import contextlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from one_joint_arm import URDF, write_run

from dynident.cli import main as cli
from dynident.cli.main import main
from dynident.errors import FileError
from dynident.files import written_for_a_while
from dynident.identification.files.estimate_file import read_estimate

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of POSIX")

Capture = pytest.CaptureFixture[str]
COMMAND = [sys.executable, "-c", "import sys; from dynident.cli.main import main; sys.exit(main(sys.argv[1:]))"]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with an arm of one joint, a log of 10 s and their case."""
    folder = tmp_path_factory.mktemp("cell")
    (folder / "arm.urdf").write_text(URDF)
    write_run(folder / "run.csv", 1000)
    how = "estimator: wls\ntrain: [run.csv]\npreprocessing: {filter: {butterworth: {cutoff_hz: 5}}, rate_hz: 50}\n"
    (folder / "case.yaml").write_text(f"case: 1\nrobot: arm.urdf\n{how}")
    return folder


def identify(cell: Path, *more: str) -> list[str]:
    return ["identify", str(cell / "case.yaml"), "--cross-validate", "0", "--quiet", *more]


WRITER = """
import sys
from dynident.files import write_atomically
print("ready", flush=True)
while True:
    for letter in "ab":
        write_atomically(sys.argv[1], letter * 3_000_000)
"""


def test_a_file_is_whole_whenever_its_writer_is_killed(tmp_path: Path) -> None:
    place, draw = tmp_path / "file", random.Random(3)
    place.write_text("a" * 3_000_000)
    for _ in range(6):
        process = subprocess.Popen([sys.executable, "-c", WRITER, str(place)], stdout=subprocess.PIPE)
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(draw.uniform(0.0, 0.05))
        process.kill()
        process.wait()
        process.stdout.close()
        content = place.read_bytes()
        assert content in (b"a" * 3_000_000, b"b" * 3_000_000)
    assert all(path.name.startswith(".file.") for path in tmp_path.iterdir() if path != place)


@contextlib.contextmanager
def disk_of(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond a size, as on a disk that is full."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_leaves_the_old_estimate(cell: Path, tmp_path: Path, capsys: Capture) -> None:
    place = tmp_path / "estimate.json"
    place.write_text("old")
    with disk_of(1000):
        assert main(identify(cell, "-o", str(place))) == 1
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith(f"error: {place}: cannot be written (file too large); check the folder")
    assert [path.name for path in tmp_path.iterdir()] == ["estimate.json"] and place.read_text() == "old"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no folder that nobody may write")
def test_a_folder_that_cannot_be_written(cell: Path, capsys: Capture) -> None:
    assert main(identify(cell, "-o", "/proc/estimate.json")) == 1
    assert "error: /proc/estimate.json: cannot be written (" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "darwin", reason="file names are UTF-8 there")
def test_names_of_files_that_are_no_utf_8(cell: Path, tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9"))
    folder.mkdir()
    for name in ("arm.urdf", "run.csv", "case.yaml"):
        (folder / name).write_bytes((cell / name).read_bytes())
    place, page = folder / os.fsdecode(b"\xff.json"), folder / os.fsdecode(b"\xfe.html")
    assert main(identify(folder, "-o", str(place), "--report", str(page))) == 0
    assert read_estimate(place).samples > 0
    assert page.read_bytes().decode("utf-8").startswith("<!DOCTYPE html>")


def test_a_reader_that_goes_and_a_disk_that_is_full() -> None:
    """``dynident list | head -1``, and an answer that no disk can hold."""
    process = subprocess.Popen([*COMMAND, "list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.wait() in (0, 141) and process.stderr.read() == b""  # nobody is there to be told
    process.stderr.close()
    if Path("/dev/full").exists():
        with open("/dev/full", "wb") as full:
            found = subprocess.run([*COMMAND, "list"], stdout=full, stderr=subprocess.PIPE, check=False, text=True)
        assert (found.returncode, found.stderr) == (1, "error: standard output: No space left on device\n")


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no folder that nobody may write")
@pytest.mark.battery
def test_no_home_and_no_cache(cell: Path) -> None:
    """Where nothing can be kept, everything is compiled anew and the answer is the same."""
    answers = []
    for cache in ({}, {"NUMBA_CACHE_DIR": "/proc/none"}):
        environment = {"PATH": os.environ.get("PATH", ""), "HOME": "/proc/none", **cache}
        found = subprocess.run([*COMMAND, *identify(cell, "--json")], env=environment, capture_output=True, check=True)
        assert b"Traceback" not in found.stderr
        answers.append(json.loads(found.stdout)["parameters"])
    assert answers[0] == answers[1]


@pytest.mark.battery
def test_two_processes_fill_one_cache(cell: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    words = [*COMMAND, *identify(cell, "--json")]
    both = [subprocess.Popen(words, env=environment, stdout=subprocess.PIPE) for _ in range(2)]
    answers = [json.loads(process.communicate()[0])["parameters"] for process in both]
    assert [process.returncode for process in both] == [0, 0] and answers[0] == answers[1]


def test_a_disk_that_is_full_meanwhile(tmp_path: Path) -> None:
    """Rows of a log that are kept while it is read, and an export that is proved before it is written."""
    for folder, name in ((tmp_path, str(tmp_path)), (None, tempfile.gettempdir())):
        with pytest.raises(FileError) as caught, disk_of(1000), written_for_a_while(folder):
            (tmp_path / "kept").write_bytes(bytes(2000))
        assert str(caught.value).startswith(f"{name}: a temporary file cannot be written (file too large); check its")
        assert ("TMPDIR" in str(caught.value)) == (folder is None)


def test_ctrl_c_while_a_command_is_loaded(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    def interrupted(_: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "module_of", interrupted)
    assert main(["list"]) == 130
    assert capsys.readouterr().err == "stopped\n"
