"""Texts as YAML: names quoted where they have to be, comments on one line."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

from dynident.case.questions import ASK, MARK
from dynident.data.formats._column_map import shown

_PLAIN = re.compile(r"[A-Za-z_./][A-Za-z0-9_./+-]*")

#: Words that YAML, or the questions of a draft, would take for something else.
_TAKEN = frozenset(("null", "none", ASK))


def quoted(text: str) -> str:
    """Return a text as YAML: plain where it is a simple word, in single quotes, or escaped where it must be."""
    if _PLAIN.fullmatch(text) and text.lower() not in _TAKEN:
        return text
    if text.isprintable() and MARK not in text:
        return "'" + text.replace("'", "''") + "'"
    return json.dumps(text).replace("#", "\\x23")


def listed(names: Sequence[str]) -> str:
    """Return names as a YAML list on one line."""
    return f"[{', '.join(map(quoted, names))}]"


def plain(text: str) -> str:
    """Return text of a comment: on one line, without signs that cannot be printed and without a question's mark."""
    words = "".join(sign if sign.isprintable() else " " for sign in text)
    return words.replace(MARK, "ask:").strip()


def few(names: Sequence[str], most: int = 40) -> str:
    """Return names for a comment, the first ones of many."""
    more = f", ... ({len(names)} in all)" if len(names) > most else ""
    return plain(", ".join(shown(name) for name in names[:most])) + more


def asked(key: str, text: str, likely: str = "") -> str:
    """Return a line whose value has to be written, with the likely answer in its comment."""
    answer = f"; likely {likely}" if likely else ""
    return f"{key}: {ASK}   {MARK} {plain(text + answer)}"


def offered(line: str, text: str) -> str:
    """Return a line that holds as it stands, with a comment that asks whether it is right."""
    return f"{line}   {MARK} {plain(text)}"
