"""dynident payload, monitor and predict on logs of an arm with and without a load."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from benchmarks.loaded_arm import with_body
from command_answers import documented

from dynident import (
    ColumnMap,
    DynamicModel,
    Inertia,
    Log,
    identify,
    read_estimate,
    read_log,
    read_robot,
    write_estimate,
    write_log,
)
from dynident.cli.main import main
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.identification.problem.choices import GainUncertainty
from dynident.model.friction import FRICTION
from scara_logs import recorded

BODY = Inertia.from_centre_of_mass(2.0, [0.05, 0.02, -0.03], np.diag([0.01, 0.01, 0.008]))


def touched(log: Log, contact: float) -> Log:
    """Return the log with a torque from outside on the first joint for a second."""
    assert log.torque is not None
    torque = log.torque.copy()
    torque[2000:2100, 0] -= contact
    return replace(log, torque=torque)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an estimate, its log, another clean one, one with a load and one with a contact."""
    folder = tmp_path_factory.mktemp("cell")
    robot = read_robot("generic-scara")
    write_log(recorded(robot, 1, 3000), folder / "train.csv")
    write_log(recorded(robot, 2, 3000), folder / "clean.csv")
    write_log(recorded(with_body(robot, BODY), 3, 3000), folder / "loaded.csv")
    write_log(touched(recorded(robot, 4, 3000), 60.0), folder / "contact.csv")
    model = DynamicModel(robot, (FRICTION.make("coulomb"), FRICTION.make("viscous")))
    how = Preprocessing(AsGiven(), rest="keep")
    columns = ColumnMap(joints=robot.joint_names, ddq=tuple(f"ddq{i}" for i in range(1, 5)))
    estimate = identify(model, [read_log(folder / "train.csv", columns)], "wls", how)
    write_estimate(replace(estimate, columns=columns), folder / "estimate.json")
    return folder


