"""Names and free text in other languages: what may stand in a program, and what takes the place of the rest."""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Collection, Sequence
from importlib import resources
from pathlib import Path

from dynident.errors import BadOption, FileError

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_ROS_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")
_NOT_PLAIN = re.compile(r"[^A-Za-z0-9_.-]")
_NOT_COMMENT = re.compile(r"[^A-Za-z0-9 _.,:()+*^=%/-]")

#: What begins or ends a comment in C, made of signs that are harmless one by one.
_ENDS = re.compile(r"\*/|/\*")

#: Longest name and longest line of free text that is written into a file.
LONGEST_NAME, LONGEST_LINE = 64, 110


def comment_text(text: str) -> str:
    """Return one line of plain ASCII for a comment: nothing in it ends or begins anything in any target language."""
    return _ENDS.sub("__", _NOT_COMMENT.sub("_", text))[:LONGEST_LINE]


def shown_names(names: Sequence[str]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return names for comments, each with other signs than ``A-Za-z0-9_.-`` replaced, and the map of the changed."""
    shown = tuple(_NOT_PLAIN.sub("_", name)[:LONGEST_NAME] or "_" for name in names)
    return shown, {name: new for name, new in zip(names, shown, strict=True) if name != new}


def module_notes(path: Path, needs: str) -> tuple[str, ...]:
    """Return what is to be said of a Python module that cannot be imported by the name of its file.

    Args:
        path: The file.
        needs: Package that the module imports.
    """
    stem = path.stem
    plain = stem.isascii() and stem.isidentifier() and not keyword.iskeyword(stem)
    if path.suffix == ".py" and plain and stem != needs and stem not in sys.stdlib_module_names:
        return ()
    word = re.sub(r"\W+", "_", stem, flags=re.ASCII).strip("_")
    new = word if word[:1].isalpha() and word != stem else f"robot_{word}".rstrip("_")
    why = "is the name of another module" if plain and path.suffix == ".py" else "is no name of a Python module"
    return (f"{path.name} {why}: 'import' takes it as {new}.py, for example",)


def program_name(path: Path, language: str, longest: int, reserved: Collection[str]) -> str:
    """Return the stem of a file as the name of its program.

    Raises:
        FileError: It is no name there, too long, or a word of the language.
    """
    stem = path.stem
    if not _WORD.fullmatch(stem) or len(stem) > longest or stem.upper() in reserved:
        evidence = f"'{comment_text(stem)}' cannot name a program in {language}"
        step = f"name the file with a letter, then letters, digits and '_', {longest} at most, no word of the language"
        raise FileError(path, evidence, step)
    return stem


def ros_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return joint names as ROS has them: they must be those of the controller, so none is changed.

    Raises:
        BadOption: A name that no ROS joint has.
    """
    for name in names:
        if not _ROS_NAME.fullmatch(name) or len(name) > 128:
            step = "ROS joints are named with letters, digits, '_', '.', '/' and '-'; rename it in the robot model"
            raise BadOption("joint", name, step)
    return tuple(names)


def template_parts(file: str) -> tuple[str, ...]:
    """Return the texts of a file of ``templates``, each behind a line ``@@@ NAME``; its ``@...@`` are replaced."""
    text = resources.files("dynident.exports").joinpath("templates", file).read_text(encoding="utf-8")
    return tuple(part.partition("\n")[2] for part in text.split("@@@ ")[1:]) or (text,)
