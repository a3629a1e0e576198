"""Recordings of ROS: joints by name, stamps, publishers, other messages, and files that were cut."""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from dynident.case.case import read_case
from dynident.case.case_draft import draft_case
from dynident.data.formats import ColumnMap, read_header, read_log, stream_log
from dynident.data.formats._mcap_salvage import MAGIC
from dynident.data.formats.rosbag import Rosbag
from dynident.data.log import Log
from dynident.errors import BadOption, DynidentError, LogFormatError, UnknownChoice

ROS2, ROS1 = get_typestore(Stores.ROS2_HUMBLE), get_typestore(Stores.ROS1_NOETIC)
for kind, text in {
    "InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    "DynamicJointState": "std_msgs/Header header\nstring[] joint_names\nInterfaceValue[] interface_values\n",
}.items():
    ROS2.register(get_types_from_msg(text, f"control_msgs/msg/{kind}"))
N = 200
STEP = 4_000_000
FIRST = 1_700_000_000_000_000_000
GENERATOR = np.random.default_rng(7)
Q, DQ, TAU = GENERATOR.normal(size=(3, N, 2))
TIME = np.arange(N) * STEP / 1e9
#: In the order of the drives, which is not that of the arm.
NAMES = ("elbow", "shoulder")
COLUMNS = ColumnMap(
    ("shoulder", "elbow"),
    q=("shoulder.position", "elbow.position"),
    dq=("shoulder.velocity", "elbow.velocity"),
    torque=("shoulder.effort", "elbow.effort"),
)

#: Topic, receive time in ns, message.
Messages = Sequence[tuple[str, int, Any]]


def header(stamp: int, store: Any = ROS2) -> Any:
    types = store.types
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    more = {"seq": 0} if store is ROS1 else {}
    return types["std_msgs/msg/Header"](stamp=time, frame_id="", **more)


def state(stamp: int, names: Sequence[str], *lists: Any, store: Any = ROS2) -> Any:
    arrays = [np.array(values, dtype=np.float64) for values in (*lists, (), ())[:3]]
    return store.types["sensor_msgs/msg/JointState"](header(stamp, store), list(names), *arrays)


def states(topic: str = "/joint_states", store: Any = ROS2, delay: int = 1_500_000) -> Messages:
    return [
        (topic, FIRST + k * STEP + delay, state(FIRST + k * STEP, NAMES, Q[k], DQ[k], TAU[k], store=store))
        for k in range(N)
    ]


def write_ros1(path: Path, messages: Messages) -> Path:
    with Writer1(path) as writer:
        topics: dict[str, Any] = {}
        for topic, received, message in messages:
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=ROS1)
            writer.write(topics[topic], received, ROS1.serialize_ros1(message, kind))
    return path


def write_ros2(path: Path, messages: Messages, plugin: StoragePlugin, *, packed: bool = False) -> Path:
    """Write a folder and return it."""
    writer = Writer(path, version=9, storage_plugin=plugin)
    if packed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        topics: dict[str, Any] = {}
        for topic, received, message in messages:
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=ROS2)
            writer.write(topics[topic], received, ROS2.serialize_cdr(message, kind))
    return path


def mcap(folder: Path, messages: Messages, *, packed: bool = False) -> Path:
    """Return a bare .mcap file."""
    write_ros2(folder / "rec", messages, StoragePlugin.MCAP, packed=packed)
    return (folder / "rec" / "rec.mcap").rename(folder / "run.mcap")


def written(folder: Path, how: str) -> Path:
    if how == "bag":
        return write_ros1(folder / "run.bag", states(store=ROS1))
    if how in ("mcap", "packed mcap"):
        return mcap(folder, states(), packed=how == "packed mcap")
    plugin = StoragePlugin.MCAP if "mcap" in how else StoragePlugin.SQLITE3
    made = write_ros2(folder / "run", states(), plugin)
    if how == "folder without metadata (mcap)":
        (made / "metadata.yaml").unlink()
    return made / "run.db3" if how == "db3" else made


