"""The JSON of dynident: a robot as plain data in a file of its own."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import ClassVar, final

from dynident.model.documents.numbers import Place, shown
from dynident.model.documents.robot_data import robot_from_dict
from dynident.model.robot import Robot
from dynident.robot_files.formats.base import Description


@final
@dataclass(frozen=True)
class Native(Description):
    """The JSON of dynident, exact to the last bit; an infinite limit is null, inertia is ten numbers as in ``TEN``.

    The keys ``shapes`` and ``base_shapes`` are there where the robot has some.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".json",)

    def read(self, path: object, data: bytes) -> Robot:
        return robot_from_dict(_load_json(path, data), path)


def _load_json(path: object, data: bytes) -> object:
    def refuse(word: str) -> float:
        raise Place(path).error(f"{word} is no number in JSON", "write null for a limit that is not known")

    def mapping(pairs: list[tuple[str, object]]) -> dict[str, object]:
        found: dict[str, object] = {}
        for key, value in pairs:
            if key in found:
                raise Place(path).error(f"the key {shown(key)} is there twice", "keep one of the two")
            found[key] = value
        return found

    try:
        return json.loads(data, parse_constant=refuse, object_pairs_hook=mapping)
    except json.JSONDecodeError as problem:
        step = "give a robot that dynident has written"
        raise Place(path, f"line {problem.lineno}").error(f"not JSON ({problem.msg})", step) from problem
    except (ValueError, RecursionError) as problem:
        reason = "a number of too many digits"
        if isinstance(problem, RecursionError):
            reason = "nested too deep"
        elif isinstance(problem, UnicodeDecodeError):
            reason = "not UTF-8 text"
        raise Place(path).error(f"not JSON ({reason})", "give a robot that dynident has written") from problem
