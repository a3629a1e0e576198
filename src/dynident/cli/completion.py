"""Print what makes a shell complete dynident: commands, options, and the names of parts.

The text is made from the parser itself; it knows estimators, friction parts, criteria and targets by name, and offers
files where a file goes.

  eval "$(dynident completion bash)"          in ~/.bashrc
  eval "$(dynident completion zsh)"           in ~/.zshrc, after compinit
  dynident completion fish | source           in ~/.config/fish/config.fish
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass

SUMMARY = "completion for bash, zsh or fish"

SHELLS = ("bash", "zsh", "fish")

#: Folders of the parts whose names go behind an option, by the option.
_PARTS = {
    "--estimator": (("dynident.identification.estimators", "dynident.identification.simulated.estimators"),),
    "--estimators": (("dynident.identification.estimators", "dynident.identification.simulated.estimators"),),
    "--friction": (("dynident.model.friction",),),
    "--criterion": (("dynident.excitation.criteria",),),
    "--trajectory": (("dynident.excitation.trajectories",),),
    "--profile": (("dynident.data.profiles",),),
    "--format": (("dynident.data.formats",),),
    "--to": (("dynident.exports.motions",), ("dynident.exports.models",)),
}

#: Words that an option takes besides the names of its family.
_WORDS = {"--friction": ("auto",), "--estimators": ("all", "quick"), "--cutoff": ("auto",), "--rate": ("all", "auto"),
          "--delay": ("auto",)}  # fmt: skip

#: Commands whose first argument may be the name of a robot that ships.
_ROBOTS = ("inspect", "excite", "init", "identify", "check", "compare")


@dataclass(frozen=True)
class OptionChoices:
    """What may follow in one command.

    Attributes:
        options: Its options.
        values: Words that go behind an option, by the option.
        bare: Options that take no value.
        words: Words that may stand alone, besides files.
    """

    options: tuple[str, ...]
    values: dict[str, tuple[str, ...]]
    bare: tuple[str, ...]
    words: tuple[str, ...]


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("shell", choices=SHELLS, help="the shell")


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    from dynident.cli import console
    from dynident.cli.main import build_parser

    console.answer_verbatim(completion(build_parser(), options.shell).rstrip())
    return 0


def completion(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return the text that a shell reads.

    Args:
        parser: The parser of all commands.
        shell: bash, zsh or fish.
    """
    known = _commands(parser)
    if shell == "fish":
        return _fish(known)
    return _bash(known) if shell == "bash" else _zsh(known)


def _commands(parser: argparse.ArgumentParser) -> dict[str, OptionChoices]:
    """Return the choices of each command, in the order of the help."""
    found: dict[str, OptionChoices] = {}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, own in action.choices.items():
                found[name] = _choices(name, own)
    return found


def _choices(name: str, parser: argparse.ArgumentParser) -> OptionChoices:
    from dynident.plugins import part_names
    from dynident.robot_files import shipped_robots

    options: list[str] = []
    values: dict[str, tuple[str, ...]] = {}
    bare: list[str] = []
    words: list[str] = []
    for action in parser._actions:
        shown = [option for option in action.option_strings if action.help is not argparse.SUPPRESS]
        options += shown
        given = tuple(map(str, action.choices or ()))
        if action.nargs == 0:
            bare += shown
        for option in shown:
            parts = tuple(part for rooms in _PARTS.get(option, ()) for part in part_names(*rooms))
            told = re.findall(r"[a-z]+", action.help or "")  # the same option means other things in other commands
            own = tuple(word for word in _WORDS.get(option, ()) if word in told)
            if given or parts or own:
                values[option] = tuple(dict.fromkeys((*given, *own, *parts)))
        if not action.option_strings:
            words += given
    words += shipped_robots() if name in _ROBOTS else ()
    return OptionChoices(tuple(options), values, tuple(bare), tuple(words))


#: The words of one command line: $1 the command, $2 the word before, then what to offer, or files.
_BASH = """\
_dynident() {{
  local cur prev words command i
  cur="${{COMP_WORDS[COMP_CWORD]}}" prev="${{COMP_WORDS[COMP_CWORD-1]}}" command="" words=""
  for ((i = 1; i < COMP_CWORD; i++)); do
    case "${{COMP_WORDS[i]}}" in -*) ;; *) command="${{COMP_WORDS[i]}}"; break ;; esac
  done
  if [[ -z "$command" ]]; then
    COMPREPLY=($(compgen -W "{commands} --help --version" -- "$cur"))
    return
  fi
  case "$command $prev" in
{values}
  esac
  if [[ -n "$words" && "$cur" != -* ]]; then
    COMPREPLY=($(compgen -W "$words" -- "$cur"))
    return
  fi
  case "$command" in
{options}
  esac
  if [[ "$cur" == -* ]]; then
    COMPREPLY=($(compgen -W "$words" -- "$cur"))
    return
  fi
  words=""
  case "$command" in
{words}
  esac
  COMPREPLY=($(compgen -W "$words" -- "$cur"))
  while IFS= read -r i; do COMPREPLY+=("$i"); done < <(compgen -f -- "$cur")
}}
complete -o filenames -F _dynident dynident
"""


def _bash(known: dict[str, OptionChoices]) -> str:
    values = [
        f'    "{name} {option}") words="{" ".join(words)}" ;;'
        for name, own in known.items()
        for option, words in own.values.items()
    ]
    options = [f'    {name}) words="{" ".join(own.options)}" ;;' for name, own in known.items()]
    words = [f'    {name}) words="{" ".join(own.words)}" ;;' for name, own in known.items() if own.words]
    blocks = {"values": values, "options": options, "words": words}
    return _BASH.format(commands=" ".join(known), **{key: "\n".join(lines) for key, lines in blocks.items()})


def _zsh(known: dict[str, OptionChoices]) -> str:
    """Return the bash function behind zsh's own layer for it."""
    return f"autoload -Uz bashcompinit && bashcompinit\n{_bash(known)}"


def _fish(known: dict[str, OptionChoices]) -> str:
    lines = [f"complete -c dynident -n __fish_use_subcommand -f -a {name}" for name in known]
    for name, own in known.items():
        seen = f"complete -c dynident -n '__fish_seen_subcommand_from {name}'"
        if own.words:
            lines.append(f"{seen} -a '{' '.join(own.words)}'")
        for option in own.options:
            kind = f"-l {option[2:]}" if option.startswith("--") else f"-s {option[1:]}"
            if option in own.values:
                kind += f" -x -a '{' '.join(own.values[option])}'"
            elif option not in own.bare:
                kind += " -r"
            lines.append(f"{seen} {kind}")
    return "\n".join(lines) + "\n"
