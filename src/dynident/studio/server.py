"""The studio as a server: on this machine only, one session, all gone when it ends unless a folder was given."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.server import ThreadingHTTPServer
from pathlib import Path

from dynident.errors import BadOption, FileError
from dynident.studio.folder import Folder
from dynident.studio.gate import Gate
from dynident.studio.handler import Session, handler_for
from dynident.studio.history import History
from dynident.studio.runs import Runs

#: Largest upload where nothing else is said, in MB.
MAX_UPLOAD_MB = 1024.0


@dataclass(frozen=True)
class Studio:
    """A running studio.

    Attributes:
        session: Gate, folder and commands.
        thread: What serves it.
    """

    session: Session
    thread: threading.Thread

    @property
    def address(self) -> str:
        """The address to open, with the token."""
        return self.session.gate.address


@contextmanager
def studio(port: int = 0, work: str | Path | None = None, max_upload_mb: float = MAX_UPLOAD_MB) -> Iterator[Studio]:
    """Serve the studio while the context is open, on 127.0.0.1 only.

    Args:
        port: Port; 0 for a free one.
        work: Folder of the session, whose files it starts with; None for a temporary one that goes with it.
        max_upload_mb: Largest upload, in MB.

    Raises:
        FileError: There is no such folder.
        BadOption: A port that cannot be had, or an upload limit that is no size.
    """
    if not 0 < max_upload_mb < 1e6:
        raise BadOption("--max-upload", max_upload_mb, "give a size in MB, above 0")
    if work is not None and not Path(work).is_dir():
        raise FileError(work, "there is no such folder", "create it, or leave --work out")
    with tempfile.TemporaryDirectory(prefix="dynident-studio-", ignore_cleanup_errors=True) as own:
        folder = Folder(Path(own if work is None else work).resolve(), int(max_upload_mb * 1e6))
        server = _server(port)
        history = History(folder.path)
        runs = Runs(folder, history.runs, history.ran)
        session = Session(Gate(server.server_address[1]), folder, runs, history)
        server.RequestHandlerClass = handler_for(session)
        threading.Thread(target=_warm_up).start()  # no daemon: one that still imports can hang the end of Python
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)
        thread.start()
        try:
            yield Studio(session, thread)
        finally:
            session.runs.close()
            server.shutdown()
            server.server_close()


def _warm_up() -> None:
    """Import what the first view needs while the browser opens."""
    from dynident.robot_files import read_robot
    from dynident.studio import scene, views

    scene.scene_of(read_robot(views.choices()["robots"][0]), Path())


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    allow_reuse_address = False

    def handle_error(self, request: object, client_address: object) -> None:
        """A connection that breaks is nobody's fault."""


def _server(port: int) -> ThreadingHTTPServer:
    from http.server import BaseHTTPRequestHandler

    if not 0 <= port < 65536:
        raise BadOption("--port", port, "give a port from 1024 to 65535, or 0 for a free one")
    try:
        return _Server(("127.0.0.1", port), BaseHTTPRequestHandler)
    except OSError as error:
        raise BadOption("--port", port, f"it cannot be had ({error.strerror}); give another one, or 0") from error
