"""What the fuzzer found, and every byte of small files: damage is taken or refused by name, no process ends."""

from __future__ import annotations

import io
import json
import random
import struct
import sys
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.data.formats import ColumnMap, read_log, stream_log, write_log
from dynident.data.formats import mat as mat_values
from dynident.data.log import Log
from dynident.errors import DynidentError, FileError, LogFormatError

ROOT = Path(__file__).parents[2]
DH = "name: one\nconvention: modified\njoints: [{alpha: 0, a: 0, d: 0, theta: 0}]\n"
SOUND = {"t": np.arange(6.0), "q": np.arange(12.0).reshape(6, 2), "tau": np.ones((6, 2), dtype=np.int16)}


def mat(folder: Path, **options: Any) -> Path:
    scipy_io = pytest.importorskip("scipy.io")
    nested = {"data": {"x": np.arange(6, dtype=np.float32), "in": {"y": np.eye(6)[0]}, "note": "text"}}
    many = [(SOUND["t"], "q"), (SOUND["q"], "tau")]
    nested["many"] = np.array(many, dtype=[("values", object), ("label", object)])  # type: ignore[assignment]
    content = SOUND if options.get("format") == "4" else {**SOUND, **nested, "z": np.array([1j, 2.0])}
    scipy_io.savemat(folder / "run.mat", content, **options)
    return folder / "run.mat"


@pytest.mark.parametrize("options", [{"format": "4"}, {}, {"do_compression": True}], ids=["4", "5", "5 packed"])
def test_values_of_a_matlab_file_are_those_of_scipy(tmp_path: Path, options: dict[str, Any]) -> None:
    from scipy.io import loadmat

    path = mat(tmp_path, **options)
    found, known = mat_values.read_values(path), loadmat(path, simplify_cells=True)
    for name in SOUND:
        np.testing.assert_array_equal(found[name], known[name], strict=True)
    if "format" not in options:
        np.testing.assert_array_equal(found["data"]["x"], known["data"]["x"], strict=True)
        np.testing.assert_array_equal(found["data"]["in"]["y"], known["data"]["in"]["y"], strict=True)
        assert found["data"]["note"] == "text" and "z" not in found
        assert [one["label"] for one in found["many"]] == ["q", "tau"]
        np.testing.assert_array_equal(found["many"][1]["values"], SOUND["q"], strict=True)


@pytest.mark.parametrize("options", [{"format": "4"}, {}, {"do_compression": True}], ids=["4", "5", "5 packed"])
def test_any_byte_of_a_matlab_file_may_be_wrong(tmp_path: Path, options: dict[str, Any]) -> None:
    """Files of version 5 with a wrong byte have ended the process inside the parser that was used before."""
    content = mat(tmp_path, **options).read_bytes()
    path = tmp_path / "bad.mat"
    refused = 0
    for place in range(len(content)):
        for value in {0xFF, 0x00, content[place] ^ 0x01} - {content[place]}:
            path.write_bytes(content[:place] + bytes([value]) + content[place + 1 :])
            try:
                mat_values.read_values(path)
            except ValueError:
                refused += 1
    assert refused > 20


def test_a_packed_matlab_variable_may_not_unpack_without_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mat_values, "MOST_UNPACKED", 1 << 20)
    head = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    bomb = zlib.compress(struct.pack("<II", 14, 1 << 24) + bytes(1 << 24), 9)
    (tmp_path / "run.mat").write_bytes(head + struct.pack("<II", 15, len(bomb)) + bomb)
    assert len(bomb) < 20_000
    with pytest.raises(LogFormatError, match="unpack to more than"):
        read_log(tmp_path / "run.mat", ColumnMap())


def test_a_matlab_variable_that_claims_more_than_the_file_holds(tmp_path: Path) -> None:
    head = struct.pack("<iiiii", 0, 1 << 30, 1 << 30, 0, 2) + b"q\0"
    (tmp_path / "run.mat").write_bytes(head + bytes(64))
    with pytest.raises(LogFormatError, match="'q' states more bytes than the file holds"):
        read_log(tmp_path / "run.mat", ColumnMap())