def check(log: Log) -> None:
    assert log.joints == ("shoulder", "elbow")
    np.testing.assert_allclose(log.time, TIME, atol=1e-12)
    for found, true in ((log.q, Q), (log.dq, DQ), (log.torque, TAU)):
        np.testing.assert_array_equal(found, true[:, ::-1])


@pytest.mark.parametrize(
    "how", ["bag", "db3", "mcap", "packed mcap", "folder (sqlite3)", "folder (mcap)", "folder without metadata (mcap)"]
)
def test_joint_states_are_read_by_the_names_of_the_joints(tmp_path: Path, how: str) -> None:
    path = written(tmp_path, how)
    check(read_log(path, COLUMNS))
    assert read_header(path)[:3] == ("t", "elbow.position", "shoulder.position")


def test_the_provenance_names_topic_stamps_and_first_stamp(tmp_path: Path) -> None:
    source = read_log(mcap(tmp_path, states()), COLUMNS).source
    assert source.steps == (
        "read as ROS 2 bag (MCAP), /joint_states, stamps of the messages",
        f"time counted from the stamp {FIRST} ns",
    )
    assert source.rows == N and len(source.sha256) == 64


def test_stamps_of_the_headers_go_before_receive_times(tmp_path: Path) -> None:
    jitter = GENERATOR.integers(0, STEP, N)
    messages = [(topic, received + int(late), m) for (topic, received, m), late in zip(states(), jitter, strict=True)]
    path = mcap(tmp_path, messages)
    check(read_log(path, COLUMNS))
    by_arrival = read_log(path, COLUMNS, form=Rosbag(stamps="receive"))
    np.testing.assert_allclose(by_arrival.time, TIME + (jitter - jitter[0]) / 1e9, atol=1e-9)


def test_messages_that_arrive_out_of_order_are_sorted_and_repeats_left_out(tmp_path: Path) -> None:
    messages = list(states())
    messages[20:22] = [(messages[20][0], messages[20][1], messages[21][2]), (*messages[21][:2], messages[20][2])]
    messages.insert(50, messages[50])
    log = read_log(mcap(tmp_path, messages), COLUMNS)
    check(log)
    assert (
        "1 messages put into the order of their stamps; 1 messages left out that repeat the one before"
        in log.source.steps
    )


def test_two_publishers_with_other_joints_on_one_topic_and_equal_stamps(tmp_path: Path) -> None:
    messages = []
    for k in range(N):
        stamp = FIRST + k * STEP
        for j, name in enumerate(NAMES):
            messages.append(("/joint_states", stamp + j, state(stamp, [name], Q[k, [j]], DQ[k, [j]], TAU[k, [j]])))
        messages.append(("/joint_states", stamp + 3, state(stamp, ["finger"], [0.1])))
    log = read_log(mcap(tmp_path, messages), COLUMNS)
    check(log)
    assert f"{N} messages of /joint_states carry none of the columns" in log.source.steps


def test_publishers_at_other_times_are_interpolated_and_gaps_left_out(tmp_path: Path) -> None:
    """A straight line is interpolated exactly; ends and a gap of one publisher are no rows."""
    messages: list[tuple[str, int, Any]] = []
    for k in range(N):
        stamp = FIRST + k * STEP
        messages.append(("/joint_states", stamp, state(stamp, ["shoulder", "hand"], [0.1 * k, 1.0], (), [1.0 * k, 0])))
        if not 50 <= k < 80:
            late = stamp + STEP // 4
            messages.append(("/joint_states", late, state(late, ["elbow"], [2.0 * (k + 0.25)], (), [3.0 * (k + 0.25)])))
    columns = ColumnMap(COLUMNS.joints, q=COLUMNS.q, dq=(), torque=COLUMNS.torque)
    log = read_log(mcap(tmp_path, messages), columns)
    k = np.rint((log.time * 1e9 + STEP) / STEP)
    np.testing.assert_allclose(log.q, np.column_stack([0.1 * k, 2.0 * k]), atol=1e-9)
    np.testing.assert_allclose(log.torque, np.column_stack([k, 3.0 * k]), atol=1e-9)  # type: ignore[arg-type]
    assert k[0] == 1 and k[-1] == N - 1 and not np.any((k >= 50) & (k <= 80))
    assert any("elbow.position, elbow.effort interpolated linearly" in step for step in log.source.steps)
    assert any("rows left out at which not all columns are known" in step for step in log.source.steps)


