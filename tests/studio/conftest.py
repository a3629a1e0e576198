"""A studio in a folder of its own, its client, and pages of one browser."""

from __future__ import annotations

import http.client
import json
import sys
import time
import urllib.parse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from browser import Browser, chromium, found
from dynident import read_robot, write_log
from dynident.studio.server import Studio, studio
from scara_logs import recorded


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a log to learn from and one to test on."""
    folder = tmp_path_factory.mktemp("logs")
    for seed, name in enumerate(("train.csv", "test.csv")):
        write_log(replace(recorded(read_robot("generic-scara"), seed, 1500), dq=None, ddq=None), folder / name)
    return folder / "train.csv", folder / "test.csv"


class Client:
    """Asks a studio as its own page would, and lets a test change what is sent."""

    def __init__(self, running: Studio) -> None:
        gate = running.session.gate
        self.port, self.folder = gate.port, running.session.folder.path
        self.host = f"127.0.0.1:{gate.port}"
        self.own = {"Host": self.host, "Origin": f"http://{self.host}", "Cookie": gate.cookie.split(";")[0]}

    def ask(
        self, method: str, path: str, body: bytes | None = None, **changes: str | None
    ) -> tuple[int, dict[str, str], bytes]:
        headers = {**self.own, **{key.replace("_", "-"): value for key, value in changes.items()}}
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            if body is not None and "Content-Length" not in headers and "Transfer-Encoding" not in headers:
                headers["Content-Length"] = str(len(body))
            for name, value in headers.items():
                if value is not None:
                    connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
        finally:
            connection.close()

    def get(self, path: str) -> Any:
        status, _, body = self.ask("GET", path)
        assert status == 200, body
        return json.loads(body)

    def post(self, path: str, data: Any) -> tuple[int, Any]:
        status, _, body = self.ask("POST", path, json.dumps(data).encode())
        return status, json.loads(body)

    def upload(self, name: str, content: bytes) -> str:
        status, _, body = self.ask("POST", f"/api/upload?{urllib.parse.urlencode({'name': name})}", content)
        assert status == 200, body
        return json.loads(body)["name"]

    def names(self) -> list[str]:
        return [file["name"] for file in self.get("/api/state")["files"]]

    def run(self, verb: str, **choices: Any) -> dict[str, Any]:
        """Start a command and wait for its end."""
        status, run = self.post("/api/run", {"verb": verb, "choices": choices})
        assert status == 200, run
        while run["state"] == "running":
            time.sleep(0.05)
            run = self.get(f"/api/run?number={run['number']}")
        return run


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Studio]:
    work = tmp_path / "session"
    work.mkdir()
    with studio(work=work, max_upload_mb=10) as started:
        yield started


@pytest.fixture
def client(running: Studio) -> Client:
    return Client(running)


@pytest.fixture(scope="session")
def new_browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], Browser]]:
    """Return what opens a new page of one Chromium."""
    if found() is None or sys.platform == "win32":
        pytest.skip("there is no Chromium to open the page with")
    with chromium(tmp_path_factory.mktemp("chromium")) as started:
        yield lambda: Browser(started)
