"""dynident fleet and dynident track at the terminal."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_answers import documented, refused

from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.identification.files.estimate_file import read_estimate
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.friction import Motion
from dynident.model.robot import Robot

Capture = pytest.CaptureFixture[str]


def top_keys(command: str) -> set[str]:
    return {key.split(".")[0].removesuffix("[]") for key in documented(command)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, planar_2r: Robot, exact_log: Callable[..., Log]) -> Path:
    """A folder with four estimates, a triangle file, a run with friction that changes, and one that is short."""
    place = tmp_path_factory.mktemp("fleet")
    (place / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    how = "friction: [coulomb, viscous]\npreprocessing: {filter: {butterworth: {cutoff_hz: 8}}, rate_hz: 50}"
    (place / "case.yaml").write_text(f"case: 1\nrobot: arm.json\nestimator: wls\n{how}\n")
    model = read_case(place / "case.yaml").model
    assert planar_2r.nominal is not None
    for k in range(5):
        friction = np.array([1.0, 0.5, 1.0, 0.5]) * np.exp(0.1 * np.random.default_rng(k).normal(size=4))
        if k == 4:
            friction[2] *= 40.0
        theta = np.append(planar_2r.nominal, friction)
        log = exact_log(model, theta, noise=0.3, seed=k, samples=1500, rate=100.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), place / f"run{k}.csv")
        command = ["identify", str(place / "case.yaml"), str(place / f"run{k}.csv"), "-o", str(place / f"r{k}.json")]
        assert main([*command, "--quiet", "--cross-validate", "0", "--no-sensitivity"]) == 0
    run = exact_log(
        model, np.append(planar_2r.nominal, [1.0, 0.5, 1.0, 0.5]), noise=0.3, seed=9, samples=2000, rate=100.0
    )
    assert run.dq is not None and run.ddq is not None and run.torque is not None
    more = model.torque(Motion(run.q, run.dq, run.ddq), np.append(np.zeros(20), [0.0, 0.0, 2.0, 0.0]))
    more[:1000] = 0.0
    write_log(Log(run.joints, run.time, run.q, torque=run.torque + more), place / "stuck.csv")
    return place


@pytest.fixture(autouse=True)
def inside(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)


def test_a_fleet_is_written_as_estimates_that_other_commands_take(capsys: Capture, tmp_path: Path) -> None:
    files = [f"r{k}.json" for k in range(5)]
    assert main(["fleet", *files, "-o", str(tmp_path), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) == {"schema", *top_keys("fleet")}
    assert printed["outliers"] == ["r4"] and printed["robots"][4]["furthest"]["parameter"] == "Fc[joint2]"
    saved = json.loads((tmp_path / "fleet.json").read_text())
    assert saved["kind"] == "dynident fleet" and saved["robots"] == printed["robots"]
    one = read_estimate(tmp_path / "r1.json")
    assert one.estimator == "fleet" and one.theta is not None and one.consistency.consistent
    assert one.beta.tolist() == pytest.approx(printed["robots"][1]["beta"])
    assert main(["validate", str(tmp_path / "r1.json"), "run0.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["test"]["total_relative_error"] < 0.2
    assert main(["fleet", *files, "--quiet"]) == 0
    text = capsys.readouterr().out
    assert "r4 is OUT: Fc[joint2] (joint2) is " in text and "after 5 comparisons" in text


def test_triangles_are_robots_too(capsys: Capture, tmp_path: Path) -> None:
    tri = str(tmp_path / "r0.tri")
    assert main(["reduce", "case.yaml", "run0.csv", "-o", tri, "--quiet"]) == 0
    capsys.readouterr()
    assert main(["fleet", tri, "r1.json", "r2.json", "r3.json", "-o", str(tmp_path / "out"), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [one["from"] for one in printed["robots"]] == ["QR factors", "estimate", "estimate", "estimate"]
    found, own = read_estimate(tmp_path / "out" / "r0.json"), read_estimate("r0.json")
    assert np.all(np.abs(found.beta - own.beta) < 3.0 * own.std)
    assert found.train.samples == own.train.samples


def test_what_fleet_refuses(capsys: Capture, tmp_path: Path) -> None:
    assert "a fleet has two or more robots" in refused(capsys, "fleet", "r0.json")
    assert "two files have this name" in refused(capsys, "fleet", "r0.json", "r0.json")
    (tmp_path / "again.json").write_text(Path("r0.json").read_text())
    again = str(tmp_path / "again.json")
    assert "again, which stands on a log that r0 stands on too" in refused(capsys, "fleet", "r0.json", again)
    (tmp_path / "empty.json").write_text("")
    assert "empty.json: line 1 is not JSON" in refused(capsys, "fleet", "r0.json", str(tmp_path / "empty.json"))
    assert "no.json: there is no such file" in refused(capsys, "fleet", "r0.json", "no.json")
    assert "input of this command" in refused(capsys, "fleet", "r0.json", "r1.json", "-o", ".")
    assert "rate = 1.0" in refused(capsys, "fleet", "r0.json", "r1.json", "--rate", "1")
    (tmp_path / "fleet.json").write_text(Path("r0.json").read_text())
    taken = refused(capsys, "fleet", str(tmp_path / "fleet.json"), "r1.json", "-o", str(tmp_path / "out"))
    assert "is that of the whole fleet" in taken


def test_track_names_what_changed_and_writes_the_course(capsys: Capture, tmp_path: Path) -> None:
    course = str(tmp_path / "course.csv")
    assert main(["track", "r0.json", "stuck.csv", "--memory", "5", "-o", course, "--json"]) == 1
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) == {"schema", *top_keys("track")}
    event = printed["events"][0]
    assert (event["kind"], event["owner"]) == ("friction", "joint2") and 10.0 <= event["time"] <= 11.5
    rows = np.genfromtxt(course, delimiter=",", skip_header=1)
    assert rows.shape == (printed["evaluations"], 1 + 2 * len(printed["parameters"]))
    assert rows[-1, 1] == pytest.approx(printed["parameters"][0]["value"], rel=1e-8)
    assert main(["track", "r0.json", "run0.csv", "--memory", "5", "--quiet"]) == 0
    assert "nothing changed at once" in capsys.readouterr().out


def test_friction_below_zero_is_told_to_be_none(
    planar_2r: Robot, exact_log: Callable[..., Log], capsys: Capture
) -> None:
    """A torque that drives a joint on along its speed, and friction that grows."""
    model = read_case("case.yaml").model
    assert planar_2r.nominal is not None
    for viscous, is_below in ((-3.0, True), (3.0, False)):
        now = np.append(planar_2r.nominal, [1.0, 0.5, 1.0, 0.5 + viscous])
        log = exact_log(model, now, noise=0.3, seed=11, samples=1500, rate=100.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), Path("other.csv"))
        main(["track", "r0.json", "other.csv", "--memory", "5", "--quiet"])
        assert ("below zero, which no friction is: Fv[joint2];" in capsys.readouterr().out) == is_below


def test_what_track_refuses(capsys: Capture) -> None:
    assert "window = 20.0" in refused(capsys, "track", "r0.json", "run1.csv", "--window", "20")
    assert "loosen = 1.0" in refused(capsys, "track", "r0.json", "run1.csv", "--loosen", "1")
    assert "false alarms = 0.0" in refused(capsys, "track", "r0.json", "run1.csv", "--rate", "0")
    assert "input of this command" in refused(capsys, "track", "r0.json", "run1.csv", "-o", "run1.csv")
