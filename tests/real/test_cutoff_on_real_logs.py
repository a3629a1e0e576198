"""The chosen cut-off on real logs: held-out error near that of the filter stated by hand; skipped without the logs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dynident.api.case_logs import read_data
from dynident.case.case import read_case
from dynident.data.preprocessing import ROWS_PER_PERIOD, preprocess
from dynident.data.preprocessing.butterworth import Butterworth
from dynident.identification.build_problem import build_problem
from dynident.identification.estimators.wls import WLS
from dynident.identification.validate import validate_prepared
from real_data import real

pytestmark = pytest.mark.battery

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(("name", "folder"), [("panda", "panda_gaz2019"), ("lwr4", "kuka_lwr4_flobaroid")])
def test_the_chosen_cut_off_predicts_as_well_as_the_stated_one(
    name: str, folder: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    real(folder, monkeypatch)
    case = read_case(ROOT / "examples" / "cases" / f"{name}.yaml")
    data = read_data(case)
    model = replace(case.model, friction=tuple(part for part in case.friction if "torque" not in part.needs))
    stated = replace(case.preprocessing, delay_s=0.0)
    chosen = replace(stated, filter=Butterworth(None), rate_hz=None, rows_per_period=ROWS_PER_PERIOD)
    tests = [preprocess(log.ordered(case.robot.joint_names), stated) for log in data.test]
    errors = []
    for how in (stated, chosen):
        problem = build_problem(model, data.train, how)
        found = validate_prepared(problem.model, problem.base, tests, WLS().solve(problem).beta)
        errors.append(found.total_relative_error)
    assert errors[1] < 1.1 * errors[0]
