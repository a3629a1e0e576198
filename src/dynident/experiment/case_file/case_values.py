"""Values of a case file that several of its keys share: one text or many, and errors that name their place."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from dynident.errors import DescriptionError, DynidentError
from dynident.model.documents.numbers import Place
from dynident.model.documents.sections import Section

Made = TypeVar("Made")


def texts(section: Section, key: str) -> tuple[str, ...]:
    """Return the texts under a key, one or many; none where it is missing.

    Raises:
        DescriptionError: Neither a text nor a list of texts.
    """
    if not section.has(key):
        return ()
    value = one_or_many(section, key)
    return (value,) if isinstance(value, str) else value


def one_or_many(section: Section, key: str) -> str | tuple[str, ...]:
    """Return a text, or the texts of a list.

    Raises:
        DescriptionError: Neither a text nor a list of texts.
    """
    value = section.value(key)
    if isinstance(value, str):
        return value
    if isinstance(value, list) and value and all(isinstance(item, str) for item in value):
        return tuple(value)
    raise section.place(key).error("neither a text nor a list of texts", "write one, or a list [a, b]")


def guarded(place: Place, make: Callable[[], Made]) -> Made:
    """Return ``make()``; an error about a value then also names its place in the case file.

    Raises:
        DescriptionError: ``make`` failed.
    """
    try:
        return make()
    except DescriptionError:
        raise
    except (DynidentError, ValueError) as error:
        raise DescriptionError(place.path, place.where, str(error), "see docs/case-file.md") from error


def part_of(place: Place, value: object) -> tuple[str, dict[str, str | None]]:
    """Return name and options, as text, of a part written as ``name`` or as ``name: {option: value}``.

    Raises:
        DescriptionError: Neither of these.
    """
    if isinstance(value, str):
        return value, {}
    if isinstance(value, dict) and len(value) == 1:
        ((name, options),) = value.items()
        if options is None or (isinstance(options, dict) and all(_is_plain(v) for v in options.values())):
            return str(name), {k: _text_of(v) for k, v in (options or {}).items()}
    raise place.error("neither a name nor one name with its options", "write name, or name: {option: value}")


def _is_plain(value: object) -> bool:
    return value is None or isinstance(value, str) or (isinstance(value, list) and all(map(_is_plain, value)))


def _text_of(value: object) -> str | None:
    return ",".join(str(item) for item in value) if isinstance(value, list) else None if value is None else str(value)
