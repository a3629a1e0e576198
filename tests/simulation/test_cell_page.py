"""The page of the virtual cell has every option of every controller and effect; run this file to write its tables."""

from __future__ import annotations

import inspect
from dataclasses import MISSING, Field, fields
from pathlib import Path

from dynident.case.cell_section import EFFECTS, KEYS
from dynident.plugins import attribute_lines
from dynident.simulation.controllers import CONTROLLERS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "virtual-cell.md"


def written(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(f"{item:g}" for item in value)
    if value is None or isinstance(value, bool):
        return {None: "none", True: "true", False: "false"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)


def line(name: str, field: Field, texts: dict[str, str]) -> str:
    default = "" if field.default is MISSING else f"`{written(field.default)}`" * (field.default != "")
    return (
        f"| {name} | `{field.name}` | {default} | {texts[field.name].replace('|', chr(92) + '|').replace('``', '`')} |"
    )


def controllers_table() -> list[str]:
    lines = ["| part | option | default | what it is |", "|---|---|---|---|"]
    base = CONTROLLERS.kind
    texts = attribute_lines(inspect.getdoc(base) or "")
    lines += [line("every part" if k == 0 else "", field, texts) for k, field in enumerate(fields(base))]
    for name in CONTROLLERS.names():
        part = CONTROLLERS.get(name)
        shared = {field.name: field.default for field in fields(base)}
        texts |= attribute_lines(inspect.getdoc(part) or "")
        own = [one for one in fields(part) if one.name not in shared or one.default != shared[one.name]]
        lines.append(f"| `{name}` | | | {CONTROLLERS.summary(name)} |")
        lines += [line("", field, texts) for field in own]
    return lines


def effects_table() -> list[str]:
    lines = ["| effect | option | default | what it is |", "|---|---|---|---|"]
    for name, kind in EFFECTS.items():
        text = inspect.getdoc(kind) or ""
        summary = " ".join(text.partition("\nAttributes:")[0].split()).replace("|", "\\|")
        lines.append(f"| `{name}` | | | {summary} |")
        lines += [line("", field, attribute_lines(text)) for field in fields(kind)]
    return lines


def with_tables(text: str) -> str:
    for name, table in (("controllers", controllers_table()), ("effects", effects_table())):
        begin, end = f"<!-- generated: {name} -->\n", "<!-- generated: end -->"
        head, _, rest = text.partition(begin)
        tail = rest.partition(end)[2]
        text = "\n".join([f"{head}{begin}", *table, "", f"{end}{tail}"])
    return text


def test_the_tables_are_those_of_the_code() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text == with_tables(text), f"run: python {Path(__file__).name}"


def test_every_key_of_a_cell_stands_on_the_page() -> None:
    text = PAGE.read_text(encoding="utf-8").partition("<!-- keys: cell -->")[2].partition("\n## ")[0]
    assert all(f"`{key}`" in text for key in KEYS)


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
