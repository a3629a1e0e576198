"""dynident gains: from two logs to a case file that identify can use, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks.loaded_arm import with_body

from dynident import DynamicModel, FourierSeries, Inertia, Log, Robot, read_robot, write_log
from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.model.friction import FRICTION, Motion

GAINS = np.array([60.0, 40.0, 900.0, 8.0])
CASE = """case: 1
robot: generic-scara
drives:
  shoulder: {gain: ask}   # ask: the gain
friction: [coulomb, viscous]
log: {columns: {current: "i{}"}}
preprocessing: {filter: as_given, rate_hz: all, trim_s: 0, rest: keep}
train: free.csv
"""


def recorded(robot: Robot, seed: int) -> Log:
    model = DynamicModel(robot, (FRICTION.make("coulomb"), FRICTION.make("viscous")))
    assert robot.nominal is not None
    generator = np.random.default_rng(seed)
    scale = np.array([0.6, 0.6, 0.05, 0.8])[:, None]
    time = np.arange(900) / 60.0
    q, dq, ddq = FourierSeries(np.zeros(4), *(scale * generator.normal(size=(2, 4, 4)) / 2), 7.5).evaluate(time)
    torque = model.torque(Motion(q, dq, ddq), np.concatenate([robot.nominal, np.tile([1.0, 2.0], 4)]))
    current = torque / GAINS
    current += 0.01 * np.sqrt(np.mean(current**2, axis=0)) * generator.normal(size=current.shape)
    return Log(robot.joint_names, time, q, dq, ddq, current=current)


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a case that asks for its gains, and runs without and with 2 kg at the tool."""
    monkeypatch.chdir(tmp_path)
    robot = read_robot("generic-scara")
    names = robot.joint_names
    body = Inertia.from_centre_of_mass(2.0, [0.05, 0.02, -0.03], np.diag([0.01, 0.01, 0.008]))
    write_log(recorded(robot, 1), "free.csv")
    write_log(recorded(with_body(robot, body), 2), "loaded.csv")
    text = CASE.replace("shoulder", names[0]).replace("as_given", "as_given")
    columns = '{current: "i{}", ddq: "ddq{}"}'
    (tmp_path / "case.yaml").write_text(text.replace('{current: "i{}"}', columns))
    return tmp_path


