"""Names of settings in words: the keys of a file as a person reads them, with their unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dynident.results.text import label, plain_value

#: Units that a key ends in.
_UNITS = {"s": "s", "hz": "Hz", "m": "m", "kg": "kg", "rad": "rad", "deg": "°", "nm": "N·m", "percent": "%"}

#: Keys that are more than their words.
_WORDS = {
    "active": "active constraints",
    "cutoff": "cut-off",
    "delta": "Huber threshold",
    "seconds": "time [s]",
    "sha256": "SHA-256",
    "trim": "cut off at both ends",
}


def term(key: object) -> str:
    """Return a key in words: ``cutoff_hz`` is ``cut-off [Hz]``."""
    *words, last = label(key).split("_")
    if not words or last not in _UNITS:
        return " ".join(_WORDS.get(word, word) for word in (*words, last))
    return f"{' '.join(_WORDS.get(word, word) for word in words)} [{_UNITS[last]}]"


def in_words(facts: Mapping[str, Any]) -> str:
    """Return named facts in one line: ``kind butterworth, cut-off 8 Hz, order 4``; those that are None are left out."""
    return ", ".join(_fact(term(key), plain_value(value)) for key, value in facts.items() if value is not None)


def _fact(name: str, value: str) -> str:
    words, _, unit = name.rstrip("]").partition(" [")
    return f"{words} {value} {unit}".rstrip() if value[:1].isdigit() else f"{words} {value}"
