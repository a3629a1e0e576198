"""A studio in a folder of its own, and a headless Chromium that is driven over its DevTools protocol."""

from __future__ import annotations

import base64
import http.client
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.parse
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dynident import read_robot, write_log
from dynident.studio.server import Studio, studio
from scara_logs import recorded

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


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


#: Puts the two ends of the pipes where Chromium expects them, and becomes Chromium.
_START = """
import os, sys
os.dup2(int(sys.argv[1]), 3)
os.dup2(int(sys.argv[2]), 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Chromium:
    """A headless Chromium, driven over two pipes by the DevTools protocol."""

    def __init__(self, program: str, profile: Path) -> None:
        import fcntl

        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        # The ends move out of the way of 3 and 4, where they have to be in the end.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (theirs_in, theirs_out)]
        options = ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader"]
        options += ["--no-first-run", "--disable-background-networking", "--remote-debugging-pipe"]
        cut = "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START, *map(str, ends), program, *options, cut, f"--user-data-dir={profile}"],
            pass_fds=ends,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        for end in (theirs_in, theirs_out, *ends):
            os.close(end)
        self._rest, self._count = b"", 0
        self.notes: list[dict[str, Any]] = []

    def call(self, session: str, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        os.write(self._out, json.dumps({**message, "sessionId": session} if session else message).encode() + b"\0")
        while True:
            while b"\0" not in self._rest:
                part = os.read(self._in, 1 << 20)
                assert part, "the browser is gone"
                self._rest += part
            line, _, self._rest = self._rest.partition(b"\0")
            found = json.loads(line)
            if found.get("id") == self._count:
                assert "error" not in found, found
                return found["result"]
            self.notes.append(found)

    def close(self) -> None:
        os.close(self._out)
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        os.close(self._in)


class Browser:
    """One page of a Chromium with the network cut, and all that it has asked for and complained of."""

    def __init__(self, chromium: Chromium) -> None:
        self._chromium, self._session, self._read = chromium, "", 0
        self.requests: list[str] = []
        self.complaints: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log", "DOM"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        answer = self._chromium.call(self._session, method, parameters)
        for note in self._chromium.notes:
            if note.get("sessionId") == self._session:
                self._note(note)
        self._chromium.notes.clear()
        return answer

    def _note(self, message: dict[str, Any]) -> None:
        facts = message.get("params", {})
        if message.get("method") == "Network.requestWillBeSent":
            self.requests.append(facts["request"]["url"])
        elif message.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(facts["exceptionDetails"])[:600])
        elif message.get("method") == "Runtime.consoleAPICalled" and facts["type"] in ("error", "warning"):
            self.complaints.append(json.dumps(facts["args"])[:600])
        elif message.get("method") == "Log.entryAdded" and facts["entry"]["level"] in ("error", "warning"):
            if "GPU stall due to ReadPixels" not in facts["entry"]["text"]:  # a screenshot of the software renderer
                self.complaints.append(f"{facts['entry']['text']} {facts['entry'].get('url', '')}"[:600])

    def js(self, code: str) -> Any:
        """Return the value of an expression in the page; a promise is awaited."""
        answer = self.call("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, code: str, timeout: float = 30.0) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + timeout
        while not self.js(f"!!({code})"):
            assert time.monotonic() < end, f"never true: {code}\n{self.js('document.body.innerText')[-1500:]}"
            time.sleep(0.05)

    def open(self, address: str, width: int = 1440, height: int = 900, dark: bool = False) -> None:
        self.size(width, height, dark)
        self.call("Page.navigate", url=address)
        self.until("document.readyState === 'complete'")

    def size(self, width: int, height: int = 900, dark: bool = False) -> None:
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def choose_files(self, selector: str, *files: Path) -> None:
        root = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", files=[str(file) for file in files], nodeId=node)

    def picture(self, file: Path, whole: bool = True) -> None:
        width, height = self.js("[innerWidth, document.documentElement.scrollHeight]")
        clip = {"width": width, "height": height, "x": 0, "y": 0, "scale": 1}
        extra = {"clip": clip, "captureBeyondViewport": True} if whole else {}
        data = self.call("Page.captureScreenshot", format="png", **extra)["data"]
        file.write_bytes(base64.b64decode(data))


@pytest.fixture(scope="session")
def new_browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], Browser]]:
    """Return what opens a new page of one Chromium."""
    if CHROMIUM is None or sys.platform == "win32":
        pytest.skip("there is no Chromium to open the page with")
    chromium = Chromium(CHROMIUM, tmp_path_factory.mktemp("chromium"))
    try:
        yield lambda: Browser(chromium)
    finally:
        chromium.close()
