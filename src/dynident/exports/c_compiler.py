"""The C compiler of this machine: found, and made to build libraries and programs."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

#: Names under which C compilers are looked for, after the environment's CC.
COMPILERS: Final = ("cc", "gcc", "clang")

#: Seconds that a compiler and a program may take.
PATIENCE = 300

#: Flags of a proof; the library of mathematics comes last.
FLAGS: Final = ("-std=c99", "-O1")


@dataclass(frozen=True)
class Compiler:
    """A C compiler.

    Attributes:
        command: How it is called.
        name: Its name with its version.
    """

    command: tuple[str, ...]
    name: str


class NoCompilerRuns(Exception):
    """The compiler cannot build and run the smallest program here; the message says why."""


def find_compiler() -> Compiler | None:
    """Return the C compiler that the environment's CC names, or the first of cc, gcc, clang; None where none is."""
    for text in (os.environ.get("CC", ""), *COMPILERS):
        words = tuple(shlex.split(text))
        if words and shutil.which(words[0]):
            return Compiler(words, _version(words))
    return None


def _version(command: tuple[str, ...]) -> str:
    try:
        found = subprocess.run([*command, "--version"], capture_output=True, timeout=PATIENCE, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return command[0]
    first = found.stdout.decode("ascii", "replace").split("\n", 1)[0]
    return " ".join("".join(sign if sign.isprintable() else "_" for sign in first).split())[:60] or command[0]


def build_library(compiler: Compiler, folder: Path, source: str, library: str) -> None:
    """Compile one source of a folder into a shared library beside it; only what it exports is seen from outside.

    Raises:
        NoCompilerRuns: Not even the smallest program can be built here.
        ValueError: The source does not compile.
    """
    position = () if sys.platform == "win32" else ("-fPIC",)
    flags = ("-std=c99", "-O2", "-shared", *position, "-fvisibility=hidden")
    _refuse(compiler, folder, _compile(compiler, folder, Path(source), Path(library), flags))


def build_program(compiler: Compiler, folder: Path, source: Path, name: str) -> Path:
    """Return the program made of a source.

    Raises:
        NoCompilerRuns: Not even the smallest program can be built here.
        ValueError: The source does not compile.
    """
    program = folder / f"{name}.exe"
    _refuse(compiler, folder, _compile(compiler, folder, source, program))
    return program


def _refuse(compiler: Compiler, folder: Path, found: str) -> None:
    """Refuse what the compiler has said of a source; where it builds nothing at all, that is the reason."""
    if found:
        least = folder / "least.c"
        text = "#include <math.h>\n#include <stdio.h>\nint main(void) { return 0; }\n"
        least.write_text(text, encoding="ascii", newline="\n")
        if why := _compile(compiler, folder, least, folder / "least.exe"):
            raise NoCompilerRuns(f"it cannot build the smallest program ({why})")
        raise ValueError(f"the C compiler refuses it: {found}")


def _compile(compiler: Compiler, folder: Path, source: Path, program: Path, flags: tuple[str, ...] = FLAGS) -> str:
    """Return why a source does not compile; empty where it does."""
    command = [*compiler.command, *flags, "-o", str(program), str(source), "-lm"]
    try:
        found = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False, cwd=folder)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoCompilerRuns(f"it does not run ({type(error).__name__})") from error
    return "" if found.returncode == 0 else found.stderr.decode("utf-8", "replace")[:300] or "no message"


def run_program(command: list[str], folder: Path) -> None:
    """Run a program in a folder.

    Raises:
        NoCompilerRuns: No program can be run there.
        ValueError: It ends with an error.
    """
    try:
        found = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False, cwd=folder)
    except OSError as error:
        raise NoCompilerRuns(f"programs cannot be run in '{folder}' ({error.strerror})") from error
    if found.returncode:
        told = found.stdout.decode("ascii", "replace")
        raise ValueError(f"{Path(command[0]).stem} ends with {found.returncode}: {told}")
