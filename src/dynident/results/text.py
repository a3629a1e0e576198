"""Numbers, names and plain tables as text, the same for the terminal and for the report."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Fit, Validation

#: What stands in a cell for a figure that does not exist.
MISSING = "–"

#: Characters that turn the direction of the text around them; a name must not do that.
_DIRECTION = {*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x061C}

_NUMBER = re.compile(r"(?P<whole>[<>]?[-+]?\d+)(?P<tail>(?:\.\d+)?(?:e[-+]?\d+)?)")
_POWERS = {"^2": "²", "^3": "³"}


def clean(text: object) -> str:
    """Return one line of printable text: line ends become blanks, control and direction characters their escapes."""
    line = str(text)
    return line if line.isprintable() else "".join(_visible(character) for character in line)


def _visible(character: str) -> str:
    if character in "\t\n\r":
        return " "
    code = ord(character)
    if code in _DIRECTION or unicodedata.category(character) in ("Cc", "Cs", "Zl", "Zp"):
        return f"\\u{code:04x}"
    return character


def label(name: object) -> str:
    """Return a name from a file as it is shown; one that is empty or blank is called ``(no name)``."""
    return clean(name).strip() or "(no name)"


#: Units that a key ends in.
_UNITS = {"s": "s", "hz": "Hz", "m": "m", "kg": "kg", "rad": "rad", "deg": "°", "nm": "N·m", "percent": "%"}

#: Keys that are more than their words.
_WORDS = {
    "active": "active constraints",
    "cutoff": "cut-off",
    "delta": "Huber threshold",
    "seconds": "time [s]",
    "sha256": "SHA-256",
    "standstill": "speed at rest [rad/s]",
    "trim": "cut off at both ends",
}


def display_width(text: str) -> int:
    """Return how many columns of a terminal a text takes: wide characters take two, combining ones none."""
    if text.isascii():
        return len(text)
    return sum(0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


def shorten(text: str, width: int) -> str:
    """Return the text cut to ``width`` columns, the cut marked by an ellipsis."""
    if display_width(text) <= width:
        return text
    kept = ""
    for character in text:
        if display_width(kept + character) > width - 1:
            break
        kept += character
    return kept.rstrip() + "…"


def pretty_unit(unit: str) -> str:
    """Return a unit as printed: ``kg m^2`` becomes ``kg·m²``."""
    for plain_power, power in _POWERS.items():
        unit = unit.replace(plain_power, power)
    return clean(unit).replace(" ", "·")


def format_value(value: float, deviation: float) -> tuple[str, str]:
    """Return a value and its standard deviation with the digits that the deviation allows.

    The rule of the Particle Data Group (Review of Particle Physics 2022, 5.3): three leading digits of the deviation
    of 100 to 354 keep two, 355 to 949 one, from 950 on it is rounded up to 1000 and keeps two; the value ends at the
    same place. ``format_value(1.2567, 0.1234)`` is ``("1.26", "0.12")``. Outside 1e-4 to 1e6 both carry the same
    power of ten. A value known to more than ten digits shows ten.
    """
    if not (np.isfinite(value) and np.isfinite(deviation) and deviation > 0):
        return _number(value, lambda v: f"{v:.6g}"), _number(deviation, lambda v: f"{v:.2g}")
    mantissa, exponent = f"{deviation:.2e}".split("e")
    place = int(exponent) - (1 if float(mantissa) < 3.55 else 0)
    size = _exponent(round(max(abs(value), deviation), -place))
    if place < size - 9:
        return format_number(value, 10), f"{deviation:.1e}"
    if -4 <= size < 6:
        return format_to(value, place), format_to(deviation, place)
    power = f"e{size:+03d}"
    return tuple(format_to(part / 10.0**size, place - size) + power for part in (value, deviation))  # type: ignore[return-value]


def format_number(value: float, digits: int = 4) -> str:
    """Return a figure with some significant digits, trailing zeros kept; MISSING for NaN."""
    return _number(value, lambda v: _significant(v, digits))


def counted(count: int, word: str) -> str:
    """Return a number of things, such as ``1 draw`` or ``25 draws``."""
    return f"{count} {word}{'' if count == 1 else 's'}"


def format_given(value: float | None) -> str:
    """Return a number that somebody stated, as short as it is; MISSING where none is, or where it is infinite."""
    return MISSING if value is None or not np.isfinite(value) else f"{value:.6g}"


def format_percent(fraction: float, sign: bool = True) -> str:
    """Return a fraction in percent with two digits, between ``<0.01 %`` and ``>999 %``; MISSING for NaN.

    Args:
        fraction: 0.05 is 5 %.
        sign: Whether to write the sign of percent; a column that has it in its heading leaves it out.
    """
    return _number(fraction, _percent) + (" %" if sign and np.isfinite(fraction) else "")


def _number(value: float, write: Callable[[float], str]) -> str:
    if np.isnan(value):
        return MISSING
    if np.isinf(value):
        return "inf" if value > 0 else "-inf"
    return write(float(value))


def _percent(fraction: float) -> str:
    percent = abs(100.0 * fraction)
    sign = "-" if fraction < 0 else ""
    if percent == 0:
        return "0"
    if percent < 0.01:
        return ">-0.01" if sign else "<0.01"
    if percent >= 999.5:
        return "<-999" if sign else ">999"
    return f"{sign}{percent:.{2 if percent < 0.995 else 1 if percent < 9.95 else 0}f}"


def _exponent(size: float) -> int:
    return int(f"{size:.15e}".split("e")[1])


def format_to(value: float, place: int) -> str:
    """Return a finite number rounded to a place: -2 is hundredths, 1 is tens; zero has no sign."""
    text = f"{round(value, -place):.{max(0, -place)}f}"
    return text.lstrip("-") if float(text) == 0 else text


def _significant(value: float, digits: int) -> str:
    if value == 0:
        return "0"
    size = int(f"{value:.{digits - 1}e}".split("e")[1])
    return f"{value:.{max(0, digits - 1 - size)}f}" if -4 <= size < 6 else f"{value:.{digits - 1}e}"


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        heading: What it is.
        unit: Its unit, empty where the cells have none or carry their own.
        numeric: Whether its cells are numbers that line up at their decimal points.
        detail: Whether a narrow terminal goes without it.
    """

    heading: str
    unit: str = ""
    numeric: bool = False
    detail: bool = False


