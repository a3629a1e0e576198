"""All that was done in a session, as the commands that do the same: what ran, and the case files that were edited."""

from __future__ import annotations

import shlex
import threading
from collections.abc import Iterable
from dataclasses import dataclass

from dynident.studio.runs import Run

#: Edits that a session remembers; the oldest are forgotten.
REMEMBERED = 100


@dataclass(frozen=True)
class Edit:
    """A text file that was written over.

    Attributes:
        after: Number of the last command that was started before.
        name: The file.
        text: What it says since.
    """

    after: int
    name: str
    text: str

    @property
    def command(self) -> str:
        """The edit as a shell does it: a here-document, ended by a word that no line of the text is."""
        lines = self.text.splitlines()
        end = next(word for word in ("END", *(f"END{k}" for k in range(len(lines) + 1))) if word not in lines)
        closed = self.text if self.text.endswith("\n") or not self.text else f"{self.text}\n"
        return f"cat > {shlex.quote(self.name)} <<'{end}'\n{closed}{end}"


class History:
    """The edits of a session among its commands."""

    def __init__(self) -> None:
        self._edits: list[Edit] = []
        self._lock = threading.Lock()

    def wrote(self, edit: Edit) -> None:
        """Take an edit; the last of several of one file between two commands counts."""
        with self._lock:
            others = [one for one in self._edits if (one.after, one.name) != (edit.after, edit.name)]
            self._edits = [*others, edit][-REMEMBERED:]

    def commands(self, runs: Iterable[Run]) -> list[str]:
        """Return the edits and the commands that came to their end, in the order in which they were made."""
        with self._lock:
            edits = [((edit.after, 1), edit.command) for edit in self._edits]
        done = [((run.number, 0), run.order.command) for run in runs if run.state == "done"]
        return [command for _, command in sorted([*edits, *done], key=lambda one: one[0])]
