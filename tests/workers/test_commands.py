"""--jobs and --scheduler at the terminal: the same answers as in one process."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.robot import Robot
from short_benchmark import benchmark_text

Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a cluster within this process."""
    distributed = pytest.importorskip("distributed")
    settings: dict[str, Any] = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(processes=False, protocol="inproc", **settings) as cluster:
        yield cluster.scheduler_address


@pytest.fixture
def folder(tmp_path: Path, planar_2r: Robot, exact_log: Callable[..., Log], monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a case and a folder of logs, one of which is cut and one file of which is none."""
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    theta = np.append(planar_2r.nominal, np.tile([0.5, 0.3, 0.1], 2))  # type: ignore[arg-type]
    (tmp_path / "logs").mkdir()
    for seed, name in enumerate("abc"):
        log = exact_log(read_case(tmp_path / "arm.json").model, theta, noise=0.1, seed=seed, samples=1200, rate=100.0)
        write_log(Log(log.joints, log.time, log.q, torque=log.torque), tmp_path / "logs" / f"{name}.npz")
    (tmp_path / "logs" / "cut.npz").write_bytes((tmp_path / "logs" / "a.npz").read_bytes()[:700])
    (tmp_path / "logs" / "notes.md").write_text("monday\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DYNIDENT_DATA", raising=False)
    return tmp_path


def test_reduce_takes_a_folder_and_leaves_bad_logs_out_on_request(
    capsys: Capture, folder: Path, scheduler: str
) -> None:
    words = ["reduce", "arm.json", "logs", "--cutoff", "5", "-o"]
    assert main([*words, "one.tri"]) == 1
    _, err = capsys.readouterr()
    assert "no logs by their suffix, left out: logs/notes.md" in err and "4 of 4 logs" in err
    assert "error: logs/cut.npz: no NumPy archive" in err and not (folder / "one.tri").exists()
    assert len(list(folder.glob("one.tri.*.partial"))) == 3
    assert main([*words, "one.tri", "--skip-bad"]) == 0
    out, err = capsys.readouterr()
    assert "of 3 logs; 1 left out" in out and "left out: logs/cut.npz: no NumPy archive" in err
    assert not list(folder.glob("*.partial"))
    assert main([*words, "two.tri", "--skip-bad", "--json", "--scheduler", scheduler]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [log["path"] for log in facts["logs"]] == ["logs/a.npz", "logs/b.npz", "logs/c.npz"]
    assert facts["left_out"][0]["path"] == "logs/cut.npz" and "no NumPy" in facts["left_out"][0]["why"]
    with np.load(folder / "one.tri") as one, np.load(folder / "two.tri") as two:
        assert {name: one[name].tobytes() for name in one.files} == {name: two[name].tobytes() for name in two.files}


def test_excite_on_a_cluster_is_excite(capsys: Capture, folder: Path, scheduler: str) -> None:
    words = ["excite", "generic-scara", "--starts", "2", "--period", "4", "--harmonics", "2", "--quiet", "-o"]
    assert main([*words, "one.json"]) == 0
    assert main([*words, "two.json", "--scheduler", scheduler]) == 0
    one, two = (json.loads((folder / name).read_text()) for name in ("one.json", "two.json"))
    for plan in (one, two):
        del plan["settings"]["seconds"]
    assert one == two


def test_what_does_not_go_with_a_cluster(capsys: Capture, folder: Path) -> None:
    for words, text in (
        (["reduce", "arm.json", "logs", "-o", "x.tri", "--jobs", "2", "--scheduler", "local"], "give one of the two"),
        (["reduce", "arm.json", "logs", "-o", "x.tri", "--scheduler", "nowhere"], "local:N, an address"),
        (["reduce", "arm.json", "logs", "-o", "x.tri", "--jobs", "0"], "jobs = 0 is not possible"),
        (["benchmark", "--real", ".", "--scheduler", "local"], "files of this machine"),
    ):
        assert main(words) == 1
        assert text in capsys.readouterr().err


@pytest.mark.battery
def test_a_benchmark_on_a_cluster_is_the_benchmark(capsys: Capture, folder: Path, scheduler: str) -> None:
    text = benchmark_text("generic-scara", "[{coulomb: {width: 0.1}}, viscous]", draws=1)
    (folder / "mine.yaml").write_text(text)
    found = []
    for more in ([], ["--scheduler", scheduler]):
        out = f"out{len(found)}"
        for plan in (folder / "out0").glob("*.plan.json"):  # designed against the clock: the same motions for both
            (folder / out).mkdir(exist_ok=True)
            (folder / out / plan.name).write_bytes(plan.read_bytes())
        assert main(["benchmark", "mine.yaml", "--out", out, "--json", *more]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0]["done"] == found[1]["done"] == 4
    for one, two in zip(found[0]["rows"], found[1]["rows"], strict=True):
        assert one["medians"] | {"seconds": 0} == two["medians"] | {"seconds": 0}
