"""Positions whose counters start again after a whole turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dynident.case.case import read_case
from dynident.data.formats import ColumnMap, open_log
from dynident.data.formats._stream import LogStream
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing, preprocess
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.data.turns import jumps_of_a_turn, turns_counted
from dynident.errors import DescriptionError, LogMismatch


@given(st.floats(-3.1, 3.1), st.floats(-0.3, 0.3), st.integers(0, 99))
def test_counting_undoes_what_a_counter_does(start: float, speed: float, lost: int) -> None:
    q = start + speed * np.arange(100.0)[:, None]
    wrapped = np.mod(q, 2 * np.pi)
    wrapped[lost] = np.nan
    expected = np.where(np.isnan(wrapped), np.nan, q)
    if lost or abs(start + speed) < 3.1:
        np.testing.assert_allclose(turns_counted(wrapped), expected, atol=1e-9)
    again = np.vstack([turns_counted(wrapped[:60]), turns_counted(wrapped[60:], q[59])])
    if lost not in (0, 59):
        np.testing.assert_allclose(again, expected, atol=1e-9)


def test_jumps_are_counted_where_the_joint_is_slow() -> None:
    slow, fast = 0.1 * np.arange(200), 1.0 * np.arange(200)
    q = np.mod(np.column_stack([slow, fast, slow]), 2 * np.pi)
    q[5, 2] = np.nan
    assert jumps_of_a_turn(q).tolist() == [3, 0, 3]
    assert jumps_of_a_turn(np.rad2deg(q), 360.0).tolist() == [3, 0, 3]
    time = np.arange(200.0)
    time[100:] += 5  # the counter of the first joint jumps from row 62 to 63, 125 to 126 and 188 to 189
    assert jumps_of_a_turn(q, time=time).tolist() == [3, 0, 3]
    time[63:] += 5
    assert jumps_of_a_turn(q, time=time).tolist() == [2, 0, 2]
    assert jumps_of_a_turn(q[:1]).tolist() == [0, 0, 0]


def test_a_wrapped_log_is_refused_until_its_turns_are_counted(tmp_path: Path) -> None:
    time = np.arange(800) / 100
    q = 3.0 * np.sin(np.array([1.3, 0.4]) * time[:, None] + 2.0)
    torque = np.cos(q)
    log = Log(("a", "b"), time, np.mod(q, 2 * np.pi), torque=torque)
    how = Preprocessing(Butterworth(cutoff_hz=5.0))
    with pytest.raises(LogMismatch, match=r"jump by a whole turn between two samples: a 3 times.*wrapped: \[a, b\]"):
        preprocess(log, how)
    rows = np.column_stack([time, np.rad2deg(log.q), torque])
    np.savetxt(tmp_path / "run.csv", rows, "%.9f", ",", header="t,q1,q2,tau1,tau2", comments="")
    case = """case: 1
robot: robot.urdf
log:
  units: {position: deg}
  wrapped: WHICH
"""
    links = "".join(f'<link name="{name}"/>' for name in ("base", "x", "y"))
    joints = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/></joint>'
        for name, parent, child in (("a", "base", "x"), ("b", "x", "y"))
    )
    (tmp_path / "robot.urdf").write_text(f'<robot name="r">{links}{joints}</robot>')
    (tmp_path / "case.yaml").write_text(case.replace("WHICH", "[a, b]"))
    read = read_case(tmp_path / "case.yaml")
    counted = read.read(str(tmp_path / "run.csv"))
    np.testing.assert_allclose(counted.q, q, atol=1e-9)
    assert "turns of a, b counted on" in counted.source.steps[-1]
    preprocess(counted, how)
    (tmp_path / "case.yaml").write_text(case.replace("WHICH", "c"))
    with pytest.raises(DescriptionError, match="no turning joint called 'c'; name joints of the log that turn: a, b"):
        read_case(tmp_path / "case.yaml")


def test_blocks_of_a_stream_go_on_where_the_last_ended(tmp_path: Path) -> None:
    time = np.arange(900) / 100
    q = 5.0 * time[:, None] - 2.0
    rows = np.column_stack([time, np.mod(q, 2 * np.pi), q])
    np.savetxt(tmp_path / "run.csv", rows, "%.12f", ",", header="t,q1,tau1", comments="")
    columns = ColumnMap(joints=("a",), wrapped=("a",))
    table = open_log(tmp_path / "run.csv", columns)
    stream = LogStream(table, columns.resolved(table.header, table.path))
    parts = [block.q for block in stream.blocks(100)]
    assert len(parts) == 9
    np.testing.assert_allclose(np.vstack(parts), q, atol=1e-9)
    stream.close()
