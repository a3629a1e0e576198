"""``dynident studio`` itself: it prints its address, answers there, and takes all with it when it is ended."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from dynident.cli.main import main

COMMAND = [sys.executable, "-m", "dynident", "studio", "--no-browser"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_serves_until_it_is_ended(number: signal.Signals) -> None:
    with subprocess.Popen(COMMAND, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:") and "/?token=" in address
        with urllib.request.urlopen(address, timeout=30) as page:
            assert b"dynident <span>studio</span>" in page.read()
        said = [process.stderr.readline(), process.stderr.readline()]
        folder = Path(said[1].removeprefix("files: ").removesuffix(" (removed at the end)\n"))
        assert folder.is_dir() and said[1].endswith("(removed at the end)\n")
        time.sleep(0.2)
        process.send_signal(number)
        assert process.wait(30) == 0
    assert not folder.exists()


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
