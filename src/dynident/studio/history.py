"""All that was done in a session, as the commands that do the same: what ran, and the case files that were edited.

It is written to a hidden file of the folder too, a line for each, so that the next studio in this folder shows it, also
where this one was killed.
"""

from __future__ import annotations

import json
import shlex
import threading
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynident.studio.orders import Order
from dynident.studio.runs import Run

#: Edits that a session remembers; the oldest are forgotten.
REMEMBERED = 100

#: Largest answer of a command that is written, in characters, and lines of its progress.
MAX_KEPT, MAX_LINES = 1_000_000, 50

#: Files of earlier sessions that are read, the newest.
SESSIONS = 20


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
    """The edits of a session among its commands.

    Attributes:
        runs: The commands of earlier sessions in this folder that came to their end, numbered from 1.
    """

    def __init__(self, folder: Path) -> None:
        known = sorted(folder.glob(".studio-*.jsonl"))
        latest = max((int(file.stem[8:]) for file in known if file.stem[8:].isdecimal()), default=0)
        # After those that are known, also where the clock was set back meanwhile.
        self._file = folder / f".studio-{max(time.time_ns(), latest + 1)}.jsonl"
        self._edits: list[Edit] = []
        self._lock = threading.Lock()
        self.runs: list[Run] = []
        for file in known[-SESSIONS:]:
            self._read(file)

    def wrote(self, edit: Edit) -> None:
        """Take an edit; the last of several of one file between two commands counts."""
        self._take(edit)
        self._append({"after": edit.after, "name": edit.name, "text": edit.text})

    def ran(self, run: Run) -> None:
        """Write down a command that came to its end."""
        facts = run.figures()
        answer = facts["answer"] if len(facts["answer"]) <= MAX_KEPT else ""
        kept = {key: facts[key] for key in ("number", "verb", "arguments", "outputs", "code", "took_s")}
        kept |= {"progress": facts["progress"][-MAX_LINES:], "answer": answer}
        self._append(kept)

    def commands(self, runs: Iterable[Run]) -> list[str]:
        """Return the edits and the commands that came to their end, in the order in which they were made."""
        with self._lock:
            edits = [((edit.after, 1), edit.command) for edit in self._edits]
        done = [((run.number, 0), run.order.command) for run in runs if run.state == "done"]
        return [command for _, command in sorted([*edits, *done], key=lambda one: one[0])]

    def _take(self, edit: Edit) -> None:
        with self._lock:
            others = [one for one in self._edits if (one.after, one.name) != (edit.after, edit.name)]
            self._edits = [*others, edit][-REMEMBERED:]

    def _append(self, entry: dict[str, Any]) -> None:
        with self._lock, suppress(OSError):  # a full disk: the session goes on, what follows it does not know this
            with open(self._file, "a", encoding="utf-8", newline="\n") as out:
                out.write(f"\n{json.dumps(entry)}\n")  # where the disk was full, half of a line may stand before

    def _read(self, file: Path) -> None:
        """Take what an earlier session did; its numbers follow those that are known."""
        entries: list[dict[str, Any]] = []
        with suppress(OSError):
            for line in file.read_bytes().splitlines():
                with suppress(ValueError):  # where a session was killed or the disk was full, it may be half of one
                    entries.append(json.loads(line))
        numbers = {0: len(self.runs)}
        with suppress(KeyError, TypeError, ValueError, AttributeError):  # written by something else
            for entry in sorted((entry for entry in entries if "verb" in entry), key=lambda one: int(one["number"])):
                run = _run_of(entry, len(self.runs) + 1)
                self.runs.append(run)
                numbers[entry["number"]] = run.number
            for entry in (entry for entry in entries if "text" in entry):
                after = max(new for old, new in numbers.items() if old <= entry["after"])
                self._take(Edit(after, str(entry["name"]), str(entry["text"])))


def _run_of(entry: dict[str, Any], number: int) -> Run:
    """Return a command that came to its end as it was written down."""
    run = Run(number, Order(str(entry["verb"]), tuple(map(str, entry["arguments"]))), None)
    run.state, run.code, run.took = "done", int(entry["code"]), float(entry["took_s"])
    run.outputs, run.progress = [str(name) for name in entry["outputs"]], [str(line) for line in entry["progress"]]
    run.answer = str(entry["answer"])
    return run
