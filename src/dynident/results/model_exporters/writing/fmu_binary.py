"""The binary of a functional mock-up unit for this machine."""

from __future__ import annotations

import platform
import sys
from pathlib import Path
from typing import Final

from dynident.results.model_exporters.proving.c_proof import Compiler, build_library
from dynident.results.model_exporters.writing.fmu_text import SOURCE

_SYSTEMS: Final = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
_MACHINES: Final = {"x86_64": "x86_64", "amd64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}


def platform_tuple() -> tuple[str, str]:
    """Return this machine's name in FMI 3.0 and the end of the names of its libraries; empty where it has none."""
    system, suffix = _SYSTEMS.get(sys.platform, ("", ""))
    machine = _MACHINES.get(platform.machine().lower(), "")
    return (f"{machine}-{system}", suffix) if system and machine and sys.maxsize > 2**32 else ("", "")


def built(files: dict[str, bytes], identifier: str, folder: Path, compiler: Compiler) -> dict[str, bytes]:
    """Return the library of a unit for this machine, by its name in the archive.

    Args:
        files: The files of the unit.
        identifier: Its model identifier.
        folder: An empty folder.
        compiler: The C compiler.

    Raises:
        NoCompilerRuns: The compiler builds nothing here.
        ValueError: It refuses the sources.
    """
    name, suffix = platform_tuple()
    for file, data in files.items():
        if file.startswith("sources/"):
            (folder / Path(file).name).write_bytes(data)
    library = f"{identifier}{suffix}"
    build_library(compiler, folder, SOURCE, library)
    return {f"binaries/{name}/{library}": (folder / library).read_bytes()}
