"""CSV logs: what is read is what was written, and every fault is named by file, line and column."""

from __future__ import annotations

import hashlib
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.applications.monitor.live import live_rows
from dynident.data.formats import ColumnMap, Units, _text_table, read_header, read_log, write_log, written_columns
from dynident.data.formats._text_table import open_table
from dynident.data.formats.csv import Csv
from dynident.data.log import Log
from dynident.errors import BadOption, DynidentError, FileError, LogFormatError, UnknownChoice

ROWS = 12


#: The remedy for a column that is not there.
MAPPED = "map it with columns: in the case file, which 'dynident init ROBOT LOG' drafts (in Python dynident.init)"


THOUSANDS = "write numbers without signs between the thousands (in Excel: format General)"


def table(header="t,q1,q2,tau1,tau2", rows=ROWS, separator=","):
    """Return a sound log: row k has time k / 100 and cell c of it the number c + k / 8."""
    width = header.count(separator) if separator != " " else len(header.split()) - 1
    lines = [header]
    for k in range(rows):
        lines.append(separator.join([f"{k / 100:.2f}", *(f"{c + k / 8:g}" for c in range(1, width + 1))]))
    return lines


def saved(folder: Path, lines, name="run.csv", end="\n", encoding="utf-8"):
    path = folder / name
    path.write_bytes((end.join(lines) + end).encode(encoding))
    return path


def edited(line, text, **kind):
    """Return a sound table whose line (counted from 1) is replaced."""
    lines = table(**kind)
    lines[line - 1] = text
    return lines


COLUMNS = 1 + np.arange(4) + np.arange(ROWS)[:, None] / 8


@pytest.mark.parametrize(
    ("separator", "word", "name"),
    [
        (",", "comma", "a.csv"),
        (";", "semicolon", "a.txt"),
        ("\t", "tab", "a.tsv"),
        (" ", "space", "a.TXT"),
        ("\t", "tab", "a.dat"),
    ],
)
def test_the_separator_is_found_in_the_header(tmp_path, separator, word, name):
    lines = table("t,q1,q2,tau1,tau2".replace(",", separator), separator=separator)
    path = saved(tmp_path, lines, name)
    log = read_log(path)
    assert log.joints == ("joint1", "joint2")
    np.testing.assert_array_equal(log.time, np.arange(ROWS) / 100)
    np.testing.assert_array_equal(np.hstack([log.q, log.torque]), COLUMNS)
    assert log.dq is None and log.ddq is None and log.current is None
    assert log.source.path == str(path)
    assert log.source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert log.source.rows == ROWS
    assert log.source.steps == (f"read as {word}-separated text, decimal '.'",)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_byte_order_mark_comments_blank_lines_and_line_ends_do_not_matter(tmp_path, end):
    lines = table()
    lines[:0] = ["\ufeff# recorded on a Monday", "", "#; second, comment"]
    lines[6:6] = ["# half-way", ""]
    lines[-1] += "  # the last"
    log = read_log(saved(tmp_path, lines, end=end))
    np.testing.assert_array_equal(np.hstack([log.q, log.torque]), COLUMNS)


def test_quoted_names_and_numbers_are_read(tmp_path):
    lines = [",".join(f'"{cell}"' for cell in line.split(",")) for line in table()]
    np.testing.assert_array_equal(read_log(saved(tmp_path, lines)).q, COLUMNS[:, :2])


def test_a_column_that_is_not_asked_for_may_hold_text(tmp_path):
    lines = ["mode,t,q1,tau1,"] + [f"auto {k},{k / 100},{k},{k}," for k in range(ROWS)]
    np.testing.assert_array_equal(read_log(saved(tmp_path, lines)).q[:, 0], np.arange(ROWS))


def test_columns_are_matched_by_name_not_by_place(tmp_path):
    straight = read_log(saved(tmp_path, table()))
    turned = read_log(saved(tmp_path, [",".join(reversed(line.split(","))) for line in table()], "turned.csv"))
    np.testing.assert_array_equal(turned.q, straight.q)
    np.testing.assert_array_equal(turned.torque, straight.torque)


