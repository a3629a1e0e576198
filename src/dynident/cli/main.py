"""The parser, lazy import of the command that was asked for, and the one error boundary with its exit codes."""

from __future__ import annotations

import argparse
import errno
import gc
import importlib
import os
import re
import signal
import sys
import traceback
from collections.abc import MutableMapping, Sequence
from io import TextIOWrapper
from typing import TYPE_CHECKING, Any, TextIO

from dynident.cli.parser import ALL_OPTIONS, SHORT, HelpText, OneLineParser, empty_value, shorten_help

if TYPE_CHECKING:
    from dynident.errors import BadOption

#: Commands in the order of the work; each is the module of the same name with ``SUMMARY``, ``configure`` and ``run``.
COMMANDS = (
    "demo", "inspect", "excite", "simulate", "export", "init", "check", "gains", "identify", "reduce", "merge",
    "validate", "predict", "payload", "monitor", "track", "compare", "diff", "fleet",
    "report", "selftest", "benchmark", "list", "environment", "studio", "completion",
)  # fmt: skip

#: Variables that state the threads of BLAS; the first two are set where none is.
BLAS_VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")

#: Objects made beyond those freed before cycles are looked for. Python's 700 looks 160 times while the modules of an
#: identification load, which are no garbage: 6 % of its time. They are some 100 000.
COLLECT_AFTER = 200_000

_MODULES = {"list": "list_parts"}

#: What the loader of shared libraries says where there is no memory for one.
_NO_MEMORY = ("failed to map segment from shared object", "cannot allocate memory")

#: Numbers with commas between them of which the first is negative; argparse knows only single ones.
_NEGATIVE_LIST = re.compile(r"-[\d.][^\s=]*,")

#: A robot model that may be a xacro, with arguments or without, and an argument of one.
_MODEL = re.compile(r"\.(xacro|urdf)(\s.*)?$|\w_description(\s.*)?$")
_XACRO_ARGUMENT = re.compile(r"([A-Za-z_]\w*):=(.*)", re.DOTALL)

_DESCRIPTION = """\
Dynamic model identification of robot arms: from a robot model and motion logs to a
physically consistent dynamic model with confidence intervals.

  dynident demo                                     the whole job on an industrial arm
  dynident inspect robot.urdf                       joints, limits, base parameters
  dynident init robot.urdf run.csv -o case.yaml     a commented case file to fill in
  dynident identify case.yaml run.csv --test other.csv -o estimate.json --report report.html
"""

_EPILOG = """\
exit codes: 0 done, 1 a named error, 2 wrong usage, 130 interrupted; identify and
validate also 3 acceptance criteria not met, 4 an error of the log checks.
'dynident COMMAND --help' explains a command.
"""


def build_parser(only: str | None = None, short: bool = False) -> argparse.ArgumentParser:
    """Return the parser of all commands, or of one; no command's own imports are made.

    Args:
        only: The command; None for all.
        short: Whether its help shows the options that most runs take, where it has many (``FREQUENT`` of its module).
    """
    from importlib.metadata import version

    parser = OneLineParser(prog="dynident", description=_DESCRIPTION, formatter_class=HelpText, epilog=_EPILOG)
    parser.add_argument("--version", action="version", version=f"dynident {version('dynident')}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands")
    for name in COMMANDS if only is None else (only,):
        module = module_of(name)
        own = commands.add_parser(name, help=module.SUMMARY, description=module.__doc__, formatter_class=HelpText)
        own.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
        module.configure(own)
        if short and hasattr(module, "FREQUENT"):
            shorten_help(own, module.FREQUENT)
    return parser


