"""Friction and delay that the command line leaves to the logs."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynident.cli.main import main
from dynident.data.formats import write_log
from dynident.data.log import Log
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot


@pytest.fixture
def files(tmp_path: Path, planar_2r: Robot, exact_log: Callable[..., Log]) -> tuple[str, str]:
    robot, log = tmp_path / "arm.json", tmp_path / "run.csv"
    robot.write_text(json.dumps(robot_to_dict(planar_2r)))
    assert planar_2r.nominal is not None
    theta = np.append(planar_2r.nominal, [3.0, 1.0, 2.0, 0.5])
    model = DynamicModel(planar_2r, (Coulomb(), Viscous()))
    write_log(exact_log(model, theta, noise=0.1, samples=2400, rate=120.0), log)
    return str(robot), str(log)


def test_tables_of_what_was_found(files: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", *files, "--friction", "auto", "--delay", "auto", "--quiet", "--full"]) == 0
    out = capsys.readouterr().out
    assert "Time delay between torque and position signals" in out
    assert re.search(r"coulomb +all +width +0\.01 +0\.0\d+ .* best\n", out)
    assert re.search(r"presliding +all +part +left out .* left out\n", out)


def test_a_delay_that_is_no_number(files: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", *files, "--delay", "soon", "--quiet"]) == 1
    assert "delay = 'soon' is not possible; give seconds, or 'auto'" in capsys.readouterr().err