@pytest.fixture
def cell(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the folder, the working directory of the test."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_payload_states_mass_and_what_the_arm_cannot_tell(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["payload", "estimate.json", "loaded.csv", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"schema", *documented("payload")}
    ten = {one["name"]: one for one in found["parameters"]}
    assert abs(ten["m"]["value"] - 2.0) < 2 * ten["m"]["half_width"] < 0.5
    assert ten["Ixx"]["label"] == "not determined" and ten["Ixx"]["value"] is None  # all axes are vertical
    assert found["consistent_body"]["mass"] == pytest.approx(2.0, abs=0.3)
    assert main(["payload", "estimate.json", "loaded.csv", "--quiet"]) == 1
    shown, told = capsys.readouterr()
    assert told.startswith("error: loaded.csv: cz not determined well enough: record larger and faster motions")
    assert "payload in the frame" in shown and "no form for controllers: cz not determined well enough; " in shown
    assert "where no axis does, as along the axes of a SCARA, enter a measured centre of mass" in shown
    assert main(["payload", "estimate.json", "train.csv", "--quiet"]) == 1
    assert "was identified from it" in capsys.readouterr().err


def test_monitor_finds_the_contact_and_nothing_else(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["monitor", "estimate.json", "clean.csv", "--rate", "0.1", "--quiet"]) == 0
    shown = capsys.readouterr().out
    assert "thresholds from 1 clean log of" in shown and "median threshold" in shown and "Thresholds follow" in shown
    assert main(["monitor", "estimate.json", "contact.csv", "--clean", "train.csv", "clean.csv", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"schema", *documented("monitor")}
    first = found["logs"][0]["alarms"][0]
    assert first["joint"] == read_robot("generic-scara").joint_names[0]
    assert 20.0 <= first["start"] <= 20.05 and first["peak"] == pytest.approx(60.0, rel=0.3)
    assert main(["monitor", "estimate.json", "clean.csv", "--rate", "never"]) == 1
    assert "false alarms an hour" in capsys.readouterr().err


def test_monitor_says_where_the_rate_is_another_than_that_of_the_clean_runs(
    cell: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    head, *rows = Path("clean.csv").read_text().splitlines()
    slow = "\n".join([head, *rows[::2]]) + "\n"
    Path("slow.csv").write_text(slow)
    rules = ["monitor", "estimate.json", "--clean", "train.csv", "clean.csv", "--rate", "0.1", "--quiet"]
    for name, told in (("clean.csv", False), ("slow.csv", True)):
        main([rules[0], rules[1], name, *rules[2:]])
        shown = capsys.readouterr().out
        assert ("50 samples a second, and thresholds of clean runs with 100" in shown) is told
        main([rules[0], rules[1], name, *rules[2:], "--json"])
        assert bool(json.loads(capsys.readouterr().out)["logs"][0]["other_rate"]) is told
        monkeypatch.setattr("sys.stdin", StringIO(Path(name).read_text()))
        main([rules[0], rules[1], "-", *rules[2:]])
        assert ("name clean runs of this rate (--clean)" in capsys.readouterr().out) is told
        monkeypatch.setattr("sys.stdin", StringIO(Path(name).read_text()))
        main([rules[0], rules[1], "-", *rules[2:], "--json"])
        assert any("remark" in json.loads(line) for line in capsys.readouterr().out.splitlines()) is told


def test_monitor_tells_alarms_of_a_stream_as_they_begin(
    cell: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rules = ["--clean", "train.csv", "clean.csv"]
    main(["monitor", "estimate.json", "contact.csv", *rules, "--json"])
    whole = [one["start"] for one in json.loads(capsys.readouterr().out)["logs"][0]["alarms"]]
    monkeypatch.setattr("sys.stdin", StringIO(Path("contact.csv").read_text()))
    assert main(["monitor", "estimate.json", "-", *rules, "--json"]) == 1
    *alarms, end = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert end == {"schema": 2, "samples": 3000, "seconds": pytest.approx(29.99), "alarms": len(alarms), "gaps": 0}
    assert [one["time"] for one in alarms] == pytest.approx(whole) and abs(alarms[0]["torque"]) > alarms[0]["threshold"]
    monkeypatch.setattr("sys.stdin", StringIO(Path("clean.csv").read_text()))
    assert main(["monitor", "estimate.json", "-", *rules, "--rate", "0.1", "--quiet"]) == 0
    assert capsys.readouterr().out == "0 alarms in 3000 samples, 29.99 s\n"
    header, *rows = Path("clean.csv").read_text().splitlines()
    for text, evidence in (
        ("", "it ended before its first row"),
        ("\n".join([header, rows[0], rows[1].replace(",", ",x", 1)]), "standard input:3: column 'q1' holds 'x"),
        ("\n".join([header, rows[0], rows[0]]), "row 2: time in column 't' repeats"),
        ("\n".join([header.replace(",q1,", ",z,"), *rows[:3]]), "no column 'q1'"),
    ):
        monkeypatch.setattr("sys.stdin", StringIO(text))
        assert main(["monitor", "estimate.json", "-", *rules]) == 1
        assert evidence in capsys.readouterr().err
    assert main(["monitor", "estimate.json", "-", "clean.csv", *rules]) == 1
    assert "standard input is looked at alone" in capsys.readouterr().err


def test_predict_writes_torques_and_bands(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["predict", "estimate.json", "clean.csv", "-o", "tau.csv", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told) == {"schema", *documented("predict")}
    assert all(0.85 < joint["inside"] <= 1.0 for joint in told["joints"])
    rows = np.genfromtxt("tau.csv", delimiter=",", names=True)
    assert len(rows) == told["samples"] == 3000
    assert np.all(rows["half_measured1"] > rows["half_model1"]) and np.all(rows["half_model1"] >= 0)
    assert np.std(rows["tau_model1"] - rows["tau_measured1"]) < 0.05 * np.std(rows["tau_measured1"])
    stamped = recorded(read_robot("generic-scara"), 2, 3000)
    write_log(replace(stamped, time=stamped.time + 1.7e9), "stamped.csv")  # seconds since 1970
    assert main(["predict", "estimate.json", "stamped.csv", "-o", "tau3.csv", "--quiet"]) == 0
    times = np.genfromtxt("tau3.csv", delimiter=",", names=True)["t"]
    np.testing.assert_allclose(times - 1.7e9, stamped.time, atol=1e-5)
    write_log(replace(recorded(read_robot("generic-scara"), 2, 3000), torque=None), "planned.csv")
    assert main(["predict", "estimate.json", "planned.csv", "-o", "tau2.csv", "--quiet"]) == 0
    estimate = read_estimate(Path("estimate.json"))
    assert estimate.columns is not None
    commanded = replace(estimate.columns, q_ref=tuple(f"q_ref{i}" for i in range(1, 5)))
    write_estimate(replace(estimate, columns=commanded), "commanded.json")  # a plan has no commands beside it
    assert main(["predict", "commanded.json", "planned.csv", "-o", "tau3.csv", "--quiet"]) == 0
    assert Path("tau3.csv").read_text() == Path("tau2.csv").read_text()
    assert main(["validate", "commanded.json", "clean.csv", "--quiet"]) == 0
    assert main(["monitor", "commanded.json", "clean.csv", "--clean", "train.csv", "--quiet"]) in (0, 1)
    assert main(["predict", "estimate.json", "clean.csv", "-o", "clean.csv"]) == 1


def test_predict_filters_all_columns_alike(cell: Path) -> None:
    """The ends of a log that begins in motion are left out; friction steps are filtered in both torques."""
    how = Preprocessing(Butterworth(3.0), rest="keep", trim_s=1.0)
    robot = read_robot("generic-scara")
    model = DynamicModel(robot, (FRICTION.make("coulomb"), FRICTION.make("viscous")))
    estimate = identify(model, [recorded(robot, 1, 3000)], "wls", how)
    write_estimate(replace(estimate, preprocessing=replace(how, trim_s=0.0)), "filtered.json")
    assert main(["predict", "filtered.json", "clean.csv", "-o", "tau.csv", "--quiet"]) == 0
    rows = np.genfromtxt("tau.csv", delimiter=",", names=True)
    assert rows["t"][0] == pytest.approx(1.0) and rows["t"][-1] == pytest.approx(28.99) and len(rows) == 2800
    for joint, deviation in enumerate(estimate.joint_deviations, start=1):
        apart = rows[f"tau_model{joint}"] - rows[f"tau_measured{joint}"]
        assert np.std(apart) < 1.3 * deviation and np.abs(apart).max() < 6 * deviation


def test_predict_says_where_its_bands_mean_nothing(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = recorded(read_robot("generic-scara"), 2, 3000)
    assert main(["predict", "estimate.json", "train.csv", "-o", "tau.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["remarks"] == []
    write_log(replace(log, torque=100.0 + np.asarray(log.torque)), "other.csv")
    assert main(["predict", "estimate.json", "other.csv", "-o", "tau.csv"]) == 0
    said = capsys.readouterr().out
    assert "remark: few measured torques lie in the band (" in said and "0 %" in said and "units, signs" in said
    write_log(replace(log, q=3.0 * log.q, torque=None), "wide.csv")
    assert main(["predict", "estimate.json", "wide.csv", "-o", "tau.csv"]) == 0
    assert "remark: extrapolation beyond the training range: position of" in capsys.readouterr().out


def test_predict_says_what_uncertain_gains_leave_out_of_its_bands(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    estimate = read_estimate("estimate.json")
    first, second, *_ = estimate.model.robot.joint_names
    moved = GainUncertainty({first: 0.05, second: 0.0}, (0.0,) * len(estimate.beta))
    write_estimate(replace(estimate, choices=replace(estimate.choices, gain_std=moved)), "gains.json")
    assert main(["predict", "gains.json", "clean.csv", "-o", "tau.csv", "--json"]) == 0
    (remark,) = [one for one in json.loads(capsys.readouterr().out)["remarks"] if "gains" in one]
    assert remark.endswith(f"off as a whole: {first} 5 %")
