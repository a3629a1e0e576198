"""The parser of the command line: what is wrong in one line of words, with the nearest choice."""

from __future__ import annotations

import argparse
import re
from typing import Any, NoReturn

from dynident.cli.short_help import ALL_OPTIONS

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
