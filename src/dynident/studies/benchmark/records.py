"""What is done stays done: one small file a task, named after everything that its result depends on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from dynident.errors import DynidentError, FileError
from dynident.file_versions import Document, FileVersions, renamed
from dynident.files import write_atomically

KIND = "dynident benchmark record"


def _to_2(data: Document) -> Document:
    return renamed(data, {"result.held_out_error": "test_error", "result.joints[].rows": "samples"})


#: Records.
VERSIONS = FileVersions("a record", (_to_2,))


class Task(Protocol):
    """One piece of work."""

    @property
    def label(self) -> str:
        """What it is called in progress."""
        ...

    @property
    def facts(self) -> Mapping[str, Any]:
        """Everything that its result depends on, as plain data."""
        ...


class Records:
    """A folder of results, each written whole or not at all, so that a run may be killed at any moment.

    The name of a file is the hash of the task's facts: a changed robot, motion, method, option or version is another
    task, and no result stands for one that it does not belong to. The order in which tasks are done leaves no trace.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(self.folder, f"cannot be made ({error.strerror})", "choose another folder") from error

    def read(self, task: Task) -> dict[str, Any] | None:
        """Return the result of a task; None where there is none, or where its file is damaged."""
        try:
            data = json.loads(self._place(task).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return None
        if not isinstance(data, dict) or data.get("kind") != KIND or data.get("facts") != json.loads(_text(task.facts)):
            return None
        try:
            data = VERSIONS.migrated(data, lambda evidence, step: FileError(self._place(task), evidence, step))
        except DynidentError:
            return None
        return data["result"] if isinstance(data.get("result"), dict) else None

    def write(self, task: Task, result: Mapping[str, Any]) -> None:
        """Keep the result of a task.

        Raises:
            FileError: It cannot be written.
        """
        data = {"kind": KIND, "format": VERSIONS.current, "facts": task.facts, "result": result}
        write_atomically(self._place(task), json.dumps(data, indent=1, allow_nan=False, sort_keys=True) + "\n")

    def _place(self, task: Task) -> Path:
        return self.folder / f"{hashlib.sha256(_text(task.facts).encode()).hexdigest()[:24]}.json"


def _text(facts: Mapping[str, Any]) -> str:
    return json.dumps(facts, sort_keys=True, allow_nan=False)
