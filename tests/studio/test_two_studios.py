"""Two studios in one folder, uploads, commands, edits, cancels and ends in any order: nothing is lost or replaced."""

from __future__ import annotations

import hashlib
import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import pytest
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from stand_ins import StandInRuns, order, until

from dynident.errors import BadOption, DynidentError, FileError
from dynident.studio.folder import Folder, store_of
from dynident.studio.history import Edit, History
from dynident.studio.runs import Run


class Session:
    """What one studio holds."""

    def __init__(self, path: Path) -> None:
        self.folder, self.history = Folder(path), History(path)
        self.runs = StandInRuns(self.folder, self.history)


_NAMES = st.sampled_from(("log.csv", "case.yaml", "estimate_1.json", "estimate_2.json"))


class TwoStudios(RuleBasedStateMachine):
    """Uploads, commands, edits, cancels, removals, ends of two studios; ``expected`` is what the folder must hold."""

    def __init__(self) -> None:
        super().__init__()
        self.path = Path(tempfile.mkdtemp())
        self.expected: dict[str, str] = {}
        self.done: set[str] = set()
        self.count = 0

    @initialize()
    def begin(self) -> None:
        self.sessions = [Session(self.path), Session(self.path)]

    @rule(which=st.integers(0, 1), name=_NAMES)
    def upload(self, which: int, name: str) -> None:
        self.count += 1
        text = f"upload {self.count}"
        kept = self.sessions[which].folder.receive(name, io.BytesIO(text.encode()), len(text))
        assert kept not in self.expected
        self.expected[kept] = text

    @rule(which=st.integers(0, 1), short=st.booleans())
    def break_an_upload(self, which: int, short: bool) -> None:
        with pytest.raises(FileError):
            self.sessions[which].folder.receive("log.csv", io.BytesIO(b"12"), 3 if short else 1 << 60)

    @rule(which=st.integers(0, 1), wait=st.sampled_from((0.0, 0.0, 60.0)))
    def start(self, which: int, wait: float) -> None:
        session = self.sessions[which]
        name = session.folder.reserve("estimate", ".json")
        assert name not in self.expected
        try:
            run = session.runs.start(order(name, wait))
        except BadOption:
            assert sum(one.state == "running" for one in session.runs.all()) == 2
            return
        if not wait:
            until(lambda: run.state != "running")
            assert run.state == "done" and run.outputs[0] not in self.expected, run.progress
            self.expected[run.outputs[0]] = name
            self.done.add(run.order.command)

    def _running(self, which: int) -> list[Run]:
        return [run for run in self.sessions[which].runs.all() if run.state == "running"]

    @rule(which=st.integers(0, 1))
    def cancel(self, which: int) -> None:
        for run in self._running(which)[:1]:
            self.sessions[which].runs.cancel(run.number)
            assert run.state == "cancelled"

    @rule(which=st.integers(0, 1), name=_NAMES, fresh=st.booleans())
    def edit(self, which: int, name: str, fresh: bool) -> None:
        self.count += 1
        session, text = self.sessions[which], f"edit {self.count}"
        seen = hashlib.sha256(self.expected.get(name, "").encode()).hexdigest() if fresh else "of another text"
        try:
            session.folder.write(name, text, seen)
        except DynidentError:
            assert not fresh or name not in self.expected
            return
        assert fresh
        self.expected[name] = text
        session.history.wrote(Edit(session.runs.count, name, text))
        self.done = {one for one in self.done if not one.startswith(f"cat > {name} ")}
        self.done.add(Edit(0, name, text).command)

    @rule(which=st.integers(0, 1), name=_NAMES)
    def remove(self, which: int, name: str) -> None:
        try:
            self.sessions[which].folder.remove(name)
        except FileError:
            return
        assert self.expected.pop(name)

    @rule(name=_NAMES)
    def write_beside(self, name: str) -> None:
        """Another program writes a file that is not there, as a command in a terminal does."""
        if name not in self.expected:
            (self.path / name).write_text("beside")
            self.expected[name] = "beside"

    @rule(which=st.integers(0, 1), killed=st.booleans())
    def end_and_begin_again(self, which: int, killed: bool) -> None:
        session = self.sessions[which]
        waiting = self._running(which)
        if killed:  # the system closes the pipes of a studio that is killed
            for process in session.runs.processes:
                if process.stdin is not None and not process.stdin.closed:
                    process.stdin.close()
        else:
            session.runs.close()
        until(lambda: all(process.poll() is not None for process in session.runs.processes))
        until(lambda: all(not (self.path / store_of(run.order.outputs[0])).exists() for run in waiting))
        self.sessions[which] = Session(self.path)
        known = self.sessions[which]
        assert self.done <= set(known.history.commands(known.runs.all()))
        assert all(run.state == "done" and run.answer == "answer\n" for run in known.runs.all())

    @precondition(lambda self: hasattr(self, "sessions"))
    @invariant()
    def the_folder_holds_what_was_made(self) -> None:
        held = {name: (self.path / name).read_text() for name in self.sessions[0].folder.names()}
        assert held == self.expected == {name: held[name] for name in self.sessions[1].folder.names()}

    def teardown(self) -> None:
        for session in getattr(self, "sessions", ()):
            session.runs.close()
        left = {path.name for path in self.path.iterdir() if not path.name.startswith(".studio-")}
        assert left == set(self.expected)  # no reserved name, no part of an upload
        shutil.rmtree(self.path)


