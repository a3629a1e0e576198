"""Exports of TwinCAT Scope, laid out as its version 3.4.3145.3 writes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dynident.data.formats import ColumnMap, read_header, read_log
from dynident.data.formats.twincat_scope import TwincatScope
from dynident.errors import BadOption, LogFormatError

N = 40
Q, TAU = np.random.default_rng(2).normal(size=(2, N)).round(4)
#: Facts of a channel that stand in the header of an export, each before its value.
FACTS = ("SymbolComment", "Data-Type", "SampleTime[ms]", "VariableSize", "SymbolName", "ScaleFactor", "Unit")


def export(path: Path, separator: str, decimal: str, fast: bool = False, end: bool = False) -> ColumnMap:
    """Write an export of two channels of 1 ms and, where ``fast``, of one of 0.5 ms; return its map."""
    names = ["axis 1 pos", "axis 1 torque", *(["fast"] if fast else [])]
    lines = [f"Name{separator}run", rf"File{separator}C:\scope\run.csv"]
    lines += [f"Starttime of export{separator}132959733843760000{separator}Montag, 2. Mai 2022{separator}15:56:24.376"]
    lines += [f"Endtime of export{separator}132959733853750000{separator}Montag, 2. Mai 2022{separator}15:56:25.375"]
    lines += ["", "", separator.join(x for name in names for x in ("Name", name))]
    lines += [separator.join(x for _ in names for x in (fact, "1")) for fact in FACTS] + [""]
    for k in range(2 * N if fast else N):
        cells = [str(k), f"{Q[k]}", str(k), f"{TAU[k]}"] if k < N else ["", "", "", ""]
        cells += [f"{k / 2:g}", f"{3 * k / 2:g}"] if fast else []
        lines.append(separator.join(cell.replace(".", decimal) for cell in cells))
    path.write_text("\r\n".join([*lines, *(["EOF"] if end else [])]) + "\r\n", encoding="utf-8-sig")
    return ColumnMap(("a",), q=("axis 1 pos",), torque=(names[-1],))


@pytest.mark.parametrize(("separator", "decimal"), [("\t", ","), (";", "."), (";", ","), (",", ".")])
@pytest.mark.parametrize("end", [False, True])
def test_channels_with_one_time(tmp_path: Path, separator: str, decimal: str, end: bool) -> None:
    path = tmp_path / "run.csv"
    columns = export(path, separator, decimal, end=end)
    form = TwincatScope(decimal=decimal)
    assert read_header(path, form=form) == ("t", "axis 1 pos", "axis 1 torque")
    log = read_log(path, columns, form=form)
    np.testing.assert_allclose(log.time, np.arange(N) / 1e3, atol=1e-12)
    np.testing.assert_array_equal(log.q[:, 0], Q)
    np.testing.assert_array_equal(log.torque[:, 0], TAU)  # type: ignore[index]


def test_a_channel_with_another_sample_time(tmp_path: Path) -> None:
    """Its values at 0, 0.5, 1, ... ms are 3 times the time in ms: at whole milliseconds no interpolation is needed."""
    columns = export(tmp_path / "run.csv", "\t", ",", fast=True)
    log = read_log(tmp_path / "run.csv", columns, form=TwincatScope(decimal=","))
    order = np.argsort(log.time)
    np.testing.assert_allclose(log.torque[:, 0], 3 * log.time * 1e3, atol=1e-9)  # type: ignore[index]
    whole = np.isclose(log.time * 1e3 % 1, 0)
    np.testing.assert_allclose(log.q[whole, 0], Q)
    assert np.all(order == np.arange(log.samples))


def test_faults(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    columns = export(path, "\t", ",")
    with pytest.raises(LogFormatError, match='is not a number; if the commas are decimal signs, declare decimal: ","'):
        read_log(path, columns, form=TwincatScope())
    with pytest.raises(BadOption, match=r"choose '\.' or ','"):
        TwincatScope(decimal=";")
    path.write_text("t,q1\n0,1\n")
    with pytest.raises(LogFormatError, match="no header of a TwinCAT Scope export"):
        read_log(path, columns, form=TwincatScope())
    export(path, ";", ".")
    path.write_text(path.read_text(encoding="utf-8-sig").replace("axis 1 torque", "axis 1 pos"))
    with pytest.raises(LogFormatError, match="'axis 1 pos' stands there 2 times"):
        read_log(path, columns, form=TwincatScope())