def test_torques_of_another_topic_carry_its_name(tmp_path: Path) -> None:
    messages = list(states())
    wrench = ROS2.types["std_msgs/msg/Float64MultiArray"]
    layout = ROS2.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    for k in range(N):
        messages.append(("/sensors", FIRST + k * STEP + 1_500_000, wrench(layout, 10 * TAU[k])))
    path = mcap(tmp_path, sorted(messages, key=lambda item: item[1]))
    form = Rosbag(topics=("/joint_states", "/sensors"), stamps="receive")
    assert "/sensors:data[1]" in read_header(path, form=form)
    columns = ColumnMap(
        ("elbow", "shoulder"),
        q=("/joint_states:elbow.position", "/joint_states:shoulder.position"),
        torque=("/sensors:data[0]", "/sensors:data[1]"),
    )
    log = read_log(path, columns, form=form)
    np.testing.assert_allclose(log.torque, 10 * TAU)  # type: ignore[arg-type]
    np.testing.assert_array_equal(log.q, Q)
    headed = read_log(path, columns, form=Rosbag(topics=form.topics))
    assert "no headers in /sensors: receive times" in headed.source.steps


def test_a_trajectory_controller_is_read_by_the_names_of_its_joints(tmp_path: Path) -> None:
    point = ROS2.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    span = ROS2.types["builtin_interfaces/msg/Duration"](0, 0)
    kind = ROS2.types["trajectory_msgs/msg/JointTrajectory"]
    messages = []
    for k in range(N):
        stamp = FIRST + k * STEP
        message = kind(header(stamp), list(NAMES), [point(Q[k], DQ[k], np.empty(0), TAU[k], span)])
        messages.append(("/plan", stamp, message))
    path = mcap(tmp_path, messages)
    columns = ColumnMap(
        ("shoulder", "elbow"),
        q=("shoulder.points[0].positions", "elbow.points[0].positions"),
        torque=("shoulder.points[0].effort", "elbow.points[0].effort"),
    )
    log = read_log(path, columns, form=Rosbag(topics=("/plan",)))
    np.testing.assert_array_equal(log.q, Q[:, ::-1])


def spoiled(messages: Messages, rows: Sequence[int], change: Callable[[Any], None]) -> Messages:
    for row in rows:
        change(messages[row][2])
    return messages


def test_a_few_messages_without_numbers_are_left_out_and_many_refused(tmp_path: Path) -> None:
    def no_number(message: Any) -> None:
        message.effort[1] = np.nan

    log = read_log(mcap(tmp_path, spoiled(states(), [3, 4], no_number)), COLUMNS)
    assert log.samples == N - 2
    assert "2 of 200 messages left out: numbers not finite" in log.source.steps
    (tmp_path / "more").mkdir()
    path = mcap(tmp_path / "more", spoiled(states(), range(0, N, 2), no_number))
    with pytest.raises(LogFormatError, match=r"'shoulder.effort' is not finite in 100 of 200 messages; record one"):
        read_log(path, COLUMNS)


def test_messages_without_efforts_do_not_become_rows(tmp_path: Path) -> None:
    def no_effort(message: Any) -> None:
        message.effort = np.empty(0)

    log = read_log(mcap(tmp_path, spoiled(states(), [10], no_effort)), COLUMNS)
    assert log.samples == N - 1
    assert "1 messages with 4 of the columns only left out" in log.source.steps


