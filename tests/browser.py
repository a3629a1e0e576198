"""A headless Chromium driven over two pipes by the DevTools protocol: no driver, no port, no host but this machine."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

#: Longest time that an answer may take, in s.
PATIENCE = 30.0

#: Puts the two ends of the pipes where Chromium expects them, and becomes Chromium.
_START = """
import os, sys
os.dup2(int(sys.argv[1]), 3)
os.dup2(int(sys.argv[2]), 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


def found() -> str | None:
    """Return the path of a Chromium, None where there is none."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


class Chromium:
    """The browser, which answers commands to its pages one by one."""

    def __init__(self, profile: Path) -> None:
        import fcntl  # not on Windows

        program = found()
        assert program is not None
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        # The ends move out of the way of 3 and 4, where they have to be in the end.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (theirs_in, theirs_out)]
        options = ["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader"]
        options += ["--no-first-run", "--hide-scrollbars", "--disable-background-networking"]
        options += ["--remote-debugging-pipe", "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"]
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START, *map(str, ends), program, *options, f"--user-data-dir={profile}"],
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
        """Send a command and return its answer; what happens meanwhile is noted."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        os.write(self._out, json.dumps({**message, "sessionId": session} if session else message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._count:
            self.notes.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            assert select.select([self._in], [], [], PATIENCE)[0], "the browser does not answer"
            part = os.read(self._in, 1 << 20)
            assert part, "the browser is gone"
            self._rest += part
        line, _, self._rest = self._rest.partition(b"\0")
        return json.loads(line)

    def close(self) -> None:
        """End it with all its processes."""
        os.close(self._out)
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
        os.close(self._in)


@contextmanager
def chromium(profile: Path) -> Iterator[Chromium]:
    """Start a Chromium with a profile of its own and end it."""
    started = Chromium(profile)
    try:
        yield started
    finally:
        started.close()


class Browser:
    """One page, with all that it has asked for and complained of since it was opened.

    Attributes:
        requests: Addresses that the page asked for, those of data and of the page itself left out.
        complaints: Errors and warnings of the console, and exceptions.
    """

    def __init__(self, chromium: Chromium) -> None:
        self._chromium, self._session, self._address = chromium, "", ""
        self.requests: list[str] = []
        self.complaints: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log", "DOM"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command of the page and return its answer."""
        answer = self._chromium.call(self._session, method, parameters)
        for note in self._chromium.notes:
            if note.get("sessionId") == self._session:
                self._note(note["method"], note.get("params", {}))
        self._chromium.notes.clear()
        return answer

    def _note(self, method: str, facts: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            address = facts["request"]["url"]
            if not address.startswith("data:") and address.partition("#")[0] != self._address:
                self.requests.append(address)
        elif method == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(facts["exceptionDetails"])[:600])
        elif method == "Runtime.consoleAPICalled" and facts["type"] in ("error", "warning", "assert"):
            self.complaints.append(json.dumps(facts["args"])[:600])
        elif method == "Log.entryAdded" and facts["entry"]["level"] in ("error", "warning"):
            if "GPU stall due to ReadPixels" not in facts["entry"]["text"]:  # a screenshot of the software renderer
                self.complaints.append(f"{facts['entry']['text']} {facts['entry'].get('url', '')}"[:600])

    def js(self, code: str) -> Any:
        """Return the value of an expression in the page; a promise is awaited."""
        answer = self.call("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, code: str, timeout: float = PATIENCE) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + timeout
        while not self.js(f"!!({code})"):
            assert time.monotonic() < end, f"never true: {code}\n{self.js('document.body.innerText')[-1500:]}"
            time.sleep(0.05)

    def open(self, address: str | Path, width: int = 1440, **how: Any) -> None:
        """Show an address or a file as :meth:`size` has it, and wait until it stands."""
        self.size(width, **how)
        self.requests, self.complaints = [], []
        self._address = address.as_uri() if isinstance(address, Path) else address
        self.call("Page.navigate", url=self._address)
        self.until("document.readyState === 'complete'")

    def size(self, width: int, height: int = 900, dark: bool = False, media: str = "") -> None:
        """Show the page at a width, in light or dark, on the screen or as ``print``."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", **metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", media=media, features=[scheme])

    def key(self, name: str) -> None:
        """Press and release a key, such as ``ArrowLeft`` or ``+``."""
        text = {"text": name} if len(name) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=name, code=name, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=name, code=name)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag the mouse from a point of the window to another one."""
        (x, y), (a, b) = start, end
        held: dict[str, Any] = {"button": "left", "clickCount": 1}
        self.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **held)
        for at in ((x + a) / 2, (y + b) / 2), (a, b):
            self.call("Input.dispatchMouseEvent", type="mouseMoved", x=at[0], y=at[1], button="left", buttons=1)
        self.call("Input.dispatchMouseEvent", type="mouseReleased", x=a, y=b, **held)

    def choose_files(self, selector: str, *files: Path) -> None:
        """Choose files for an input of the page."""
        root = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", files=[str(file) for file in files], nodeId=node)
