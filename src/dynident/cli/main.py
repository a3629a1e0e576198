"""The parser, lazy import of the command that was asked for, and the one error boundary with its exit codes."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

#: Commands in the order of the work; each is the module of the same name with ``SUMMARY``, ``configure`` and ``run``.
COMMANDS = ("demo", "inspect", "init", "identify", "validate", "report", "list")

_MODULES = {"list": "list_parts"}

_DESCRIPTION = """\
Dynamic model identification of robot arms: from a robot description and a motion log to a model that is
physically consistent and says how well each parameter is known.

  dynident demo                                     the article's case from end to end
  dynident inspect robot.urdf                       joints, limits, base parameters
  dynident init robot.urdf run.csv -o case.yaml     a commented case file to fill in
  dynident identify case.yaml run.csv --test other.csv -o estimate.json --report report.html
"""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands; no command's own imports are made."""
    parser = argparse.ArgumentParser(
        prog="dynident",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="exit codes: 0 done, 1 a named error, 2 wrong usage. 'dynident COMMAND --help' explains a command.",
    )
    parser.add_argument("--version", action="version", version=f"dynident {version('dynident')}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for name in COMMANDS:
        module = _module(name)
        own = commands.add_parser(
            name,
            help=module.SUMMARY,
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        own.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        module.configure(own)
    return parser


def _module(name: str) -> Any:
    return importlib.import_module(f"dynident.cli.{_MODULES.get(name, name)}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    parser = build_parser()
    options = parser.parse_args(arguments)
    if options.command is None:
        parser.print_help()
        return 2
    from dynident.errors import DynidentError

    try:
        return _module(options.command).run(options)
    except DynidentError as error:
        if options.debug:
            traceback.print_exc()
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 128 + signal.SIGINT
    except BrokenPipeError:
        # The reader (head, less) has gone; nothing more can be said on stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + 13


def entry_point() -> None:
    """Run the command line and exit."""
    sys.exit(main())