def columns_of(*headings: str | Column) -> tuple[Column, ...]:
    """Return columns by what :func:`heading_text` prints, such as ``joint`` and ``>mass [kg]``; ``>``: numeric."""
    return tuple(one if isinstance(one, Column) else _column(one) for one in headings)


def _column(text: str) -> Column:
    heading, _, unit = text.removeprefix(">").removesuffix("]").partition(" [")
    return Column(heading, unit, numeric=text.startswith(">"))


def heading_text(column: Column) -> str:
    """Return a heading as printed, its unit in brackets."""
    return f"{column.heading} [{column.unit}]" if column.unit else column.heading


@dataclass(frozen=True)
class Table:
    """A table as data.

    Attributes:
        columns: The columns.
        rows: The cells, row by row, one for each column.
        note: What has to be said beside it.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for number, row in enumerate(self.rows, start=1):
            if len(row) != len(self.columns):
                raise ValueError(f"row {number} has {len(row)} cells for {len(self.columns)} columns")

    def lined_up(self, digit: str = " ", point: str = " ") -> tuple[tuple[str, ...], ...]:
        """Return the rows with the numbers of each numeric column padded so that their decimal points line up.

        Args:
            digit: A blank as wide as a digit.
            point: A blank as wide as a decimal point.
        """
        columns = [
            line_up([row[k] for row in self.rows], digit, point) if column.numeric else [row[k] for row in self.rows]
            for k, column in enumerate(self.columns)
        ]
        return tuple(zip(*columns, strict=True)) if self.rows else ()


def line_up(cells: Sequence[str], digit: str = " ", point: str = " ") -> list[str]:
    """Return number texts padded on the right so that, set flush right, their decimal points line up."""
    tails = [_tail(cell) for cell in cells]
    longest = max((len(tail) for tail in tails), default=0)
    pointed = any("." in tail for tail in tails)
    return [cell + _blank(longest - len(tail), pointed and not tail, digit, point) for cell, tail in zip(cells, tails)]  # noqa: B905


def _tail(cell: str) -> str:
    match = _NUMBER.fullmatch(cell)
    return match["tail"] if match else ""


def _blank(count: int, with_point: bool, digit: str, point: str) -> str:
    return point + digit * (count - 1) if with_point and count else digit * count


def plain(table: Table) -> str:
    """Return a table as lines of text: two blanks between columns, numbers flush right, a rule below the headings."""
    heads = [heading_text(column) for column in table.columns]
    lines = [tuple(heads), *table.lined_up()]
    widths = [max(display_width(line[k]) for line in lines) for k in range(len(heads))]
    ruled = [lines[0], tuple("-" * width for width in widths), *lines[1:]]
    return "\n".join("  ".join(map(_cell, line, widths, table.columns)).rstrip() for line in ruled)


def _cell(text: str, width: int, column: Column) -> str:
    blank = " " * (width - display_width(text))
    return blank + text if column.numeric else text + blank


def parameters_table(estimate: Estimate, width: int | None = None) -> Table:
    """Return the base parameters: value with its deviation, unit, relative deviation and what it is made of.

    Args:
        estimate: The estimate.
        width: Columns of a terminal that a name may take; longer ones are shortened. None shows all.
    """
    base = estimate.base
    rows = []
    known = zip(base.names, estimate.beta, base.units, estimate.std, estimate.relative_std, strict=True)
    for number, (name, value, unit, deviation, relative) in enumerate(known, start=1):
        shown, spread = format_value(value, deviation)
        called = label(name) if width is None else shorten(label(name), width)
        share = format_percent(relative if value else np.nan, sign=False)  # there is none of a value of 0
        rows.append((str(number), called, shown, spread, pretty_unit(unit), share))
    columns = columns_of(">#", "parameter", ">value", ">std", "unit", ">rel. std [%]")
    return Table(columns, tuple(rows))


def total_error(validation: Validation) -> str:
    """Return the total relative error, and that of the rows in motion where it differs by a tenth or more."""
    every, moving = validation.total_relative_error, validation.moving_relative_error
    without = f" ({format_percent(moving)} without the samples at rest)"
    return format_percent(every) + without * bool(validation.rests and abs(moving - every) > 0.1 * every)


def rest_words(validation: Validation) -> str:
    """Return what an error counts of the samples at rest, as ``it counts ...``; empty where no joint rests."""
    part = "of samples at rest only the torque that static friction cannot hold"
    how = "samples at rest in full" if validation.held is None else part
    return f"counts {how}" if validation.rests else ""


def fits_table(validation: Validation, moving: bool = False) -> Table:
    """Return the figures of each joint, over all rows or over those in motion; the note states the filter.

    Args:
        validation: What was compared.
        moving: Only rows where the joint moves faster than ``validation.standstill``.
    """
    samples, unfiltered, square = (Column(name, numeric=True, detail=True) for name in ("samples", "unfiltered", "R²"))
    errors = (">RMS error", unfiltered, ">relative error [%]", ">correlation", square)
    columns = columns_of("joint", samples, "unit", *errors)
    fits = validation.moving if moving else validation.joints
    return Table(columns, tuple(_fit_row(fit) for fit in fits), in_words(validation.filter))


def rest_table(validation: Validation) -> Table | None:
    """Return how the samples at rest lie to what static friction can hold; None where that is not known."""
    columns = columns_of("joint", ">samples at rest", ">static friction +-", ">inside [%]", ">RMS beyond", "unit")
    rows = []
    for one in validation.at_rest:
        share, sizes = format_percent(one["inside"], sign=False), (one["half_width"], one["rms_beyond"])
        half, beyond = (format_number(size, 3) for size in sizes)
        rows.append((label(one["name"]), str(one["samples"]), half, share, beyond, pretty_unit(one["unit"])))
    return Table(columns, tuple(rows)) if rows else None


def _fit_row(fit: Fit) -> tuple[str, ...]:
    return (
        label(fit.name),
        str(fit.samples),
        pretty_unit(fit.unit),
        format_number(fit.rmse, 3),
        format_number(fit.rmse_unfiltered, 3),
        format_percent(fit.relative_error, sign=False),
        _number(fit.correlation, lambda v: f"{v:.4f}"),
        _number(fit.r2, lambda v: f"{v:.4f}"),
    )


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


def plain_value(value: object) -> str:
    """Return any plain value as text: numbers short, yes and no, MISSING for None, lists with commas."""
    if isinstance(value, Mapping):
        return in_words(value)
    if isinstance(value, np.ndarray):
        return plain_value(value.tolist())
    if isinstance(value, list | tuple):
        return ", ".join(plain_value(item) for item in value)
    return _plain_scalar(value)


def _plain_scalar(value: object) -> str:
    if value is None:
        return MISSING
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return str(int(value))
    if isinstance(value, float | np.floating):
        return _number(float(value), lambda v: f"{v:.6g}")
    return label(value)


def comparison_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return rows given as data: a column for each key, in the order of first sight; numbers with four digits at most.

    A column of texts that all end in a sign of percent has it in its heading.
    """
    keys = list(dict.fromkeys(key for row in rows for key in row))
    cells = {key: [_compared(row.get(key)) for row in rows] for key in keys}
    columns = []
    for key, texts in cells.items():
        percent = all(text.endswith(" %") or text == MISSING for text in texts)
        cells[key] = [text.removesuffix(" %") for text in texts] if percent else texts
        numeric = all(_NUMBER.fullmatch(text) or text in (MISSING, "inf", "-inf") for text in cells[key])
        columns.append(Column(label(key), "%" if percent and any(t != MISSING for t in texts) else "", numeric))
    return Table(tuple(columns), tuple(zip(*cells.values(), strict=True)))


def _compared(value: object) -> str:
    return _number(float(value), lambda v: f"{v:.4g}") if isinstance(value, float | np.floating) else plain_value(value)