def test_velocities_are_taken_where_they_are_and_accelerations_only_when_named(tmp_path):
    path = saved(tmp_path, table("t,q1,dq1,ddq1,i1"))
    log = read_log(path)
    assert list(log.signals()) == ["q", "dq", "current"]
    assert list(read_log(path, ColumnMap(ddq=("ddq1",))).signals()) == ["q", "dq", "ddq", "current"]
    assert list(read_log(path, ColumnMap(dq=(), current=(), torque=())).signals()) == ["q"]


def test_of_torques_and_currents_the_torques_are_the_default_and_the_map_decides(tmp_path):
    path = saved(tmp_path, table("t,q1,i1,tau1"))
    assert list(read_log(path).signals()) == ["q", "torque"]
    assert list(read_log(path, ColumnMap(torque=())).signals()) == ["q", "current"]
    assert list(read_log(path, ColumnMap(current=("i1",))).signals()) == ["q", "current"]
    assert list(read_log(path, ColumnMap(torque=("tau1",), current=("i1",))).signals()) == ["q", "torque", "current"]


def test_units_are_converted_as_declared(tmp_path):
    path = saved(tmp_path, table("stamp,a,x,va,vx,ta,tx,ia,ix,temp_a,temp_x"))
    units = Units(time="ms", position=("deg", "mm"), velocity=("deg/s", "mm/s"), torque=("mN m", "N"), current="mA")
    columns = ColumnMap(
        joints=("arm", "slide"),
        time="stamp",
        q=["a", "x"],
        dq=("va", "vx"),
        torque=("ta", "tx"),
        current=("ia", "ix"),
        temperature=("temp_a", "temp_x"),
        units=units,
    )
    log = read_log(path, columns)
    raw = np.arange(1, 11) + np.arange(ROWS)[:, None] / 8
    assert log.joints == ("arm", "slide")
    np.testing.assert_allclose(log.time, np.arange(ROWS) * 1e-5, rtol=1e-15)
    np.testing.assert_allclose(log.q, raw[:, 0:2] * [math.pi / 180, 1e-3], rtol=1e-15)
    np.testing.assert_allclose(log.dq, raw[:, 2:4] * [math.pi / 180, 1e-3], rtol=1e-15)
    np.testing.assert_allclose(log.torque, raw[:, 4:6] * [1e-3, 1.0], rtol=1e-15)
    np.testing.assert_allclose(log.current, raw[:, 6:8] * 1e-3, rtol=1e-15)
    np.testing.assert_array_equal(log.temperature, raw[:, 8:10])
    assert log.source.steps[1] == (
        "time from ms; position from deg, mm; velocity from deg/s, mm/s; torque from mN m; current from mA"
    )


