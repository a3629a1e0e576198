"""Answers on stdout, progress and remarks on stderr; colours and bars only on a terminal."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from dynident.results.text import Table


#: Version of what --json prints, its first key; docs/json-output.md has the keys of this one and what they were called.
SCHEMA = 2

#: Columns that the name of a base parameter takes in a table; --json and the report have the whole name.
NAME_WIDTH = 60


#: How a terminal shows the word that a line begins with.
STYLES = {
    "error:": "bold red",
    "warning:": "bold yellow",
    "not accepted": "bold red",
    "accepted": "bold green",
    "stopped": "bold",
}


def _say(text: str, stream: TextIO) -> None:
    """Print a line; where its reader (head, less) has gone, the rest goes nowhere and the command does its work."""
    sign = next((sign for sign in STYLES if text.startswith(sign)), None)
    try:
        if sign is not None and stream.isatty():
            _say_in_colour(text, sign, stream)
        else:
            print(text, file=stream)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _say_in_colour(text: str, sign: str, stream: TextIO) -> None:
    """Print a line whose first words stand out; NO_COLOR and terminals without colours are rich's to honour."""
    try:
        from rich.console import Console
        from rich.text import Text
    except (ImportError, MemoryError):  # the line may say that there is no memory left
        print(text, file=stream)
        return
    line = Text.assemble((sign, STYLES[sign]), text[len(sign) :])
    Console(file=stream).print(line, soft_wrap=True)


def answer(text: str = "") -> None:
    """Print an answer: on a terminal as lines that end between words, each set in as it is; elsewhere as it is."""
    _say_prose(text, sys.stdout)


def answer_verbatim(text: str) -> None:
    """Print what is to be copied, such as a command of a controller, as it is."""
    _say(text, sys.stdout)


def remark(text: str, quiet: bool = False) -> None:
    """Print a remark that is no answer, as prose."""
    if not quiet:
        _say_prose(text, sys.stderr)


def _say_prose(text: str, stream: TextIO) -> None:
    """Print lines of prose: on a terminal broken between words, set in as each is; elsewhere as they are."""
    if not stream.isatty():
        _say(text, stream)
        return
    from dynident.results.table_width import wrap_text

    columns = shutil.get_terminal_size().columns
    for line in text.split("\n"):
        own = line[: len(line) - len(line.lstrip())]
        for part in wrap_text(line.strip(), max(columns - len(own), 20), break_long_words=False) or [""]:
            _say(own + part, stream)


def line_width() -> int:
    """Return how many columns a line of the answer may take: those of the terminal; in a pipe 160."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else 160


def answer_json(data: Mapping[str, Any]) -> None:
    """Print one JSON object."""
    _say(json.dumps({"schema": SCHEMA, **data}, indent=1, allow_nan=False), sys.stdout)


def answer_line(data: Mapping[str, Any]) -> None:
    """Print one JSON object on a line of its own, as in a stream of them."""
    _say(json.dumps({"schema": SCHEMA, **data}, allow_nan=False), sys.stdout)


def answer_table(table: Table, title: str = "") -> None:
    """Print a table: as wide as the terminal allows there, as plain columns in a pipe."""
    from dynident.results.text import plain

    if not sys.stdout.isatty():
        if title:
            answer(title)
        answer(plain(table))
        return
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    from dynident.results.table_width import GAP, fit_width
    from dynident.results.text import heading_text

    screen = Console(soft_wrap=False)
    fitted = fit_width(table, screen.width)
    for number, (part, widths) in enumerate(zip(fitted.parts, fitted.widths, strict=True)):
        if number:
            answer()
        heading = title if title and not number else None
        shown = RichTable(
            title=heading, title_justify="left", box=None, header_style="bold", pad_edge=False, padding=(0, GAP, 0, 0)
        )
        for column, width in zip(part.columns, widths, strict=True):
            shown.add_column(Text(heading_text(column)), justify="right" if column.numeric else "left", width=width)
        for row in part.lined_up():
            shown.add_row(*[Text(cell) for cell in row])
        screen.print(shown)
    if fitted.left_out:
        shown_by = "--json and a wider terminal show them"
        screen.print(Text(f"left out here: {', '.join(fitted.left_out)}; {shown_by}", style="dim"))


class Progress:
    """Tells each step of a long work; a bar with the time left where stderr is a terminal, else one line a step."""

    def __init__(self, total: int, quiet: bool) -> None:
        self._total, self._quiet, self._told = total, quiet, set[str]()
        self._bar: Any = None
        self._task: Any = None

    def start(self) -> None:
        """Open the bar."""
        if self._quiet or not sys.stderr.isatty():
            return
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as RichProgress

        columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        self._bar = RichProgress(*columns, console=Console(stderr=True), transient=True)
        self._bar.start()
        self._task = self._bar.add_task("", total=self._total)

    def step(self, text: str) -> None:
        """Begin a step; the one before is done. One that comes again, in another round of a search, is told once."""
        is_new = text not in self._told
        self._told.add(text)
        if self._bar is not None:
            self._bar.update(self._task, description=text, completed=min(len(self._told), self._total) - 1)
        elif is_new and not self._quiet:
            _say(f"  {text}", sys.stderr)

    def update(self, text: str) -> None:
        """Say how far the work is between two steps; on a terminal only."""
        if self._bar is not None:
            self._bar.update(self._task, description=text)

    def note(self, text: str) -> None:
        """Print a line between two steps where there is no bar."""
        if self._bar is None and not self._quiet:
            _say(f"  {text}", sys.stderr)

    def line(self, text: str) -> None:
        """Print a line that stays, above the bar where there is one."""
        if self._bar is not None:
            self._bar.console.print(text, markup=False, highlight=False, soft_wrap=True)
        elif not self._quiet:
            _say(f"  {text}", sys.stderr)

    def reach(self, share: float) -> None:
        """Say which share of the whole is done, between 0 and 1; the bar shows the time left by it."""
        if self._bar is not None:
            self._bar.update(self._task, completed=share * self._total)

    def stop(self) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.stop()


@contextmanager
def progress(total: int, quiet: bool = False) -> Iterator[Progress]:
    """Show the progress of a work of ``total`` steps."""
    shown = Progress(total, quiet)
    shown.start()
    try:
        yield shown
    finally:
        shown.stop()