def test_faults_name_the_next_step(tmp_path: Path) -> None:
    both = [*states(), *states("/sim/joint_states")]
    path = mcap(tmp_path, sorted(both, key=lambda item: item[1]))
    with pytest.raises(LogFormatError, match=r"2 topics with states of joints; name topics with format: \{rosbag"):
        read_log(path, COLUMNS)
    with pytest.raises(UnknownChoice, match="did you mean '/joint_states'"):
        read_log(path, COLUMNS, form=Rosbag(topics=("/joint_state",)))
    with pytest.raises(BadOption, match="choose 'header' or 'receive'"):
        Rosbag(stamps="both")
    with pytest.raises(UnknownChoice, match="did you mean 'humble'"):
        Rosbag(distro="humbel")
    with pytest.raises(LogFormatError, match=r"no column 'knee\.position'"):
        read_log(path, ColumnMap(("knee",), q=("knee.position",)), form=Rosbag(topics=("/joint_states",)))
    zero = [(topic, received, state(0, NAMES, Q[0], DQ[0], TAU[0])) for topic, received, _ in states()]
    (tmp_path / "zero").mkdir()
    with pytest.raises(LogFormatError, match="the stamps in the headers are all 0; read it by the times"):
        read_log(mcap(tmp_path / "zero", zero), COLUMNS)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "a.mcap").write_bytes(b"nothing")
    with pytest.raises(LogFormatError, match="no recording of ROS, or a damaged one"):
        read_log(tmp_path / "empty", COLUMNS)


def test_a_clock_that_jumps_back_is_refused(tmp_path: Path) -> None:
    messages = [
        (topic, received, state(FIRST + (k % 100) * STEP * 10, NAMES, Q[k], DQ[k], TAU[k]))
        for k, (topic, received, _) in enumerate(states())
    ]
    with pytest.raises(LogFormatError, match="row 101: time in column 't' runs back"):
        read_log(mcap(tmp_path, messages), COLUMNS)


URDF = """<robot name="arm"><link name="base"/>
<link name="a"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="3" effort="200"/></joint>
<joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="3" effort="200"/></joint></robot>
"""


@pytest.mark.parametrize(("profile", "gains"), [("joint_states", (1.0, 1.0)), ("ur_ros2", (14.0, 11.0))])
def test_a_case_reads_a_recording_by_a_profile(tmp_path: Path, profile: str, gains: tuple[float, float]) -> None:
    """By ``ur_ros2`` the efforts are currents, which the drive gains turn into torques."""
    both = sorted([*states(), *states("/other")], key=lambda item: item[1])
    mcap(tmp_path, both)
    (tmp_path / "robot.urdf").write_text(URDF)
    (tmp_path / "case.yaml").write_text(
        f"case: 1\nrobot: robot.urdf\nlog: {{profile: {profile}, format: {{rosbag: {{topics: [/joint_states]}}}}}}\n"
        f"drives: {{shoulder: {{gain: {gains[0]}}}, elbow: {{gain: {gains[1]}}}}}\n"
    )
    log = read_case(tmp_path / "case.yaml").read("run.mcap")
    np.testing.assert_array_equal(log.q, Q[:, ::-1])
    np.testing.assert_allclose(log.torque, TAU[:, ::-1] * gains)  # type: ignore[arg-type]
    assert (log.current is None) == (profile == "joint_states")