TestTwoStudios = pytest.mark.battery(TwoStudios.TestCase)
TestTwoStudios.settings = settings(max_examples=100, stateful_step_count=25, deadline=None)


def test_the_next_session_shows_what_was_done(tmp_path: Path) -> None:
    first = Session(tmp_path)
    for _ in range(2):
        name = first.folder.reserve("estimate", ".json")
        run = first.runs.start(order(name))
        until(lambda run=run: run.state == "done")
        first.history.wrote(Edit(first.runs.count, "case.yaml", f"before {name}\n"))
    first.runs.close()
    commands = first.history.commands(first.runs.all())
    assert [line.split()[1] for line in commands] == ["identify", ">", "identify", ">"]
    journal = next(tmp_path.glob(".studio-*.jsonl"))
    with open(journal, "a") as out:
        out.write('{"number": 3, "verb": "iden')  # where the studio was killed
    second = Session(tmp_path)
    assert second.history.commands(second.runs.all()) == commands
    assert [(run.number, run.state, run.outputs, run.answer) for run in second.runs.all()] == [
        (1, "done", ["estimate_1.json"], "answer\n"),
        (2, "done", ["estimate_2.json"], "answer\n"),
    ]
    name = second.folder.reserve("estimate", ".json")
    third = second.runs.start(order(name))
    until(lambda: third.state == "done")
    assert third.number == 3
    (tmp_path / ".studio-0.jsonl").write_text('[]\n{"number": "x", "verb": 1}\n{"text": 1}\n')  # of something else
    assert Session(tmp_path).history.commands(second.runs.all())[:4] == commands


@pytest.mark.battery
@pytest.mark.skipif(not hasattr(os, "killpg"), reason="signals of POSIX")
def test_a_studio_that_is_killed_loses_nothing_that_was_done(tmp_path: Path, logs: tuple[Path, Path]) -> None:
    for log in logs:
        shutil.copy(log, tmp_path)
    (tmp_path / "arm.yaml").write_text(
        "case: 1\nrobot: generic-scara\ntrain: train.csv\nfriction: [coulomb, viscous]\n"
    )
    process, ask = _own_process(tmp_path)
    run = ask("run", {"verb": "check", "choices": {"case": "arm.yaml"}})
    until(lambda: ask(f"run?number={run['number']}")["state"] == "done", 120)
    answer = ask(f"run?number={run['number']}")["answer"]
    ask("run", {"verb": "identify", "choices": {"case": "arm.yaml"}})
    until(lambda: list(tmp_path.glob(".estimate_1.reserved")))
    process.send_signal(signal.SIGKILL)
    process.communicate()
    until(lambda: not list(tmp_path.glob(".*.reserved")))
    process, ask = _own_process(tmp_path)
    try:
        state = ask("state")
        assert [(one["verb"], one["state"]) for one in state["runs"]] == [("check", "done")]
        assert ask("run?number=1")["answer"] == answer
        assert ask("history")["commands"] == ["dynident check arm.yaml --json"]
        assert sorted(file["name"] for file in state["files"]) == ["arm.yaml", "test.csv", "train.csv"]
    finally:
        process.terminate()
        process.communicate()


def _own_process(folder: Path) -> tuple[subprocess.Popen[str], Callable[..., Any]]:
    """Start a studio as a process of its own; return it and what asks it."""
    import json

    command = [sys.executable, "-m", "dynident", "studio", "--work", str(folder), "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"})
    assert process.stdout is not None
    address = next(word for line in process.stdout for word in line.split() if word.startswith("http://"))
    host = address.split("/?")[0].rstrip("/")
    with urllib.request.urlopen(address) as page:
        cookie = page.headers["Set-Cookie"].split(";")[0]

    def ask(path: str, data: Any = None) -> Any:
        body = None if data is None else json.dumps(data).encode()
        request = urllib.request.Request(f"{host}/api/{path}", body, {"Cookie": cookie, "Origin": host})
        with urllib.request.urlopen(request) as answer:
            return json.loads(answer.read())

    return process, ask
