"""Files that are whole or not there: write under another name, then swap; the hash of their content; JSON in them."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from dynident.errors import DynidentError, FileError

_CHUNK = 1 << 20

#: What taking values out of a file raises where they are not as they were written.
DAMAGE = (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError, RecursionError)

#: The bit that Windows asks for, so that line ends are written as they are; 0 elsewhere.
_BINARY = getattr(os, "O_BINARY", 0)

#: Where files for some folders are written instead; empty but in the commands of a studio.
STAGED: dict[Path, Path] = {}


def stage(folder: Path, store: Path) -> None:
    """Let this process write the files for a folder into another one: who started it moves them, or removes them.

    Args:
        folder: The folder, without links in its path.
        store: Where its files are written, on the same file system.
    """
    STAGED[folder] = store


def move_to_new_name(source: Path, target: Path) -> None:
    """Move a finished file to a name that nothing has; what another process has written there stays.

    Raises:
        FileExistsError: Something has this name.
    """
    try:
        os.link(source, target)  # fails where the name is taken, as replacing would not
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        os.close(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
        os.replace(source, target)
    else:
        source.unlink()


def write_atomically(path: str | os.PathLike[str], data: str | bytes) -> None:
    """Write a file so that a reader, or a crash half-way, sees the old content or the new, never a part.

    Text is written as UTF-8 with its line ends as they are. A link is followed, an existing file keeps its mode.

    Raises:
        FileError: The folder is missing, the place is no ordinary file, or it cannot be written.
    """
    content = data.encode("utf-8") if isinstance(data, str) else data
    try:
        target, mode = check_place(_place_of(path))
        partial = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.part")
        try:
            _write(partial, content, mode)
            os.replace(partial, target)
        except BaseException:
            with suppress(OSError):
                partial.unlink()
            raise
    except OSError as error:
        evidence = f"cannot be written ({_reason(error)})"
        raise FileError(path, evidence, "check the folder, its rights and the space left") from error


def size_of_file(path: str | os.PathLike[str]) -> int:
    """Return the bytes of an ordinary file.

    Raises:
        FileError: It is a folder or no ordinary file, or cannot be reached.
    """
    try:
        found = os.stat(path)
    except OSError as error:
        raise unreadable(path, error) from error
    if stat.S_ISDIR(found.st_mode):
        raise FileError(path, "this is a folder", "give a file")
    if not stat.S_ISREG(found.st_mode):
        raise FileError(path, "this is no ordinary file", "save the data to a file first")
    return found.st_size


def check_place(path: str | os.PathLike[str]) -> tuple[Path, int | None]:
    """Refuse a place where no file can be written: worth asking before the work whose result goes there.

    Returns:
        The place behind any link, and the mode of the file that is there, or None.

    Raises:
        FileError: The folder is missing, or the place is no ordinary file.
    """
    target = resolved(path)
    if not target.parent.is_dir():
        raise FileError(path, f"there is no folder '{Path(path).parent}'", "create it or choose another place")
    return target, _mode_of(target, path)


def files_behind(provenance: Mapping[str, Any]) -> list[str]:
    """Return the files that an estimate was made from, by its provenance: logs, case file and robot model."""
    logs = [str(log.get("path", "")) for log in provenance.get("logs", ())]
    return [*logs, *(str(provenance.get(name, {}).get("path", "")) for name in ("case", "robot"))]


def check_outputs(outputs: Sequence[str | None], inputs: Sequence[str | Path]) -> None:
    """Refuse an output that would overwrite an input or another output, before anything is computed.

    Raises:
        FileError: Two of the files are the same.
    """
    taken = {resolved(name): "it is an input of this command" for name in inputs if name}
    for name in filter(None, outputs):
        place = resolved(str(name))
        if place in taken:
            raise FileError(name, f"{taken[place]} and would be overwritten", "choose another name for the output")
        taken[place] = "two outputs have this name"


@contextmanager
def written_for_a_while(folder: Path | None = None) -> Iterator[None]:
    """Say that it is a temporary file that cannot be written: the system's own error names none where space runs out.

    Args:
        folder: Where it is; None for the system's own folder.

    Raises:
        FileError: It cannot be written.
    """
    try:
        yield
    except OSError as error:
        evidence = f"a temporary file cannot be written ({_reason(error)})"
        step = f"check its rights and the space left{'' if folder else '; TMPDIR names another folder'}"
        raise FileError(folder or _temporary(), evidence, step) from error


def _temporary() -> str:
    import tempfile  # only needed here

    return tempfile.gettempdir()


def sha256_of(path: str | os.PathLike[str]) -> str:
    """Return the SHA-256 of a file's bytes in hexadecimal; of a folder, of the names and hashes of its files.

    Raises:
        FileError: The file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        if os.path.isdir(path):
            for file in sorted(item for item in Path(path).iterdir() if item.is_file()):
                digest.update(f"{file.name}\0{sha256_of(file)}\n".encode())
            return digest.hexdigest()
        with open(path, "rb") as stream:
            while chunk := stream.read(_CHUNK):
                digest.update(chunk)
    except OSError as error:
        raise unreadable(path, error) from error
    return digest.hexdigest()