def test_a_name_in_a_matlab_file_that_is_no_utf_8(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.mat", "w", userblock_size=512) as file:
        file["name_of_eight"] = np.arange(6.0)
    content = (tmp_path / "run.mat").read_bytes()
    assert content.count(b"name_of_eight") == 1
    (tmp_path / "run.mat").write_bytes(content.replace(b"name_of_eight", b"name\xff\xfe\xff_eight"))
    with pytest.raises(LogFormatError, match=r"is not UTF-8"):
        read_log(tmp_path / "run.mat", ColumnMap())


def npy(header: str, data: bytes = b"") -> bytes:
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


@pytest.mark.parametrize(
    "header",
    ["{'descr': '<f8', 'fortran_order': False, 'shape': (6,", "{'descr': '<f8'", "{(): 1}", "[[[", "\t(", "1 1"],
)
@pytest.mark.parametrize("name", ["t", "note"])
def test_headers_of_arrays_that_are_no_dictionary(tmp_path: Path, header: str, name: str) -> None:
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{name}.npy", npy(header, bytes(48)))
    with pytest.raises(LogFormatError, match="is no array"):
        read_log(path, ColumnMap())


def test_a_directory_that_points_before_the_file(tmp_path: Path) -> None:
    content = io.BytesIO()
    np.savez(content, **SOUND)  # type: ignore[arg-type]
    data = bytearray(content.getvalue())
    place = data.rfind(b"PK\x05\x06") + 16  # offset of the directory, in the last record
    for offset in (0xFFFFFFF0, 0, 1 << 20):
        data[place : place + 4] = struct.pack("<I", offset)
        (tmp_path / "run.npz").write_bytes(bytes(data))
        with pytest.raises(LogFormatError, match=r"run\.npz: "):
            read_log(tmp_path / "run.npz", ColumnMap())


@pytest.mark.parametrize("suffix", [".parquet", ".npz"])
def test_damaged_pages_are_named_in_both_ways_of_reading(tmp_path: Path, suffix: str) -> None:
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    sound, path, draw = tmp_path / f"sound{suffix}", tmp_path / f"run{suffix}", random.Random(0)
    write_log(Log(("a",), SOUND["t"], SOUND["q"][:, :1]), sound)
    content = sound.read_bytes()
    columns, refused = ColumnMap(torque=()), 0
    for place in draw.sample(range(4, len(content)), 60):
        path.write_bytes(content[:place] + bytes([content[place] ^ (1 << draw.randrange(8))]) + content[place + 1 :])
        for read in (lambda: read_log(path, columns), lambda: list(stream_log(path, columns).blocks(4))):
            try:
                read()
            except DynidentError as error:
                refused += 1
                assert str(path) in str(error)
    assert refused > 20


def test_a_parquet_file_of_less_than_no_rows_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    path = tmp_path / "run.parquet"
    write_log(Log(("a",), np.arange(10.0), np.ones((10, 1))), path)
    rows, negative = b"\x16\x14\x19\x1c", b"\x16\x13\x19\x1c"  # 10 in the footer, between the names and the groups
    assert path.read_bytes().count(rows) == 1
    path.write_bytes(path.read_bytes().replace(rows, negative))
    with pytest.raises(LogFormatError, match=r"damaged Parquet file \(-10 rows"):
        read_log(path, ColumnMap(torque=()))


def test_a_parquet_file_with_too_many_cells_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    from dynident.data.formats import parquet

    log = Log(("a",), np.arange(1000.0), np.zeros((1000, 1)))
    write_log(log, tmp_path / "run.parquet")
    monkeypatch.setattr(parquet, "MAX_CELLS", 1999)
    monkeypatch.setattr(parquet, "unpacked", lambda *_: pytest.fail("it was unpacked"))
    with pytest.raises(LogFormatError, match="more than are read at once"):
        read_log(tmp_path / "run.parquet", ColumnMap(torque=()))


@pytest.mark.parametrize("name", ["plan", "estimate", "robot_json", "document", "search"])
@pytest.mark.parametrize("text", ["[" * 100_000, f'{{"a": {"9" * 5000}}}', "\xff", "{", "[1e999]"], ids=range(5))
def test_json_that_is_none_is_refused_by_name(name: str, text: str, tmp_path: Path) -> None:
    from dynident.excitation.design.multistart import DesignCheckpoint
    from dynident.excitation.design.plan import read_plan
    from dynident.exports.models.writing.document import read_document
    from dynident.identification.files.estimate_file import read_estimate
    from dynident.robot_files import read_robot

    def search(path: Path) -> object:
        return DesignCheckpoint(str(path), {}, 1).read()

    read = {
        "plan": read_plan,
        "estimate": read_estimate,
        "robot_json": read_robot,
        "document": read_document,
        "search": search,
    }[name]
    (tmp_path / "a.json").write_text(text, encoding="latin-1")
    with pytest.raises(DynidentError, match=r"a\.json"):
        read(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("before", "after"),
    [('"samples": 201', '"samples": 1e999'), ('"format": 3', '"format": 1e999'), ('"run_in": ', '"run_in": 1e400')],
)
def test_a_plan_with_numbers_beyond_all(
    before: str, after: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from fuzz.seeds import plan

    from dynident.excitation.design.plan import read_plan

    for path in plan(tmp_path):
        text = path.read_text()
        assert before in text
        path.write_text(text.replace(before, after))
        with pytest.raises(FileError, match="plan"):
            read_plan(path)


def test_a_robot_in_the_home_of_nobody(tmp_path: Path) -> None:
    from dynident.case.case import read_case

    (tmp_path / "case.yaml").write_text("case: 1\nrobot: ~nobody-of-this-name/arm.urdf\n")
    with pytest.raises(DynidentError, match=r"~nobody-of-this-name/arm\.urdf"):
        read_case(tmp_path / "case.yaml")


def test_a_cut_recording_with_definitions_in_idl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """ROS puts all of them into one text, each under a line with its name."""
    pytest.importorskip("rosbags")
    monkeypatch.syspath_prepend(str(ROOT))
    from fuzz.seeds import IDL, JOINTS, mcap

    from dynident.data.formats.rosbag import Rosbag

    whole = mcap(tmp_path)[-1]
    assert IDL.count("IDL: ") == 3 and b"ros2idl" in whole.read_bytes()
    names = [tuple(f"{joint}.{word}" for joint in JOINTS) for word in ("position", "effort")]
    columns = ColumnMap(JOINTS, q=names[0], torque=names[1])
    log = read_log(whole, columns)
    (tmp_path / "cut.mcap").write_bytes(whole.read_bytes()[:-400])
    cut = read_log(tmp_path / "cut.mcap", columns, form=Rosbag(salvage=True))
    np.testing.assert_array_equal(cut.q, log.q)
    np.testing.assert_array_equal(cut.torque, log.torque)  # type: ignore[arg-type]


@pytest.mark.skipif(sys.platform == "win32", reason="the fuzzer limits memory as POSIX does")
@pytest.mark.parametrize("name", ["urdf", "xacro", "robot_json", "csv", "npz"])
def test_the_fuzzer_finds_nothing_in_its_first_inputs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from fuzz.mutations import mutated
    from fuzz.targets import TARGETS

    if name == "xacro":
        pytest.importorskip("xacro", reason="xacro files need the package xacro (extra xacro)")
    target = TARGETS[name]
    seeds = target.prepare(tmp_path, name)
    path, outcomes = tmp_path / f"input{target.suffix}", set()
    for number in range(60):
        draw = random.Random(f"{name} 0 {number}")
        path.write_bytes(mutated(target.kind, draw.choice(seeds), draw.choice(seeds), draw, target.words))
        try:
            target.read(path)
            outcomes.add("taken")
        except DynidentError:
            outcomes.add("refused")
    assert outcomes == {"taken", "refused"}


def test_the_page_has_the_counts_of_the_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from fuzz.record import Record
    from fuzz.targets import TARGETS

    page, record = ROOT / "docs/robustness.md", ROOT / "docs/assets/fuzzing.json"
    Record(record).into(page_again := tmp_path / "page.md", page)
    assert page_again.read_text("utf-8") == page.read_text("utf-8")
    assert set(json.loads(record.read_text())["targets"]) == set(TARGETS)
    assert json.loads(record.read_text())["open"] == {}


def test_counts_add_up_from_one_run_to_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))
    from fuzz.record import Record

    place = tmp_path / "record.json"
    score = {"executions": 10, "taken": 3, "crash": 1, "seconds": 2.0, "slowest_s": 0.1, "faults": {"crash: here": "a"}}
    Record(place).add("csv", "plain", score)
    Record(place).add("csv", "plain", {"executions": 5, "seconds": 0.5, "slowest_s": 0.3, "faults": {}})
    again = Record(place)
    assert again.executions("csv") == again.begin("csv", "plain") == 15 and again.begin("csv", "guided") == 0
    assert "| `csv` | 15 | 0 | 3 | 1 | 0 | 0 | 6 |" in again.table()
    again.mend("csv", "a")
    assert json.loads(place.read_text())["open"] == {}


def test_names_that_are_too_long_for_the_system_are_no_files(tmp_path: Path) -> None:
    from dynident.case.case import read_case
    from dynident.robot_files import read_robot

    long, case = "r" * 5000, tmp_path / "case.yaml"
    for read in (read_case, read_robot, read_log):
        for name in (long, f"{long}.yaml", f"{long}.bag", f"{long}.csv"):
            with pytest.raises(DynidentError):
                read(tmp_path / name)
    (tmp_path / "arm.yaml").write_text(DH)
    for text in (
        f"robot: {long}.urdf",
        f"robot: folder/{long}.urdf",
        f"robot: arm.yaml\nworkspace: {{mesh_folders: {long}}}",
    ):
        case.write_text(f"case: 1\n{text}\n")
        with pytest.raises(DynidentError):
            read_case(case)
    case.write_text(f"case: 1\nrobot: arm.yaml\ntest: {long}.csv\n")
    with pytest.raises(FileError):
        read_case(case).read(read_case(case).test[0])