@pytest.mark.parametrize(("word", "factor"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
def test_units_of_time(tmp_path, word, factor):
    log = read_log(saved(tmp_path, table()), ColumnMap(units=Units(time=word)))
    np.testing.assert_allclose(log.time, np.arange(ROWS) / 100 * factor, rtol=1e-15)


def test_whole_milliseconds_become_the_nearest_seconds(tmp_path):
    lines = ["t,q1,tau1", *(f"{k},0,0" for k in range(2000))]
    log = read_log(saved(tmp_path, lines), ColumnMap(units=Units(time="ms")))
    assert log.time.tolist() == [float(f"{k}e-3") for k in range(2000)]


def test_declared_decimal_commas_are_read(tmp_path):
    lines = [line.replace(".", ",") for line in table("t;q1;q2;tau1;tau2", separator=";")]
    log = read_log(saved(tmp_path, lines), form=Csv(decimal=","))
    np.testing.assert_array_equal(np.hstack([log.q, log.torque]), COLUMNS)
    assert log.source.steps == ("read as semicolon-separated text, decimal ','",)


FIX = " ('dynident check' with --fix OUT.csv, of a few)"
BACK = "split the log there, or sort its rows if they are only out of order"
AGAIN = "'dynident check' with --fix OUT.csv leaves a few out; of many write the time with more digits"
FAULTS = [
    (
        table("t,q1,q2,tau_a,tau2"),
        "1: no column 'tau1'; the header has t, q1, q2, tau_a, tau2; " + MAPPED + "; did you mean 'tau_a'?",
    ),
    (table("clock,q1,tau1"), "1: no column 't'; the header has clock, q1, tau1; " + MAPPED),
    (table("t,pos,effort"), "1: no column 'q1'; the header has t, pos, effort; " + MAPPED),
    (table("t,q1,q3,tau1,tau2"), "1: no column 'q2'; the header has t, q1, q3, tau1, tau2; " + MAPPED),
    (
        table("t,q1,tau1,tau2"),
        "1: a column 'tau2' where the number of joints is 1; "
        "name the columns of these joints with columns: in the case file",
    ),
    (table("t,q1,q1,tau1,tau2"), "1: 2 columns are called 'q1'; give each column a name of its own"),
    (edited(4, "0.02,1,x2,3,4"), "4: column 'q2' holds 'x2', which is not a number; correct the cell"),
    (
        edited(4, "0.02,1,,3,4"),
        "4: column 'q2' holds no number (blank or nan); repair the recording or leave these rows out" + FIX,
    ),
    (
        edited(4, "0.02,1,nan,3,4"),
        "4: column 'q2' holds no number (blank or nan); repair the recording or leave these rows out" + FIX,
    ),
    (
        [*edited(4, "0.02,1,2,inf,nan"), "# note", "0.5,nan,2,3,4"],
        "4: column 'tau1' holds inf (3 such cells in 2 rows); repair the recording or leave these rows out" + FIX,
    ),
    (
        edited(5, "0.03,1,2,3"),
        "5: 4 comma-separated cells, the header in line 1 has 5; "
        "correct the line, or write the header with the separator of the rows",
    ),
    (
        edited(5, "0.03,1,2,3,4,5"),
        "5: 6 comma-separated cells, the header in line 1 has 5; "
        "correct the line, or write the header with the separator of the rows",
    ),
    (
        [table()[0], *("0,01,1,5,2,5,3,5,4,5" for _ in range(ROWS))],
        "2: 10 comma-separated cells, the header in line 1 has 5; "
        "decimal commas need another separator; write decimal points or separate by semicolons",
    ),
    (
        edited(3, "0,01;1;2;3;4", header="t;q1;q2;tau1;tau2", separator=";"),
        "3: column 't' holds '0,01', which is not a number; if the commas are decimal signs, declare decimal: \",\"",
    ),
    (table()[:1], "1: a header and no rows; record the log again"),
    (table(rows=9), "1: only 9 rows; an identification needs seconds of motion"),
    (
        table()[1:],
        "1: numbers where the names of the columns should stand; add a header row such as t,q1,q2,tau1,tau2, "
        "or name the columns (log: format: {csv: {names: [...]}})",
    ),
    (
        ["# t q1 tau1", *(f"{k} 1 2 3" for k in range(ROWS))],
        "2: numbers where the names of the columns should stand; if the comment '# t q1 tau1' is the header, "
        "remove its '#'",
    ),
    (edited(6, "0.025,1,2,3,4"), f"6: time in column 't' runs back: 0.03 s, then 0.025 s; {BACK}"),
    (
        [*edited(6, "0.03,1,2,3,4"), "", "0.11,1,2,3,4"],
        f"6: time in column 't' repeats: 0.03 s, then 0.03 s (2 such rows); {AGAIN}",
    ),
]


@pytest.mark.parametrize(("lines", "message"), FAULTS)
def test_every_fault_names_line_and_column(tmp_path, lines, message):
    path = saved(tmp_path, lines)
    with pytest.raises(LogFormatError) as caught:
        read_log(path)
    assert str(caught.value) == f"{path}:{message}"
    assert caught.value.line == int(message.partition(":")[0])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", ": the file is empty; record the log again"),
        (b"\n \n", ": the file is empty; record the log again"),
        (b"# a\n# b\n", ": only comments; give a header row and rows of numbers"),
        (b"t,q1\n0,\0\n", ":2: a binary file, not text; give a text file, or name its format"),
        (b"t,q1,tau1\n0,1,1\n1,\xb0,1\n", ":3: column 'q1' holds '°', which is not a number; correct the cell"),
        (b"t,q1,tau1\n0,1,1\n1,1,\xc2", ":3: column 'tau1' holds 'Â', which is not a number; correct the cell"),
        (b"t,q\x1b[31m\n" + b"0,1\n" * 12, ":1: no column 'q1'; the header has t, q\\x1b[31m; " + MAPPED),
        ("t,q1\n0,1\n".encode("utf-16"), ":1: UTF-16 text, not UTF-8; save it as CSV UTF-8"),
        (b"t" + b"," * 5000 + b"\n", ":1: 5001 columns; at most 4096 are read"),
        (b"t" * (1 << 20) + b"\n", ":1: a line of more than 1048576 characters; is it a table?"),
    ],
)
def test_files_that_are_no_text_table(tmp_path, content, message):
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    with pytest.raises(LogFormatError) as caught:
        read_log(path)
    assert str(caught.value) == f"{path}{message}"