def module_of(name: str) -> Any:
    """Return the module of a command."""
    return importlib.import_module(f"dynident.cli.{_MODULES.get(name, name)}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    words = _joined(sys.argv[1:] if arguments is None else arguments)
    try:
        return _done(words)
    except KeyboardInterrupt as error:  # also while a command is loaded
        if "--debug" in words:
            traceback.print_exc()
        return _reported(error)


def _done(words: list[str]) -> int:
    from dynident.cli.console import remark
    from dynident.errors import BadOption, DynidentError, nearest

    if words and not words[0].startswith("-") and words[0] not in COMMANDS:
        remark(f"error: no command called '{words[0]}'{nearest(words[0], COMMANDS)}")
        remark("'dynident --help' lists the commands")
        return 2
    short = ALL_OPTIONS not in words
    words = [SHORT[-1] if word == ALL_OPTIONS else word for word in words]
    parser = build_parser(words[0] if words and words[0] in COMMANDS else None, short and bool({*SHORT} & set(words)))
    options, unknown = parser.parse_known_args(words)
    if options.command is None:
        if unknown:
            remark(f"error: no option '{unknown[0]}'{nearest(unknown[0], _flags(parser))}")
            remark("'dynident --help' lists options and commands")
        else:
            parser.print_help()
        return 2
    if unknown:
        remark(_not_taken(unknown[0], options, _parser_of(parser, options.command)))
        remark(f"'dynident {options.command} {ALL_OPTIONS}' lists all options")
        return 2

    if name := empty_value(_parser_of(parser, options.command), options):
        remark(f"error: {name} is empty; give its value, or leave it out")
        return 2
    if sys.stdout is None:
        remark("error: there is no standard output to write the answer to")
        return 1
    try:
        code = module_of(options.command).run(options)
        sys.stdout.flush()
    except (DynidentError, OSError, MemoryError, ImportError) as error:
        if isinstance(error, ImportError) and _out_of_memory(error) is None:
            raise
        if options.debug:
            traceback.print_exc()
        code = _reported(_by_flag(error, parser, options) if isinstance(error, BadOption) else error)
    return code


def _not_taken(given: str, options: argparse.Namespace, own: argparse.ArgumentParser) -> str:
    """Return the error on a word that a command does not take, beside what it took."""
    from dynident.errors import nearest

    command = options.command
    word = given.split("=", maxsplit=1)[0]
    if word.startswith("-"):
        return f"error: '{command}' has no option '{word}'{nearest(word, _flags(own), 0.7)}"
    names = " ".join(str(action.metavar or action.dest) for action in own._actions if not action.option_strings)
    step = f"it takes {names} and options" if names else "it takes options alone"
    for action in own._actions:
        if action.metavar == "NAMES" and getattr(options, action.dest) != action.default and "." not in given:
            step = f"write names with commas: {action.option_strings[0]} {getattr(options, action.dest)},{given}"
    if ":=" in given:
        step = f"arguments follow a xacro file: '{command} FILE.urdf.xacro {given}'"
    return f"error: '{command}' does not take '{given}'; {step}"


def _parser_of(parser: argparse.ArgumentParser, command: str) -> argparse.ArgumentParser:
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    return commands.choices[command]


def _flags(parser: argparse.ArgumentParser) -> list[str]:
    return [flag for action in parser._actions for flag in action.option_strings]


def _by_flag(error: BadOption, parser: argparse.ArgumentParser, options: argparse.Namespace) -> BadOption:
    """Return the error with the flag in place of the option's name in Python, where the flag is what was given."""
    for action in _parser_of(parser, options.command)._actions:
        given = getattr(options, action.dest, action.default) != action.default
        if action.dest == error.option and action.option_strings and (given or error.value is None):
            return error.called(action.option_strings[-1])
    return error


def _out_of_memory(error: BaseException | None) -> BaseException | None:
    """Return the lack of memory that an error is or follows from; libraries that do not load say it in a text alone."""
    while error is not None:
        lacking = isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM
        if lacking or any(sign in str(error).lower() for sign in _NO_MEMORY):
            return error
        error = error.__cause__ or error.__context__
    return None


def _joined(arguments: Sequence[str]) -> list[str]:
    """Return the arguments with those as one word that belong together.

    Lists such as -1,0.5 are the value of the option before them, not options; ``NAME:=VALUE`` belongs to the robot
    model before it, as for the program xacro.
    """
    found: list[str] = []
    for one in arguments:
        argument = _XACRO_ARGUMENT.fullmatch(one)
        robots = [number for number, word in enumerate(found) if _MODEL.search(word)] if argument else []
        if found and found[-1].startswith("--") and "=" not in found[-1] and _NEGATIVE_LIST.match(one):
            found[-1] += f"={one}"
        elif robots and argument:
            from dynident.robot_files.xacro import with_arguments

            found[robots[-1]] = with_arguments(found[robots[-1]], {argument[1]: argument[2]})
        else:
            found.append(one)
    return found


def _reported(error: BaseException) -> int:
    """Say on stderr what went wrong, in one line, and return the exit code."""
    from dynident.cli.console import remark
    from dynident.errors import DynidentError

    if isinstance(error, DynidentError):
        remark(f"error: {' '.join(str(error).split())}")
        return 1
    if isinstance(error, KeyboardInterrupt):
        remark("stopped")
        return 128 + signal.SIGINT
    if (lack := _out_of_memory(error)) is not None:
        evidence = f" ({' '.join(str(lack).split())})" if str(lack) else ""
        step = "raise its limit (ulimit -v), end other programs, or use fewer samples"
        remark(f"error: there is not enough memory{evidence}; {step}")
        return 1
    # Nothing more can be said on stdout: its reader (head, less) has gone, or its disk is full.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):
        return 128 + 13
    place, reason = getattr(error, "filename", None), getattr(error, "strerror", None)
    remark(f"error: {place or 'standard output'}: {reason or error}")
    return 1


def entry_point() -> None:
    """Run the command line and exit."""
    one_blas_thread_unless_stated(os.environ)
    gc.set_threshold(COLLECT_AFTER)
    escape_unknown_characters(sys.stdout)
    code = main()
    gc.freeze()  # the memory goes with the process: no search for cycles among all that is left
    sys.exit(code)


def escape_unknown_characters(stream: TextIO | None) -> None:
    """Have a stream escape characters that its encoding lacks, such as those of a unit or a name, by their number.

    Python writes so to the standard error; on the standard output they are an error, unless PYTHONIOENCODING states
    what to do with them.
    """
    if isinstance(stream, TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
        stream.reconfigure(errors="backslashreplace")


def one_blas_thread_unless_stated(variables: MutableMapping[str, str]) -> None:
    """Have BLAS work on one thread unless a variable states how many; NumPy reads them when it loads.

    The matrices here are small: a second thread of OpenBLAS waits in a loop for most of the time, which costs more than
    it spares, several times as much where other programs run.
    """
    if not any(name in variables for name in BLAS_VARIABLES):
        variables.update(dict.fromkeys(BLAS_VARIABLES[:2], "1"))
