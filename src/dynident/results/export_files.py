"""The files of an export are written all or none that could be refused beforehand, each of them whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dynident.errors import FileError
from dynident.files import check_place, write_atomically


def write_files(files: Mapping[Path, bytes], target: Path) -> None:
    """Write all files of an export; a folder that is the target is made, and holds nothing else.

    Args:
        files: Bytes by place.
        target: What the user named: the first file, or the folder of all.

    Raises:
        FileError: A place where no file can be, or a folder with something else in it.
    """
    inside = [file for file in files if target in file.parents]
    if inside:
        known = {file.name for file in inside}
        if target.exists() and (not target.is_dir() or {entry.name for entry in target.iterdir()} - known):
            raise FileError(target, "there is something else already", "choose a new folder")
        if not target.parent.is_dir():
            raise FileError(target, f"there is no folder '{target.parent}'", "create it or choose another place")
        try:
            target.mkdir(exist_ok=True)
        except OSError as error:
            raise FileError(target, f"cannot be made ({error.strerror})", "choose another place") from error
    for file in files:
        check_place(file)
    for file, data in files.items():
        write_atomically(file, data)
