"""What spoils a log of commands and positions is named, and nothing is said of a sound one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_bench import PENDULUM, parameters, virtual_logs, write_csv

from dynident.actuators.drive_law import preset
from dynident.actuators.identify import identify_actuators
from dynident.actuators.servo_log import ServoColumns, ServoLog, ServoSetup, is_read_back, laws_of
from dynident.actuators.virtual import ServoBench, virtual_log
from dynident.cli.main import main
from dynident.diagnosis.servo_findings import arm_findings, servo_findings
from dynident.errors import LogMismatch
from dynident.model.robot import Robot

LAW = preset("feetech_sts3215")


@pytest.fixture(scope="module")
def log(robot: Robot) -> ServoLog:
    return virtual_logs(robot, parameters(), gains=(2.0,))[2]


def names(log: ServoLog) -> list[tuple[str, str]]:
    return [(one.severity, one.name) for one in servo_findings(log, (LAW,))]


def test_a_sound_log_has_no_findings(log: ServoLog) -> None:
    assert names(log) == []


def test_each_fault_is_found(log: ServoLog) -> None:
    def changed(**signals: object) -> ServoLog:
        return ServoLog(**{**vars(log), **signals})  # type: ignore[arg-type]

    failed = log.failed.copy()
    failed[::50] = True
    assert names(changed(failed=failed)) == [("warning", "failed reads")]
    assert names(changed(time=log.time + (log.time > 3.0) * 0.5)) == [("warning", "gaps in time")]
    assert names(changed(kp=200.0)) == [("error", "saturated")]
    coarse = np.round(log.q / 0.05) * 0.05
    assert names(changed(q=coarse)) == [("warning", "quantisation")]
    assert names(changed(q=0.3 + 0.0 * log.q)) == [("error", "no motion")]
    assert names(changed(enabled=log.enabled | True)) == [("note", "no free swing")]
    for trained, is_told in (((1.0, 1.5), True), ((1.0, 4.0), False), ((), False)):
        assert [one.name for one in servo_findings(log, (LAW,), (), trained)] == ["extrapolation"] * is_told


def test_a_joint_that_is_held_and_a_short_way_to_full_speed_are_no_faults(log: ServoLog) -> None:
    """A held joint sags by some steps of its encoder; a release is at its limit until the drive is off."""
    held = replace(log, q=np.round(0.03 * log.q / 1.5e-3) * 1.5e-3, q_ref=np.full_like(log.q_ref, 0.1))
    assert names(held) == []
    assert names(replace(held, q_ref=log.q_ref)) == [("warning", "quantisation")]
    time = log.time
    pushed = replace(log, q_ref=log.q + 8.0 * (time < 1.6)[:, None], enabled=(time < 3.0)[:, None], kp=2.0)
    assert names(pushed) == []
    assert names(replace(pushed, q_ref=log.q + 8.0 * (time < 2.5)[:, None])) == [("warning", "saturated")]


def test_saturation_for_long_is_no_fault_beside_a_log_below_the_limit(log: ServoLog) -> None:
    """The motions of excite saturate on purpose; throughout, or in all logs, it is one."""
    limited = replace(log, q_ref=log.q + 8.0 * (log.time < 2.5)[:, None], enabled=(log.time < 3.0)[:, None], kp=2.0)
    held = replace(log, q_ref=np.full_like(log.q_ref, 0.1))
    for others, is_told in (((limited,), True), ((limited, held), True), ((limited, log), False)):
        assert [one.name for one in servo_findings(limited, (LAW,), others)] == ["saturated"] * is_told
    assert [one.severity for one in servo_findings(replace(log, kp=200.0), (LAW,), (log,))] == ["error"]


def test_a_command_that_is_late_alone_is_no_saturation(log: ServoLog) -> None:
    """At a high gain the way of some hundredths of a second is an error beyond full duty; a lasting error is one."""
    late = np.interp(log.time - 0.02, log.time, log.q_ref[:, 0])[:, None]
    stiff = replace(log, q=late, kp=60.0)
    assert [one for one in names(stiff) if one[1] == "saturated"] == []
    assert ("error", "saturated") in names(replace(stiff, q=late + 2.0))


@pytest.mark.parametrize("size", [2.9, 0.5], ids=["far commands", "near commands"])
def test_a_drive_of_an_unknown_law_that_is_saturated_throughout_is_named(robot: Robot, size: float) -> None:
    """Commands that jump to and fro far off, too fast to be reached: the size of the error has no effect.

    Logs that are saturated in part, below the limit, or where only stiction has one size, are not.
    """
    law, time = preset("position_servo"), np.arange(0.0, 6.0, 0.005)
    bench, setup = ServoBench(robot, LAW), ServoSetup((law,), ServoColumns(("joint1",)), "m1")
    limited = []
    for kp in (600.0, 601.0):  # the limit is at an error of 10 mrad
        jumps = size * np.sign(np.sin(0.01 * kp * time + 0.5 * np.sin(0.003 * kp * time)))
        limited.append(replace(virtual_log(bench, parameters(), time, jumps, kp), kp=float("nan")))
    below = np.mean([np.abs(log.q_ref - log.q) < LAW.limit / 600.0 / LAW.error_gain for log in limited])
    assert (below < 0.02) == (size > 1.0)
    told = [(one.severity, one.name, one.joint) for one in arm_findings(robot, limited, laws_of(setup, limited))]
    assert (("error", "saturated", "joint1") in told) == (size > 1.0)
    if size > 1.0:
        with pytest.raises(LogMismatch, match=r"joint1 is at its limit throughout.* log slower or smaller motions"):
            identify_actuators(robot, setup, limited)
        assert "saturated" not in [one.name for one in arm_findings(robot, limited, (LAW,))]  # by kp and law, or never
    for gains, coulomb in (((0.5,), 0.2), ((2.0, 20.0), 0.04)):
        logs = [replace(log, kp=float("nan")) for log in virtual_logs(robot, parameters(coulomb=coulomb), gains=gains)]
        assert [one.name for one in arm_findings(robot, logs, laws_of(setup, logs))] == []


def test_where_all_logs_are_saturated_no_direction_is_told(log: ServoLog, robot: Robot) -> None:
    """Commands that are turned over are named where the duty is below its limit."""
    turned = replace(log, q_ref=-log.q_ref)
    assert [one.name for one in arm_findings(robot, [turned], (LAW,))] == ["direction"]
    assert arm_findings(robot, [replace(turned, kp=600.0)], (LAW,)) == []


def test_a_joint_that_no_log_moves_is_named(log: ServoLog) -> None:
    still = replace(log, q=1e-3 * log.q, q_ref=1e-3 * log.q_ref)
    for others, is_told in (((still,), True), ((still, log), False)):
        assert ("one pose" in [one.name for one in servo_findings(still, (LAW,), others)]) is is_told


def test_an_end_stop_is_named(robot: Robot, log: ServoLog) -> None:
    """An arm that is let go and comes to rest on a table, at a limit of the robot model; led there, or swinging."""
    names = ("time", "q", "q_ref", "dq_ref", "added", "enabled", "supply", "failed")
    swing = replace(log, **{name: getattr(log, name)[log.time > 1.6] for name in names})
    stop = 0.3
    stopped = replace(swing, name="stopped", q=np.maximum(swing.q, stop))
    assert swing.q.min() < 0.0 and swing.q[0] > stop + 0.2
    limits = replace(robot.active[0].limits, lower=stop)
    limited = replace(robot, joints=tuple(replace(one, limits=limits) for one in robot.joints))
    (found,) = arm_findings(limited, [stopped, stopped])
    assert (found.severity, found.name) == ("warning", "end stop") and "2 of 2 logs (stopped, ...)" in found.evidence
    assert "end stop" not in [one.name for one in arm_findings(limited, [swing])]
    led = replace(stopped, q_ref=stopped.q, enabled=np.ones_like(stopped.enabled))
    assert "end stop" not in [one.name for one in arm_findings(limited, [led])]
    logs = [*virtual_logs(robot, parameters(), gains=(2.0, 6.0)), stopped]
    joint = identify_actuators(robot, ServoSetup((LAW,), ServoColumns(("joint1",)), "m1"), logs).joints[0]
    assert any("do not follow 1 of 7 logs (stopped;" in text and "end stop" in text for text in joint.remarks)


def test_commands_that_are_read_back_are_named(log: ServoLog, robot: Robot) -> None:
    """A position that is read twice, with the noise of its encoder."""
    noise = np.random.default_rng(0).normal(0.0, 1e-3, log.q.shape)
    twice = replace(log, q_ref=log.q + noise)
    assert names(twice) == [("warning", "command read back")] and is_read_back(twice, 0)
    joint = identify_actuators(robot, ServoSetup((LAW,), ServoColumns(("joint1",)), "m1"), [twice]).joints[0]
    assert any("where they are read back" in text for text in joint.remarks)
    for own in virtual_logs(robot, parameters(), gains=(2.0, 20.0)):
        assert not is_read_back(own, 0) and not is_read_back(replace(own, q=own.q + noise), 0)


def test_a_late_velocity_is_named_with_its_lag(log: ServoLog) -> None:
    """As the moving average of a servo's firmware makes it; an exact one, noise and another unit are no lag."""
    exact = np.gradient(log.q, log.time, axis=0)
    noise = np.random.default_rng(0).normal(0.0, 0.3, exact.shape)
    late = np.interp(log.time - 0.035, log.time, exact[:, 0])[:, None]
    for dq, lags in ((exact, False), (exact + noise, False), (2.0 * exact, False), (late, True), (late + noise, True)):
        found = servo_findings(replace(log, dq=dq), (LAW,))
        assert [one.name for one in found] == ["velocity lag"] * lags
        assert not lags or 33.0 <= float(found[0].evidence.split()[3]) <= 37.0


