"""Where the files are that a case file names: as they are written, beside it, or in the folder of the data."""

from __future__ import annotations

import os
from pathlib import Path

from dynident.errors import FileError
from dynident.files import expanded

#: The folder under which logs and robots are looked for when they are neither beside the case file nor where it says.
DATA_VARIABLE = "DYNIDENT_DATA"


def find_file(name: str, case: str) -> Path:
    """Return where a file named in a case file is; the name itself where it is nowhere, for the reader to refuse."""
    written = expanded(name)
    if written.is_absolute():
        return written
    data = os.environ.get(DATA_VARIABLE)
    roots = [*([Path(case).parent] if case else []), Path(), *([Path(data)] if data else [])]
    return next((root / written for root in roots if os.path.exists(root / written)), written)


def find_robot(name: str, case: str) -> Path:
    """Return where the robot of a case file is, or its name as it stands, which may be that of a robot that ships.

    Raises:
        FileError: It is named with a folder, and is nowhere.
    """
    found = find_file(name, case)
    if len(found.parts) > 1 and not os.path.exists(found):
        data = os.environ.get(DATA_VARIABLE)
        places = f"beside the case file, here or under {data}" if data else "beside the case file or here"
        unset = "" if data else f", or name the folder of the data in {DATA_VARIABLE}, which is not set"
        raise FileError(found, f"there is no such file {places}", f"check the path{unset}")
    return found