# --- cut files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("packed", [False, True])
def test_a_cut_file_is_refused_and_read_on_request(tmp_path: Path, packed: bool) -> None:
    path = mcap(tmp_path, states(), packed=packed)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(LogFormatError, match=r"'run.mcap' is cut: it has no end; .*salvage=true, .*salvage: true"):
        read_log(path, COLUMNS)
    if packed:  # one block of zstd holds the whole recording, and half of it nothing
        with pytest.raises(DynidentError):
            read_log(path, COLUMNS, form=Rosbag(salvage=True))
        return
    log = read_log(path, COLUMNS, form=Rosbag(salvage=True))
    assert 50 < log.samples < N
    np.testing.assert_array_equal(log.q, Q[: log.samples, ::-1])
    np.testing.assert_array_equal(log.torque, TAU[: log.samples, ::-1])  # type: ignore[arg-type]
    assert f"the file is cut: {log.samples} messages recovered" in log.source.steps


def test_a_folder_whose_file_was_cut(tmp_path: Path) -> None:
    folder = write_ros2(tmp_path / "run", states(), StoragePlugin.MCAP)
    file = folder / "run.mcap"
    file.write_bytes(file.read_bytes()[:-500])
    with pytest.raises(LogFormatError, match=r"'run\.mcap' is cut"):
        read_log(folder, COLUMNS)
    check(read_log(folder, COLUMNS, form=Rosbag(salvage=True)))


def without_types(path: Path, release: str = "rosbags") -> Path:
    """Take the message types out of a SQLite file, as ROS 2 before Iron wrote it; ``release`` is what it names."""
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute("DELETE FROM message_definitions")
        database.execute("UPDATE topics SET type_description_hash = ''")
        database.execute("UPDATE schema SET ros_distro = ?", (release,))
    return path


@pytest.mark.parametrize("how", ["db3", "folder (sqlite3)"])
def test_states_of_joints_need_no_definition(tmp_path: Path, how: str) -> None:
    """They are the same in all releases of ROS 2; the file may be alone."""
    path = written(tmp_path, how)
    file = without_types(tmp_path / "run" / "run.db3")
    if how == "db3":
        path = file.rename(tmp_path / "alone 1.db3")
    check(read_log(path, COLUMNS))
    check(read_log(path, COLUMNS, form=Rosbag(distro="humble")))


def test_a_type_that_releases_define_differently_needs_the_release(tmp_path: Path) -> None:
    """The file may name it, as that of ROS 2 Iron does."""
    kind = "shape_msgs/msg/SolidPrimitive"
    old, new = (get_typestore(store).fielddefs[kind] for store in (Stores.ROS2_FOXY, Stores.ROS2_HUMBLE))
    assert old != new
    box = ROS2.types[kind](1, np.array([0.1, 0.2, 0.3]), ROS2.types["geometry_msgs/msg/Polygon"]([]))
    folder = write_ros2(tmp_path / "run", [("/box", FIRST + k * STEP, box) for k in range(20)], StoragePlugin.SQLITE3)
    path, form = without_types(folder / "run.db3"), Rosbag(("/box",), stamps="receive")
    with pytest.raises(LogFormatError, match=r"define the message type 'shape_msgs/msg/SolidPrimitive'; name the ROS"):
        read_header(path, form=form)
    expected = read_header(path, form=Rosbag(("/box",), stamps="receive", distro="humble"))
    assert "dimensions[2]" in expected
    without_types(path, "humble")
    assert read_header(path, form=form) == expected


def record(kind: int, *parts: bytes) -> bytes:
    content = b"".join(parts)
    return bytes([kind]) + struct.pack("<Q", len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value.encode())) + value.encode()


