"""Logs of commands and positions: what is read, and each fault with its name and the next step."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_bench import motions, parameters, virtual_logs, write_csv

from dynident.actuators.drive_law import preset
from dynident.actuators.joint_load import with_payload
from dynident.actuators.servo_files import kp_of, read_servo_logs
from dynident.actuators.servo_log import ServoColumns, ServoLog, ServoSetup, laws_of
from dynident.actuators.torque_state import check_torque_state
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.data.formats import ColumnMap
from dynident.errors import DynidentError, LogFormatError, LogMismatch
from dynident.model.robot import Robot
from dynident.simulation.effects import Payload

COLUMNS = ServoColumns(("joint1",), enabled=("torque_enable",), kp=4.0)


@pytest.fixture(scope="module")
def log(robot: Robot) -> ServoLog:
    return virtual_logs(robot, parameters(), gains=(4.0,))[2]


def changed(log: ServoLog, **signals: object) -> ServoLog:
    return ServoLog(**{**vars(log), **signals})  # type: ignore[arg-type]


def test_a_table_and_bam_json_are_the_same_log(log: ServoLog, tmp_path: Path) -> None:
    table = read_servo_logs(write_csv(log, tmp_path / "a.csv"), COLUMNS)[0]
    entries = [
        {"timestamp": t, "position": q, "goal_position": g, "torque_enable": bool(on), "input_volts": 7.4}
        for t, q, g, on in zip(table.time, table.q[:, 0], table.q_ref[:, 0], table.enabled[:, 0], strict=True)
    ]
    (tmp_path / "b.json").write_text(json.dumps({"kp": 4, "mass": 0.8, "entries": entries}))
    bam = read_servo_logs(tmp_path / "b.json", ServoColumns(("joint1",)))[0]
    assert bam.kp == table.kp == 4.0
    setup = ServoSetup((preset("feetech_sts3215"),), ServoColumns(("joint1",)))
    assert laws_of(setup, [bam]) == setup.laws  # a gain that the log alone states is one
    assert laws_of(setup, [changed(bam, kp=np.nan)])[0].gain_is_free
    for name in ("time", "q", "q_ref", "enabled"):
        assert np.array_equal(getattr(bam, name), getattr(table, name)), name
    (tmp_path / "c.json").write_text("{}")
    with pytest.raises(LogFormatError, match=r"no log of BAM .*'entries'"):
        read_servo_logs(tmp_path / "c.json", COLUMNS)


REGISTERS: dict[str, Callable[[int], int]] = {
    "dynamixel": lambda n: int.from_bytes(n.to_bytes(4, "little", signed=True), "little"),
    "dynamixel_mx": lambda n: int.from_bytes(n.to_bytes(2, "little", signed=True), "little"),
    "feetech": lambda n: n if n >= 0 else -n | 0x8000,
    "feetech_complement": lambda n: n % 2**16,
}


@pytest.mark.parametrize("family", REGISTERS)
def test_counts_of_a_register_are_angles(log: ServoLog, tmp_path: Path, family: str) -> None:
    """Turned so far that some of the counts are negative; signed already they are the same."""
    how = replace(COLUMNS, counts=family, columns=ColumnMap(joints=("joint1",), zero=(4.0,)))

    def table(register: Callable[[int], int], name: str) -> ServoLog:
        def counts(values: np.ndarray) -> np.ndarray:
            whole = np.round((values - 4.0) * 4096 / 6.283185307179586 + 2048).astype(int)
            assert whole.min() < 0 < whole.max()
            return np.array([float(register(int(n))) for n in whole])

        file = tmp_path / name
        table = np.column_stack([log.time, counts(log.q[:, 0]), counts(log.q_ref[:, 0]), log.enabled[:, 0]])
        np.savetxt(file, table, "%.12g", ",", header="t,q1,q_ref1,torque_enable", comments="")
        return read_servo_logs(file, how)[0]

    found, signed = table(REGISTERS[family], "a.csv"), table(lambda n: n, "b.csv")
    for name in ("q", "q_ref"):
        assert np.max(np.abs(getattr(found, name) - getattr(log, name))) < 0.51 * 6.2832 / 4096
        assert np.array_equal(getattr(found, name), getattr(signed, name))
    if family.startswith("feetech"):
        other = REGISTERS.keys() - {family, "dynamixel", "dynamixel_mx"}
        with pytest.raises(LogMismatch, match=rf"rad as counts of {family}; .*: by {other.pop()} it spans .* rad"):
            table(REGISTERS["feetech" if family == "feetech_complement" else "feetech_complement"], "d.csv")
    with pytest.raises(LogMismatch, match=r"q of joint1 is .* in sample \d+: no count"):
        read_servo_logs(write_csv(log, tmp_path / "c.csv"), how)


def test_failed_reads_are_marked_and_bridged(log: ServoLog, tmp_path: Path) -> None:
    q = log.q.copy()
    q[[50, 200], 0], q[300, 0] = np.nan, q[300, 0] + 2.0
    found = read_servo_logs(write_csv(changed(log, q=q), tmp_path / "a.csv"), COLUMNS)[0]
    assert np.flatnonzero(found.failed[:, 0]).tolist() == [50, 200, 300]
    assert np.max(np.abs(found.q - log.q)) < 0.02
    sound = read_servo_logs(write_csv(log, tmp_path / "b.csv"), COLUMNS)[0]
    assert not sound.failed.any()


@pytest.mark.parametrize("share", [0.002, 0.03])
def test_reads_that_fail_often_are_found_too(log: ServoLog, tmp_path: Path, share: float) -> None:
    """Positions of 0 in place of them; those near 0 look right."""
    random = np.random.default_rng(0)
    bad = random.random(len(log.q)) < share
    most = int(np.argmax(np.abs(log.q[:, 0])))
    bad[most : most + 3] = True  # three in a row
    far = bad & (np.abs(log.q[:, 0]) > 13.0 * np.quantile(np.abs(np.diff(log.q[:, 0])), 0.99))
    path = write_csv(changed(log, q=np.where(bad[:, None], 0.0, log.q)), tmp_path / "a.csv")
    failed = read_servo_logs(path, COLUMNS)[0].failed[:, 0]
    assert failed[far].mean() > 0.9 and failed[most : most + 3].all()
    assert failed[~bad].mean() <= 2.0 * share**2  # a right read between two that fail looks like one


@pytest.mark.parametrize("share", [0.03, 0.3, 0.7])
def test_an_encoder_that_ticks_at_rest_has_no_failed_reads(log: ServoLog, tmp_path: Path, share: float) -> None:
    count, random = 2 * np.pi / 4096, np.random.default_rng(1)
    q = np.round(log.q / count) * count
    q[:, 0] = count * (500 + (random.random(len(q)) < share))
    assert not read_servo_logs(write_csv(changed(log, q=q), tmp_path / "a.csv"), COLUMNS)[0].failed.any()
    q[100, 0] = 0.0
    found = read_servo_logs(write_csv(changed(log, q=q), tmp_path / "b.csv"), COLUMNS)[0]
    assert np.flatnonzero(found.failed[:, 0]).tolist() == [100]


FAULTS: list[tuple[str, Callable[[ServoLog], dict[str, object]], str, str]] = [
    ("command is measurement", lambda log: {"q_ref": log.q}, "equals its measurement", "goal position"),
    ("command is a later measurement", lambda log: {"q_ref": np.roll(log.q, -1, 0)}, "1 sample later", "goal position"),
    ("command is an earlier one", lambda log: {"q_ref": np.roll(log.q, 3, 0)}, "3 samples before", "leader arm"),
    ("one pose", lambda log: {"q": 0 * log.q, "q_ref": 0 * log.q}, "stands in one pose", "tens of degrees"),
    ("counts", lambda log: {"q": log.q * 4096 / 6.2832}, "they are counts, degrees", "counts: dynamixel"),
    ("a command in degrees", lambda log: {"q_ref": 57.3 * log.q_ref}, "its commands 85.95 rad", "position: deg"),
    ("never on", lambda log: {"enabled": ~log.enabled & False}, "never on", "inverted"),
    ("no reads", lambda log: {"q": np.where(np.arange(len(log.q))[:, None] % 3, np.nan, log.q)}, "reads", "bus"),
]


@pytest.mark.parametrize(("change", "evidence", "step"), [one[1:] for one in FAULTS], ids=[one[0] for one in FAULTS])
def test_a_fault_is_named_with_the_next_step(
    log: ServoLog, tmp_path: Path, change: Callable[[ServoLog], dict[str, object]], evidence: str, step: str
) -> None:
    path = write_csv(changed(log, **change(log)), tmp_path / "a.csv")
    with pytest.raises(LogMismatch) as caught:
        read_servo_logs(path, COLUMNS)
    assert evidence in caught.value.evidence and step in caught.value.step and "a.csv" in str(caught.value)


@pytest.mark.parametrize("kp", [2.0, 16.0])
@pytest.mark.parametrize("motion", ["chirp", "steps", "hold"])
@pytest.mark.parametrize(("first", "last"), [(2.0, 3.5), (4.0, 9.0)], ids=["off between", "off at last"])
def test_an_inverted_torque_column_is_named(robot: Robot, motion: str, kp: float, first: float, last: float) -> None:
    """Inverted it is refused, right it is not: also where the command goes on while the joint swings freely.

    A model with another weight, its axis the same, makes no difference.
    """
    time, each = motions()
    command = np.full_like(time, 1.0) if motion == "hold" else each[motion][0]
    on = (time < first) | (time > last)
    log = virtual_log(ServoBench(robot, preset("feetech_sts3215")), parameters(), time, command, kp, on)
    other = with_payload(robot, Payload(0.3, (0.0, 0.0, -0.1)))
    for known in (robot, other):
        check_torque_state(known, log)
        with pytest.raises(LogMismatch, match="joint1 is driven where its drive is off by the column") as caught:
            check_torque_state(known, changed(log, enabled=~log.enabled))
        assert "inverted: turn it over" in caught.value.step


@pytest.mark.parametrize(("first", "last"), [(2.0, 3.5), (4.0, 9.0)], ids=["off between", "off at last"])
def test_an_inverted_torque_column_is_named_beside_a_slew_limit(robot: Robot, first: float, last: float) -> None:
    """The goal inside the drive runs behind the steps of the command, and so does its torque."""
    time, each = motions()
    on = (time < first) | (time > last)
    true = parameters(slew_limit=2.2)
    log = virtual_log(ServoBench(robot, preset("feetech_sts3215")), true, time, each["steps"][0], 4.0, on)
    check_torque_state(robot, log)
    with pytest.raises(LogMismatch, match="joint1 is driven where its drive is off by the column"):
        check_torque_state(robot, changed(log, enabled=~log.enabled))


@pytest.mark.parametrize("is_tried", [True, False])
def test_a_joint_that_rests_where_its_drive_is_off(robot: Robot, is_tried: bool) -> None:
    """Under a command that moves the inverted column is named; one that stands tells nothing."""
    time, each = motions()
    on, chirp = time > 1.5, each["chirp"][0]
    command = chirp if is_tried else np.where(on, chirp, 0.0)
    log = virtual_log(ServoBench(robot, preset("feetech_sts3215")), parameters(), time, command, 4.0, on)
    check_torque_state(robot, log)
    with pytest.raises(LogMismatch, match="inverted") if is_tried else nullcontext():
        check_torque_state(robot, changed(log, enabled=~log.enabled))


def test_a_missing_command_is_named(log: ServoLog, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.csv", np.column_stack([log.time, log.q]), "%.9g", ",", header="t,q1", comments="")
    with pytest.raises(LogFormatError, match=r"no column of the command \('q_ref1'\); log the commanded position"):
        read_servo_logs(tmp_path / "a.csv", ServoColumns(("joint1",)))


def test_the_gain_of_a_log_is_stated_in_four_ways() -> None:
    assert kp_of("x/run_kp250.csv", "kp{}") == 250 and kp_of("a.csv", 32) == 32
    assert kp_of("logs/a.csv", {"other/a.csv": 7.0}) == 7 and np.isnan(kp_of("a.csv", None))
    for kp in ("kp{}", {"b.csv": 1.0}):
        with pytest.raises(DynidentError, match="kp"):
            kp_of("a.csv", kp)