@pytest.mark.parametrize("sign", [".", ","])
def test_a_header_in_windows_1252_is_read_and_noted(tmp_path, sign):
    path = tmp_path / "run.csv"
    rows = "".join(f"{k};{k}{sign}5\n" for k in range(80))
    path.write_bytes(("# Prüfstand\nt [s];q1 [°]\n" + rows).encode("cp1252"))
    table = open_table(path, sign)
    assert table.header == ("t [s]", "q1 [°]") and "read as Windows-1252" in table.how
    np.testing.assert_array_equal(table.columns(["q1 [°]"])[:, 0], np.arange(80) + 0.5)
    path.write_text("# Prüfstand\nt [s];q1 [°]\n" + rows, encoding="utf-8")
    assert "Windows" not in open_table(path, sign).how


@pytest.mark.parametrize(
    ("words", "encoding"),
    [("时间,关节1位置", "gbk"), ("t,関節1トルク", "shift_jis"), ("t,トルク", "shift_jis"), ("время,q1", "cp1251")],
)
def test_a_header_in_another_encoding_is_refused_and_read_as_utf_8(tmp_path, words, encoding):
    path = tmp_path / "run.csv"
    path.write_bytes(f"# C\n{words}\n0,1\n1,2\n".encode(encoding, "ignore"))
    with pytest.raises(LogFormatError, match=r"run.csv:2: GBK or Shift-JIS, not UTF-8; save it as CSV UTF-8"):
        open_table(path)
    path.write_text(f"{words}\n0,1\n1,2\n", encoding="utf-8")
    assert open_table(path).header == tuple(words.split(","))


def test_names_of_the_west_in_windows_1252_are_no_other_encoding(tmp_path):
    path = tmp_path / "run.csv"
    for words in ("Zeit [µs];Größe [°];Übung±1", "durée;déçu – «été»;‰"):
        path.write_bytes(f"{words}\n0;1;2\n1;2;3\n".encode("cp1252"))
        assert open_table(path).header == tuple(words.split(";"))


def test_a_foreign_byte_far_into_the_file_is_found_across_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr(_text_table, "CHUNK", 7)
    path = tmp_path / "run.csv"
    path.write_bytes("# °C °C °C\nt,q1,tau1\n".encode() + b"0.1,1,1\n" * 9 + b"0.2,0.2\xe9,1\n")
    with pytest.raises(LogFormatError, match=r":12: column 'q1' holds '0.2é', which is not a number"):
        read_log(path)


