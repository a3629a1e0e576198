"""dynident benchmark: a file, the folder that it goes on from, its page; and the scoreboard on logs of a folder."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_answers import documented

import dynident
from dynident.cli.main import main
from dynident.model.friction import Motion
from dynident.studies.benchmark.possible_robots import described_truth
from short_benchmark import benchmark_text

MINE = benchmark_text("generic-scara", "[{coulomb: {width: 0.1}}, viscous]", draws=1)


def test_a_benchmark_goes_on_and_writes_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.yaml").write_text(MINE)
    command = ["benchmark", str(tmp_path / "mine.yaml"), "--out", str(tmp_path / "out")]
    assert main([*command, "--methods", "ols", "--quiet"]) == 0
    assert "mine: 1 draw of each condition" in capsys.readouterr().out
    assert len(list((tmp_path / "out").glob("*.plan.json"))) == 2
    assert main([*command, "--html", str(tmp_path / "page.html"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["tasks"] == found["done"] == 4 and {row["method"] for row in found["rows"]} == {"ols", "wls"}
    keys = {f"rows[].{key}" for key in found["rows"][0]} | {key for key in found if key not in ("schema", "rows")}
    for group in ("medians", "tails", "means"):
        keys |= {f"rows[].{group}.{key}" for key in found["rows"][0][group]} - {f"rows[].{group}"}
    assert documented("benchmark") == keys - {"rows[].medians", "rows[].tails", "rows[].means"}
    page = (tmp_path / "page.html").read_text()
    assert "generic-scara" in page and "<svg" in page and "src=" not in page
    assert main([*command, "--quick"]) == 1 and "no short form" in capsys.readouterr().err
    assert main(["benchmark"]) == 1 and "tx40" in capsys.readouterr().err
    assert main(["benchmark", "tx40", "--real", str(tmp_path)]) == 1


@pytest.fixture
def cases(tmp_path: Path) -> Path:
    """Return a folder with a case, two logs of its robot, a case without its log, and a scoreboard."""
    robot = dynident.read_robot("generic-scara")
    model = dynident.DynamicModel(robot, ("coulomb", "viscous"))  # type: ignore[arg-type]
    theta = described_truth(model)
    time = np.arange(0, 8, 0.01)
    for seed, name in enumerate(("a.csv", "b.csv")):
        generator = np.random.default_rng(seed)
        series = [generator.uniform(-0.2, 0.2, shape) for shape in (4, (4, 4), (4, 4))]
        series[0][2] = 0.1
        motion = dynident.FourierSeries(*series, period=8.0).evaluate(time)
        q, dq, ddq = (signal * [1, 1, 0.1, 1] for signal in motion)
        torque = model.torque(Motion(q, dq, ddq), theta) + generator.normal(0, 0.1, q.shape)
        dynident.write_log(dynident.Log(robot.joint_names, time, q, torque=torque), tmp_path / name)
    case = "case: 1\nrobot: generic-scara\nfriction: [coulomb, viscous]\ntrain: {}\n"
    (tmp_path / "arm.yaml").write_text(case.format("a.csv"))
    (tmp_path / "other.yaml").write_text(case.format("nowhere.csv"))
    (tmp_path / "scoreboard.yml").write_text(
        "scoreboard: 1\nsets:\n"
        "  - {name: second log, case: arm.yaml, test: b.csv, cutoff_hz: 10}\n"
        "  - {name: halves, case: arm.yaml, split: 'first:0.5', cutoff_hz: 10}\n"
        "  - {name: lost, case: other.yaml}\n"
        "published:\n  - {set: halves, who: somebody, test_error: 0.5, source: a paper}\n"
    )
    return tmp_path


def test_the_scoreboard_has_sets_splits_and_published_figures(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [
        "benchmark",
        "--real",
        str(cases),
        "--methods",
        "ols,wls,didim:iterations=1",
        "--out",
        str(cases / "out"),
    ]
    assert main([*command, "--html", str(cases / "page.html"), "--quiet"]) == 0
    captured = capsys.readouterr()
    lines = captured.out.splitlines()
    ours = [line for line in lines if line.startswith("halves ") and "published" not in line]
    assert len(ours) == 3 and any(line.startswith("halves") and "somebody" in line for line in lines)
    assert "left out: lost" in captured.err and "nowhere.csv" in captured.err
    assert "somebody" in (cases / "page.html").read_text()
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    second, halves, lost = found["sets"]
    assert lost["missing"] and not lost["methods"]
    for each in (second, halves):
        by_name = {method["method"]: method for method in each["methods"]}
        assert 0 < by_name["wls"]["test_error"] < 0.2
    assert halves["published"][0]["test_error"] == 0.5


def test_a_run_that_is_stopped_says_so(
    cases: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from dynident.studies.benchmark import runner

    def run_one(*given: Any, **options: Any) -> Iterator[Any]:
        yield next(iter(whole(*given, **options)))
        raise KeyboardInterrupt

    whole = runner.run_tasks
    monkeypatch.setattr(runner, "run_tasks", run_one)
    command = ["benchmark", "--real", str(cases), "--methods", "ols,wls", "--out", str(cases / "out"), "--quiet"]
    assert main(command) == 130
    captured = capsys.readouterr()
    assert captured.err.splitlines()[-1] == "stopped: 1 of 4 tasks done" and "second log" in captured.out


def test_a_folder_without_cases_or_logs_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["benchmark", "--real", str(tmp_path)]) == 1
    assert "no case file" in capsys.readouterr().err
    (tmp_path / "scoreboard.yml").write_text("scoreboard: 1\nsets: [{name: a, cas: b.yaml}]\n")
    assert main(["benchmark", "--real", str(tmp_path)]) == 1
    assert "'case'" in capsys.readouterr().err
    (tmp_path / "scoreboard.yml").unlink()
    (tmp_path / "arm.yaml").write_text("case: 1\nrobot: generic-scara\ntrain: nowhere.csv\n")
    assert main(["benchmark", "--real", str(tmp_path), "--out", str(tmp_path / "out")]) == 1
    assert "DYNIDENT_DATA" in capsys.readouterr().err