def test_gains_are_written_into_a_case_that_identify_takes(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    payload = ("--load", "loaded.csv", "--mass", "2", "--com", "0.05,0.02,-0.03")
    assert main(["gains", "case.yaml", *payload, "-o", "out.yaml", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["complete"] is True
    for gain, true in zip(found["gains"], GAINS, strict=True):
        assert gain["low"] < gain["gain"] < gain["high"]
        assert gain["gain"] == pytest.approx(true, rel=0.05)
    drives = [joint.drive for joint in read_case("out.yaml").robot.active]
    assert [drive.gain for drive in drives] == pytest.approx([gain["gain"] for gain in found["gains"]], rel=1e-5)
    assert all(0 < drive.gain_deviation < 0.05 for drive in drives)
    assert main(["identify", "out.yaml", "--cross-validate", "0", "--full"]) == 0
    shown = capsys.readouterr().out
    assert "Drive gain uncertainty" in shown
    assert "warning: drive gains have a relative std of" in shown


def test_the_lines_to_paste_and_the_method(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gains", "case.yaml", "--load", "loaded.csv", "--mass", "2", "--com", "0.05,0.02,-0.03"]) == 0
    shown = capsys.readouterr().out
    assert (
        "by the method 'structured'; the scale is set by a payload of 2 kg, centre 0.05, 0.02, -0.03 m in the frame"
        in shown
    )
    assert "for the case file:\n\ndrives:\n" in shown
    assert "N/A" in shown and "identified" in shown


def test_gains_of_currents_in_percent_are_per_percent(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = Path("case.yaml")
    case.write_text(case.read_text().replace("log: {columns:", "log: {units: {current: percent}, columns:"))
    payload = ("--load", "loaded.csv", "--mass", "2", "--com", "0.05,0.02,-0.03")
    assert main(["gains", "case.yaml", *payload, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["gains"]
    assert [gain["gain"] for gain in found] == pytest.approx(GAINS, rel=0.05)
    assert [gain["unit"] for gain in found] == ["N m/percent", "N m/percent", "N/percent", "N m/percent"]


def test_a_loaded_run_without_its_load_determines_nothing(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(recorded(read_robot("generic-scara"), 3), "loaded.csv")
    assert main(["gains", "case.yaml", "--load", "loaded.csv", "--mass", "2", "--delay", "auto", "--json"]) == 1
    verdicts = [gain["label"] for gain in json.loads(capsys.readouterr().out)["gains"]]
    assert verdicts == ["not determined"] * 4


def test_a_stated_centre_that_the_logs_contradict_determines_nothing(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Stated in another frame than the default one, as the frame of the flange for that of the tool."""
    assert (
        main(["gains", "case.yaml", "--load", "loaded.csv", "--mass", "2", "--com", "0.25,0.02,-0.03", "-o", "o.yaml"])
        == 1
    )
    told = capsys.readouterr().out
    assert "the stated centre contradicts the logs: they place it at 0.0" in told
    assert "name the frame that it is stated in (--frame)" in told and told.count("contradicts") == 1
    assert "ask" in Path("o.yaml").read_text()


def test_a_stated_inertia_that_the_logs_contradict_is_named_as_such(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated = ("--com", "0.05,0.02,-0.03", "--inertia", "0.5,0,0,0.5,0,0.5")
    assert main(["gains", "case.yaml", "--load", "loaded.csv", "--mass", "2", *stated]) == 1
    told = capsys.readouterr().out
    assert "the stated inertia contradicts the logs" in told and "(--inertia)" in told
    assert told.count("these logs do not determine it") == 4


def test_rotors_that_identify_would_choose_stay(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Currents turn the rotors: without them gains are wrong, and look sure."""
    payload = ("--load", "loaded.csv", "--mass", "2", "--com", "0.05,0.02,-0.03", "--json", "--quiet")
    case = Path("case.yaml")
    case.write_text(case.read_text().replace("viscous]", "viscous, {rotor_inertia: {choose: [part]}}]"))
    assert main(["gains", "case.yaml", *payload]) == 0
    chosen = json.loads(capsys.readouterr().out)
    case.write_text(case.read_text().replace("{rotor_inertia: {choose: [part]}}", "rotor_inertia"))
    assert main(["gains", "case.yaml", *payload]) == 0
    assert json.loads(capsys.readouterr().out)["gains"] == chosen["gains"] and not chosen["remarks"]
    assert main(["gains", "case.yaml", "--friction", "auto", *payload]) == 0
    automatic = [gain["gain"] for gain in json.loads(capsys.readouterr().out)["gains"]]
    assert automatic == pytest.approx(GAINS, rel=0.05)


def test_known_bodies_and_signs(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gains", "case.yaml", "free.csv", "--prior-share", "0.05", "--quiet", "--json"]) in (0, 1)
    assert "known bodies, each link within 5 % (std)" in json.loads(capsys.readouterr().out)["scale"]
    assert main(["gains", "case.yaml", "--prior-share", "0", "--signed", "--quiet"]) in (0, 1)
    assert "gains for each sign go into no case file" in capsys.readouterr().out


def test_parts_that_identify_would_choose_are_left_out(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    payload = ("--load", "loaded.csv", "--mass", "2", "--com", "0.05,0.02,-0.03", "--json", "--quiet")
    assert main(["gains", "case.yaml", *payload]) == 0
    plain = json.loads(capsys.readouterr().out)
    case, part = Path("case.yaml"), "{stribeck: {velocity: 0.1, width: 0.01, choose: [part, velocity]}}"
    case.write_text(case.read_text().replace("viscous]", f"viscous, {part}]"))
    assert main(["gains", "case.yaml", *payload]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["gains"] == plain["gains"] and "left out (stribeck)" in " ".join(found["remarks"])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--load", "loaded.csv"], "weigh the payload"),
        (["--mass", "2"], "name the logs with it"),
        ([], "say how far the bodies are trusted"),
        (["--load", "loaded.csv", "--mass", "2", "--com", "1,2"], "give 3 numbers with commas"),
        (["--load", "loaded.csv", "--mass", "2", "--prior-share", "0.1"], "does not go with --load"),
        (["--load", "free.csv", "--mass", "2"], "the same content as"),
        (["--load", "loaded.csv", "--mass", "2", "-o", "case.yaml"], "would be overwritten"),
        (["--prior-share", "0.1", "--method", "best"], "no method for drive gains called 'best'"),
    ],
)
def test_refusals(cell: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], text: str) -> None:
    assert main(["gains", "case.yaml", "free.csv", *arguments, "--quiet"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("error: ") and text in told
    assert "gain: ask" in Path("case.yaml").read_text()


def test_a_case_that_still_asks_for_a_gain_says_so(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    last = read_robot("generic-scara").joint_names[-1]
    assert main(["gains", "case.yaml", "free.csv", "--prior-share", "0.4", "-o", "out.yaml"]) == 1
    assert f"saved out.yaml; it asks for the gains of {last}; then: " in capsys.readouterr().err
    assert (
        main(["gains", "case.yaml", "--load", "loaded.csv", "--mass", "2", "--com", "0.05,0.02,-0.03", "-o", "b"]) == 0
    )
    assert "saved b; next: dynident identify b" in capsys.readouterr().err