def test_a_file_over_the_cap_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = saved(tmp_path, table())
    monkeypatch.setattr(_text_table, "MAX_BYTES", 16)
    with pytest.raises(LogFormatError, match="are read at once; reduce it as a stream: dynident reduce"):
        read_log(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(FileError, match="no ordinary file"):
        read_log(tmp_path / "pipe.csv")


def test_an_unknown_suffix_lists_the_formats(tmp_path):
    path = saved(tmp_path, table(), "run.xyz")
    with pytest.raises(LogFormatError) as caught:
        read_log(path)
    assert str(caught.value) == (
        f"{path}: no log format has the suffix '.xyz'; the formats are: bam (.json); csv (.csv, .txt, .tsv, .dat); "
        "mat (.mat, .h5, .hdf5); npz (.npz, .npy); parquet (.parquet, .pq); rosbag (.bag, .db3, .mcap); trajectory (by "
        "name only); twincat_scope (by name only)"
    )
    assert read_log(path, form="csv").samples == ROWS
    with pytest.raises(LogFormatError, match=r"^payload=2: no such file; the formats are: bam .*csv"):
        read_log("payload=2")


@pytest.mark.parametrize(
    ("cell", "message"),
    [
        ("1.234,5", "column 'q1' holds '1.234,5', which is not a number; " + THOUSANDS),
        ("#N/A", "column 'q1' holds '#N/A', which is not a number; leave the cell empty where a value is missing"),
        ("1.5", "column 'q1' holds '1.5', which is not a number; with decimal: \",\" points are refused"),
        ("1,2,3", "column 'q1' holds '1,2,3', which is not a number; correct the cell"),
    ],
)
def test_with_decimal_commas_a_point_is_refused(tmp_path, cell, message):
    lines = ["t;q1;tau1", *(f"{k};0,5;1" for k in range(ROWS)), f"99;{cell};1"]
    path = saved(tmp_path, lines)
    with pytest.raises(LogFormatError) as caught:
        read_log(path, form=Csv(decimal=","))
    assert str(caught.value) == f"{path}:{ROWS + 2}: {message}"


@pytest.mark.parametrize("cell", ['"1,000.0"', "1 000.5", "1\u202f000.5", '"-1,234,567"', "1'000.25"])
def test_signs_between_thousands_are_named(tmp_path, cell):
    with pytest.raises(LogFormatError, match=rf":4: column 'q1' holds .*{re.escape(THOUSANDS)}"):
        read_log(saved(tmp_path, edited(4, f"0.02,{cell},2,3,4")))


@pytest.mark.parametrize("cell", ["#N/A", "#DIV/0!", "#NV", "#WERT!", "#SPILL!"])
@pytest.mark.parametrize("row", [2, 4])
def test_an_error_of_a_spreadsheet_is_no_comment(tmp_path, cell, row):
    for text in (f"0.02,{cell},2,3,4", f"0.02,1,2,3,{cell}"):
        with pytest.raises(LogFormatError, match=f"'{re.escape(cell)}', which is not a number; leave the cell empty"):
            read_log(saved(tmp_path, edited(row, text)))
    assert read_log(saved(tmp_path, edited(4, "0.02,1,2,3,4 # by hand"))).samples == ROWS


@pytest.mark.parametrize("cell", ["1_000", "0x10", "١", "1e", "--1", "1 2", "1j", "True"])
def test_what_only_a_programming_language_calls_a_number_is_refused(tmp_path, cell):
    with pytest.raises(LogFormatError, match=":4: column 'q1' holds"):
        read_log(saved(tmp_path, edited(4, f"0.02,{cell},2,3,4")))


def test_maps_that_contradict_themselves():
    for arguments, message in (
        ({"q": "q1"}, "q = 'q1' is not possible; give a list of names, one per joint"),
        (
            {"joints": ("a", "b"), "q": ("x",)},
            "q = ['x'] is not possible; 1 names, elsewhere 2; name one column per joint, in the order of joints",
        ),
        ({"q": ("x", "x")}, "columns = 'x' is not possible; it is named twice; name each once"),
        ({"q": ("x",), "torque": ("x",)}, "columns = 'x' is not possible; it is named twice; name each once"),
        ({"joints": ("a", "a")}, "joints = 'a' is not possible; it is named twice; name each once"),
        ({"q": ()}, "q = [] is not possible; name the columns of the positions"),
    ):
        with pytest.raises(BadOption) as caught:
            ColumnMap(**arguments)
        assert str(caught.value) == message


def test_unknown_units_are_refused_with_the_choices():
    with pytest.raises(UnknownChoice) as caught:
        Units(position="degrees")
    assert str(caught.value) == (
        "no unit of position called 'degrees'; choose one of: SI, rad, deg, m, mm; did you mean 'deg'?"
    )
    with pytest.raises(UnknownChoice, match="did you mean 'N m'"):
        Units(torque=("N m", "Nm"))
    with pytest.raises(BadOption, match="give one unit"):
        Units(time=("s", "s"))
    with pytest.raises(BadOption, match="decimal"):
        Csv(decimal=";")


def test_units_that_make_a_joint_turn_and_slide_are_refused(tmp_path):
    path = saved(tmp_path, table("t,q1,q2,dq1,dq2,tau1,tau2"))
    with pytest.raises(BadOption) as caught:
        read_log(path, ColumnMap(joints=("a", "b"), units=Units(position="deg", velocity=("deg/s", "mm/s"))))
    assert str(caught.value) == (
        "units = 'position in deg, velocity in mm/s' is not possible; "
        "joint 'b' cannot both turn and slide; give one unit per joint"
    )
    with pytest.raises(BadOption, match="one for each of the 2 joints"):
        read_log(path, ColumnMap(units=Units(position=("deg",))))


NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=40, deadline=None)
@given(st.data(), st.integers(1, 3), st.sampled_from(["run.csv", "run.tsv"]), st.sampled_from([".", ","]))
def test_a_written_log_reads_back_bit_for_bit(tmp_path_factory, data, joints, name, decimal):
    block = st.lists(st.lists(NUMBERS, min_size=joints, max_size=joints), min_size=10, max_size=10)
    time = data.draw(st.lists(NUMBERS, min_size=10, max_size=10, unique=True).map(sorted))
    if np.any(np.diff(time) <= 0):  # two different doubles can have a difference of zero only if they are -0 and 0
        return
    signals = {signal: data.draw(st.none() | block) for signal in ("dq", "ddq", "torque", "current", "raw_torque")}
    log = Log(tuple("abc"[:joints]), np.array(time), np.array(data.draw(block)), **signals)
    path = tmp_path_factory.mktemp("log") / name
    form = Csv(decimal=decimal)
    write_log(log, path, form=form)
    back = read_log(path, written_columns(log), form=form)
    assert back.joints == log.joints
    assert list(back.signals()) == list(log.signals())
    for was, now in zip([log.time, *log.signals().values()], [back.time, *back.signals().values()], strict=True):
        assert was.tobytes() == now.tobytes()


