"""The parser of the command line: what is wrong in one line of words, with the nearest choice.

The help of a command takes one screen: its summary, its examples and the options that most runs take.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from typing import Any, NoReturn

#: What argparse says where arguments, or the value of an option, are missing.
_MISSING = "the following arguments are required: "
_NO_VALUE = re.compile(r"argument (?:\S+/)?(?P<flag>-\S+): expected (?:one|at least one) argument")

#: Kinds of values in words.
KINDS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "yes or no",
    "str": "a word",
    "None": "none",
    "tuple[str, ...]": "names",
    "tuple[float, ...]": "numbers",
    "tuple[int, ...]": "whole numbers",
}


class OneLineParser(argparse.ArgumentParser):
    """Says what is wrong with the arguments in one line, and how all options are listed; exit code 2."""

    def error(self, message: str) -> NoReturn:
        """Print the fault and the flag that lists the options, and exit with 2."""
        from dynident.cli.console import remark

        text = message
        if message.startswith(_MISSING):
            free = {_name(action) for action in self._actions if action.nargs == "*"}  # told before Python 3.14
            text = f"missing: {', '.join(name for name in message[len(_MISSING) :].split(', ') if name not in free)}"
        elif match := _NO_VALUE.match(message):
            text = f"{match['flag']} needs a value"
        command = self.prog.partition(" ")[2]
        flag = ALL_OPTIONS if command else "--help"
        remark(f"error: {text}")
        remark(f"'{self.prog} {flag}' lists all options")
        raise SystemExit(2)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            kind = KINDS.get(getattr(action.type, "__name__", ""), "a number")
            stated = isinstance(error.__context__, argparse.ArgumentTypeError)
            text = error.message if stated else f"{kind} is needed"
            raise argparse.ArgumentError(None, f"{_name(action)} {arg_string}: {text}") from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        from dynident.errors import nearest

        if action.choices is None or value in action.choices:
            return
        choices = [str(choice) for choice in action.choices]
        step = f"choose one of: {', '.join(choices)}{nearest(str(value), choices)}"
        raise argparse.ArgumentError(None, f"{_name(action)} {value}: no such choice; {step}")


def _name(action: argparse.Action) -> str:
    return action.option_strings[-1] if action.option_strings else str(action.metavar or action.dest)


def empty_value(parser: argparse.ArgumentParser, options: argparse.Namespace) -> str:
    """Return the first argument that was given an empty value; empty where there is none."""
    for action in parser._actions:
        value = getattr(options, action.dest, action.default)
        values = value if isinstance(value, list) else [value]
        if value not in (action.default, action.const) and any(
            isinstance(each, str) and not each.strip() for each in values
        ):
            return _name(action)
    return ""


#: Flags of the short and of the whole help.
SHORT, ALL_OPTIONS = ("-h", "--help"), "--help-all"

#: Examples of a short help.
EXAMPLES = 4


class HelpText(argparse.RawDescriptionHelpFormatter):
    """Descriptions as they are written; what an option is stands beside its name, up to a column."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=27)


def shorten_help(parser: argparse.ArgumentParser, frequent: Sequence[str]) -> None:
    """Keep the summary, examples, frequent options and what they are in short in the help; name the flag for all.

    Args:
        parser: That of the command, with all its options.
        frequent: Flags that stay; the required ones, the arguments and ``--help`` stay in any case.
    """
    summary, *rest = (parser.description or "").strip().split("\n\n")
    examples = [part for part in rest if part.lstrip().startswith("dynident ")][:1]
    parser.description = "\n\n".join([summary, *("\n".join(part.splitlines()[:EXAMPLES]) for part in examples)])
    needed = [_written(action) for action in parser._actions if action.required or not action.option_strings]
    parser.usage = f"%(prog)s [options] {' '.join(needed)}"
    hidden = 0
    for action in parser._actions:
        kept = not action.option_strings or action.required or {*frequent, *SHORT} & set(action.option_strings)
        if not kept and action.help is not argparse.SUPPRESS:
            action.help = argparse.SUPPRESS
            hidden += 1
        elif action.help is not None:
            action.help = action.help.partition("; ")[0]
    for group in parser._action_groups[2:]:  # behind the arguments and the options without a title: one list in short
        parser._optionals._group_actions += group._group_actions
        group._group_actions = []
    parser.epilog = f"{ALL_OPTIONS} shows {hidden} more options, and says more about the command"


def _written(argument: argparse.Action) -> str:
    """Return an argument or a required option as the first line of the help has it."""
    name = str(argument.metavar or argument.dest)
    if argument.option_strings:
        return f"{argument.option_strings[0]} {name}"
    return {"*": f"[{name} ...]", "+": f"{name} [{name} ...]", "?": f"[{name}]"}.get(str(argument.nargs), name)
