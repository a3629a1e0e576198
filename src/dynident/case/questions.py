"""Questions that a drafted case file asks: lines that end in ``# ask: ...``, and whether they are answered."""

from __future__ import annotations

import re
from dataclasses import dataclass

from dynident.errors import DescriptionError

#: What stands where an answer has to be written.
ASK = "ask"

#: What a comment begins with that asks for something.
MARK = "# ask:"

_OPEN = re.compile(rf"(?<![\w'\"./-]){ASK}(?![\w'\"./-])")


@dataclass(frozen=True)
class Question:
    """A line of a case file that asks for something.

    Attributes:
        line: Line of the file, counted from 1.
        text: What is asked for.
        needed: Whether the file cannot be used before it is answered; else what stands there holds until then.
    """

    line: int
    text: str
    needed: bool


def questions_in(text: str) -> tuple[Question, ...]:
    """Return the questions of a case file; a needed one has the word ``ask`` in place of its value."""
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        before, mark, asked = line.partition(MARK)
        if mark:
            needed = not before.lstrip().startswith("#") and _OPEN.search(before) is not None
            found.append(Question(number, asked.strip(), needed))
    return tuple(found)


def check_answered(path: object, data: bytes) -> None:
    """Refuse a case file with a question that has no answer yet.

    Raises:
        DescriptionError: The first line that asks, and how many more do.
    """
    open_ones = [q for q in questions_in(data.decode("utf-8-sig", errors="replace")) if q.needed]
    if not open_ones:
        return
    first, *more = open_ones
    which = ", ".join(str(q.line) for q in more[:20])
    others = f"; {'line' if len(more) == 1 else 'lines'} {which} ask{'s' * (len(more) == 1)} as well" if more else ""
    step = f"write the answer in place of the word '{ASK}'{others}"
    raise DescriptionError(path, "", f"line {first.line} asks for {first.text.rstrip('.')}", step)


def without_open_gains(data: bytes) -> bytes:
    """Return a case file in which drive gains are no longer asked for, its lines where they were."""
    data = re.sub(rb"\bgain:[ \t]*ask\b(?![\w'\"./-])(?:[ \t]+#[^\r\n]*)?", b"gain_std: 0", data)
    return re.sub(rb"^drives:[ \t]*ask\b[^\r\n]*", b"", data, flags=re.MULTILINE)
