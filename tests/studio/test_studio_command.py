"""``dynident studio`` itself: it prints its address, answers there, and takes all with it when it is ended."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import urllib.parse
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from dynident.cli.main import main
from dynident.cli.studio import endings

COMMAND = [sys.executable, "-m", "dynident", "studio", "--no-browser"]


@pytest.fixture
def signals_reach_children() -> Iterator[None]:
    """What this process ignores, as under nohup, its children would ignore too."""
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = [(number, signal.signal(number, signal.default_int_handler)) for number in numbers]
    yield
    for number, handler in before:
        signal.signal(number, handler)


@contextmanager
def _serving(*options: str, before: Sequence[str] = ()) -> Iterator[tuple[subprocess.Popen[str], str, Path]]:
    """A studio of its own process, with its address and its folder; it is gone at the end, whatever becomes of it."""
    with subprocess.Popen(
        [*before, *COMMAND, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            address = process.stdout.readline().strip()
            assert address.startswith("http://127.0.0.1:") and "/?token=" in address
            said = [process.stderr.readline(), process.stderr.readline()]
            yield process, address, Path(said[1].removeprefix("files: ").removesuffix(" (removed at the end)\n"))
        finally:
            process.kill()


def _started(address: str) -> None:
    """Start a long command as the page does."""
    parts = urllib.parse.urlsplit(address)
    cookie = f"dynident-studio-{parts.port}={urllib.parse.parse_qs(parts.query)['token'][0]}"
    headers = {"Origin": f"http://{parts.netloc}", "Cookie": cookie}
    order = {"verb": "excite", "choices": {"case": "generic-6r", "friction": ["viscous"], "time_limit": 600}}
    request = urllib.request.Request(f"http://{parts.netloc}/api/run", json.dumps(order).encode(), headers)
    with urllib.request.urlopen(request, timeout=30) as answer:
        assert json.load(answer)["state"] == "running"


def _children(process: subprocess.Popen[str]) -> list[int]:
    """Return the processes that another one has started."""
    lists = Path(f"/proc/{process.pid}/task").glob("*/children")
    return [int(number) for found in lists for number in found.read_text().split()]


def _gone(numbers: list[int], patience: float = 20.0) -> bool:
    """Say whether processes end; one that nobody has asked for yet counts as ended."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        states = [Path(f"/proc/{number}/stat") for number in numbers]
        if all(not one.exists() or one.read_text().rpartition(")")[2].split()[0] == "Z" for one in states):
            return True
        time.sleep(0.05)
    return False


@pytest.mark.battery  # waits for processes of their own
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.usefixtures("signals_reach_children")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_it_serves_until_it_is_ended(name: str) -> None:
    with _serving() as (process, address, folder):
        with urllib.request.urlopen(address, timeout=30) as page:
            assert b"dynident <span>studio</span>" in page.read()
        assert folder.is_dir()
        process.send_signal(getattr(signal, name))
        assert process.wait(30) == 0
    assert not folder.exists()


@pytest.mark.usefixtures("signals_reach_children")
def test_what_ends_it_is_noted_and_raised_nowhere() -> None:
    before = signal.getsignal(signal.SIGINT)
    with endings() as asked:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
        assert asked == [signal.SIGINT, signal.SIGTERM]
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.usefixtures("signals_reach_children")
def test_what_is_ignored_stays_ignored_but_for_sigterm() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    with endings() as asked:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
    assert asked == [signal.SIGTERM]


@pytest.mark.battery
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="processes are looked up in /proc")
@pytest.mark.usefixtures("signals_reach_children")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_command_that_runs_ends_with_the_studio(number: signal.Signals, tmp_path: Path) -> None:
    with _serving("--work", str(tmp_path)) as (process, address, _):
        _started(address)
        children = _children(process)
        assert children
        process.send_signal(number)
        process.wait(30)
        assert _gone(children)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.battery
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="processes are looked up in /proc")
@pytest.mark.usefixtures("signals_reach_children")
def test_in_the_background_of_a_script_sigterm_ends_it_with_its_command(tmp_path: Path) -> None:
    ignoring = ("sh", "-c", 'trap "" INT; exec "$@"', "sh")
    with _serving("--work", str(tmp_path), before=ignoring) as (process, address, _):
        _started(address)
        children = _children(process)
        assert children
        process.send_signal(signal.SIGINT)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(2)
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
        assert _gone(children)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["studio", "--no-browser", "--work", str(tmp_path / "none")]) == 1
    assert "there is no such folder; create it, or leave --work out" in capsys.readouterr().err


def test_the_first_view_needs_nothing_heavy() -> None:
    code = """
import sys, urllib.request
from dynident.studio.server import studio
with studio() as running:
    opened = urllib.request.build_opener()
    opened.addheaders = [("Cookie", running.session.gate.cookie.split(";")[0])]
    for path in ("", "static/report.css", "static/main.js", "api/choices", "api/state", "api/robot?name=er16"):
        opened.open(f"http://127.0.0.1:{running.session.gate.port}/{path}").read()
print([name for name in ("numba", "scipy", "jinja2", "trimesh") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
