"""The key ``cell`` of a case file, or a file of its own: the virtual cell in which ``dynident simulate`` runs the case.

Keys: controller, truth, one mapping per effect (encoder, ripple, bristles, elasticity, warming, payload, tilt, effort,
recorder), saturation, lead_in, integration_rate, plant. docs/virtual-cell.md describes each.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from dynident.case.case_values import guarded, part_of
from dynident.errors import BadOption
from dynident.files import bytes_of
from dynident.model.documents.sections import Section
from dynident.robot_files.strict_yaml import load_yaml
from dynident.simulation import effects
from dynident.simulation.cell import Cell
from dynident.simulation.controllers import CONTROLLERS
from dynident.simulation.truth import Truth

#: The effects that have a mapping of their own, and what each becomes.
EFFECTS: dict[str, type] = {
    "encoder": effects.Encoder,
    "ripple": effects.Ripple,
    "bristles": effects.Bristles,
    "elasticity": effects.Elasticity,
    "warming": effects.Warming,
    "payload": effects.Payload,
    "tilt": effects.Tilt,
    "effort": effects.Effort,
    "recorder": effects.Recorder,
}

#: Keys that are plain values.
PLAIN = ("saturation", "lead_in", "integration_rate", "plant")

KEYS = ("controller", "truth", *EFFECTS, *PLAIN)

_TRUTH_KEYS = ("parameters", "spread", "friction", "believed")


@dataclass(frozen=True)
class CellSetup:
    """A virtual cell as it is written.

    Attributes:
        cell: Controller and effects.
        truth: How the true parameters are made.
        path: The file that it stands in.
        values: The mapping that it was read from.
    """

    cell: Cell = field(default_factory=Cell)
    truth: Truth = field(default_factory=Truth)
    path: str = "cell"
    values: Mapping[str, Any] = field(default_factory=dict)

    def changed(self, settings: Sequence[str]) -> CellSetup:
        """Return the setup with settings of the command line, such as ``encoder.noise=1e-5`` or ``controller=pid``.

        Raises:
            BadOption: A setting that is not of the form KEY=VALUE.
            DescriptionError: An unknown key, or a value that cannot be.
        """
        if not settings:
            return self
        values = copy.deepcopy(dict(self.values))
        for setting in settings:
            _put(values, setting)
        return cell_of(Section.top(f"{self.path} with --set", values, KEYS, {}))


def read_cell(path: str | Path) -> CellSetup:
    """Read a file with the keys of the section ``cell`` of a case file.

    Raises:
        FileError: The file cannot be read.
        DescriptionError: A fault in it, with the line and the key.
        UnknownChoice: A controller that does not exist.
    """
    value, lines = load_yaml(path, bytes_of(path))
    return cell_of(Section.top(path, value, KEYS, lines))


def cell_of(section: Section) -> CellSetup:
    """Return what a section with the keys of a cell states.

    Raises:
        DescriptionError: A fault, with the key.
    """
    found: dict[str, Any] = {}
    if section.has("controller"):
        place = section.place("controller")
        name, options = part_of(place, section.value("controller"))
        found["controller"] = guarded(place, lambda: CONTROLLERS.make_from_text(name, options))
    for key, kind in EFFECTS.items():
        if section.has(key):
            inner = section.section(key, [one.name for one in fields(kind)])
            values = {one.name: _value(inner, one.name, str(one.type)) for one in fields(kind) if inner.has(one.name)}
            found[key] = guarded(section.place(key), lambda kind=kind, values=values: kind(**values))
    for key in PLAIN:
        if section.has(key):
            kinds = {one.name: str(one.type) for one in fields(Cell)}
            found[key] = _value(section, key, kinds[key])
    truth = _truth(section) if section.has("truth") else Truth()
    cell = guarded(section.place(), lambda: Cell(**found))
    return CellSetup(cell, truth, str(section.path), dict(section.values))


def _truth(section: Section) -> Truth:
    inner = section.section("truth", _TRUTH_KEYS)
    friction: dict[str, tuple[float, ...]] = {}
    if inner.has("friction"):
        stated = inner.values["friction"]
        symbols = inner.section("friction", [str(key) for key in stated] if isinstance(stated, dict) else [])
        friction = {key: _numbers(symbols, key) for key in symbols.values}
    return guarded(
        inner.place(),
        lambda: Truth(
            inner.text("parameters", "nominal"), inner.number("spread", 0.0), friction, inner.text("believed", "truth")
        ),
    )


def _value(section: Section, key: str, kind: str) -> Any:
    """Return the value of a field by the words of its type."""
    if kind == "Numbers":
        return _numbers(section, key)
    if kind == "bool":
        return section.choice(key, ("true", "false")) == "true"
    return section.number(key) if kind.startswith("float") else section.text(key)


def _numbers(section: Section, key: str) -> tuple[float, ...]:
    value = section.value(key)
    return tuple(map(float, section.numbers(key, len(value)))) if isinstance(value, list) else (section.number(key),)


def _put(values: dict[str, Any], setting: str) -> None:
    """Put ``key.key=value`` into the mapping."""
    name, equals, text = setting.partition("=")
    keys = name.strip().split(".")
    if not equals or not all(keys):
        raise BadOption("--set", setting, "write KEY=VALUE, such as encoder.noise=1e-5 or controller=pid")
    value: Any = [item.strip() for item in text.split(",")] if "," in text else text.strip()
    if keys[0] == "controller" and len(keys) == 2:
        stated = values.get("controller", "pd")
        ((part, options),) = stated.items() if isinstance(stated, dict) else ((stated, {}),)
        values["controller"] = {part: {**(options or {}), keys[1]: value}}
        return
    inner = values
    for key in keys[:-1]:
        inner[key] = dict(inner.get(key) or {})
        inner = inner[key]
    inner[keys[-1]] = value