def own_mcap(compression: str, per_chunk: int) -> tuple[bytes, list[int]]:
    """Return an .mcap file without an index, written after the specification, and where its chunks end."""
    definition, _ = ROS2.generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)
    start = record(0x03, struct.pack("<H", 1), text("sensor_msgs/msg/JointState"), text("ros2msg"), text(definition))
    start += record(0x04, struct.pack("<HH", 5, 1), text("/joint_states"), text("cdr"), struct.pack("<I", 0))
    data, ends = MAGIC + record(0x01, text("ros2"), text("test")) + start, []
    for first in range(0, N, per_chunk):
        inner = b"".join(
            record(0x05, struct.pack("<HIQQ", 5, 0, t, t), bytes(ROS2.serialize_cdr(m, m.__msgtype__)))
            for _, t, m in states()[first : first + per_chunk]
        )
        if compression == "lz4":
            from lz4.frame import compress

            packed = compress(inner, block_size=4)
        else:
            from rosbags.rosbag2.storage_mcap import zstd

            packed = zstd.compress(inner) if compression else inner
        sizes = struct.pack("<QQQI", 0, 0, len(inner), 0)
        data += record(0x06, sizes, text(compression), struct.pack("<Q", len(packed)), packed)
        ends.append(len(data))
    return data, ends


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_all_chunks_before_the_cut_are_recovered(tmp_path: Path, compression: str) -> None:
    data, ends = own_mcap(compression, 40)
    path = tmp_path / "run.mcap"
    path.write_bytes(data[: ends[3] + 30])
    log = read_log(path, COLUMNS, form=Rosbag(salvage=True))
    assert log.samples == 160
    np.testing.assert_array_equal(log.q, Q[:160, ::-1])


def test_a_cut_anywhere_gives_the_first_messages_or_an_error(tmp_path: Path) -> None:
    data, _ = own_mcap("zstd", 25)
    path = tmp_path / "run.mcap"
    for size in GENERATOR.integers(9, len(data), 12):
        path.write_bytes(data[:size])
        try:
            log = read_log(path, COLUMNS, form=Rosbag(salvage=True))
        except DynidentError as error:
            assert "\n" not in str(error)
        else:
            np.testing.assert_array_equal(log.q, Q[: log.samples, ::-1])


