"""Help of a command in one screen: its summary, its examples and the options that most runs take."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

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
