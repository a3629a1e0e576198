"""Numbers and tables as text: golden tables, the rule of the Particle Data Group, laws of rounding."""

from __future__ import annotations

import unicodedata
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.validation import Fit, Validation
from dynident.results.text import (
    MISSING,
    Column,
    Table,
    clean,
    columns_of,
    comparison_table,
    display_width,
    fits_table,
    format_given,
    format_number,
    format_percent,
    format_value,
    in_words,
    label,
    line_up,
    parameters_table,
    plain,
    plain_value,
    pretty_unit,
    shorten,
    total_error,
)

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("value", "deviation", "expected"),
    [
        (1.2567, 0.1234, ("1.26", "0.12")),
        (0.827, 0.119, ("0.83", "0.12")),  # the three examples of the Review of Particle Physics
        (0.827, 0.367, ("0.8", "0.4")),
        (0.827, 0.967, ("0.8", "1.0")),
        (1.2567, 0.3545, ("1.26", "0.35")),
        (1.2567, 0.9499, ("1.3", "0.9")),
        (99.96, 0.0996, ("99.96", "0.10")),
        (123456.0, 1234.0, ("123500", "1200")),
        (123.0, 5000.0, ("0", "5000")),
        (-0.001, 0.1, ("0.00", "0.10")),
        (0.0, 0.1, ("0.00", "0.10")),
        (1e-9, 3e-10, ("1.00e-09", "0.30e-09")),
        (1e9, 3.3e7, ("1.000e+09", "0.033e+09")),
        (9.999e9, 1e8, ("1.000e+10", "0.010e+10")),
        (999999.6, 1.0, ("999999.6", "1.0")),
        (1.0, 1e-14, ("1.000000000", "1.0e-14")),
        (2.5, 0.0, ("2.5", "0")),
        (2.5, INF, ("2.5", "inf")),
        (2.5, NAN, ("2.5", MISSING)),
        (NAN, 0.1234, (MISSING, "0.12")),
        (-INF, 0.1234, ("-inf", "0.12")),
    ],
)
def test_the_deviation_sets_the_digits(value: float, deviation: float, expected: tuple[str, str]) -> None:
    assert format_value(value, deviation) == expected


@given(st.floats(-1e12, 1e12), st.floats(1e-12, 1e12))
def test_value_and_deviation_end_at_the_same_place(value: float, deviation: float) -> None:
    shown, spread = format_value(value, deviation)
    assert float(spread) == pytest.approx(deviation, rel=0.15)
    if spread.count("e") == shown.count("e") and format_number(value, 10) != shown:
        (mantissa, _, power), (last, _, other) = shown.partition("e"), spread.partition("e")
        assert power == other
        assert len(mantissa.partition(".")[2]) == len(last.partition(".")[2])
        assert abs(float(shown) - value) <= 0.51 * deviation
    assert float(shown) != 0 or not shown.startswith("-")


@pytest.mark.parametrize(
    ("fraction", "expected"),
    [
        (0.0, "0 %"),
        (1e-5, "<0.01 %"),
        (-1e-5, ">-0.01 %"),
        (0.0042, "0.42 %"),
        (0.00996, "1.0 %"),
        (0.0123, "1.2 %"),
        (-0.0123, "-1.2 %"),
        (0.0996, "10 %"),
        (1.4, "140 %"),
        (9.994, "999 %"),
        (9.996, ">999 %"),
        (-12.0, "<-999 %"),
        (INF, "inf"),
        (NAN, MISSING),
    ],
)
def test_percentages(fraction: float, expected: str) -> None:
    assert format_percent(fraction) == expected
    assert format_percent(fraction, sign=False) == expected.removesuffix(" %")


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0, "0"),
        (1.0, "1.000"),
        (9.99999, "10.00"),
        (123456.0, "123456"),
        (999999.9, "1.000e+06"),
        (1e-5, "1.000e-05"),
    ],
)
def test_significant_digits(value: float, expected: str) -> None:
    assert format_number(value) == expected


def test_stated_numbers_are_as_short_as_they_are() -> None:
    assert [format_given(v) for v in (2.0, 3.14159265, INF, None, NAN)] == ["2", "3.14159", MISSING, MISSING, MISSING]