@settings(max_examples=60, deadline=None)
@given(cell=st.text(st.sampled_from("0123456789+-.eE naif_x\t\u00a0"), min_size=1, max_size=8))
def test_the_fast_and_the_careful_reader_agree(tmp_path_factory, cell):
    """One unasked text column sends the file to the careful reader; the rest must not notice."""
    folder = tmp_path_factory.mktemp("cells")

    def outcome(name, extra, last):
        lines = [f"t,q1,tau1,{extra}", *(f"{k},{k},1,{last}" for k in range(ROWS)), f"99,{cell},1,{last}"]
        try:
            return read_log(saved(folder, lines, name)).q.tobytes()
        except DynidentError as error:
            return str(error).replace(name, "")

    assert outcome("fast.csv", "n", "0") == outcome("slow.csv", "n", "x")


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 400), st.binary(max_size=6)), min_size=1, max_size=4))
def test_a_damaged_file_is_a_log_or_an_error_on_one_line(tmp_path_factory, damage):
    content = bytearray("\n".join(table()).encode())
    for place, data in damage:
        content[place : place + len(data)] = data
    path = tmp_path_factory.mktemp("damaged") / "run.csv"
    path.write_bytes(content)
    try:
        log = read_log(path)
    except DynidentError as error:
        assert str(error).startswith(str(path))
        assert len(str(error).splitlines()) == 1
    else:
        assert np.all(np.isfinite(np.hstack([log.time[:, None], log.q, log.torque])))
        assert np.all(np.diff(log.time) > 0)


