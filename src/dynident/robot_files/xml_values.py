"""Attributes of an XML element as numbers and words, each checked; an error names the file, the element, the remedy."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from dynident.arrays import Array
from dynident.errors import nearest
from dynident.model.documents.numbers import Place, check_name, decimal, shown


@dataclass(frozen=True)
class Values:
    """Values by name, as a file writes them.

    Attributes:
        place: Where they are.
        given: The texts by name, defaults included.
    """

    place: Place
    given: Mapping[str, str]

    def __contains__(self, name: str) -> bool:
        return name in self.given

    def known(self, names: Collection[str]) -> Values:
        """Return the values after a check that there are no others.

        Raises:
            DescriptionError: An unknown name; the message has the nearest known one.
        """
        for name in self.given:
            if name not in names:
                raise self.place.error(
                    f"unknown attribute {shown(name)}", f"remove or correct it{nearest(name, names)}"
                )
        return self

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text.

        Raises:
            DescriptionError: Missing without a default.
        """
        found = self.given.get(name, default)
        if found is None:
            raise self.place.error(f"no attribute '{name}'", f'write {name}="..."')
        return found

    def name(self, name: str) -> str:
        """Return a name: a text that is not empty and can be printed."""
        return check_name(self.place, name, self.text(name))

    def choice(self, name: str, words: Collection[str], default: str) -> str:
        """Return one of some words.

        Raises:
            DescriptionError: Another word.
        """
        word = self.text(name, default)
        if word not in words:
            step = f"choose one of: {', '.join(words)}{nearest(word, words)}"
            raise self.place.error(f"{name} {shown(word)} is not known", step)
        return word

    def flag(self, name: str, default: bool) -> bool:
        """Return whether ``true`` is written."""
        return self.choice(name, ("true", "false"), "true" if default else "false") == "true"

    def number(self, name: str, default: float | None = None) -> float:
        """Return a finite number."""
        if name not in self.given and default is not None:
            return default
        return decimal(self.place, name, self.text(name))

    def at_least_zero(self, name: str, default: float | None = None) -> float:
        """Return a number that is not negative."""
        value = self.number(name, default)
        if value < 0:
            raise self.place.error(f"{name} {value:g} is negative", "write 0 or more")
        return value

    def numbers(self, name: str, least: int, most: int = 0) -> Array:
        """Return as many numbers as there have to be: ``least``, or up to ``most``.

        Raises:
            DescriptionError: Fewer or more, or one that is no number.
        """
        text = self.text(name)
        words = text.split()
        if not least <= len(words) <= max(least, most):
            step = f"write {least}{f' to {most}' if most > least else ''} numbers with spaces between them"
            raise self.place.error(f"{name} {shown(text)} has {len(words)} numbers", step)
        return np.array([decimal(self.place, name, word) for word in words])
