"""One request of the browser: checked at the gate, answered from the session, every answer with the same headers."""

from __future__ import annotations

import json
import re
import urllib.parse
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

from dynident.errors import BadOption, DynidentError
from dynident.studio import views
from dynident.studio.assets import asset, three_js
from dynident.studio.folder import Folder
from dynident.studio.gate import POLICY, REPORT_POLICY, Gate
from dynident.studio.history import Edit, History
from dynident.studio.orders import order_of
from dynident.studio.runs import Runs

#: Largest body of a request that is no upload, in bytes.
MAX_BODY = 2_000_000

_JSON = "application/json; charset=utf-8"


@dataclass(frozen=True)
class Session:
    """What the requests of one run of the studio share.

    Attributes:
        gate: Who may ask.
        folder: The files.
        runs: The commands.
        history: What was edited among them.
    """

    gate: Gate
    folder: Folder
    runs: Runs
    history: History


@dataclass(frozen=True)
class Reply:
    """An answer.

    Attributes:
        status: Status of HTTP.
        body: Its bytes, or the file that holds them.
        kind: Its media type.
        headers: Further headers.
    """

    status: int
    body: bytes | Path
    kind: str = _JSON
    headers: Mapping[str, str] = field(default_factory=dict)


class StudioHandler(BaseHTTPRequestHandler):
    """Answers the requests of one connection; ``session`` is set by :func:`handler_for`."""

    session: Session
    protocol_version = "HTTP/1.1"
    server_version = "dynident"
    sys_version = ""
    timeout = 60

    def do_GET(self) -> None:
        """Answer a request that changes nothing."""
        self._answer("GET")

    def do_POST(self) -> None:
        """Answer a request that changes something."""
        self._answer("POST")

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the terminal belongs to the command."""

    def _answer(self, method: str) -> None:
        try:
            parts = urllib.parse.urlsplit(self.path)
        except ValueError:  # such as brackets around no address
            self.close_connection = True
            return self._send(_said(400, "the address of the request is not valid"))
        query = dict(urllib.parse.parse_qsl(parts.query, keep_blank_values=True))
        headers = {name.lower(): value for name, value in self.headers.items()}
        refusal = self.session.gate.refusal(method, parts.path, query, headers)
        size = headers.get("content-length", "0" if method == "GET" else "")
        if refusal:
            self.close_connection = True
            reply = _said(403, refusal)
        elif "transfer-encoding" in headers or not size.isascii() or not size.isdigit() or len(size) > 15:
            self.close_connection = True
            reply = _said(411, "the request does not say how long it is")
        else:
            reply = self._guarded(method, parts.path, query, int(size))
        return self._send(reply)

    def _guarded(self, method: str, path: str, query: Mapping[str, str], size: int) -> Reply:
        session = self.session
        route = _ROUTES.get((method, path))
        if route is None:
            self.close_connection = size > 0
            return self._file(path) if method == "GET" else _said(404, "there is nothing here")
        try:
            return self._answered(route, path, query, size)
        except DynidentError as error:
            return _said(422, views.local(session.folder, " ".join(str(error).split())))
        except TimeoutError:
            self.close_connection = True
            return _said(408, "the rest of the request did not come")
        except Exception as error:  # a fault of one request must not end the connection without an answer
            return _said(500, f"the studio could not answer this: {type(error).__name__}: {error}"[:500])

    def _answered(self, route: Route, path: str, query: Mapping[str, str], size: int) -> Reply:
        """Read what came with a request and answer it."""
        if path == "/api/upload":
            self.close_connection = True  # an upload that is refused is not read to its end
            name = self.session.folder.receive(query.get("name", ""), self.rfile, size)  # type: ignore[arg-type]
            return _json({"name": name})
        if size > MAX_BODY:
            self.close_connection = True
            return _said(413, "the request is too long")
        data = _plain(self.rfile.read(size)) if size else {}
        if not isinstance(data, dict):
            return _said(400, "the request is not one JSON object of valid Unicode text; load the page again")
        return route(self.session, query, data)

    def _file(self, path: str) -> Reply:
        """Return a file of the page."""
        if path == "/static/three.js":
            try:
                return Reply(200, three_js(), "text/javascript; charset=utf-8")
            except DynidentError as error:
                return _said(404, str(error))
        found = asset(path.removeprefix("/static/")) if path.startswith("/static/") else None
        return _said(404, "there is nothing here") if found is None else Reply(200, *found)

    def _send(self, reply: Reply) -> None:
        size = len(reply.body) if isinstance(reply.body, bytes) else reply.body.stat().st_size
        headers = {
            "Content-Type": reply.kind,
            "Content-Length": str(size),
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cache-Control": "no-store",
            **reply.headers,
        }
        if self.close_connection:
            headers["Connection"] = "close"
        try:
            self.send_response(reply.status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.end_headers()
            if isinstance(reply.body, bytes):
                self.wfile.write(reply.body)
                return
            with open(reply.body, "rb") as stream:
                left = size
                while left and (chunk := stream.read(min(left, 1 << 20))):
                    self.wfile.write(chunk)
                    left -= len(chunk)
        except (BrokenPipeError, ConnectionError, TimeoutError):
            self.close_connection = True  # the browser has gone


def handler_for(session: Session) -> type[StudioHandler]:
    """Return the handler of a session."""
    return type("SessionHandler", (StudioHandler,), {"session": session})


def _json(data: Any) -> Reply:
    return Reply(200, json.dumps(data, allow_nan=False).encode())


def _said(status: int, text: str) -> Reply:
    return Reply(status, json.dumps({"error": text}).encode())


def _plain(text: str | bytes) -> Any:
    """Return what a JSON text says; None where it is not JSON, or holds half a surrogate pair, which no file can."""
    try:
        value = json.loads(text)
        json.dumps(value, ensure_ascii=False).encode()
    except (ValueError, RecursionError):
        return None
    return value


Query = Mapping[str, str]
Data = Mapping[str, Any]
Route = Callable[[Session, Query, Data], Reply]


def _page(session: Session, query: Query, data: Data) -> Reply:
    found = asset("index.html")
    assert found is not None
    return Reply(200, *found, {"Set-Cookie": session.gate.cookie})


def _state(session: Session, query: Query, data: Data) -> Reply:
    runs = [run.figures(whole=False) for run in session.runs.all()]
    folder = session.folder
    facts = {"folder": str(folder.path), "max_bytes": folder.max_bytes}
    return _json({**facts, "files": folder.listing(), "runs": runs})


def _choices(session: Session, query: Query, data: Data) -> Reply:
    return _json(views.choices())


def _targets(session: Session, query: Query, data: Data) -> Reply:
    return _json(views.targets_view(query.get("kind", "")))


def _robot(session: Session, query: Query, data: Data) -> Reply:
    return _json(views.robot_view(session.folder, query.get("name", "")))


def _log(session: Session, query: Query, data: Data) -> Reply:
    names = _plain(query.get("columns", "[]"))
    if not isinstance(names, list):
        return _said(400, "the columns of the request are not a JSON list of names; load the page again")
    columns = tuple(map(str, names))
    return _json(views.log_view(session.folder, query.get("name", ""), query.get("case", ""), columns))


def _motion(session: Session, query: Query, data: Data) -> Reply:
    return _json(views.motion_view(session.folder, query.get("name", ""), query.get("case", "")))


def _case(session: Session, query: Query, data: Data) -> Reply:
    return _json(views.case_view(session.folder, query.get("name", "")))


def _save_case(session: Session, query: Query, data: Data) -> Reply:
    saved = views.saved_case(session.folder, data)
    session.history.wrote(Edit(session.runs.count, str(data["name"]), saved["text"]))
    return _json(saved)


def _history(session: Session, query: Query, data: Data) -> Reply:
    return _json({"commands": session.history.commands(session.runs.all())})


def _estimate(session: Session, query: Query, data: Data) -> Reply:
    return _json(views.estimate_view(session.folder, query.get("name", "")))


def _test_torques(session: Session, query: Query, data: Data) -> Reply:
    from dynident.studio.preview import torques_on_test_data

    return _json(torques_on_test_data(session.folder, query.get("name", "")))


def _run(session: Session, query: Query, data: Data) -> Reply:
    return _json(session.runs.get(_count(query, "number")).figures(_count(query, "since")))


def _count(query: Query, key: str) -> int:
    text = query.get(key, "")
    return int(text) if re.fullmatch(r"[0-9]{1,9}", text) else 0


def _start(session: Session, query: Query, data: Data) -> Reply:
    choices = data.get("choices")
    order = order_of(session.folder, str(data.get("verb", "")), choices if isinstance(choices, dict) else {})
    return _json(session.runs.start(order).figures())


def _cancel(session: Session, query: Query, data: Data) -> Reply:
    number = data.get("number")
    session.runs.cancel(number if isinstance(number, int) else 0)
    return _json({})


def _remove(session: Session, query: Query, data: Data) -> Reply:
    session.folder.remove(str(data.get("name", "")))
    return _json({})


def _download(session: Session, query: Query, data: Data) -> Reply:
    path = session.folder.find(query.get("name", ""))
    quoted = urllib.parse.quote(path.name, safe="")
    headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quoted}", "Content-Security-Policy": "sandbox"}
    return Reply(200, path, "application/octet-stream", headers)


def _report(session: Session, query: Query, data: Data) -> Reply:
    path = session.folder.find(query.get("name", ""))
    if path.suffix.lower() != ".html":
        raise BadOption("report", path.name, "choose a report")
    return Reply(200, path, "text/html; charset=utf-8", {"Content-Security-Policy": REPORT_POLICY})


_ROUTES: dict[tuple[str, str], Route] = {
    ("GET", "/"): _page,
    ("GET", "/api/state"): _state,
    ("GET", "/api/history"): _history,
    ("GET", "/api/choices"): _choices,
    ("GET", "/api/targets"): _targets,
    ("GET", "/api/robot"): _robot,
    ("GET", "/api/log"): _log,
    ("GET", "/api/motion"): _motion,
    ("GET", "/api/case"): _case,
    ("POST", "/api/case"): _save_case,
    ("GET", "/api/estimate"): _estimate,
    ("GET", "/api/test-torques"): _test_torques,
    ("GET", "/api/run"): _run,
    ("POST", "/api/run"): _start,
    ("POST", "/api/cancel"): _cancel,
    ("POST", "/api/remove"): _remove,
    ("POST", "/api/upload"): _state,  # its body is no JSON: the handler takes it as it comes
    ("GET", "/file"): _download,
    ("GET", "/report"): _report,
}