def test_units_are_printed_with_signs() -> None:
    assert [pretty_unit(u) for u in ("kg m^2", "N m s/rad", "N")] == ["kg·m²", "N·m·s/rad", "N"]


def test_names_cannot_break_the_line_or_turn_the_text_around() -> None:
    assert clean("a\nb\x00\x1b[31m\u202ec\u2028\ud800") == "a b\\u0000\\u001b[31m\\u202ec\\u2028\\ud800"
    assert [label(name) for name in ("", "  \t", " joint ")] == ["(no name)", "(no name)", "joint"]
    assert shorten("joint", 5) == "joint"
    assert shorten("a long joint", 7) == "a long…"
    assert display_width("é関節") == 5
    assert display_width(shorten("関節関節", 5)) == 5


@given(st.text(st.characters(exclude_categories=())))
def test_a_clean_text_is_one_line_that_can_be_written_and_stays_as_it_is(text: str) -> None:
    shown = clean(text)
    assert clean(shown) == shown
    assert len(shown.splitlines()) <= 1
    assert shown.encode("utf-8") or not text
    assert not any(unicodedata.category(c) in ("Cc", "Cs") for c in shown)


def test_decimal_points_line_up() -> None:
    cells = ["1", "2.55", "-10.1", MISSING, "1.2e-07", ">999", "inf"]
    assert line_up(cells) == ["1      ", "2.55   ", "-10.1    ", "–      ", "1.2e-07", ">999      ", "inf      "]
    assert line_up(["1", "2.5"], digit="D", point="P") == ["1PD", "2.5"]
    assert line_up([]) == []


@given(st.lists(st.floats(-1e9, 1e9).map(lambda v: f"{v:.{abs(hash(v)) % 5}f}"), min_size=1, max_size=8))
def test_flush_right_numbers_have_their_points_below_each_other(cells: list[str]) -> None:
    padded = line_up(cells)
    width = max(map(len, padded))
    right = [cell.rjust(width) for cell in padded]
    places = {
        len(text) - len(text.lstrip()) + len(cell.partition(".")[0]) for text, cell in zip(right, cells, strict=True)
    }
    assert len(places) == 1


def test_plain_table() -> None:
    columns = (Column("joint"), Column("error", "N·m", numeric=True), Column("R²", numeric=True))
    rows = (("shoulder", "12.5", "0.99"), ("関節", "0.125", MISSING), ("", "-3", "1"))
    assert plain(Table(columns, rows)) == (
        "joint     error [N·m]    R²\n"
        "--------  -----------  ----\n"
        "shoulder       12.5    0.99\n"
        "関節            0.125  –\n"
        "               -3      1"
    )
    assert plain(Table(columns, ())).splitlines()[0] == "joint  error [N·m]  R²"


def test_a_table_refuses_a_short_row() -> None:
    with pytest.raises(ValueError, match="row 2 has 1 cells for 2 columns"):
        Table((Column("a"), Column("b")), (("1", "2"), ("1",)))


def fits() -> tuple[Fit, ...]:
    return (
        Fit("joint1", "N m", 3000, 1.23456, 2.5, 0.99871, 0.9812, 0.0421, 30.0),
        Fit("<b>" + "long" * 6, "N", 0, *[NAN] * 6),
        Fit("joint3", "N m", 3000, 1e-9, 0.0, -0.5, -12.5, 14.0, 1.0),
    )


def validation() -> Validation:
    none = np.zeros((0, 3))
    filter = {"kind": "butterworth", "cutoff_hz": 5.0, "order": 4, "torque": "same", "rate_hz": None}
    return Validation(
        fits(), fits()[1:], 0.0421, 3000, 0.02, filter, ("a.csv",), np.zeros(0), (0,), none, none, none, none, none
    )


def test_fits_table_golden() -> None:
    table = fits_table(validation())
    assert plain(table) == (
        "joint                        samples  unit  RMS error  unfiltered  relative error [%]  correlation        R²\n"
        "---------------------------  -------  ----  ---------  ----------  ------------------  -----------  --------\n"
        "joint1                          3000  N·m    1.23            2.50                 4.2       0.9987    0.9812\n"
        "<b>longlonglonglonglonglong        0  N      –               –                    –         –         –\n"
        "joint3                          3000  N·m    1.00e-09        0                 >999        -0.5000  -12.5000"
    )
    assert table.note == "kind butterworth, cut-off 5 Hz, order 4, torque same"
    assert len(fits_table(validation(), moving=True).rows) == 2


