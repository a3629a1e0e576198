"""Open the studio: a local web page for the whole job, from a robot model and a log to report and exports.

It is served to this machine only, under an address with a token that is printed once. Everything that is done there is
shown as the command that does the same. With --work the files of a folder are at hand and results stay there; without
it the session has a folder of its own, which is removed at the end: download what you want to keep.

  dynident studio
  dynident studio --work cell-3
  dynident studio --port 8123 --no-browser
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from dynident.cli import console
from dynident.errors import MissingDependency

SUMMARY = "the whole job in a local web page"


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("--work", metavar="DIR", help="work on the files of this folder, and keep results there")
    parser.add_argument("--port", type=int, default=0, metavar="N", help="port on 127.0.0.1 (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the address, open nothing")
    parser.add_argument("--max-upload", type=float, default=1024.0, metavar="MB", help="largest upload (1024)")
    parser.add_argument("--quiet", action="store_true", help="print the address, no remarks")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    import time
    import webbrowser

    from dynident.studio.assets import three_js
    from dynident.studio.server import studio

    with endings() as asked, studio(options.port, options.work, options.max_upload) as running:
        console.answer(running.address)
        console.remark("open this address; it works on this machine only. Ctrl-C ends the studio", options.quiet)
        kept = "" if options.work else " (removed at the end)"
        console.remark(f"files: {running.session.folder.path}{kept}", options.quiet)
        try:
            three_js()
        except MissingDependency as error:
            console.remark(f"no 3D view: {error}", options.quiet)
        if not options.no_browser and not asked:
            webbrowser.open(running.address)
        while not asked:
            time.sleep(0.2)
    return 0


@contextmanager
def endings() -> Iterator[list[int]]:
    """Collect the signals that ask for the end: SIGINT, SIGTERM and SIGHUP.

    They only make the list longer. An exception out of a signal's handler can leave a lock held for good, that of the
    imports for one, and what the other threads of the studio wait for then never comes. SIGINT and SIGHUP stay ignored
    where they are: so are they started with nohup, or in the background of a script.
    """
    import signal

    asked: list[int] = []
    before = []
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and (name == "SIGTERM" or signal.getsignal(number) is not signal.SIG_IGN):
            before.append((number, signal.signal(number, lambda number, frame: asked.append(number))))
    try:
        yield asked
    finally:
        for number, handler in before:
            signal.signal(number, handler)
