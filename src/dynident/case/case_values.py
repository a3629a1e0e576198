"""Values that keys of a case file share: texts, parts, files that it names, and errors that name their place."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from dynident.data.formats import FORMATS
from dynident.errors import DescriptionError, DynidentError, FileError
from dynident.files import expanded
from dynident.model.documents.numbers import Place, expression
from dynident.model.documents.sections import Section
from dynident.robot_files.xacro import split_arguments, with_arguments

#: What is to be done about forces of cylinders or of belts at joints that turn.
LEVER_ARM = (
    "a cylinder's force acts by a lever arm that changes with the position: log or compute the torques (force times "
    "lever arm), or describe the cylinders as joints that slide"
)

#: Gravity in m/s^2 that is more than that of any planet: it is in another unit.
_MOST_GRAVITY = 30.0

#: A product with pi.
_PRODUCT = re.compile(r"[\d\s.*/+-]*\bpi\b[\d\s.*/+-]*")

Made = TypeVar("Made")

#: The folder under which logs and robots are looked for when they are neither beside the case file nor where it says.
DATA_VARIABLE = "DYNIDENT_DATA"


def gravity_of(top: Section) -> tuple[float, ...]:
    """Return the stated gravity in m/s^2.

    Raises:
        DescriptionError: It is no vector, or larger than that of any planet.
    """
    gravity = tuple(top.numbers("gravity", 3))
    if (size := math.hypot(*gravity)) > _MOST_GRAVITY:
        raise top.place("gravity").error(f"a gravity of {size:.4g} m/s^2", "write it in m/s^2, such as [0, 0, -9.81]")
    return gravity


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
            return str(name), {k: _text_of(place, v) for k, v in (options or {}).items()}
    raise place.error("neither a name nor one name with its options", "write name, or name: {option: value}")


def _is_plain(value: object) -> bool:
    return value is None or isinstance(value, str) or (isinstance(value, list) and all(map(_is_plain, value)))


def _text_of(place: Place, value: object) -> str | None:
    """Return an option as text, a product with ``pi`` as its number."""
    if isinstance(value, list):
        return ",".join(str(_text_of(place, item)) for item in value)
    product = isinstance(value, str) and _PRODUCT.fullmatch(value)
    return None if value is None else repr(expression(place, str(value))) if product else str(value)


def find_file(name: str, case: str) -> Path:
    """Return where a file named in a case file is; the name itself where it is nowhere, for the reader to refuse."""
    written = expanded(name)
    if written.is_absolute():
        return written
    data = os.environ.get(DATA_VARIABLE)
    roots = [*([Path(case).parent] if case else []), Path(), *([Path(data)] if data else [])]
    return next((root / written for root in roots if os.path.exists(root / written)), written)


def find_robot(name: str, case: str) -> Path:
    """Return where the robot of a case file is, or its name as it stands, which may be that of a robot that ships.

    Raises:
        FileError: It is named with a folder, and is nowhere.
    """
    found = find_file(name, case)
    if len(found.parts) > 1 and not os.path.exists(found):
        data = os.environ.get(DATA_VARIABLE)
        places = f"beside the case file, here or under {data}" if data else "beside the case file or here"
        unset = "" if data else f", or name the folder of the data in {DATA_VARIABLE}, which is not set"
        raise FileError(found, f"there is no such file {places}", f"check the path{unset}")
    return found


def robot_named(top: Section, case: str) -> str:
    """Return the robot of a case file as :func:`read_robot` takes it: a text, or ``{file: ..., arguments: {...}}``.

    Raises:
        DescriptionError: Neither of these.
        FileError: It is named with a folder, and is nowhere.
    """
    if not isinstance(top.value("robot"), Mapping):
        name, arguments = split_arguments(top.text("robot"))
        return with_arguments(str(find_robot(name, case)), arguments)
    section = top.section("robot", ("file", "arguments"))
    arguments = {}
    if section.has("arguments"):
        values = section.value("arguments")
        if not isinstance(values, Mapping):
            raise section.place("arguments").error("a mapping (name: value) is needed", "write 'name: value' lines")
        inner = section.section("arguments", tuple(map(str, values)))
        arguments = {str(name): inner.text(str(name)) for name in values}
    return with_arguments(str(find_robot(section.text("file"), case)), arguments)


def model_place(path: str) -> str:
    """Return where a robot model is.

    Raises:
        FileError: It is a log by its ending: robot model and log stand in the other order.
    """
    is_log = not path.lower().endswith(".json") and any(FORMATS.get(name).takes(path) for name in FORMATS.names())
    if is_log and os.path.exists(path):
        step = "give the robot model or the case file first, then the logs; write a table of DH parameters in YAML"
        raise FileError(path, "a log by its ending, where a robot model is wanted", step)
    return path
