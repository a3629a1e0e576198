"""Times that stand in two columns, and rows that repeat the one before: what the map of columns makes of them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from drafted_logs import moved, named, numbered, read, write_log, write_robot
from dynident.case.case_draft import draft_case
from dynident.case.draft.time_columns import split_time
from dynident.data.formats import ColumnMap, Units, read_log, stream_log
from dynident.errors import BadOption, LogFormatError
from dynident.robot_files import read_robot

TIME = "stamp.sec s + stamp.nanosec ns"


def written(path: Path, rows: np.ndarray, header: str) -> Path:
    path.write_text("\n".join([header, *(",".join(f"{x:.15g}" for x in row) for row in rows)]) + "\n")
    return path


def test_seconds_and_nanoseconds_are_one_time(tmp_path: Path) -> None:
    time = 1.7e9 + 0.995 + np.arange(40) * 0.004
    nano = np.round((time % 1) * 1e9)
    rows = np.column_stack([np.floor(time), nano, np.arange(40), np.ones(40)])
    path = written(tmp_path / "run.csv", rows, "stamp.sec,stamp.nanosec,q1,tau1")
    log = read_log(path, ColumnMap(time=TIME))
    np.testing.assert_allclose(np.diff(log.time), 0.004, atol=5e-7)
    np.testing.assert_array_equal(log.q[:, 0], np.arange(40))
    with closing(stream_log(path, ColumnMap(time=TIME))) as stream:
        np.testing.assert_array_equal(np.concatenate(list(stream.times(7))), log.time)
    assert any("time as stamp.sec s + stamp.nanosec ns" in step for step in log.source.steps)
    with pytest.raises(LogFormatError, match=r"run.csv:1: no column 'stamp.nsec'"):
        read_log(path, ColumnMap(time="stamp.sec s + stamp.nsec ns"))
    with pytest.raises(BadOption, match="leave it out: the time is made of the sum"):
        read_log(path, ColumnMap(time=TIME, units=Units(time="ms")))


def repeated(path: Path) -> tuple[Path, np.ndarray]:
    """Write a log of 60 rows in which every third is there twice, in three blocks of a stream or more."""
    rows = np.column_stack([np.arange(60) * 0.01, np.sin(np.arange(60)), np.cos(np.arange(60))])
    counts = np.where(np.arange(60) % 3 == 0, 2, 1)
    return written(path, np.repeat(rows, counts, axis=0), "t,q1,tau1"), rows


def test_repeated_rows_are_left_out_where_the_map_says_so(tmp_path: Path) -> None:
    path, rows = repeated(tmp_path / "run.csv")
    with pytest.raises(LogFormatError, match=r"run.csv:3: time in column 't' repeats.*log: \{repeats: drop\}"):
        read_log(path)
    log = read_log(path, ColumnMap(repeats="drop"))
    np.testing.assert_allclose(np.column_stack([log.time, log.q, np.asarray(log.torque)]), rows, atol=1e-14)
    assert "20 rows left out that repeat the one before" in log.source.steps
    with closing(stream_log(path, ColumnMap(repeats="drop"))) as stream:
        np.testing.assert_array_equal(np.concatenate(list(stream.times(7))), log.time)
        np.testing.assert_array_equal(np.concatenate([block.q for block in stream.blocks(7)]), log.q)
    with pytest.raises(BadOption, match="repeats = 'keep' is not possible; choose 'refuse' or 'drop'"):
        ColumnMap(repeats="keep")


def test_a_fault_behind_repeated_rows_has_its_line(tmp_path: Path) -> None:
    """The time alone repeats in row 50 of the file: other values are no repetition."""
    path, _ = repeated(tmp_path / "run.csv")
    lines = path.read_text().splitlines()
    at = next(k for k in range(50, len(lines)) if lines[k] != lines[k - 1] != lines[k - 2])
    lines[at] = ",".join([lines[at - 1].partition(",")[0], "5", "5"])
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(LogFormatError, match=rf"run.csv:{at + 1}: time in column 't' repeats.*more digits"):
        read_log(path, ColumnMap(repeats="drop"))


@pytest.mark.parametrize(
    ("header", "found"),
    [
        ("header.stamp.sec header.stamp.nanosec q1", "header.stamp.sec s header.stamp.nanosec ns"),
        ("time_stamp_sec time_stamp_nano_sec", "time_stamp_sec s time_stamp_nano_sec ns"),
        ("tv_sec tv_usec", "tv_sec s tv_usec us"),
        ("/joint_states/header/stamp/sec /joint_states/header/stamp/nanosec", None),
        ("secs nsecs", "secs s nsecs ns"),
        ("time_s dq_ns", ""),
        ("t delay_ns q1", ""),
    ],
)
def test_two_columns_of_a_time_by_their_names(header: str, found: str | None) -> None:
    names = header.split()
    parts = split_time(names)
    told = "" if parts is None else " ".join(word for part in parts for word in part)
    assert told == (f"{names[0]} s {names[1]} ns" if found is None else found)


def test_drafts_say_both(tmp_path: Path) -> None:
    robot = read_robot("generic-6r")
    arm, motion = write_robot(tmp_path / "arm.json", robot), moved(robot)
    stamps = 1.7e9 + motion["time"]
    columns = {"stamp_sec": np.floor(stamps), "stamp_nanosec": np.round((stamps % 1) * 1e9), **numbered(motion)}
    columns.pop("t")
    twice = {name: np.repeat(values, np.where(np.arange(600) == 9, 2, 1)) for name, values in columns.items()}
    draft = draft_case(arm, write_log(tmp_path / "run.csv", twice), tmp_path)
    assert draft.needed == () and draft.remarks == (), draft.text
    case = read(draft, tmp_path)
    log = case.read("run.csv")
    assert case.columns.time == "stamp_sec s + stamp_nanosec ns" and case.columns.repeats == "drop"
    np.testing.assert_allclose(log.time, stamps, atol=1e-6)
    np.testing.assert_allclose(log.q, motion["q"])
    # a whole time in each of two units is no sum
    columns["stamp_nanosec"] = np.round(motion["time"] * 1e9)
    plain = {"stamp_sec": motion["time"], **columns} | named(motion, "stamp_sec", {})
    whole = draft_case(arm, write_log(tmp_path / "whole.csv", plain), tmp_path)
    assert "+" not in whole.recognition.time
