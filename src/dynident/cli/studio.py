"""Open the studio: a local web page for the whole job, from a robot description and a log to report and exports.

It is served to this machine only, under an address with a token that is printed once. Everything that is done there is
shown as the command that does the same. With --work the files of a folder are at hand and results stay there; without
it the session has a folder of its own, which is removed at the end: download what you want to keep.

  dynident studio
  dynident studio --work cell-3
  dynident studio --port 8123 --no-browser
"""

from __future__ import annotations

import argparse

SUMMARY = "the whole job in a local web page"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("--work", metavar="DIR", help="work on the files of this folder, and keep results there")
    parser.add_argument("--port", type=int, default=0, metavar="N", help="port on 127.0.0.1 (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    parser.add_argument(
        "--max-upload",
        type=float,
        default=1024.0,
        metavar="MB",
        help="largest upload (1024)",
    )


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    import contextlib
    import signal
    import threading
    import webbrowser

    from dynident.cli import console
    from dynident.errors import MissingDependency
    from dynident.studio.assets import three_js
    from dynident.studio.server import studio

    with contextlib.suppress(KeyboardInterrupt), studio(options.port, options.work, options.max_upload) as running:
        for number in _endings():  # before the address is told: commands and folder go with the studio
            signal.signal(number, signal.default_int_handler)
        console.answer(running.address)
        console.remark("open this address; it works on this machine only. Ctrl-C ends the studio")
        console.remark(f"files: {running.session.folder.path}{'' if options.work else ' (removed at the end)'}")
        try:
            three_js()
        except MissingDependency as error:
            console.remark(f"no 3D view: {error}")
        if not options.no_browser:
            webbrowser.open(running.address)
        threading.Event().wait()
    return 0


def _endings() -> list[int]:
    """Return the signals that end the studio as Ctrl-C does: SIGTERM, and SIGHUP unless it is ignored (nohup)."""
    import signal

    found: list[int] = [signal.SIGTERM]
    hang_up = getattr(signal, "SIGHUP", None)
    if hang_up is not None and signal.getsignal(hang_up) is signal.SIG_DFL:
        found.append(hang_up)
    return found
