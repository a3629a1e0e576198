"""dynident selftest: exit codes, JSON, and plans of another robot."""

import json
from pathlib import Path

import pytest

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


def test_refuses_what_cannot_be(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["selftest", "generic-scara", *SHORT, "--noise", "1", "2"]) == 1
    assert "one for each of the 4 joints" in capsys.readouterr().err
    assert main(["selftest", "generic-scara", *SHORT, "--seed", "-1"]) == 1
    assert "--seed" in capsys.readouterr().err