def bytes_of(path: str | os.PathLike[str]) -> bytes:
    """Return the bytes of a file.

    Raises:
        FileError: It cannot be read.
    """
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error


def read_at_most(path: Path, most: int, step: str) -> bytes:
    """Return the bytes of a file of a sane size.

    Args:
        path: The file.
        most: Its largest size in bytes.
        step: What to do where it is larger.

    Raises:
        FileError: The file cannot be read, or is larger.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(most + 1)
    except OSError as error:
        raise FileError(path, f"it cannot be read ({error.strerror})", "check its permissions") from error
    if len(data) > most:
        raise FileError(path, f"it is larger than {most // 1_000_000} MB", step)
    return data


def read_json(path: str | os.PathLike[str], step: str, kind: Callable[[object, str, str], DynidentError]) -> Any:
    """Return what a file of JSON holds.

    Args:
        path: The file.
        step: What to do where it is none.
        kind: The error to raise then, of path, evidence and step.

    Raises:
        FileError: The file cannot be read.
        DynidentError: Of ``kind``: it is not UTF-8 or not JSON, or nested or written too long for any.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise unreadable(path, error) from error
    except UnicodeDecodeError as error:
        raise kind(path, "not UTF-8 text", step) from error
    except json.JSONDecodeError as error:
        raise kind(path, f"line {error.lineno} is not JSON ({error.msg})", step) from error
    except (ValueError, RecursionError) as error:  # a number of thousands of digits, brackets without end
        raise kind(path, f"no JSON that can be read ({error})", step) from error


def is_json_of(path: str | os.PathLike[str], kind: str) -> bool:
    """Return whether a file is called as JSON and names its kind at the beginning, as files of ours do."""
    if not str(path).lower().endswith(".json"):
        return False
    try:
        with Path(path).open("rb") as stream:
            return kind.encode() in stream.read(200)
    except OSError:
        return False


def resolved(path: str | os.PathLike[str]) -> Path:
    """Return the absolute path behind any links; a loop of links, which only opening refuses, stays as it is."""
    return Path(os.path.realpath(path))


def expanded(name: str) -> Path:
    """Return a path with ``~`` and ``~user`` replaced; as it is where nobody has such a home."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        return Path(name)


def unreadable(path: str | os.PathLike[str], error: OSError) -> FileError:
    """Return the error to raise for a file that the system does not give out."""
    if isinstance(error, FileNotFoundError):
        return FileError(path, "there is no such file", "check the path")
    if isinstance(error, IsADirectoryError):
        return FileError(path, "this is a folder", "give a file")
    return FileError(path, f"cannot be read ({_reason(error)})", "check the path and its rights")


def _place_of(path: str | os.PathLike[str]) -> str | os.PathLike[str]:
    """Return where a file for this place is written; a link there is not followed where that is a store."""
    store = STAGED.get(Path(os.path.realpath(Path(path).parent))) if STAGED else None
    return path if store is None else store / Path(path).name


def _mode_of(target: Path, path: object) -> int | None:
    """Return the permission bits of an existing file, None where there is none yet."""
    if target.is_symlink():
        raise FileError(path, "this link leads to itself", "give the name of a file")
    if not target.exists():
        return None
    found = target.stat().st_mode
    if not stat.S_ISREG(found):
        what = "this is a folder" if stat.S_ISDIR(found) else "this is no ordinary file"
        raise FileError(path, what, "give the name of a file")
    return stat.S_IMODE(found)


def _write(partial: Path, content: bytes, mode: int | None) -> None:
    descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, 0o666)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    if mode is not None:
        partial.chmod(mode)


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
