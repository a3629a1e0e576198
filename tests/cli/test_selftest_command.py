"""dynident selftest: exit codes, JSON, and plans of another robot."""

import json
from pathlib import Path

import pytest
from command_answers import documented

from dynident.cli.main import main

SHORT = ["--period", "4", "--time-limit", "2", "--rate", "500", "--quiet"]


def test_passes_or_not_by_the_tolerance(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    design = ["excite", "generic-scara", "--period", "4", "--starts", "1", "--time-limit", "2", "--quiet"]
    assert main([*design, "-o", str(plan)]) == 0
    capsys.readouterr()
    command = ["selftest", "generic-scara", "--plan", str(plan), "--rate", "500", "--noise", "0.1", "--quiet"]
    assert main([*command, "--estimator", "wls", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["passed"] and found["estimator"] == "wls" and len(found["stages"]) == 4
    assert main([*command, "--tolerance", "1e-6"]) == 1
    assert "not passed:" in capsys.readouterr().out
    assert main(["selftest", "generic-6r", "--plan", str(plan), "--quiet"]) == 1
    assert "design it for this case" in capsys.readouterr().err
    data = json.loads(plan.read_text())
    data["trajectory"]["offset"][0] += 10.0
    plan.write_text(json.dumps(data))
    assert main(command) == 1
    assert "the position of shoulder is 1" in (said := capsys.readouterr().err) and "do not drive it" in said
    assert main(["simulate", "generic-scara", str(plan), "-o", str(tmp_path / "run.csv")]) == 0
    assert "do not drive this plan: the position of shoulder is 1" in capsys.readouterr().err


def test_refuses_what_cannot_be(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["selftest", "generic-scara", *SHORT, "--noise", "1", "2"]) == 1
    assert "one for each of the 4 joints" in capsys.readouterr().err
    assert main(["selftest", "generic-scara", *SHORT, "--seed", "-1"]) == 1
    assert "--seed" in capsys.readouterr().err


CASE = """case: 1
robot: generic-scara
friction: [coulomb, viscous]
cell:
  controller: {pid: {rate: 2000}}
  encoder: {noise: 1e-6}
  effort: {noise: [0.2, 0.1, 0.4, 0.02]}
  recorder: {rate: 500}
  truth: {friction: {Fc: [4, 3, 8, 0.4]}}
"""


@pytest.mark.battery
def test_the_cell_of_the_case_is_the_one_that_is_rehearsed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("case.yaml").write_text(CASE)
    design = ["excite", "case.yaml", "--period", "4", "--starts", "1", "--time-limit", "1", "--quiet"]
    assert main([*design, "-o", "plan.json"]) == 0
    command = ["selftest", "case.yaml", "--plan", "plan.json", "--estimator", "wls"]
    capsys.readouterr()
    main([*command, "--json", "--set", "payload.mass=0.5", "--position-noise", "2e-6"])
    found = json.loads(capsys.readouterr().out)
    assert found["cell"]["controller"]["pid"]["rate"] == 2000 and found["cell"]["recorder"]["rate"] == 500
    assert found["cell"]["encoder"]["noise"] == [2e-6] and found["cell"]["payload"]["mass"] == 0.5
    assert found["noise"] == [0.2, 0.1, 0.4, 0.02] and found["noise_source"] == "of the cell"
    truth = {one["name"]: one["truth"] for one in found["stages"][1]["parameters"]}
    assert [value for name, value in truth.items() if name.startswith("Fc[")] == [4, 3, 8, 0.4]
    keys = documented("selftest")
    stage = {f"stages[].{key}" for key in found["stages"][0]} - {"stages[].joints", "stages[].parameters"}
    assert keys == {*found, *stage, *inner(found["stages"][0])} - {"schema", "stages"}
    main([*command, "--quiet", "--set", "ripple.amplitude=0.1"])
    assert "virtual cell: pid at 2000 Hz, 500 samples a second; beside the default: ripple" in capsys.readouterr().out
    assert main([*command, "--set", "effort.noise=-1"]) == 1
    assert "effort.noise" in capsys.readouterr().err


def inner(stage: dict[str, list[dict[str, object]]]) -> set[str]:
    """Return the keys of the joints and parameters of a stage."""
    return {f"stages[].{name}[].{key}" for name in ("joints", "parameters") for key in stage[name][0]}
