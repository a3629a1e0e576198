"""Machine code kept on disk for the next process: a file for each assembly, processor and compiler.

A file can only cost time: its name is a digest of all that the code depends on, it begins with the digest of what
follows, and where none can be read or written the code is made again.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from dynident.errors import FileError
from dynident.files import write_atomically

#: Files kept in a folder; the one written longest ago goes first.
KEPT = 256

#: Characters of assembly below which code is made in less time than a file is worth.
WORTH_KEEPING = 20_000

_ENDING, _DIGEST = ".dynident-code", hashlib.sha256().digest_size


def kept_code(facts: str, assembly: str, make: Callable[[], bytes]) -> bytes:
    """Return the object code of some assembly: that of an earlier process, or what ``make`` returns now.

    Args:
        facts: Processor, its features and the compiler with its settings, in words.
        assembly: What the code was made of.
        make: Makes the code.
    """
    if len(assembly) < WORTH_KEEPING:
        return make()
    name = hashlib.sha256(f"{facts}\n{assembly}".encode()).hexdigest() + _ENDING
    folders = tuple(cache_folders())
    for folder in folders:
        with suppress(OSError):
            found = (folder / name).read_bytes()
            if hashlib.sha256(found[_DIGEST:]).digest() == found[:_DIGEST]:
                return found[_DIGEST:]
    code = make()
    for folder in folders:
        with suppress(OSError, FileError):
            folder.mkdir(parents=True, exist_ok=True)
            write_atomically(folder / name, hashlib.sha256(code).digest() + code)
            _drop_oldest(folder)
            break
    return code


def cache_folders() -> Iterator[Path]:
    """Yield where code may be kept, as numba chooses: the folder stated, else beside the source, else the user's."""
    stated = os.environ.get("NUMBA_CACHE_DIR")
    if stated:
        yield Path(stated)
        return
    yield Path(__file__).parent / "__pycache__"
    if sys.platform == "win32":
        place = os.environ.get("LOCALAPPDATA", "")
    elif sys.platform == "darwin":
        place = os.path.expanduser("~/Library/Caches")
    else:
        place = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    if os.path.isabs(place):
        yield Path(place) / "dynident"


def _drop_oldest(folder: Path) -> None:
    """Delete files beyond those that are kept; another process may delete the same ones."""
    ages: list[tuple[float, Path]] = []
    for path in folder.glob(f"*{_ENDING}"):
        with suppress(OSError):
            ages.append((path.stat().st_mtime, path))
    for _, path in sorted(ages)[: max(len(ages) - KEPT, 0)]:
        with suppress(OSError):
            path.unlink()