def test_positions_beyond_the_limits_are_named(log: ServoLog, robot: Robot) -> None:
    """A whole turn moves no weight, so that only the limits of the robot model tell it; a free swing keeps them."""
    assert arm_findings(robot, [log]) == []
    (found,) = arm_findings(robot, [replace(log, q=log.q + 2.0 * np.pi, q_ref=log.q_ref + 2.0 * np.pi)])
    assert (found.severity, found.name) == ("warning", "joint limits") and "log: zero" in found.remedy


def test_check_is_the_command_for_it(
    log: ServoLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("pendulum.urdf").write_text(PENDULUM)
    write_csv(log, Path("drop_kp2.csv"))
    write_csv(log, Path("drop_kp200.csv"))
    Path("case.yaml").write_text(
        "case: 2\nrobot: pendulum.urdf\nservo: {law: feetech_sts3215, kp: 'kp{}', enabled: torque_enable}\n"
        "log: {columns: {time: t, q: [q1], q_ref: [q_ref1], torque: none}}\n"
    )
    write_csv(replace(log, enabled=np.ones_like(log.enabled)), Path("chirp_kp2.csv"))
    assert main(["check", "case.yaml", "chirp_kp2.csv"]) == 0
    assert "no free swing (joint1)" in capsys.readouterr().out
    assert main(["check", "case.yaml", "drop_kp2.csv", "chirp_kp2.csv"]) == 0  # one log with a free swing is enough
    answer = capsys.readouterr().out
    assert "nothing found" in answer and "free swing" not in answer
    assert main(["check", "case.yaml", "drop_kp200.csv", "--json"]) == 1
    (found,) = json.loads(capsys.readouterr().out)["logs"][0]["findings"]
    assert found["name"] == "saturated" and found["severity"] == "error"
    degrees = replace(log, q=np.degrees(0.2 * log.q), q_ref=np.degrees(0.2 * log.q_ref))  # within 40: not by itself
    assert np.ptp(degrees.q) < 30.0
    write_csv(degrees, Path("degrees_kp2.csv"))
    assert main(["check", "case.yaml", "degrees_kp2.csv"]) == 1
    assert "the joint travels 6.4: they are counts, degrees" in capsys.readouterr().err
    write_csv(replace(log, enabled=~log.enabled), Path("inverted_kp2.csv"))
    for words in (["check", "case.yaml"], ["identify", "-o", "a.json", "case.yaml"]):
        assert main([*words, "inverted_kp2.csv"]) == 1
        assert "the column of the torque is inverted: turn it over" in capsys.readouterr().err
