"""What was executed so far: counts of all runs, in a file that each run adds to, and the table of them."""

from __future__ import annotations

import importlib.metadata
import json
import platform
from pathlib import Path
from typing import Any

_SUMS = ("executions", "taken", "refused", "crash", "hang", "memory", "escape", "seconds")
_TABLE = (
    "| target | executions | guided | taken | crashes | hangs | memory, escapes | rate |",
    "|---|---|---|---|---|---|---|---|",
)
_BEGIN, _END = "<!-- fuzzing table: begin -->", "<!-- fuzzing table: end -->"


class Record:
    """The counts of every target, guided and plain apart.

    Args:
        path: The file; what it holds is added to.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._facts: dict[str, Any] = {"with": {}, "targets": {}, "open": {}}
        self._read()

    def executions(self, name: str) -> int:
        """Return how often a target was executed, in both ways together."""
        return sum(counts["executions"] for counts in self._of(name).values())

    def begin(self, name: str, way: str) -> int:
        """Return the number of the next input of one way: that of the executions before."""
        return self._of(name).get(way, {}).get("executions", 0)

    def add(self, name: str, way: str, score: dict[str, Any]) -> None:
        """Add the score of one process to what the file holds by now, and write it."""
        self._read()
        counts = self._of(name).setdefault(way, {})
        for key in _SUMS:
            counts[key] = round(counts.get(key, 0) + score.get(key, 0), 1)
        counts["slowest_s"] = max(counts.get("slowest_s", 0.0), score.get("slowest_s", 0.0))
        packages = {"Python": platform.python_version()}
        if way == "guided":
            packages["atheris"] = importlib.metadata.version("atheris")
        self._facts["with"] |= packages
        if score["faults"]:
            self._facts["open"].setdefault(name, {}).update(score["faults"])
        self._write()

    def mend(self, name: str, file: str) -> None:
        """Note that a kept input finds no fault any more."""
        self._read()
        left = {fault: kept for fault, kept in self._facts["open"].pop(name, {}).items() if kept != file}
        self._facts["open"] |= {name: left} if left else {}
        self._write()

    def _read(self) -> None:
        if self._path.exists():
            self._facts |= json.loads(self._path.read_text())

    def _write(self) -> None:
        partial = self._path.with_name(f".{self._path.name}.part")
        partial.write_text(json.dumps(self._facts, indent=1, sort_keys=True) + "\n")
        partial.replace(self._path)

    def table(self) -> str:
        """Return the counts as a table of Markdown."""
        rows = []
        for name, ways in self._facts["targets"].items():
            total = {key: sum(counts[key] for counts in ways.values()) for key in _SUMS}
            guided = ways.get("guided", {}).get("executions", 0)
            cells = (
                f"`{name}`",
                f"{total['executions']:,}",
                f"{guided:,}",
                f"{total['taken']:,}",
                str(total["crash"]),
                str(total["hang"]),
                str(total["memory"] + total["escape"]),
                f"{total['executions'] / max(total['seconds'], 0.1):.0f}",
            )
            rows.append(f"| {' | '.join(cells)} |")
        return "\n".join((*_TABLE, *rows))

    def into(self, page: Path, source: Path | None = None) -> None:
        """Write a page, or that of a source, with the table between its marks."""
        text = (source or page).read_text(encoding="utf-8")
        before, _, rest = text.partition(_BEGIN)
        _, _, after = rest.partition(_END)
        page.write_text(f"{before}{_BEGIN}\n\n{self.table()}\n\n{_END}{after}", encoding="utf-8")

    def _of(self, name: str) -> dict[str, Any]:
        return self._facts["targets"].setdefault(name, {})
