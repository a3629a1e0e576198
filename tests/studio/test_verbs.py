"""The verbs behind the page: a case from upload to export over HTTP, each as the command that is shown; cancelling."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from dynident import read_robot
from dynident.case.case import read_case
from dynident.cli.main import build_parser
from dynident.errors import BadOption, DynidentError, FileError, UnknownChoice
from dynident.identification.files.estimate_file import read_estimate
from dynident.studio import orders, views
from dynident.studio.folder import Folder
from dynident.studio.history import Edit
from dynident.studio.orders import order_of

JOINTS = read_robot("generic-scara").joint_names


def test_a_case_from_upload_to_report(client, logs: tuple[Path, Path]) -> None:
    train, test = (client.upload(path.name, path.read_bytes()) for path in logs)
    seen = client.get(f"/api/log?name={train}")
    assert seen["header"] == ["t", "q1", "q2", "q3", "q4", "tau1", "tau2", "tau3", "tau4"] and seen["rows"] == 1500
    draft = client.run("init", robot="generic-scara", logs=[train], test=[test])
    assert draft["command"] == "dynident init generic-scara train.csv --test test.csv -o case_1.yaml --json"
    assert json.loads(draft["answer"])["case"] == "case_1.yaml"
    found = client.get("/api/case?name=case_1.yaml")
    assert found["fault"].startswith("case_1.yaml: line ") and found["mapping"]["signals"]["q"] == seen["header"][1:5]
    shown = {"name": "case_1.yaml", "sha256": found["sha256"], **found["mapping"]}
    status, refused = client.post("/api/case", shown)
    assert status == 422 and refused["error"].endswith("choose the unit: it is not guessed")
    units = {"time": "s", "position": "SI", "torque": "SI"}
    status, saved = client.post("/api/case", {**shown, "units": units})
    assert status == 200 and saved["fault"] == "" and saved["mapping"]["joints"] == list(JOINTS)
    assert "# Drafted from train.csv" in saved["text"]
    status, refused = client.post("/api/case", {**shown, "text": "case: 1"})  # of a tab that has not seen this
    assert status == 422 and "changed meanwhile, in another tab" in refused["error"]
    assert client.get("/api/case?name=case_1.yaml")["text"] == saved["text"]
    init, edit = client.get("/api/history")["commands"]
    assert init == draft["command"] and edit == f"cat > case_1.yaml <<'END'\n{saved['text']}END"
    done = client.run("identify", case="case_1.yaml", estimator="wls", friction=["coulomb", "viscous"], quick=True)
    assert done["state"] == "done", done["progress"]
    assert done["progress"][0].strip() == "reading" and "test error" in done["answer"]
    assert done["outputs"] == ["estimate_1.json", "report_1.html"]
    estimate = read_estimate(client.folder / "estimate_1.json")
    assert estimate.provenance["command"] == done["command"]
    shown = client.get("/api/estimate?name=estimate_1.json")
    assert shown["parameters"] == json.loads(json.dumps(estimate.parameters()))
    assert len(shown["torques"]) == 4 and len(shown["torques"][0]["measured"]["y"]) > 100
    tested = client.get("/api/test-torques?name=estimate_1.json")
    assert tested["missing"] == "" and len(tested["torques"]) == 4 and tested["motion"]["joints"] == list(JOINTS)
    seconds = [data["torques"][0]["measured"]["x"][-1] for data in (shown, tested)]
    assert seconds[0] == pytest.approx(seconds[1]) and shown["torques"] != tested["torques"]
    text = saved["text"].replace("test: test.csv", "test: train_2.csv")
    (client.folder / "train_2.csv").write_bytes(
        b"\n".join((client.folder / "test.csv").read_bytes().splitlines()[:900])
    )
    sha256 = client.get("/api/case?name=case_1.yaml")["sha256"]
    assert client.post("/api/case", {"name": "case_1.yaml", "text": text, "sha256": sha256})[0] == 200
    tested = client.get("/api/test-torques?name=estimate_1.json")
    assert tested["torques"] == [] and "no longer those of the test" in tested["missing"]
    assert client.get("/api/robot?name=estimate_1.json")["robot"] == "generic-scara"
    status, _, page = client.ask("GET", "/report?name=report_1.html")
    assert status == 200 and page == (client.folder / "report_1.html").read_bytes()
    motion = client.get("/api/motion?name=train.csv&case=case_1.yaml")
    assert motion["joints"] == list(JOINTS) and motion["time"][-1] == pytest.approx(14.99)
    kinds = {file["name"]: file["kind"] for file in client.get("/api/state")["files"]}
    assert kinds["estimate_1.json"] == "estimate" and kinds["case_1.yaml"] == "case" and kinds["train.csv"] == "log"


@pytest.mark.battery
def test_the_other_verbs(client, logs: tuple[Path, Path]) -> None:
    train, test = (client.upload(path.name, path.read_bytes()) for path in logs)
    robot = {"case": "generic-scara", "friction": ["coulomb", "viscous"]}
    plan = client.run("excite", **robot, starts=1, time_limit=2, period=6, harmonics=3)
    assert plan["state"] == "done" and plan["limit_s"] == 2
    motion = client.get(f"/api/motion?name={plan['outputs'][0]}")
    assert motion["joints"] == list(JOINTS) and motion["q"][0] == pytest.approx(motion["q"][-1])
    assert client.run("export", file=plan["outputs"][0], to="csv", posture="start")["state"] == "done"
    text = f"case: 1\nrobot: generic-scara\ntrain: {train}\ntest: {test}\n"
    client.upload("own.yaml", text.encode())
    checked = client.run("check", case="own.yaml")
    assert checked["state"] == "done" and [log["findings"] for log in json.loads(checked["answer"])["logs"]] != []
    fixed = client.run("check", case="own.yaml", logs=[train], fix=True)
    assert fixed["outputs"] == ["fixed_1.csv"] and (client.folder / "fixed_1.csv").exists()
    for estimator in ("ols", "wls"):
        assert client.run("identify", case="own.yaml", estimator=estimator, quick=True)["state"] == "done"
    beside = client.run("diff", estimates=["estimate_1.json", "estimate_2.json"])
    assert beside["state"] == "done" and (client.folder / beside["outputs"][0]).exists()
    written = client.run("export", file="estimate_1.json", to="csv")
    assert written["state"] == "done" and {"exported_2.csv", "exported_2-standard.csv"} <= set(client.names())
    assert client.run("validate", estimate="estimate_1.json", logs=[test])["state"] == "done"
    assert client.run("report", estimate="estimate_1.json", test=[test])["state"] == "done"
    assert client.run("compare", case="own.yaml", estimators=["ols", "wls"], time_limit=30)["state"] == "done"


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
@pytest.mark.parametrize("text", ["", "a: 1\n", "END\nEND0\n$HOME `id` \\ 'x' é\n"])
def test_an_edit_is_a_command_that_writes_the_same_text(tmp_path: Path, text: str) -> None:
    edit = Edit(1, "my 'case'.yaml", text)
    subprocess.run(["sh", "-e"], input=edit.command, text=True, cwd=tmp_path, check=True)
    assert (tmp_path / edit.name).read_text(encoding="utf-8") == text


def test_a_cancelled_command_leaves_nothing(client, running) -> None:
    choices = {"case": "generic-6r", "friction": ["viscous"], "starts": 500, "time_limit": 600}
    status, run = client.post("/api/run", {"verb": "excite", "choices": choices})
    assert status == 200
    process = running.session.runs.get(run["number"]).process
    (client.folder / ".plan_1.reserved" / ".plan_1.json.0123.part").write_text("half")  # where the command writes
    time.sleep(0.5)
    assert client.post("/api/cancel", {"number": run["number"]})[0] == 200
    process.wait(20)
    end = time.monotonic() + 10
    while any(client.folder.iterdir()) and time.monotonic() < end:
        time.sleep(0.05)
    assert list(client.folder.iterdir()) == []
    assert client.get(f"/api/run?number={run['number']}")["state"] == "cancelled"
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


def test_a_fault_of_a_file_is_told_without_the_place_of_the_session(client) -> None:
    client.upload("case.yaml", b"case: 1\nrobot: nothing.urdf\n")
    done = client.run("export", file="case.yaml", to="csv")
    assert done["state"] == "failed" and done["progress"][-1].startswith("error: case.yaml: ")
    status, _, body = client.ask("GET", "/api/robot?name=case.yaml")
    assert status == 422 and str(client.folder).encode() not in body


def test_only_so_many_commands_run_at_once(client) -> None:
    choices = {"case": "generic-6r", "friction": ["viscous"], "time_limit": 600}
    started = [client.post("/api/run", {"verb": "excite", "choices": choices}) for _ in range(3)]
    assert [status for status, _ in started] == [200, 200, 422]
    assert "run already" in started[2][1]["error"]
    for _, run in started[:2]:
        client.post("/api/cancel", {"number": run["number"]})


FULL: dict[str, dict[str, Any]] = {
    "init": {"robot": "er16", "logs": ["a.csv"], "test": ["b.csv"], "profile": "ur_rtde"},
    "check": {"case": "c.yaml", "logs": ["a.csv"], "fix": True},
    "identify": {
        "case": "c.yaml",
        "logs": ["a.csv"],
        "test": ["b.csv"],
        "estimator": "wls",
        "friction": ["auto"],
        "cutoff": "5",
        "quick": True,
    },
    "validate": {"estimate": "e.json", "logs": ["a.csv"]},
    "report": {"estimate": "e.json", "test": ["a.csv"], "plan": "p.json"},
    "excite": {
        "case": "er16",
        "trajectory": "bspline",
        "criterion": "condition",
        "period": 5,
        "harmonics": 4,
        "margin": 0.1,
        "torque_margin": 0.1,
        "starts": 2,
        "time_limit": 3,
        "earlier": "e.json",
        "friction": ["viscous"],
    },
    "diff": {"estimates": ["e.json", "p.json"]},
    "compare": {"case": "c.yaml", "estimators": ["ols", "wls"], "time_limit": 3},
    "export": {"file": "e.json", "to": "urdf", "speed": 20, "posture": "-0.1, 2", "description": "p.json"},
}


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    for name in ("a.csv", "b.csv", "c.yaml", "e.json", "p.json"):
        (tmp_path / name).write_text("")
    return Folder(tmp_path)


@pytest.mark.parametrize("verb", FULL)
def test_every_command_is_one_that_the_parser_takes(folder: Folder, verb: str) -> None:
    order = order_of(folder, verb, FULL[verb])
    options = build_parser().parse_args(order.arguments)
    assert options.command == verb and shlex.split(order.command) == ["dynident", *order.arguments]
    assert all(name in order.arguments for name in order.outputs)
    again = order_of(folder, verb, FULL[verb])
    assert not set(order.outputs) & set(again.outputs)


def test_every_verb_is_tried_here() -> None:
    assert set(FULL) == set(orders.VERBS)


@pytest.mark.parametrize(
    ("verb", "changes", "kind"),
    [
        ("identify", {"case": "--report=x"}, FileError),
        ("identify", {"case": "../c.yaml"}, FileError),
        ("identify", {"logs": ["-o"]}, FileError),
        ("identify", {"logs": "a.csv"}, BadOption),
        ("identify", {"estimator": "--json"}, UnknownChoice),
        ("identify", {"friction": ["-o"]}, UnknownChoice),
        ("identify", {"cutoff": "nan"}, BadOption),
        ("identify", {"cutoff": [5]}, BadOption),
        ("identify", {"cutoff": 10**400}, BadOption),
        ("excite", {"period": "1e9"}, BadOption),
        ("excite", {"starts": 1.5}, BadOption),
        ("excite", {"case": "/etc/passwd"}, FileError),
        ("export", {"to": "ros2_bag"}, UnknownChoice),
        ("export", {"posture": "--check"}, BadOption),
        ("export", {"posture": "0,inf"}, BadOption),
        ("init", {"logs": []}, BadOption),
        ("diff", {"estimates": ["e.json"]}, BadOption),
        ("demo", {}, UnknownChoice),
    ],
)
def test_no_text_of_the_page_becomes_an_option(
    folder: Folder, verb: str, changes: dict[str, Any], kind: type[DynidentError]
) -> None:
    with pytest.raises(kind):
        order_of(folder, verb, {**FULL.get(verb, {}), **changes})


def test_the_page_offers_what_the_families_have() -> None:
    from dynident.excitation.trajectories import TRAJECTORIES
    from dynident.exports.models import MODEL_EXPORTERS
    from dynident.exports.motions import MOTION_EXPORTERS
    from dynident.identification.estimators import ESTIMATORS

    found = views.choices()
    assert found["estimators"] == list(ESTIMATORS.names()) and found["trajectories"] == list(TRAJECTORIES.names())
    files = [name for name in MOTION_EXPORTERS.names() if not MOTION_EXPORTERS.get(name).writes_folder]
    assert views.targets_view("plan") == {"targets": files} and len(files) < len(MOTION_EXPORTERS.names())
    assert views.targets_view("estimate") == {"targets": list(MODEL_EXPORTERS.names())}
    assert views.targets_view("log") == {"targets": []}


@pytest.mark.parametrize(("kind", "target", "suffix"), [("plan", "krl", ".src"), ("estimate", "drake", ".dmd.yaml")])
def test_a_file_is_exported_to_targets_of_its_kind(folder: Folder, kind: str, target: str, suffix: str) -> None:
    (folder.path / "x.json").write_text(json.dumps({"kind": f"dynident {kind}"}))
    assert order_of(folder, "export", {"file": "x.json", "to": target}).outputs[0].endswith(suffix)
    with pytest.raises(UnknownChoice, match="rapid" if kind == "plan" else "mjcf"):
        order_of(folder, "export", {"file": "x.json", "to": "urdf" if kind == "plan" else "krl"})


def test_a_case_with_a_mapping_reads_as_it_was_mapped(tmp_path: Path) -> None:
    from dynident.studio.case_text import Mapped, mapping_of, with_columns

    log = tmp_path / "a.csv"
    log.write_text('zeit,p1,p2,p 3,m1,m2,m3,"x: #y"\n' + "".join(f"{k},1,2,3,4,5,6,7\n" for k in range(12)))
    case = tmp_path / "c.yaml"
    log_key = "log:\n  profile: ur_rtde\n  force: q_ref  # kept\n"
    case.write_text(f"case: 1   # kept\nrobot: er16\nlocked: rest\n{log_key}train: a.csv\n")
    signals = {"q": ("p1", "p2", "p 3"), "torque": ("m1", "m2", "x: #y")}
    units = {"time": "ms", "position": ("rad", "deg", "rad"), "torque": "N m"}
    mapped = Mapped(("joint1", "joint2", "joint3"), "zeit", signals, units)
    case.write_text(with_columns(case.read_text(), mapped))
    assert case.read_text().count("# kept") == 2 and "ur_rtde" not in case.read_text()
    found = mapping_of(case)
    assert found["joints"] == list(mapped.joints) and found["time"] == "zeit"
    assert {key: tuple(value) for key, value in found["signals"].items()} == signals
    assert {key: found["units"][key] for key in units} == units
    assert read_case(case).columns.units.time == "ms"
    assert with_columns(case.read_text(), mapped) == case.read_text()
