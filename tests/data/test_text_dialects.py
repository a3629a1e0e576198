"""Text tables as programs write them: stated separators, headers in comments, lines before the header, mixed blanks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynident.data.formats import ColumnMap, read_header, read_log
from dynident.data.formats._text_table import open_table
from dynident.data.formats.csv import Csv
from dynident.errors import LogFormatError

N = 30
VALUES = np.random.default_rng(3).normal(size=(N, 3)).round(6)
VALUES[:, 0] = np.arange(N) / 100


def rows(separator: str = ",", decimal: str = ".") -> list[str]:
    return [separator.join(f"{x:.6f}".replace(".", decimal) for x in row) for row in VALUES]


def check(path: Path, lines: list[str], note: str = "", decimal: str = ".") -> None:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    log = read_log(path, form=Csv(decimal=decimal))
    np.testing.assert_allclose(np.column_stack([log.time, log.q, log.torque]), VALUES, atol=1e-12)  # type: ignore[arg-type]
    assert note in log.source.steps[0]


def test_a_spreadsheet_that_names_its_separator(tmp_path: Path) -> None:
    check(tmp_path / "a.csv", ["\ufeffsep=;", "t;q1;tau1", *rows(";", ",")], decimal=",")
    check(tmp_path / "a.csv", ["sep=,", "t,q1,tau1", *rows()])


@pytest.mark.parametrize(
    ("separator", "header"), [(" ", "# t q1 tau1"), (",", "#t, q1, tau1"), ("\t", "# t\tq1\ttau1")]
)
def test_a_header_in_a_comment(tmp_path: Path, separator: str, header: str) -> None:
    """As numpy.savetxt writes it."""
    check(tmp_path / "a.txt", ["# a run on Monday", header, *rows(separator)], "its header in a comment")


def test_savetxt_of_numpy(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    np.savetxt(path, VALUES, header="t q1 tau1")
    np.testing.assert_allclose(read_log(path).q[:, 0], VALUES[:, 1])


@pytest.mark.parametrize(
    "preamble",
    [
        ["Robot arm 7, serial 1234", "Date: 2026-03-01"],
        ["name;value", "rate;1000", "", "operator;somebody else"],
        ["Recorded by a controller"],
        ["1.0"],
    ],
)
def test_lines_before_the_header_are_passed_over(tmp_path: Path, preamble: list[str]) -> None:
    count = len([line for line in preamble if line])
    check(tmp_path / "a.csv", [*preamble, "t,q1,tau1", *rows()], f"{count} lines before the header passed over")


def test_faults_after_a_preamble_name_their_line(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    lines = ["made by hand", "", "t,q1,tau1", *rows()]
    lines[7] = "0.04,x,1"
    path.write_text("\n".join(lines))
    with pytest.raises(LogFormatError, match=r"a\.csv:8: column 'q1' holds 'x'"):
        read_log(path)


def test_quoted_names_with_blanks_between_blanks(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("\n".join(['t "axis 1" "load 1"', *rows("  ")]))
    assert read_header(path) == ("t", "axis 1", "load 1")
    log = read_log(path, ColumnMap(("a",), q=("axis 1",), torque=("load 1",)))
    np.testing.assert_allclose(log.q[:, 0], VALUES[:, 1])


def test_tabs_and_blanks_mixed(tmp_path: Path) -> None:
    check(tmp_path / "a.txt", ["t\tq1 tau1", *(row.replace(",", "\t ", 1).replace(",", " ") for row in rows())])
    check(tmp_path / "a.txt", ["t\tq1\ttau1", *(row.replace(",", "   ") for row in rows())])
    check(tmp_path / "b.txt", ["  t   q1   tau1", *("  " + row.replace(",", "   ") for row in rows())])


def test_a_file_without_a_header_is_refused_and_a_preamble_is_no_header(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["a run", *rows()]))
    with pytest.raises(LogFormatError, match="no column 'q1'; the header has a, run"):
        read_log(path)


def test_a_column_of_dates_and_a_preamble_of_as_many_words_as_cells_are_passed_over(tmp_path: Path) -> None:
    """German drives: date and time of day in two columns, or in one; the preamble has blanks as the rows do."""
    before = ["Messprotokoll Antriebe", "Anlage;Stand 3", "Abtastzeit [ms];10"]
    times = [f"14:03:21,{10 * k:03d}" for k in range(len(VALUES))]
    cells = [";".join(f"{value:.6f}".replace(".", ",") for value in row[1:]) for row in VALUES]
    two = [*before, "Datum;Uhrzeit;q1;tau1", *(f"12.11.2026;{t};{own}" for t, own in zip(times, cells, strict=True))]
    one = [*before, "Zeit;q1;tau1", *(f"12.11.2026 {t};{own}" for t, own in zip(times, cells, strict=True))]
    for name, lines, clock in (("two", two, "Uhrzeit"), ("one", one, "Zeit")):
        path = tmp_path / f"{name}.csv"
        path.write_text("\n".join(lines))
        table = open_table(path, ",")
        assert table.header[-3:] == (clock, "q1", "tau1") and table.time_stamps == (clock,)
        values = table.columns(table.header[-3:])
        np.testing.assert_allclose(np.diff(values[:, 0]), 0.01, atol=1e-6)
        np.testing.assert_allclose(values[:, 1:], VALUES[:, 1:], atol=1e-6)
    assert open_table(tmp_path / "one.csv", ",").columns(["Zeit"])[0, 0] == 1794492201.0  # 12 November 2026, 14:03:21