@pytest.mark.parametrize(
    ("every", "moving", "told"),
    [(0.3, 0.036, "30 % (3.6 % without the samples at rest)"), (0.0421, 0.041, "4.2 %"), (0.02, NAN, "2.0 %")],
)
def test_the_rows_at_rest_are_told_where_they_matter(every: float, moving: float, told: str) -> None:
    fit = Fit("joint1", "N m", 100, 2.0, 2.5, 0.9, 0.9, moving, 30.0)
    found = replace(validation(), total_relative_error=every, moving=(fit,))
    assert total_error(found) == told


def test_parameters_table_golden() -> None:
    estimate = SimpleNamespace(
        base=SimpleNamespace(
            names=("Izz[link1] + 0.16 m[link2]", "Fc[joint1]", "mx[link2]", "Ixy[link2]"),
            units=("kg m^2", "N m", "kg m", "kg m^2"),
        ),
        beta=np.array([50.4438, 4.0, 0.0, -1.2e-7]),
        std=np.array([0.123, 0.0, 0.5, 3e-8]),
        relative_std=np.array([0.123 / 50.4438, 0.0, INF, 0.25]),
    )
    table = parameters_table(cast(Estimate, estimate))
    assert plain(table) == (
        "#  parameter                       value       std  unit   rel. std [%]\n"
        "-  --------------------------  ---------  --------  -----  ------------\n"
        "1  Izz[link1] + 0.16 m[link2]  50.44      0.12      kg·m²          0.24\n"
        "2  Fc[joint1]                   4         0         N·m            0\n"
        "3  mx[link2]                    0.0       0.5       kg·m           –\n"
        "4  Ixy[link2]                  -1.20e-07  0.30e-07  kg·m²         25"
    )
    assert parameters_table(cast(Estimate, estimate), width=12).rows[0][1] == "Izz[link1]…"
    assert table.rows == (
        ("1", "Izz[link1] + 0.16 m[link2]", "50.44", "0.12", "kg·m²", "0.24"),
        ("2", "Fc[joint1]", "4", "0", "N·m", "0"),
        ("3", "mx[link2]", "0.0", "0.5", "kg·m", MISSING),
        ("4", "Ixy[link2]", "-1.20e-07", "0.30e-07", "kg·m²", "25"),
    )


def test_comparison_table_takes_any_rows() -> None:
    rows: list[dict[str, Any]] = [
        {"method": "abc", "objective [N m]": 0.31820001, "gap": "12.5 %", "physical": False, "time [s]": 0.21},
        {"method": "ols", "objective [N m]": NAN, "gap": "3 %", "physical": True, "extra": 3},
        {"method": "<i>", "gap": None, "physical": np.bool_(True), "time [s]": np.float64(12345.678)},
    ]
    table = comparison_table(rows)
    assert [(c.heading, c.unit, c.numeric) for c in table.columns] == [
        ("method", "", False),
        ("objective [N m]", "", True),
        ("gap", "%", True),
        ("physical", "", False),
        ("time [s]", "", True),
        ("extra", "", True),
    ]
    assert table.rows == (
        ("abc", "0.3182", "12.5", "no", "0.21", MISSING),
        ("ols", MISSING, "3", "yes", MISSING, "3"),
        ("<i>", MISSING, MISSING, "yes", "1.235e+04", MISSING),
    )
    assert comparison_table([]) == Table((), ())


def test_facts_in_a_line() -> None:
    facts = {"kind": "five_point", "cutoff_hz": None, "box": {"lower": [1, 2.5], "upper": np.array([INF])}, "on": True}
    assert in_words(facts) == "kind five_point, box lower 1, 2.5, upper inf, on yes"
    assert plain_value(np.int64(3)) == "3"
    assert plain_value(None) == MISSING


def test_columns_by_what_is_printed_above_them() -> None:
    mass = Column("mass", "kg", numeric=True)
    kept = Column("R²", detail=True)
    assert columns_of("link", ">mass [kg]", "file [.csv]", ">P>|t|", kept) == (
        Column("link"),
        mass,
        Column("file", ".csv"),
        Column("P>|t|", numeric=True),
        kept,
    )
