"""Message definitions in recordings: a few hundred bytes that would take hours or all memory are refused at once."""

from __future__ import annotations

import contextlib
import struct
from pathlib import Path

import pytest

pytest.importorskip("rosbags")

from rosbags.typesys import get_types_from_idl, get_types_from_msg

from dynident.data.formats import ColumnMap, read_header, read_log
from dynident.data.formats import _bag_decoding as definitions
from dynident.data.formats._mcap_salvage import MAGIC
from dynident.data.formats.rosbag import Rosbag
from dynident.errors import LogFormatError

KIND = "sensor_msgs/msg/JointState"
OTHER = f"\n{'=' * 80}\nMSG: pkg/Y\n"
IDL = "module sensor_msgs {{ module msg {{ {} struct JointState {{ {} x; }}; }}; }};"


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def text(words: str) -> bytes:
    return struct.pack("<I", len(words)) + words.encode()


def mcap(path: Path, language: str, definition: str, *, cut: bool) -> Path:
    """Write two messages of one topic, with a definition of our own; without an end where it is cut."""
    schema = record(3, struct.pack("<H", 1) + text(KIND) + text(language) + text(definition))
    channel = record(4, struct.pack("<HH", 1, 1) + text("/js") + text("cdr") + struct.pack("<I", 0))
    messages = [record(5, struct.pack("<HIQQ", 1, k, k, k) + b"\0\1\0\0" + bytes(200)) for k in range(2)]
    start = MAGIC + record(1, text("ros2") + text("test")) + schema + channel + b"".join(messages)
    about = (
        schema + channel + record(11, struct.pack("<QHIIIIQQI", 2, 1, 1, 0, 0, 0, 0, 1, 10) + struct.pack("<HQ", 1, 2))
    )
    ends = record(15, bytes(4)) + about
    place = len(start) + 13
    end = record(2, struct.pack("<QQI", place, 0, 0)) + MAGIC
    path.write_bytes(start if cut else start + ends + end)
    return path


@pytest.mark.parametrize("cut", [True, False], ids=["cut", "whole"])
@pytest.mark.parametrize(
    ("language", "definition", "evidence"),
    [
        ("ros2msg", "string[30000000] x\n", "arrays of 30000000 texts or messages"),
        ("ros2msg", f"pkg/Y[5000000] x{OTHER}int32 a\n", "arrays of 5000000 texts"),
        ("ros2msg", f"pkg/Y x{OTHER}string[1500] a\nstring[1500] b\n", "'pkg/msg/Y' has arrays of 3000 texts"),
        ("ros2idl", IDL.format(f"const long A = {'(' * 9}1{')' * 9};", "long"), "computes its constants"),
        ("ros2idl", IDL.format(f"@note({'(' * 9}1{')' * 9})", "long"), "computes its constants"),
        ("ros2idl", IDL.format('@note("// ") const long A = 1 /* " */ << 30000000000;', "long"), "computes its"),
        ("ros2idl", IDL.format("", f"{'sequence<' * 40}long{'>' * 40}"), "nests its sequences"),
    ],
    ids=["texts", "messages", "inner", "parentheses", "annotation", "shift", "nested"],
)
def test_definitions_that_would_take_too_long(
    tmp_path: Path, language: str, definition: str, evidence: str, cut: bool
) -> None:
    path = mcap(tmp_path / "run.mcap", language, definition, cut=cut)
    assert path.stat().st_size < 2000
    with pytest.raises(LogFormatError, match=evidence):
        read_header(path, form=Rosbag(salvage=cut))


def test_definitions_as_they_are_written_are_not_refused() -> None:
    message = "# module (see <<there>>)\nstring[4] names\nfloat64[4000] values\n"
    idl = IDL.format('@note(text="a (b) << c") const long A = 4; typedef double four[A];', "four")
    definitions.check_texts("run", [(message, False), (idl, True)])
    for found in (get_types_from_msg(message, KIND), get_types_from_idl(idl)):
        definitions.check_arrays("run", found, [KIND])
        assert list(found) == [KIND]


def test_definitions_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(definitions, "MOST_TEXT", 1000)
    path = mcap(tmp_path / "run.mcap", "ros2msg", "float64 a\n" * 120, cut=True)
    with pytest.raises(LogFormatError, match="more than 1000 characters of message definitions"):
        read_header(path, form=Rosbag(salvage=True))


@pytest.mark.parametrize("column", ["name", "type"])
def test_topics_whose_names_or_types_are_bytes_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, column: str
) -> None:
    import sqlite3

    monkeypatch.syspath_prepend(str(Path(__file__).parents[2]))
    from fuzz.seeds import JOINTS, db3

    (path,) = db3(tmp_path)
    columns = ColumnMap(JOINTS, q=tuple(f"{joint}.position" for joint in JOINTS), torque=())
    assert len(read_log(path, columns).time) == 10
    with contextlib.closing(sqlite3.connect(path)) as base:
        base.executescript(f"UPDATE topics SET {column} = CAST({column} AS BLOB);")
    with pytest.raises(LogFormatError, match=r"\.db3: .*damaged"):
        read_log(path, columns)
