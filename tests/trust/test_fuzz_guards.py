"""The guards of the fuzzer: what a reader must not do is found, in a process of its own as the guards stay."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

#: Readers that each do one thing that none may do, and two that are as they should be.
_SCRIPT = """
import json, os, shutil, socket, subprocess, sys, tempfile
from pathlib import Path

from dynident.errors import FileError
from fuzz import trial
from fuzz.targets import Target

inside, outside = Path(sys.argv[1]), Path(sys.argv[2])
trial.LONGEST = 1.0
(outside / "there").write_text("it")
(inside / "mine").write_text("it")


def spins(path):
    while True:
        pass


def refuses(path):
    raise FileError(path, "damaged", "record it again")


def says_nothing(path):
    class Silent(FileError):
        def __str__(self):
            return ""

    raise Silent(path, "", "")


def fits(path):
    (path.parent / "beside").write_text("a temporary file")
    os.replace(path.parent / "beside", path.parent / "again")
    return bytearray(200 << 20)


readers = {
    "taken": [fits, lambda path: open(os.devnull, "w").close()],
    "refused": [refuses],
    "crash": [lambda path: 1 / 0, says_nothing],
    "hang": [spins],
    "memory": [lambda path: bytearray(3 << 30)],
    "escape": [
        lambda path: (outside / "new").write_text("x"),
        lambda path: os.open(outside / "new", os.O_CREAT),
        lambda path: (outside / "folder").mkdir(),
        lambda path: (outside / "there").unlink(),
        lambda path: os.truncate(outside / "there", 0),
        lambda path: os.rename(outside / "there", path.parent / "stolen"),
        lambda path: os.replace(path.parent / "mine", outside / "there"),
        lambda path: os.symlink(path, outside / "link"),
        lambda path: os.link(path, outside / "link"),
        lambda path: shutil.rmtree(outside),
        lambda path: subprocess.run(["true"]),
        lambda path: os.system("true"),
        lambda path: os.posix_spawn("/bin/true", ["true"], {}),
        lambda path: os.fork() or os._exit(0),
        lambda path: socket.create_connection(("127.0.0.1", 9)),
        lambda path: socket.getaddrinfo("localhost", 80),
        lambda path: socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x", ("127.0.0.1", 9)),
        lambda path: socket.socket().bind(("127.0.0.1", 0)),
    ],
}
found, limited = {}, False
for expected, some in readers.items():
    for read in some:
        trials = trial.Trials(Target(".txt", "text", read), inside, outside)
        if not limited:
            trials.limit_memory()
        limited = True
        found.setdefault(expected, []).append(trials.judge(b"input")[0])
print(json.dumps(found))
print(json.dumps(sorted(path.name for path in outside.iterdir())))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the fuzzer limits memory and time as Linux does")
def test_what_no_reader_may_do_is_found_and_does_not_happen(tmp_path: Path) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    inside.mkdir()
    outside.mkdir()
    command = [sys.executable, "-c", _SCRIPT, str(inside), str(outside)]
    ended = subprocess.run(command, check=False, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert ended.returncode == 0, ended.stderr
    found, left = map(json.loads, ended.stdout.splitlines())
    assert {name for name, outcomes in found.items() if set(outcomes) != {name}} == set(), found
    assert left == ["there"] and (outside / "there").read_text() == "it"
