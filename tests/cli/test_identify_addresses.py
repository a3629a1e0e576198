"""identify, validate and compare on addresses, folders and patterns: the answer of the files, or a named error."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot

fsspec = pytest.importorskip("fsspec")

CASE = """\
case: 1
robot: arm.json
friction: [viscous]
preprocessing: {filter: {butterworth: {cutoff_hz: 8}}}
"""

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path, planar_2r: Robot, exact_log: Callable[..., Log], monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with a case and two logs, which are in a bucket too."""
    monkeypatch.chdir(tmp_path)
    model = DynamicModel(planar_2r, (FRICTION.make("viscous"),))
    assert planar_2r.nominal is not None
    bucket = fsspec.filesystem("memory")
    (tmp_path / "runs").mkdir()
    for name, seed in (("a.csv", 0), ("b.csv", 1)):
        whole = exact_log(
            model, np.append(planar_2r.nominal, [0.3, 0.2]), noise=0.05, samples=1200, rate=200.0, seed=seed
        )
        place = tmp_path / "runs" / name
        write_log(Log(whole.joints, whole.time, whole.q, torque=whole.torque), place)
        bucket.pipe(f"/arms/{name}", place.read_bytes())
    (tmp_path / "arm.json").write_text(json.dumps(robot_to_dict(planar_2r)))
    (tmp_path / "case.yaml").write_text(CASE)
    return tmp_path


def identified(capsys: Capture, *words: str) -> dict[str, object]:
    code = main(["identify", "case.yaml", *words, "--json", "--cross-validate", "0", "--no-sensitivity"])
    shown = capsys.readouterr()
    assert code == 0, shown.err
    found = json.loads(shown.out)
    test = found["test"] and {**found["test"], "logs": len(found["test"]["logs"])}
    return {"parameters": found["parameters"], "test": test}


def test_addresses_folders_and_patterns_are_those_files(folder: Path, capsys: Capture) -> None:
    wanted = identified(capsys, "runs/a.csv", "--test", "runs/b.csv")
    assert identified(capsys, "memory://arms/a.csv", "--test", f"file://{folder}/runs/b.csv") == wanted
    both = identified(capsys, "runs/a.csv", "runs/b.csv")
    for words in (["runs"], ["runs/*.csv"], ["memory://arms"], ["memory://arms/*.csv"]):
        assert identified(capsys, *words) == both
    assert both != wanted


def test_a_case_may_name_addresses_and_the_estimate_keeps_them(folder: Path, capsys: Capture) -> None:
    (folder / "case.yaml").write_text(f"{CASE}train: [memory://arms/a.csv]\ntest: ['memory://arms/b*']\n")
    main(["identify", "case.yaml", "-o", "estimate.json", "--quiet", "--cross-validate", "0", "--no-sensitivity"])
    (log,) = json.loads((folder / "estimate.json").read_text())["provenance"]["logs"]
    assert log["path"] == "memory://arms/a.csv"
    capsys.readouterr()
    assert main(["validate", "estimate.json", "memory://arms/b.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["warnings"] == []
    assert main(["compare", "case.yaml", "--estimators", "wls,ols", "--json"]) == 0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["identify", "case.yaml", "memory://arms/none.csv"], "memory://arms/none.csv: cannot be reached (File"),
        (["identify", "case.yaml", "nosuch://arms/a.csv"], "nosuch://arms/a.csv: cannot be reached (ValueError"),
        (["identify", "case.yaml", "memory://arms/bad.csv"], "memory://arms/bad.csv:1: no column 'q2'"),
        (
            ["identify", "case.yaml", "memory://arms/a.csv", "file://runs/a.csv"],
            "file://runs/a.csv: the same content as",
        ),
        (["identify", "case.yaml", "runs/a.csv", "memory://arms/a.csv"], "the same content as runs/a.csv"),
        (["identify", "case.yaml", "none/*.csv"], "none/*.csv: there is no log"),
        (["check", "case.yaml", "memory://arms/a.csv"], "memory://arms/a.csv: it is an address"),
    ],
)
def test_what_cannot_be_read_is_named(words: list[str], told: str, folder: Path, capsys: Capture) -> None:
    fsspec.filesystem("memory").pipe("/arms/bad.csv", b"time,q1\n0.0,half\n")
    assert main([*words, "--quiet"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert told in line and "dynident-" not in line