def test_damage_in_the_middle_is_an_error_or_the_rest(tmp_path: Path) -> None:
    data = mcap(tmp_path, states()).read_bytes()
    path = tmp_path / "damaged.mcap"
    for place in GENERATOR.integers(0, len(data), 12):
        path.write_bytes(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        try:
            read_log(path, COLUMNS)
        except DynidentError as error:
            assert "\n" not in str(error)


def streamed(path: Path, columns: ColumnMap = COLUMNS, rows: int = 20) -> tuple[list[Log], Any]:
    """Return the blocks of a recording and where it comes from."""
    stream = stream_log(path, columns, folder=path.parent)
    blocks = stream.blocks(rows)
    return list(blocks), blocks.result


def test_blocks_of_a_recording_are_the_whole_though_messages_come_late_twice_or_without_numbers(tmp_path: Path) -> None:
    messages = [list(message) for message in states()]
    messages[40], messages[41] = messages[41], messages[40]
    messages[90:90] = [messages[90]]
    messages[130][2] = state(FIRST + 129 * STEP + 1, NAMES, Q[130] * np.nan, DQ[130], TAU[130])
    messages.insert(20, ["/joint_states", 0, state(FIRST + 20 * STEP, NAMES, Q[20], DQ[20])])  # without efforts
    for k, message in enumerate(messages):
        message[1] = FIRST + k * STEP
    path = mcap(tmp_path, [tuple(message) for message in messages])
    whole = read_log(path, COLUMNS)
    logs, source = streamed(path)
    assert len(logs) > 1 or STEP * N < 2e9
    np.testing.assert_array_equal(np.concatenate([log.time for log in logs]), whole.time)
    for name in ("q", "dq", "torque"):
        np.testing.assert_array_equal(np.concatenate([getattr(log, name) for log in logs]), getattr(whole, name))
    assert source.rows == whole.samples
    for words in ("1 of 201 messages left out", "1 messages put into the order", "1 messages left out that repeat"):
        assert any(words in step for step in source.steps) and any(words in step for step in whole.source.steps)
    assert any("with 4 of the columns only left out" in step for step in source.steps)


def test_blocks_do_not_wait_for_the_end_of_a_recording(tmp_path: Path) -> None:
    messages = [
        ("/joint_states", FIRST + k * 10**8, state(FIRST + k * 10**8, NAMES, Q[k], DQ[k], TAU[k])) for k in range(N)
    ]
    logs, _ = streamed(mcap(tmp_path, messages))
    assert len(logs) >= 5 and sum(log.samples for log in logs) == N and max(log.samples for log in logs) <= 40


def test_faults_of_a_recording_are_found_in_blocks_too(tmp_path: Path) -> None:
    (tmp_path / "zero").mkdir()
    zero = [(topic, received, state(0, NAMES, Q[0], DQ[0], TAU[0])) for topic, received, _ in states()]
    with pytest.raises(LogFormatError, match="stamps in the headers are all 0"):
        streamed(mcap(tmp_path / "zero", zero))
    (tmp_path / "nan").mkdir()
    broken = [
        (topic, received, state(received, NAMES, Q[k] * (np.nan if k % 5 else 1), DQ[k], TAU[k]))
        for k, (topic, received, _) in enumerate(states())
    ]
    with pytest.raises(LogFormatError, match="is not finite in 160 of 200 messages"):
        streamed(mcap(tmp_path / "nan", broken))


def test_topics_that_are_put_together_are_streamed_as_a_whole(tmp_path: Path) -> None:
    def half(joint: int) -> Messages:
        return [
            (
                "/joint_states",
                FIRST + k * STEP + joint,
                state(
                    FIRST + k * STEP,
                    NAMES[joint : joint + 1],
                    *[values[k, joint : joint + 1] for values in (Q, DQ, TAU)],
                ),
            )
            for k in range(N)
        ]

    path = mcap(tmp_path, sorted([*half(0), *half(1)], key=lambda message: message[1]))
    logs, source = streamed(path)
    whole = read_log(path, COLUMNS)
    np.testing.assert_array_equal(np.concatenate([log.q for log in logs]), whole.q)
    assert source == whole.source


@pytest.mark.parametrize("beside", [False, True])
def test_states_with_signals_by_name_are_read_as_states_of_joints(tmp_path: Path, beside: bool) -> None:
    """As ros2_control publishes them, each joint with signals of its own; states of joints beside them come first."""
    types = ROS2.types
    value, dynamic = (types[f"control_msgs/msg/{name}"] for name in ("InterfaceValue", "DynamicJointState"))
    own = ("effort", "position", "velocity")
    messages = [
        (
            "/dynamic_joint_states",
            FIRST + k * STEP,
            dynamic(
                header(FIRST + k * STEP),
                ["head", *NAMES],
                [
                    value(["position"], np.array([0.1])),
                    *(value(list(own), np.array([TAU[k, j], Q[k, j], DQ[k, j]])) for j in range(2)),
                ],
            ),
        )
        for k in range(N)
    ]
    path = mcap(tmp_path, [*messages, *(states() if beside else ())])
    check(read_log(path, COLUMNS))
    assert ("head.position" in read_header(path)) != beside


@pytest.mark.parametrize("arms", [1, 2])
def test_a_draft_reads_the_topic_with_joints_of_the_robot(tmp_path: Path, arms: int) -> None:
    """A gripper beside the arm has a topic of its own, whose joints the robot model lacks."""
    (tmp_path / "arm.urdf").write_text(URDF)
    grip = [("/gripper/joint_states", at, state(at, ["finger"], [0.1], [0.0], [1.0])) for _, at, _ in states()]
    path = mcap(tmp_path, [*states("/robot/joint_states"), *(grip if arms == 1 else states("/other"))])
    if arms == 2:
        with pytest.raises(LogFormatError, match="2 topics with states of joints; name topics"):
            draft_case(str(tmp_path / "arm.urdf"), str(path), tmp_path)
        return
    draft = draft_case(str(tmp_path / "arm.urdf"), str(path), tmp_path)
    assert "format: {rosbag: {topics: [/robot/joint_states]}}" in draft.text
    assert draft.recognition.joints.names == ("shoulder", "elbow")