def test_the_header_alone_is_read_too(tmp_path):
    path = saved(tmp_path, ["# note", "t; q1 ;tau", "no numbers; needed; here"])
    assert read_header(path) == ("t", "q1", "tau")


def stamped_table(stamps, **kind):
    """Return a sound table whose first cells are texts."""
    header, *rows = table(**kind)
    return [header, *(f"{stamp},{row.partition(',')[2]}" for stamp, row in zip(stamps, rows, strict=False))]


@pytest.mark.parametrize(
    ("pattern", "start"),
    [
        ("2024-03-01T10:00:{:06.3f}", 1709287200.0),
        ("2024-03-01 10:00:{:06.3f}Z", 1709287200.0),
        ("2024-03-01T10:00:{:06.3f}+01:00", 1709283600.0),
        ("10:00:{:06.3f}", 36000.0),
        ("9:00:{:09.6f}", 32400.0),
    ],
)
def test_time_stamps_that_read_one_way_are_seconds(tmp_path, pattern, start):
    seconds = np.arange(ROWS) / 8
    path = saved(tmp_path, stamped_table(map(pattern.format, seconds)))
    log = read_log(path, ColumnMap())
    np.testing.assert_allclose(log.time, start + seconds, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(np.hstack([log.q, log.torque]), COLUMNS)
    assert "t in seconds from time stamps" in log.source.steps[0]
    with pytest.raises(BadOption, match=r"units.time = 'ms' is not possible; leave it out: t holds time stamps"):
        read_log(path, ColumnMap(units=Units(time="ms")))


@pytest.mark.parametrize(
    ("number", "cell", "evidence"),
    [
        (
            5,
            "01/03/2024 10:00:00",
            "'01/03/2024 10:00:00', which is not a time stamp as in the first row; write the time in seconds, or as in",
        ),
        (5, "10:61:00", "'10:61:00', which is not a time stamp as in the first row; write the time in seconds"),
        (5, "10:00:00.125 AM", "which is not a time stamp as in the first row; write the time in seconds"),
        (5, "36000.5", "column 't' holds '36000.5', which is not a time stamp as in the first row"),
        (5, "10:00:00.000", "runs back: 36000.25 s, then 36000 s"),
    ],
)
def test_other_dates_are_refused_by_line(tmp_path, number, cell, evidence):
    lines = stamped_table(f"10:00:{k / 8:06.3f}" for k in range(ROWS))
    lines[number - 1] = cell + "," + lines[number - 1].partition(",")[2]
    with pytest.raises(LogFormatError) as caught:
        read_log(saved(tmp_path, lines), ColumnMap())
    assert caught.value.line == number and evidence in str(caught.value)


def test_a_time_stamp_where_no_first_row_has_one_is_refused(tmp_path):
    with pytest.raises(LogFormatError, match="column 'q1' holds '10:00:00', which is not a number"):
        read_log(saved(tmp_path, edited(4, "0.02,10:00:00,1,1,1")), ColumnMap())


@pytest.mark.parametrize("before", [[], ["Robot 7", "operator: nobody"]])
@pytest.mark.parametrize("units", ["s,deg,deg,N m,Nm", "[s],[deg],[deg],[N*m],[-]", "ms,rad,rad,A,"])
def test_a_row_of_units_under_the_header_goes_into_the_names(tmp_path, units, before):
    header, *rows = table()
    plain = [unit.strip("[]-") for unit in units.split(",")]
    names = [f"{name} [{unit}]" if unit else name for name, unit in zip(header.split(","), plain, strict=True)]
    path = saved(tmp_path, [*before, header, units, *rows])
    assert read_header(path) == tuple(names)
    log = read_log(path, ColumnMap(time=names[0], joints=("a", "b"), q=tuple(names[1:3]), torque=tuple(names[3:])))
    np.testing.assert_array_equal(np.hstack([log.q, log.torque]), COLUMNS)
    assert f"the units in line {len(before) + 2} put into the names" in log.source.steps[0]


@pytest.mark.parametrize("cell", ["hh:mm:ss", "HH:MM:SS.fff", "[time]", "UTC", "-"])
def test_the_word_above_time_stamps_is_no_unit(tmp_path, cell):
    header, *rows = stamped_table(f"10:00:{k / 8:06.3f}" for k in range(ROWS))
    names = header.split(",")
    path = saved(tmp_path, [header, f"{cell},deg,rad,N m,A", *rows])
    assert read_header(path) == (names[0], *map("{} [{}]".format, names[1:], ("deg", "rad", "N m", "A")))
    if cell != "-":
        with pytest.raises(LogFormatError, match="remove it and put them into the names"):  # seconds have a unit
            read_log(saved(tmp_path, [table()[0], f"{cell},deg,rad,N m,A", *table()[1:]]), ColumnMap())


def test_units_in_the_names_are_not_put_there_again(tmp_path):
    _, *rows = table()
    path = saved(tmp_path, ["t [s],q1 (deg),q(2),tau1 [N m],tau2", "s,deg,deg,N m,N m", *rows])
    assert read_header(path) == ("t [s]", "q1 (deg)", "q(2) [deg]", "tau1 [N m]", "tau2 [N m]")


@pytest.mark.parametrize("tab", ["", "\t"])
def test_rows_that_come_one_at_a_time_are_those_of_a_file(tmp_path, tab):
    lines = [line + tab for line in stamped_table((f"10:00:{k / 8:06.3f}" for k in range(ROWS)), separator=",")]
    lines = [line.replace(",", "\t") for line in lines]
    logs = list(live_rows(lines, ColumnMap(joints=("joint1", "joint2"))))
    np.testing.assert_allclose(np.concatenate([log.time for log in logs]), 36000.0 + np.arange(ROWS) / 8)
    np.testing.assert_array_equal(np.concatenate([np.hstack([log.q, log.torque]) for log in logs]), COLUMNS)
    with pytest.raises(BadOption, match="leave it out: t holds time stamps"):
        list(live_rows(lines, ColumnMap(joints=("joint1", "joint2"), units=Units(time="ms"))))


def test_a_second_row_of_other_words_is_no_row_of_units(tmp_path):
    header, *rows = table()
    path = saved(tmp_path, [header, "s,shoulder,elbow,shoulder,elbow", *rows])
    with pytest.raises(LogFormatError, match="if the row holds units, remove it and put them into the names"):
        read_log(path, ColumnMap())


def test_a_number_before_a_unit_is_what_one_count_is(tmp_path):
    lines = table()
    units = Units(time="4 ms", position=("-deg", "0.01 rad"), torque=("-1e-1 percent", "- N m"))
    log = read_log(saved(tmp_path, lines), ColumnMap(joints=("a", "b"), rated=(50, 1), units=units))
    np.testing.assert_allclose(log.time, 0.004 * np.arange(ROWS) / 100, rtol=1e-14, atol=0)
    np.testing.assert_allclose(log.q, COLUMNS[:, :2] * [-np.pi / 180, 0.01], rtol=1e-14)
    np.testing.assert_allclose(log.torque, COLUMNS[:, 2:] * [-0.05, -1.0], rtol=1e-14)
    assert "position from -deg, 0.01 rad" in log.source.steps[-1]


@pytest.mark.parametrize(
    ("quantity", "word"),
    [("time", "-s"), ("time", "0 s"), ("position", "0 rad"), ("torque", "1e999 N m"), ("torque", "2")],
)
def test_numbers_that_no_count_has_are_refused(quantity, word):
    with pytest.raises(UnknownChoice, match=f"no unit of {quantity} called '{word}'"):
        Units(**{quantity: word})


@pytest.mark.parametrize("name", ["time", "Time", "TIME"])
def test_a_column_called_time_is_the_time_where_none_is_called_t(tmp_path, name):
    rows = np.column_stack([np.arange(20) * 0.01, np.sin(np.arange(20)), np.arange(20)])
    for k, header in enumerate((f"{name},q1,tau1", f"{name},q1,t")):
        np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=header, comments="")
        log = read_log(tmp_path / "run.csv", ColumnMap(torque=(name,) if k else None))
        np.testing.assert_allclose(log.time, rows[:, 2 * k])
