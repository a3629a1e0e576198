"""Logs without a column of the time, and text without a header."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.data.formats import ColumnMap, Units, read_log, stream_log, write_log
from dynident.errors import BadOption, LogFormatError

RATE = ColumnMap(time="200 Hz")


@pytest.fixture(scope="module")
def columns() -> dict[str, np.ndarray]:
    generator = np.random.default_rng(0)
    return {name: generator.normal(size=(500, 2)) for name in ("q", "tau")}


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_rows_at_a_rate_are_those_with_a_time(suffix: str, columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    if suffix == ".npz":
        np.savez(path, **columns)  # type: ignore[arg-type]
    else:
        np.savetxt(path, np.hstack(list(columns.values())), "%.17g", ",", header="q1,q2,tau1,tau2", comments="")
    log = read_log(path, RATE)
    assert np.array_equal(log.time, np.arange(500) / 200)
    assert np.array_equal(log.q, columns["q"]) and np.array_equal(np.asarray(log.torque), columns["tau"])
    assert log.source is not None and "200 Hz for want of a column of the time" in log.source.steps[0]
    stream = stream_log(path, RATE, folder=tmp_path)
    times, blocks = np.concatenate(list(stream.times(64))), list(stream.blocks(64))
    stream.close()
    assert np.array_equal(times, log.time) and np.array_equal(np.concatenate([each.time for each in blocks]), log.time)
    assert np.array_equal(np.concatenate([each.q for each in blocks]), log.q)
    written = tmp_path / "written.csv"
    write_log(log, written)
    assert np.array_equal(read_log(written).time, log.time)


@pytest.mark.parametrize(("name", "factors"), [("tau1 + 0.5 * tau2", (1, 0.5)), ("2e-1 * tau1 - tau2", (0.2, -1))])
def test_a_torque_may_be_the_sum_of_columns(
    name: str, factors: tuple[float, float], columns: dict[str, np.ndarray], tmp_path: Path
) -> None:
    path = tmp_path / "run.csv"
    np.savetxt(path, np.hstack(list(columns.values())), "%.17g", ",", header="q1,q2,tau1,tau2", comments="")
    summed = replace(RATE, q=("q1",), torque=(name,))
    log, stream = read_log(path, summed), stream_log(path, summed, folder=tmp_path)
    np.testing.assert_allclose(np.asarray(log.torque)[:, 0], columns["tau"] @ factors, rtol=1e-12, atol=1e-15)
    blocks = list(stream.blocks(64))
    stream.close()
    assert np.array_equal(np.concatenate([np.asarray(each.torque) for each in blocks]), np.asarray(log.torque))
    with pytest.raises(LogFormatError, match=r"no column 'tau1 \+ tau9'"):
        read_log(path, replace(summed, torque=("tau1 + tau9",)))


def test_a_rate_has_no_unit_and_is_one(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, **columns)  # type: ignore[arg-type]
    with pytest.raises(BadOption, match=r"units\.time.*made of the rate 200 Hz"):
        read_log(path, replace(RATE, units=Units(time="ms")))
    with pytest.raises(BadOption, match="samples a second"):
        read_log(path, ColumnMap(time="0 Hz"))
    with pytest.raises(LogFormatError, match="no column 't'"):
        read_log(path)


def test_names_for_a_text_without_a_header(columns: dict[str, np.ndarray], tmp_path: Path) -> None:
    path = tmp_path / "run.txt"
    np.savetxt(path, np.hstack(list(columns.values())), "%.17g")
    named = replace(RATE, form="csv", form_options=(("names", "[q1, q2, tau1, tau2]"),))
    assert np.array_equal(read_log(path, named).q, columns["q"])
    with pytest.raises(LogFormatError, match=r"run\.txt:1: .*names: \[\.\.\.\]"):
        read_log(path, RATE)
    with pytest.raises(LogFormatError, match=r"run\.txt:1: 4 cells and 2 names"):
        read_log(path, replace(named, form_options=(("names", "[q1, tau1]"),)))
    path.write_text("a b c d\n1 2 3 4\n")
    with pytest.raises(LogFormatError, match=r"run\.txt:1: 'a' in the first row is no number; the file has a header"):
        read_log(path, named)
